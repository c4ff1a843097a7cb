"""The numbers of the page on the motor."""

import re
from pathlib import Path

import pytest

from tools.motor_page import INERTIAS, JUMP, STARTS, VOLTAGES, sommerfeld_speeds
from vibro_ros.configuration.scene_file import load_scene


@pytest.mark.process
def test_the_speed_jumps_where_it_was_measured():
    """A70. Measured with another program: up between 46 and 48 V, to 275 rad/s, down between 36 and 34 V."""
    for speeds, below in zip(sommerfeld_speeds(), (46, 34), strict=True):
        jumps = [VOLTAGES[k] for k in range(len(speeds) - 1) if speeds[k + 1] - speeds[k] > JUMP]
        assert jumps == [below]
    assert sommerfeld_speeds()[0][VOLTAGES.index(48)] == pytest.approx(275.0, abs=2.0)


def test_the_page_says_of_its_table_what_the_table_says():
    """The page names the flywheels with which all starts, or most, have the ideal motor's speed to a tenth; the table
    agrees.
    """
    page = (Path(__file__).resolve().parents[3] / "docs/guide/motor.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([\d.e-]+)\S*.* \| (-[\d.]+) mm/s, .*\((\d+) of 16\) \| .* \| ([\d.]+) A \|",
                      page, re.MULTILINE)
    ideal = float(re.search(r"motor `ramp` \| (-[\d.]+) mm/s", page)[1])
    near_ideal = {flywheel: [abs(float(speed) / ideal - 1.0) < 0.1
                             for inertia, speed, *_ in rows if float(inertia) == flywheel] for flywheel in INERTIAS}
    assert [flywheel for flywheel, motions in near_ideal.items() if all(motions)] == [5e-3]
    assert [flywheel for flywheel, motions in near_ideal.items() if motions[0]] == [1e-3, 5e-3]
    machine = load_scene("machine")
    currents = [float(current) for inertia, _, _, current in rows if float(inertia) == machine["motor.crank_inertia"]]
    assert max(currents) < machine["motor.continuous_current"]
    assert all(sum(int(starts) for inertia, _, starts, _ in rows if float(inertia) == flywheel) == STARTS
               for flywheel in INERTIAS)
