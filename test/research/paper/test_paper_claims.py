"""When a claim of the paper holds, and when it does not: the rule on speeds whose answer is known."""

import numpy as np
import pytest

from research.paper.claims import (
    CLAIMS,
    DIVERGES,
    DOES_NOT,
    HOLDS,
    NAMED,
    NOISE,
    judged_pairs,
    mean_of,
    one_run_pairs,
    score,
    settled,
    speeds,
    verdicts,
)
from research.paper.readings import INSTANTS, SERIES, Point, Reading, Span, points

BEST, FALLS, HEAVIER, LIGHTEST, LONGER = CLAIMS
STARTS = 16
NEAR_ZERO = 0.01 * np.random.default_rng(3).standard_normal(STARTS)
READING = Reading("exact", 0.0, "corrected", "weight", "rest", "eq5")


def speed_of(series, mean):
    """Speeds of every robot of a series, shape (starts,), with the given mean at each of its values."""
    draw = np.random.default_rng(7)
    return {Point(series, value): mean(value) + 0.01 * draw.standard_normal(STARTS) for value in SERIES[series]}


@pytest.mark.parametrize(("claim", "mean", "outcome"), [
    (BEST, lambda angle: -abs(angle - 80.0), HOLDS), (BEST, lambda angle: -abs(angle - 84.0), NAMED),
    (BEST, lambda angle: angle, DOES_NOT), (BEST, lambda angle: 0.0, NOISE),
    (BEST, lambda angle: -abs(angle - 75.0), NOISE),  # 70 and 80 are equal, and nothing is faster than 80
    (FALLS, lambda angle: -angle, HOLDS), (FALLS, lambda angle: abs(angle - 94.0), NAMED),
    (FALLS, lambda angle: angle, DOES_NOT),
    (HEAVIER, lambda mass: -mass, HOLDS), (HEAVIER, lambda mass: -abs(mass - 0.1), NAMED),
    (LIGHTEST, lambda mass: -mass, HOLDS), (LIGHTEST, lambda mass: float(mass == 0.05) - mass, NAMED),
    (LONGER, lambda crank: crank, NAMED), (LONGER, lambda crank: 10.0 * crank, HOLDS),
    (LONGER, lambda crank: 10.0 * abs(crank - 0.015), NAMED), (LONGER, lambda crank: -10.0 * crank, DOES_NOT)])
def test_outcome_of_a_claim(claim, mean, outcome):
    """Sixteen starts whose speeds scatter by 0.01 m/s."""
    assert settled(claim, speed_of(claim.series, mean), judged_pairs) == outcome


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.name)
def test_the_judge_is_given_the_named_pairs_and_then_all(claim):
    """Robots whose speed is their own value, and a judge who only looks."""
    given = []

    def judge(differences):
        given.append(differences[:, 0].tolist())
        return HOLDS

    speed = {Point(claim.series, value): np.array([value]) for value in SERIES[claim.series]}
    assert settled(claim, speed, judge) == HOLDS
    assert given == [[fast - slow for fast, slow in pairs] for pairs in (claim.named, (*claim.named, *claim.others))]


def test_one_run_takes_the_first_start_as_it_is():
    up = np.array([[1e-9, -5.0, -5.0]])
    assert one_run_pairs(up) == HOLDS and one_run_pairs(-up) == DOES_NOT and judged_pairs(up) != HOLDS
    assert one_run_pairs(np.array([[0.0, 1.0]])) == DOES_NOT


def test_pure_noise_hardly_ever_settles_a_claim():
    """No difference: a pair is found the other way round in at most 5 % of the studies, and all pairs never hold."""
    draw = np.random.default_rng(11)
    found = [judged_pairs(draw.standard_normal((5, STARTS))) for _ in range(2000)]
    assert found.count(DOES_NOT) < 0.065 * len(found) and found.count(HOLDS) == 0


def test_what_diverges_is_told():
    speed = speed_of("angle", lambda angle: -abs(angle - 80.0))
    for value in (np.inf, np.nan, -1e40):
        speed[Point("angle", 60.0)][3] = value
        assert settled(BEST, speed, judged_pairs) == DIVERGES and settled(BEST, speed, one_run_pairs) == HOLDS


def test_speeds_are_those_of_the_span():
    displacement = np.tile(np.square(INSTANTS), (3, 1))
    assert speeds(displacement, Span(0.0, 2.0)).tolist() == [2.0] * 3
    assert speeds(displacement, Span(10.0, 40.0)).tolist() == [50.0] * 3


def test_an_interval_is_students():
    """Of 1, 2, 3 with t = 4.3027 at two degrees of freedom."""
    assert mean_of(np.array([1.0, 2.0, 3.0])) == pytest.approx((2.0, 4.302652729911275 / np.sqrt(3.0)), rel=1e-9)


def test_backwards_is_not_forwards_but_may_be_fast():
    """A robot whose size of speed obeys every claim, and that goes backwards."""
    def speed(point):
        order = {"angle": 200.0 - abs(point.value - 80.0), "mass": 200.0 - 100.0 * point.value,
                 "crank": 1e3 * point.value}
        return -order[point.series]

    draw = np.random.default_rng(5)
    found = {point: np.outer(speed(point) + 0.01 * draw.standard_normal(STARTS), INSTANTS) for point in points()}
    for one in verdicts(READING, found):
        assert score(one.size) == len(CLAIMS) and score(one.along_ox) == 0
        assert one.forwards == (0, len(found)) and one.fastest("crank") == 0.01
