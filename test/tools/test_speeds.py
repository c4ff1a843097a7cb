"""The page on speeds: every motion of every robot has a row, and no row is a mean over motions."""

import re

import pytest

from tools import speeds
from vibro_ros.configuration.scene_file import load_scene

PAGE = speeds.PAGE.read_text(encoding="utf-8")


def test_every_robot_and_every_optimum_has_its_motions_on_the_page():
    """A new scene or optimum gets its rows by `make documents`."""
    rows = re.findall(r"^\| (\S+), [\d.]+ rad/s \|", PAGE, re.MULTILINE)
    assert set(rows) == set(speeds.robots())
    costed = set(re.findall(r"^\| `(\w+)` \| (?:ideal|of `machine`) \|", PAGE, re.MULTILINE))
    assert costed == {"device", *speeds.ADVISED}


@pytest.mark.parametrize("name", ["damped", "device", "rigid"])
def test_the_motions_on_the_page_are_still_the_robots(name):
    """`device` has a motion to which its own start leads, but no random start."""
    rows = speeds.motion_rows(f"`{name}`", speeds.robots()[f"`{name}`"])
    assert [row for row in PAGE.splitlines() if row.startswith(f"| `{name}`, ")] == rows
    shares = [int(starts) for starts in re.findall(r"\| (\d+) of 64", "\n".join(rows))]
    assert sum(shares) == speeds.STARTS and (name != "device" or shares[-1] == 0)


def test_a_robot_with_the_motor_of_machine_is_the_same_robot():
    device = load_scene("device")
    moved = speeds.with_machines_motor(device)
    changed = {name for name in moved.parameters if moved[name] != device[name]}
    assert moved.has_rotor and "motor.crank_inertia" in changed
    assert all(name == "effects.motor" or name.startswith("motor.") for name in changed)
    assert moved["motor.speed"] == device["motor.speed"]
