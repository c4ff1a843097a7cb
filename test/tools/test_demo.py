"""`make demo`, with scripts shorter than the shipped one, and `make view`, as a user starts them."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest

from tools.demo import ros_environment
from vibro_ros.bag.reader import read_bag

PATIENCE = 120.0  # [s] deadline of what takes some seconds on an idle machine
CRAWL = "entries: [{for: 2.0, motor_speed: 100.0, upper_gap: 0.0, inclined_gap: 0.0}]\n"


class Tool:
    """A running tool that starts a robot, and what it has said."""

    def __init__(self, folder: Path, *words: str):
        self._said = folder / "said.txt"
        self.process = subprocess.Popen([sys.executable, "-m", *words], cwd=folder, stdout=self._said.open("w"),
                                        stderr=subprocess.STDOUT, start_new_session=True)

    @property
    def text(self) -> str:
        return self._said.read_text()

    def wait_for(self, words: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while words not in self.text:
            assert self.process.poll() is None, f"ended without {words!r}:\n{self.text}"
            assert time.monotonic() < deadline, f"no {words!r} within {PATIENCE} s:\n{self.text}"
            time.sleep(0.05)

    def end(self) -> int:
        try:
            return self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired as error:
            raise AssertionError(f"still running after {PATIENCE} s:\n{self.text}") from error

    def children(self) -> dict[str, int]:
        """Process id by name of the executables that run below it."""
        pids = [int(pid) for listing in Path(f"/proc/{self.process.pid}/task").glob("*/children")
                for pid in listing.read_text().split()]
        words = {pid: Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0") for pid in pids}
        return {word.rpartition(".")[2]: pid for pid, one in words.items() for word in one
                if word.startswith("vibro_ros.ros.")}


def discovery_range(pid: int) -> str:
    """What a running process was told of how far to look for peers."""
    words = Path(f"/proc/{pid}/environ").read_bytes().decode().split("\0")
    return dict(word.partition("=")[::2] for word in words)["ROS_AUTOMATIC_DISCOVERY_RANGE"]


@pytest.fixture
def tool(domain_id: int, tmp_path: Path) -> Iterator[Callable[..., Tool]]:
    started: list[Tool] = []

    def start(*words: str) -> Tool:
        started.append(Tool(tmp_path, *words))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            one.process.terminate()  # it ends its own children
            one.process.wait(PATIENCE)


@pytest.fixture
def demo(tool: Callable[..., Tool], tmp_path: Path) -> Callable[[str], Tool]:
    def start(script: str) -> Tool:
        (tmp_path / "script.yaml").write_text(script)
        return tool("tools.demo", "--script", "script.yaml", "--output", "out")

    return start


def ends_leaving_nothing(demo: Tool) -> int:
    children = demo.children()
    assert set(children) == {"robot", "controller"}
    code = demo.end()
    assert not [pid for pid in children.values() if Path(f"/proc/{pid}").exists()]
    return code


def test_it_moves_the_robot_and_reports(demo, tmp_path, domain_id, monkeypatch):
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    shown = demo(CRAWL)
    shown.wait_for("entry 1, 2 s: motor_speed 100 rad/s")
    assert {discovery_range(pid) for pid in shown.children().values()} == {"LOCALHOST"}  # although a domain is chosen
    assert ends_leaving_nothing(shown) == 0, shown.text
    assert f"ROS_DOMAIN_ID={domain_id}" in shown.text
    paths = {label: tmp_path / line.split(" | ")[1] for line in shown.text.splitlines()
             for label in ("bag", "summary", "picture", "page") if line.startswith(f"{label:>10} | ")}
    assert abs(read_bag(paths["bag"])["odom"]["position"][-1, 0]) > 0.01  # [m]
    assert "mean speed" in paths["summary"].read_text()
    assert paths["picture"].read_bytes().startswith(b"\x89PNG")
    assert paths["page"].read_text().startswith("<!doctype html>")


def test_a_robot_that_stands_still_is_a_failure(demo):
    shown = demo("entries: [{for: 0.5, motor_speed: 0.0}]\n")
    assert shown.end() == 1
    assert shown.text.splitlines()[-1].startswith("demo: the robot did not move: 0.000 mm from its start")


def test_a_robot_that_dies_is_a_failure(demo):
    shown = demo("entries: [{for: 1000.0, motor_speed: 100.0}]\n")
    shown.wait_for("entry 1")
    os.kill(shown.children()["robot"], signal.SIGKILL)
    assert shown.end() == 1
    assert "demo: the robot ended before the script, with exit code -9" in shown.text
    assert "Traceback" not in shown.text


def test_stopping_it_stops_everything_and_seals_the_bag(demo, tmp_path):
    shown = demo("entries: [{for: 1000.0, motor_speed: 100.0}]\n")
    shown.wait_for("entry 1")
    shown.process.send_signal(signal.SIGTERM)
    assert ends_leaving_nothing(shown) == 130
    assert shown.text.splitlines()[-1] == "demo: stopped"
    (folder,) = (tmp_path / "out").iterdir()
    assert len(read_bag(folder)["odom"]["time"])


@pytest.mark.parametrize("chosen, used", [
    ({}, "LOCALHOST"), ({"ROS_DOMAIN_ID": "7"}, "LOCALHOST"), ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, "SUBNET")])
def test_the_user_decides_who_may_meet_whom(monkeypatch, chosen, used):
    for name in ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_DOMAIN_ID"):
        monkeypatch.delenv(name, raising=False)
    for name, value in chosen.items():
        monkeypatch.setenv(name, value)
    environment = ros_environment()
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == used
    assert environment["ROS_DOMAIN_ID"] == chosen.get("ROS_DOMAIN_ID", environment["ROS_DOMAIN_ID"])
    assert 1 <= int(environment["ROS_DOMAIN_ID"]) <= 101


def test_the_page_is_there_and_one_interrupt_ends_all(tool, tmp_path, domain_id):
    """Ctrl-C in a terminal goes to all three processes at once."""
    one = tool("tools.look", "--port", "0")
    one.wait_for("ready: 200 Hz")
    one.wait_for("view: http://")
    with urlopen(re.search(r"http://\S+", one.text)[0], timeout=PATIENCE) as page:
        assert b"/vibro_robot" in page.read()
    assert f"look | ROS domain {domain_id};" in one.text  # that of README's next commands
    children = one.children()
    assert set(children) == {"view", "robot"}
    os.killpg(one.process.pid, signal.SIGINT)
    assert one.end() == 0, one.text
    assert not any(Path(f"/proc/{pid}").exists() for pid in children.values())
    assert list((tmp_path / "out").iterdir()) == []  # nothing is recorded unless somebody asks


def test_when_one_of_them_is_killed_the_other_ends(tool):
    one = tool("tools.look", "--port", "0")
    one.wait_for("view: http://")
    children = one.children()
    os.kill(children["robot"], signal.SIGKILL)
    assert one.end() == 1
    assert "look: robot has ended with exit code -9; it says why above" in one.text
    assert not any(Path(f"/proc/{pid}").exists() for pid in children.values())
