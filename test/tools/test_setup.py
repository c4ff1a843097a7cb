"""`make setup` replaces an environment only by one that is complete."""

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: No network, and no options of the make that runs the tests.
APART = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": "", "MAKEFLAGS": ""}


@pytest.fixture
def checkout(tmp_path) -> Path:
    """A folder with the Makefile, the locks, and an environment that another Python is said to have made."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    shutil.copytree(ROOT / "requirements", tmp_path / "requirements")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / ".venv"], check=True)
    (tmp_path / ".venv" / "packages.done").write_text("3.11.0\n")
    (tmp_path / ".venv" / "kept").touch()
    return tmp_path


def make(checkout: Path, python: str) -> subprocess.CompletedProcess:
    """Make the environment's packages with an interpreter that the user names, without a network."""
    return subprocess.run(["make", ".venv/packages.done", f"PYTHON={python}"], cwd=checkout, text=True,
                          env={**os.environ, **APART}, capture_output=True)


def says(checkout: Path) -> str:
    return subprocess.run([checkout / ".venv" / "bin" / "python", "-c", "print('works')"], check=True, text=True,
                          capture_output=True).stdout


def test_a_failed_set_up_leaves_the_old_environment_working(checkout):
    """The interpreter is missing or too old, or pip fails after the new environment has been made."""
    (checkout / "old").write_text("#!/bin/sh\n[ $1 = -V ] && exec echo Python 3.8.10\nexit 1\n")
    (checkout / "old").chmod(0o755)
    for python, reason in (("python3.99", "python3.99 is missing"), ("./old", "./old is Python 3.8.10, and"),
                           (sys.executable, "setup: .venv is as it was before")):
        done = make(checkout, python)
        assert done.returncode and reason in done.stderr, done.stderr
        assert (checkout / ".venv" / "kept").exists() and says(checkout) == "works\n"


def test_an_environment_is_replaced_only_by_a_working_one(checkout):
    """The new one has the sets that the old one had, so that tests and studies run on."""
    for lock in ("run.txt", "jazzy.txt", "jazzy-types.txt", "study.txt"):
        (checkout / "requirements" / lock).write_text("# nothing\n")
    (checkout / ".venv" / "study.done").touch()
    done = make(checkout, sys.executable)
    assert not done.returncode, done.stderr
    assert not (checkout / ".venv" / "kept").exists() and says(checkout) == "works\n"
    assert ", and those of study" in done.stdout and (checkout / ".venv" / "study.done").exists()
    assert not (checkout / ".venv" / "lint.done").exists()
    pip = subprocess.run([checkout / ".venv" / "bin" / "pip", "--version"], check=True, text=True, capture_output=True)
    assert str(checkout / ".venv") in pip.stdout
    assert [path.name for path in checkout.iterdir() if path.name.startswith(".venv")] == [".venv"]
    assert not [file for file in (checkout / ".venv" / "bin").iterdir() if b".venv-new" in file.read_bytes()]


def test_pins_of_tests_and_studies_leave_the_environment_of_the_robot_alone(checkout):
    for lock in (checkout / "requirements").glob("*.txt"):
        if lock.name not in ("run.txt", "jazzy.txt", "jazzy-types.txt"):
            lock.write_text("changed\n")
    (checkout / ".venv" / "packages.done").write_text(f"{platform.python_version()}\n")
    assert "up to date" in make(checkout, sys.executable).stdout
