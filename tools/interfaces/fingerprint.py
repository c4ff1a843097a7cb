"""From what the types were made, as one word."""

import hashlib
import platform
from collections.abc import Iterable
from importlib.metadata import distributions
from pathlib import Path

from tools.interfaces.definitions import InterfacePackage

_MAKERS = ("ros-", "empy", "numpy")  # distributions whose templates, headers and libraries are used


def fingerprint(packages: Iterable[InterfacePackage]) -> str:
    """A hash of the definitions, of this builder, of Python and of the distributions that take part."""
    makers = sorted({f"{name}=={found.version}" for found in distributions()
                     if (name := found.name.replace("_", "-").lower()).startswith(_MAKERS)})
    builder = [file.read_text(encoding="utf-8") for file in sorted(Path(__file__).parent.glob("*.py"))]
    parts = [platform.python_version(), platform.machine(), *makers, *builder, *map(repr, packages)]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()
