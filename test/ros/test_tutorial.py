"""docs/guide/begin.md as a student follows it: every file, every command, and the output that the page shows."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from observation import stop

from vibro_ros.process.executables import EXECUTABLES

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "guide" / "begin.md").read_text(encoding="utf-8")
FILES = {name: content for name, content in re.findall(
    r"[Ss]ave\s+this as `([\w.]+)`[^`]*```\w+\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)}
SESSIONS = dict(re.findall(r"^```shell-session\n\$ (.*?)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL))
FOLDER = r"vibro_robot_\d{4}(?:_\d\d){2}-\d\d_\d\d_\d\d"
NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]\d+)?"


def check(shown: str, said: str, live: bool) -> None:
    """Compare output with the page, where `…` matches anything; numbers of a live run, and spaces, may differ."""
    shown, said = (re.sub(" +", " ", text) for text in (shown, said))
    pattern = re.sub(FOLDER, "FOLDER", shown.strip())
    pattern = re.escape(pattern).replace("FOLDER", FOLDER).replace("…", ".*?").replace("\\\n", "\n")
    if live:
        pattern = re.sub(r"(?<![\\\w{])(?:\\[-+])?\d+(?:\\\.\d+)?(?:e\\[-+]\d+)?", lambda _: NUMBER, pattern)
    assert re.fullmatch(pattern, said.strip(), re.DOTALL), f"shown:\n{shown}\nsaid:\n{said}"


def numbers_after(word: str, said: str) -> list[float]:
    return [float(number) for number in re.findall(rf"{re.escape(word)}\s*({NUMBER})", said)]


@pytest.fixture
def run(tmp_path):
    """Run one of the page's commands and return its output."""
    def run_one(command: str) -> str:
        program, *arguments = command.replace('"', "").split()
        name = Path(program).name
        words = arguments if name == "python" else ["-m", EXECUTABLES[name].module, *arguments]
        done = subprocess.run([sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0 and "Traceback" not in done.stderr, done.stdout + done.stderr
        return done.stdout + done.stderr
    return run_one


def test_the_tutorial_shows_the_real_output(start, run, tmp_path):
    sessions = dict(SESSIONS)
    assert sessions.pop("make demo") == ""  # which test_demo.py runs
    commands = list(sessions)
    robot_command, controller_command, look, replay, vary, sweep, standstill = commands
    robot = start("robot", *robot_command.split()[1:])
    ready = robot.lines.index(robot.wait_for("ready:"))
    check(sessions[robot_command], "\n".join(robot.lines[:ready + 1]), live=False)
    (tmp_path / "speeds.yaml").write_text(FILES["speeds.yaml"])
    check(sessions[controller_command], run(controller_command), live=False)
    stop(robot)
    [sealed] = re.findall(r"ends:\n\n```text\n(.*?)```", TEXT, re.DOTALL)
    check(sealed, robot.lines[-1], live=True)

    [bag] = (tmp_path / "out").iterdir()
    assert {*FILES} == {"speeds.yaml", "look.py", "sweep.py", "standstill.py"}
    for name, content in FILES.items():
        (tmp_path / name).write_text(re.sub(FOLDER, bag.name, content))
    said = run(look)
    check(sessions[look], said, live=True)
    speeds, powers = numbers_after("rad/s:", said), numbers_after("second,", said)
    assert speeds[0] < speeds[1] < 0.0 < powers[0] < powers[1]  # the faster motor makes it slower for more power
    check(sessions[replay], run(re.sub(FOLDER, bag.name, replay)), live=True)
    said = run(re.sub(FOLDER, bag.name, vary))
    check(sessions[vary], said, live=True)
    recorded, varied = numbers_after("displacement [m]", said)[0], float(said.split("displacement [m]")[1].split()[1])
    assert recorded < -0.3 and abs(varied) < 0.01  # m: on ice it ends where it began, but for what still swings


@pytest.mark.parametrize("name", ["sweep.py", "standstill.py"])
def test_simulations_of_the_page_print_what_is_shown(run, tmp_path, name):
    (tmp_path / name).write_text(FILES[name])
    check(SESSIONS[f".venv/bin/python {name}"], run(f"python {name}"), live=False)
