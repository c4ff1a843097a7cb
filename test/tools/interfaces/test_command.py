"""`make setup` says in one line why it cannot build types, and goes on."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tools.interfaces.command import LOG, PACKAGES, STAMP

PATIENCE = 60.0  # [s] deadline of what takes some seconds on an idle machine
WITHOUT = "; the robot runs without them"
NAMES = " and ".join(PACKAGES)


def run(prefix: Path, **variables: str) -> list[str]:
    """Return the lines that the command prints in an environment of variables; it must not fail."""
    environment = {name: value for name, value in os.environ.items() if name not in ("CC", "CXX")} | variables
    done = subprocess.run([sys.executable, "-m", "tools.interfaces.command", "--prefix", str(prefix)], env=environment,
                          text=True, capture_output=True, timeout=PATIENCE)
    assert (done.returncode, done.stderr) == (0, "")
    assert not (prefix / STAMP).exists() and not [*prefix.rglob("site-packages")]
    return done.stdout.splitlines()


def test_without_a_compiler_the_error_is_one_line(tmp_path):
    assert run(tmp_path, PATH="/nowhere") == [
        f"setup: types of {NAMES} not built: no C++ compiler (c++, g++, clang++); install g++{WITHOUT}"]
    assert not [*tmp_path.iterdir()]


@pytest.mark.process
def test_a_compiler_that_fails_is_one_line_and_a_log(tmp_path):
    building, line = run(tmp_path, CXX="false")
    assert building.startswith(f"setup: building the Python types of {NAMES}")
    assert line.startswith(f"setup: types of {NAMES} not built: CMake Error") and line.endswith(WITHOUT)
    assert "false" in (tmp_path / LOG).read_text()
