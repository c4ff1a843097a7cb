"""`make setup` builds types where it can, once, and says in one line why it cannot."""

import os
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tools.interfaces.command import STAMP, main
from tools.interfaces.definitions import interface_packages
from tools.interfaces.fingerprint import fingerprint

MODULE = "tools.interfaces.command"
PATIENCE = 60.0  # [s] deadline of what takes a second on an idle machine
WITHOUT = "; the robot runs without them"
BUILDING = "setup: building the Python types of tf2_msgs and simulation_interfaces (a quarter of a minute)"

Start = Callable[..., subprocess.Popen]


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """An environment with nothing in it."""
    folder = tmp_path / "environment"
    for part in ("lib", "share", sysconfig.get_path("platlib", vars={"platbase": str(folder)})):
        (folder / part).mkdir(parents=True, exist_ok=True)
    return folder


@pytest.fixture
def start(prefix: Path) -> Iterator[Start]:
    """Start the command in an environment of variables; killed at the end with all that it started."""
    started: list[subprocess.Popen] = []

    def start_one(**variables: str) -> subprocess.Popen:
        environment = {name: value for name, value in os.environ.items() if name != "CC"} | variables
        started.append(subprocess.Popen([sys.executable, "-m", MODULE, "--prefix", str(prefix)], env=environment,
                                        text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                        start_new_session=True))
        return started[-1]

    yield start_one
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def files(prefix: Path) -> list[Path]:
    return [file for file in prefix.rglob("*") if file.is_file()]


@pytest.fixture
def endless(tmp_path: Path) -> str:
    """A compiler that never ends."""
    program = tmp_path / "endless"
    program.write_text("#!/bin/sh\nexec sleep 600\n")
    program.chmod(0o755)
    return str(program)


@pytest.mark.parametrize(("variables", "reason"), [
    ({"PATH": "/nowhere"}, "no C compiler (cc, gcc, clang); install gcc"),
    ({"CC": "'"}, "CC=': No closing quotation"),
])
def test_without_a_compiler_one_line_says_so(start, prefix, variables, reason):
    process = start(**variables)
    said, _ = process.communicate(timeout=PATIENCE)
    assert said == f"setup: types of tf2_msgs and simulation_interfaces not built: {reason}{WITHOUT}\n"
    assert process.returncode == 0
    assert not files(prefix)


@pytest.mark.parametrize(("compiler", "complaint"), [
    ("false", "false failed with exit code 1: it says nothing"),
    ("/nowhere/cc", "/nowhere/cc: No such file or directory"),
    ("gcc --no-such-option", "gcc failed with exit code 1: gcc: error: unrecognized command-line option"),
])
def test_a_compiler_that_fails_is_one_line_and_leaves_nothing(start, prefix, compiler, complaint):
    process = start(CC=compiler)
    said, _ = process.communicate(timeout=PATIENCE)
    building, line = said.splitlines()
    assert building == BUILDING
    assert line.startswith(f"setup: types of tf2_msgs and simulation_interfaces not built: {complaint}")
    assert line.endswith(WITHOUT)
    assert process.returncode == 0
    assert not files(prefix)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_build_leaves_nothing(start, prefix, endless, number):
    process = start(CC=endless)
    assert process.stdout.readline().rstrip() == BUILDING
    os.killpg(process.pid, number)  # as a terminal does
    said, _ = process.communicate(timeout=PATIENCE)
    assert said == "interface_types: stopped\n"
    assert process.returncode == 128 + number
    assert not files(prefix)


def test_a_killed_build_leaves_nothing_to_import_and_the_next_one_clears_up(start, prefix, endless):
    process = start(CC=endless)
    assert process.stdout.readline().rstrip() == BUILDING
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate(timeout=PATIENCE)
    assert {file.relative_to(prefix).parts[0] for file in files(prefix)} <= {"interface_types.part"}
    start(CC="false").communicate(timeout=PATIENCE)
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


def test_a_prefix_that_is_no_folder_is_an_error(tmp_path, capfd):
    assert main(["--prefix", str(tmp_path / "nowhere")]) == 1
    assert capfd.readouterr().err == f"setup: {tmp_path / 'nowhere'}: No such file or directory\n"
