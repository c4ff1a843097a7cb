"""The page on the motor."""

import re
from pathlib import Path

import pytest

from tools.motor_page import INERTIAS, JUMP, VOLTAGES, sommerfeld_speeds
from vibro_ros.configuration.scene_file import load_scene


@pytest.mark.process
def test_the_speed_jumps_where_it_was_measured():
    """A70. By another program: up between 46 and 48 V, to 275 rad/s, down between 36 and 34 V."""
    for speeds, below in zip(sommerfeld_speeds(), (46, 34), strict=True):
        jumps = [VOLTAGES[k] for k in range(len(speeds) - 1) if speeds[k + 1] - speeds[k] > JUMP]
        assert jumps == [below]
    assert sommerfeld_speeds()[0][VOLTAGES.index(48)] == pytest.approx(275.0, abs=2.0)


def test_the_page_says_of_its_table_what_the_table_says():
    page = (Path(__file__).resolve().parents[2] / "docs/guide/motor.md").read_text(encoding="utf-8")
    found = re.findall(r"^\| [\d.e-]+ .* mm/s .*$", page, re.MULTILINE)
    rows = {float(row.split()[1]): row.split(" | ") for row in found}
    ideal = float(re.search(r"motor `ramp` .* ([+-]\d+) mm/s", page)[1])
    near = {flywheel for flywheel, row in rows.items() if abs(float(row[3].split()[0]) / ideal - 1.0) < 0.1}
    assert len(rows) == len(INERTIAS) and near == {flywheel for flywheel in rows if flywheel >= 1e-3}
    machine = load_scene("machine")
    assert float(rows[machine["motor.crank_inertia"]][2].split()[0]) < machine["motor.continuous_current"]
