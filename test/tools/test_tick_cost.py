"""`tick_cost` runs real publishers, and its tables say what was asked for and what ran."""

import re

import pytest

from tools.tick_cost import ASKED, RATES

pytestmark = pytest.mark.quiet


def test_a_tick_is_measured_for_every_accuracy_and_rate(start):
    measuring = start("tick_cost", "--duration", "0.02")
    assert measuring.end() == 0, measuring.text
    rows = re.findall(r"^\| (.*`.*?) \| (.*?) \| (\d+) µs \| (\d+) µs \| ([\d.]+) \|$", measuring.text, re.MULTILINE)
    assert [asked for asked, *_ in rows] == [*ASKED] * len(RATES)
    assert {ran for asked, ran, *_ in rows if "rk4" not in asked} == {"exact"}  # the cheapest of the device's scene
    assert {ran for asked, ran, *_ in rows if "rk4" in asked} == {"rk4, 1e-05 s", "rk4, 1e-06 s"}
    assert all(0 < int(median) <= int(most) and float(ratio) > 0.0 for _, _, median, most, ratio in rows)
