"""The page on speeds has a row for every motion of every robot, and no page has a mean over several motions."""

import re
from collections import defaultdict

import pytest

from tools import speeds
from vibro_ros.configuration.scene_file import load_scene

PAGE = speeds.PAGE.read_text(encoding="utf-8")
PAGES = {str(path.relative_to(speeds.ROOT)): path.read_text(encoding="utf-8")
         for path in (speeds.ROOT / "README.md", *sorted((speeds.ROOT / "docs").rglob("*.md")))}
#: Speed [mm/s] of a motion and the starts that lead to it, in a row of the page on speeds or in a list of motions.
MOTION = re.compile(r"(-?[\d.]+)(?: ± [\d.]+)? mm/s, (?:again|without)[^|;(]*[|(] ?(\d+) of \d+")


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


def means_over_motions():
    """Mean speeds [mm/s] over the motions of each robot that has several: plain, and by the numbers of their starts."""
    of_robot = defaultdict(list)
    for line in PAGE.splitlines():
        if (row := re.match(r"^\| (\S+, [\d.]+ rad/s) \|", line)) and (one := MOTION.search(line)):
            of_robot[row[1]].append((float(one[1]), int(one[2])))
    for line in PAGES["docs/literature.md"].splitlines():
        if found := re.match(r"^- (-?\d+ mm, \d+ rad/s):", line):
            of_robot[found[1]] += [(float(one[1]), int(one[2])) for one in MOTION.finditer(line)]
    several = {robot: found for robot, found in of_robot.items() if len(found) > 1}
    return {robot: (sum(speed for speed, _ in found) / len(found),
                    sum(speed * starts for speed, starts in found) / sum(starts for _, starts in found))
            for robot, found in several.items()}


@pytest.mark.parametrize("page", PAGES)
def test_no_page_has_a_mean_over_motions(page):
    """The means that could be mistaken for a speed, to four digits or more, forwards or towards a plate."""
    means = means_over_motions()
    assert {"`device`, 100 rad/s", "`machine`, 100 rad/s", "`optimum/fastest`, 199.7 rad/s",
            "56 mm, 100 rad/s"} <= set(means)
    told = {float(text.replace("−", "-")) for text in re.findall(r"(?<![\d.])[-−]?\d+\.?\d*(?=[^|\n]{0,24}mm/s)",
                                                               PAGES[page]) if len(re.sub(r"\D", "", text)) > 3}
    for robot, both in means.items():
        for mean in both:
            close = {one for one in told if abs(mean) > 1.0 and abs(abs(one) - abs(mean)) < 1e-4 * abs(mean)}
            assert not close, f"{page}: {close} is a mean over the motions of {robot}"


@pytest.mark.parametrize("page", [page for page in PAGES if not page.startswith("docs/accuracy")])
def test_an_interval_of_a_speed_is_of_one_motion_without_a_period(page):
    """A periodic motion has one speed, and starts that have not settled have a range. In the pages of accuracy the
    intervals are of rows that `averages` has grouped by motion.
    """
    intervals = re.findall(r"± [\d.e+-]+ mm/s[^;|]{0,20}", PAGES[page])
    assert [text for text in intervals if "mm/s, without a period" not in text] == []
