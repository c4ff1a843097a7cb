"""Impact gap and speed: the mapping against scipy, and the words of a curve."""

import pytest

from research.literature import gap_speed, gap_speed_finding
from research.literature.published import FAILS, HOLDS, NOISE
from vibro_ros.accuracy.starts import Average


@pytest.mark.parametrize(("gap", "motor"), [(0.0, 100.0), (0.03, 80.0), (-0.003, 120.0)])
def test_exact_and_scipy_agree_on_the_robot(gap, motor):
    assert gap_speed.difference(gap, motor) < 1e-9


def test_a_gap_that_is_never_bridged_has_no_blows():
    row = gap_speed.tried((0.058, 60.0, 2))
    assert row.approach.mean == 0.0 and row.speed.mean > 0.0


def row(gap, speed, approach, spread=0.001):
    return gap_speed.Tried(gap, 100.0, Average(speed, spread, 2), Average(approach, spread, 2))


@pytest.mark.parametrize(("last", "verdict"), [
    (row(0.02, 0.05, 3.0), HOLDS), (row(0.02, 0.02, 3.0), FAILS), (row(0.02, 0.02, 3.0, 0.1), NOISE)])
def test_the_verdict_of_a_curve(last, verdict):
    curve = [row(0.0, 0.04, 1.0), row(0.01, 0.03, 1.5), last]
    assert gap_speed_finding.claim(curve).verdict == verdict
