"""The measurement of what recording costs: a real robot that is told when to record, and how the result is shown."""

import signal

import pytest

from tools.lateness import table


@pytest.mark.quiet
def test_recording_is_switched_on_and_off_and_both_are_told(start, domain_id, tmp_path):
    measurement = start("lateness", "--rounds", "1", "--length", "1")
    assert measurement.end() == 0, measurement.text
    rows = [line.split("|")[1:5] for line in measurement.lines if line.startswith("|")]  # a busy robot may warn between
    assert [row[0].strip() for row in rows] == ["lateness of a tick", "---", "median [µs]", "p99 [µs]", "max [µs]"]
    assert all(float(cell) > 0.0 for row in rows[2:] for cell in row[1:])
    assert "medians over 1 and 1 seconds" in measurement.text
    assert list(tmp_path.iterdir()) == []  # bags go


def test_an_interrupted_measurement_ends_its_robot(start, domain_id, tmp_path):
    measurement = start("lateness", "--rate", "20.0")
    measurement.wait_for("measuring")
    measurement.send(signal.SIGINT)
    assert measurement.end() == 130  # its robot has ended as well, else the output would still be open
    assert list(tmp_path.iterdir()) == []


def test_a_bad_argument_is_one_line(start, domain_id):
    measurement = start("lateness", "--rounds", "many")
    assert measurement.end() == 2
    assert measurement.text.startswith("lateness: argument --rounds: invalid int value: 'many'")


def test_medians_and_their_ratio_are_shown():
    seconds = [{"median": 50.0, "p99": 100.0, "max": 300.0}, {"median": 51.0, "p99": 110.0, "max": 1000.0},
               {"median": 49.0, "p99": 90.0, "max": 200.0}]
    shown = table({False: seconds, True: [{name: 1.5 * value for name, value in one.items()} for one in seconds]})
    assert "| p99 [µs] | 100 | 150 | 1.50 |" in shown
    assert "| max [µs] | 300 | 450 | 1.50 |" in shown
