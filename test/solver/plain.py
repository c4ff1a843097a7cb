"""Kernels as plain Python in a process that otherwise runs compiled ones."""

import importlib.util
from types import ModuleType
from unittest.mock import patch

from vibro_ros.solver import typed


def plain(module: ModuleType) -> ModuleType:
    """Return a copy of a module whose entries are their text, not compiled."""
    specification = module.__spec__
    assert specification is not None and specification.loader is not None
    copy = importlib.util.module_from_spec(specification)
    with patch.object(typed, "PLAIN", True):
        specification.loader.exec_module(copy)
    return copy
