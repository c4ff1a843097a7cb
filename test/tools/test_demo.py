"""`make demo`, with scripts shorter than the shipped one, and `make view`, as a user starts them."""

import os
import re
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from urllib.request import urlopen

import pytest
from real_processes import Executable, start  # noqa: F401 (fixtures)

from tools.demo import ros_environment
from vibro_ros.bag.reader import read_bag

PATIENCE = 120.0  # [s] deadline of what takes some seconds on an idle machine
CRAWL = "entries: [{for: 2.0, motor_speed: 100.0, upper_gap: 0.0, inclined_gap: 0.0}]\n"


def children(program: Executable) -> dict[str, int]:
    """Return the process ids by name of the executables that run below a tool."""
    pids = [int(pid) for listing in Path(f"/proc/{program.pid}/task").glob("*/children")
            for pid in listing.read_text().split()]
    words = {pid: Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0") for pid in pids}
    return {word.rpartition(".")[2]: pid for pid, command in words.items() for word in command
            if word.startswith("vibro_ros.ros.")}


def discovery_range(pid: int) -> str:
    """Return the discovery range in the environment of a running process."""
    words = Path(f"/proc/{pid}/environ").read_bytes().decode().split("\0")
    return dict(word.partition("=")[::2] for word in words)["ROS_AUTOMATIC_DISCOVERY_RANGE"]


@pytest.fixture
def tool(start) -> Callable[..., Executable]:  # noqa: F811
    """Fixture: a function that starts a tool in a session of its own."""
    return partial(start, "-m", wrapper=("setsid",))


@pytest.fixture
def demo(tool, tmp_path: Path) -> Callable[[str], Executable]:
    def started(script: str) -> Executable:
        (tmp_path / "script.yaml").write_text(script)
        return tool("tools.demo", "--script", "script.yaml", "--output", "out")

    return started


def ends_leaving_nothing(demo: Executable) -> int:
    below = children(demo)
    assert set(below) == {"robot", "controller"}
    code = demo.end(PATIENCE)
    assert not [pid for pid in below.values() if Path(f"/proc/{pid}").exists()]
    return code


def test_the_demo_moves_its_own_robot_and_reports(demo, start, tmp_path, domain_id, monkeypatch):  # noqa: F811
    """Another robot runs in the same domain, such as that of `make view`, and receives none of the demonstration's
    commands.
    """
    other = start("robot", "--ros-args", "-p", "record.directory:=other")
    other.wait_for("ready")
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    shown = demo(CRAWL)
    shown.wait_for("entry 1, 2 s: motor_speed 100 rad/s")
    assert {discovery_range(pid) for pid in children(shown).values()} == {"LOCALHOST"}  # although a domain is chosen
    assert ends_leaving_nothing(shown) == 0, shown.text
    assert f"ROS_DOMAIN_ID={domain_id}, for example: view --robot /demo_" in shown.text
    other.send(signal.SIGINT)
    assert other.end(PATIENCE) == 0
    (bag,) = (tmp_path / "other").iterdir()
    assert not len(read_bag(bag)["motor_speed"]["time"])
    paths = {label: tmp_path / line.split(" | ")[1] for line in shown.text.splitlines()
             for label in ("bag", "summary", "picture", "page") if line.startswith(f"{label:>10} | ")}
    assert abs(read_bag(paths["bag"])["odom"]["position"][-1, 0]) > 0.01  # [m]
    assert "mean speed" in paths["summary"].read_text()
    assert paths["picture"].read_bytes().startswith(b"\x89PNG")
    assert paths["page"].read_text().startswith("<!doctype html>")


def test_a_robot_that_stands_still_is_a_failure(demo):
    shown = demo("entries: [{for: 0.5, motor_speed: 0.0}]\n")
    assert shown.end(PATIENCE) == 1
    assert shown.text.splitlines()[-1].startswith("make demo: the robot did not move: 0.000 mm from its start")


def test_a_robot_that_dies_is_a_failure(demo):
    shown = demo("entries: [{for: 1000.0, motor_speed: 100.0}]\n")
    shown.wait_for("entry 1")
    os.kill(children(shown)["robot"], signal.SIGKILL)
    assert shown.end(PATIENCE) == 1
    assert "make demo: the robot ended before the script, with exit code -9" in shown.text
    assert "Traceback" not in shown.text


def test_stopping_the_demo_stops_everything_and_seals_the_bag(demo, tmp_path):
    shown = demo("entries: [{for: 1000.0, motor_speed: 100.0}]\n")
    shown.wait_for("entry 1")
    shown.send(signal.SIGTERM)
    assert ends_leaving_nothing(shown) == 130
    assert shown.text.splitlines()[-1] == "make demo: stopped"
    (folder,) = (tmp_path / "out").iterdir()
    assert len(read_bag(folder)["odom"]["time"])


@pytest.mark.parametrize("chosen, used", [
    ({}, "LOCALHOST"), ({"ROS_DOMAIN_ID": "7"}, "LOCALHOST"), ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, "SUBNET")])
def test_the_users_domain_and_discovery_range_are_kept(monkeypatch, chosen, used):
    for name in ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_DOMAIN_ID"):
        monkeypatch.delenv(name, raising=False)
    for name, value in chosen.items():
        monkeypatch.setenv(name, value)
    environment = ros_environment()
    assert environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] == used
    assert environment["ROS_DOMAIN_ID"] == chosen.get("ROS_DOMAIN_ID", environment["ROS_DOMAIN_ID"])
    assert 1 <= int(environment["ROS_DOMAIN_ID"]) <= 101


def test_make_view_serves_the_page_and_an_interrupt_ends_all(tool, tmp_path, domain_id):
    """Ctrl-C in a terminal goes to all three processes at once."""
    demo = tool("tools.demo", "look", "--port", "0")
    demo.wait_for("ready: 200 Hz")
    demo.wait_for("view: http://")
    with urlopen(re.search(r"http://\S+", demo.text)[0], timeout=PATIENCE) as page:
        assert b"/vibro_robot" in page.read()
    assert f"look | ROS domain {domain_id}, robot /vibro_robot;" in demo.text  # that of README's next commands
    below = children(demo)
    assert set(below) == {"view", "robot"}
    os.killpg(demo.pid, signal.SIGINT)
    assert demo.end(PATIENCE) == 0, demo.text
    assert not any(Path(f"/proc/{pid}").exists() for pid in below.values())
    assert list((tmp_path / "out").iterdir()) == []  # nothing is recorded unless somebody asks


def test_the_view_ends_when_the_robot_is_killed(tool):
    demo = tool("tools.demo", "look", "--port", "0")
    demo.wait_for("view: http://")
    below = children(demo)
    os.kill(below["robot"], signal.SIGKILL)
    assert demo.end(PATIENCE) == 1
    assert "make view: robot has ended with exit code -9; it says why above" in demo.text
    assert not any(Path(f"/proc/{pid}").exists() for pid in below.values())
