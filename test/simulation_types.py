"""The types of simulation_interfaces, which `make setup` does not build, for the tests that need them."""

import fcntl
import importlib
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tools.interfaces.command import FOLDERS, BuildError, build, require_compiler

PACKAGE = "simulation_interfaces"
STAMP = Path(sys.prefix) / f"{PACKAGE}.done"


def require_types() -> None:
    """Build the types into the environment, as a user installs the package, unless they are there.

    The tests of the calling module are left out where there is no compiler, and a minute is taken at the first call.
    """
    try:
        require_compiler()
    except BuildError as error:
        pytest.skip(str(error), allow_module_level=True)
    with open(f"{STAMP}.lock", "w") as lock:  # of the processes of a test run, one builds
        fcntl.flock(lock, fcntl.LOCK_EX)
        sources = [file.stat().st_mtime for folder in FOLDERS for file in folder.glob(f"{PACKAGE}/**/*")]
        if find_spec(PACKAGE) is None or STAMP.exists() and STAMP.stat().st_mtime < max(sources):
            build(Path(sys.prefix), [PACKAGE])
            STAMP.touch()
    importlib.invalidate_caches()
