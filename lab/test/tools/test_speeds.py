"""The page on speeds has a row for every motion of every robot."""

import re

import pytest

from tools import speeds
from vibro_ros.configuration.scene_file import load_scene

PAGE = speeds.PAGE.read_text(encoding="utf-8")


def test_every_robot_and_every_optimum_has_its_motions_on_the_page():
    """A new scene or optimum gets its rows by `make documents`."""
    rows = re.findall(r"^\| (\S+), [\d.]+ rad/s \| (near `)?", PAGE, re.MULTILINE)
    assert set(rows) == {(name, "near `" * speeds.keeps_energy(scene)) for name, scene in speeds.robots().items()}
    costed = set(re.findall(r"^\| `(\w+)` \| (?:ideal|of `machine`) \|", PAGE, re.MULTILINE))
    assert costed == {"device", *speeds.ADVISED}


@pytest.mark.parametrize("name", ["damped", "device", "rigid"])
def test_the_motions_on_the_page_are_still_the_robots(name):
    """`device` has a motion to which its own start leads, but no random start."""
    rows = speeds.motion_rows(f"`{name}`", speeds.robots()[f"`{name}`"])
    assert [row for row in PAGE.splitlines() if row.startswith(f"| `{name}`, ")] == rows
    shares = [int(starts) for starts in re.findall(r"\| (\d+) of 64", "\n".join(rows))]
    assert sum(shares) == speeds.STARTS and (name != "device" or shares[-1] == 0)


def test_a_robot_that_keeps_its_energy_has_the_range_of_its_starts_and_no_mean(monkeypatch):
    """Few starts lie within the range of all 64 on the page, and both sets of starts are named. `paper` is three times
    as fast near `zero` as near `rest`: it does not forget its start.
    """
    monkeypatch.setattr(speeds, "STARTS", 4)
    rows = {about: next(row for row in PAGE.splitlines() if row.startswith(f"| `paper`, 100 rad/s | near `{about}` |"))
            for about in speeds.ABOUT}
    for row in speeds.distribution_rows("`paper`", speeds.robots()["`paper`"]):
        about = re.search(r"near `(\w+)`", row)[1]
        few, all_starts = ([float(cell.strip(" |")) for cell in text.split(" | ")[2:]]
                           for text in (row, rows[about]))
        assert all_starts[0] <= few[0] <= few[-1] <= all_starts[-1]
    speed = {about: float(row.split(" | ")[4]) for about, row in rows.items()}
    assert speed["zero"] < 1.5 * speed["rest"] < 0.0
    assert not any(speeds.keeps_energy(load_scene(name)) for name in ("device", "damped", "rigid", "machine"))


def test_a_robot_with_the_motor_of_machine_is_the_same_robot():
    device = load_scene("device")
    moved = speeds.with_machines_motor(device)
    changed = {name for name in moved.parameters if moved[name] != device[name]}
    assert moved.has_rotor and "motor.crank_inertia" in changed
    assert all(name == "effects.motor" or name.startswith("motor.") for name in changed)
    assert moved["motor.speed"] == device["motor.speed"]
