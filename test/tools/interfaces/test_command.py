"""`make setup` builds types once where it can, and otherwise gives the reason in one line."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from tools.interfaces.command import STAMP, main
from tools.interfaces.definitions import fingerprint, interface_packages

MODULE = "tools.interfaces.command"
PATIENCE = 60.0  # [s] deadline of what takes a second on an idle machine
WITHOUT = "; the robot runs without them"
NAMES = "tf2_msgs, simulation_interfaces and vibro_ros_interfaces"
BUILDING = f"setup: building the Python types of {NAMES} (a quarter of a minute)"



@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """An empty environment."""
    folder = tmp_path / "environment"
    for part in ("lib", "share", sysconfig.get_path("platlib", vars={"platbase": str(folder)})):
        (folder / part).mkdir(parents=True, exist_ok=True)
    return folder


def run(prefix: Path, **variables: str) -> str:
    """Return the command's output with these environment variables; the command must not fail."""
    environment = {name: value for name, value in os.environ.items() if name != "CC"} | variables
    done = subprocess.run([sys.executable, "-m", MODULE, "--prefix", str(prefix)], env=environment, text=True,
                          capture_output=True, timeout=PATIENCE)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def files(prefix: Path) -> list[Path]:
    return [file for file in prefix.rglob("*") if file.is_file()]


@pytest.mark.parametrize(("variables", "reason"), [
    ({"PATH": "/nowhere"}, "no C compiler (cc, gcc, clang); install gcc"),
    ({"CC": "'"}, "CC=': No closing quotation"),
])
def test_without_a_compiler_one_line_says_so(prefix, variables, reason):
    assert run(prefix, **variables) == (
        f"setup: types of {NAMES} not built: {reason}{WITHOUT}\n")
    assert not files(prefix)


@pytest.mark.parametrize(("compiler", "complaint"), [
    ("false", "false failed with exit code 1: it says nothing"),
    ("gcc --no-such-option", "gcc failed with exit code 1: gcc: error: unrecognized command-line option"),
])
def test_a_compiler_that_fails_is_one_line_and_leaves_nothing(prefix, compiler, complaint):
    building, line = run(prefix, CC=compiler).splitlines()
    assert building == BUILDING
    assert line.startswith(f"setup: types of {NAMES} not built: {complaint}")
    assert line.endswith(WITHOUT)
    assert not files(prefix)


def test_nothing_is_built_twice(prefix, monkeypatch, capfd):
    monkeypatch.setenv("CC", "false")
    (prefix / STAMP).write_text(fingerprint(interface_packages()))
    os.utime(prefix / STAMP, (0, 0))
    assert main(["--prefix", str(prefix)]) == 0
    assert not any(capfd.readouterr())
    assert (prefix / STAMP).stat().st_mtime > 0  # or make would ask again
    (prefix / STAMP).write_text("of other definitions")
    assert main(["--prefix", str(prefix)]) == 0
    assert capfd.readouterr().out.startswith(BUILDING)
    assert not files(prefix)
