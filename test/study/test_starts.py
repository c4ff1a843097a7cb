"""Mean speeds over starts: the interval of a t-test, and the same numbers however many processes work."""

import numpy as np
import pytest
from scipy.stats import ttest_1samp

import vibro_ros
from vibro_ros.orbits.starts import drawn_start
from vibro_ros.study.starts import average, motions_of, speed_of_start, speeds_of_starts


def covered(values: np.ndarray, starts: int) -> tuple[int, int]:
    """Of the intervals of batches of so many starts: how many hold the mean of all, and how many overlap the next."""
    batches = [average(batch) for batch in values.reshape(-1, starts)]
    holding = sum(abs(found.mean - values.mean()) <= found.spread for found in batches)
    overlapping = sum(abs(found.mean - other.mean) <= found.spread + other.spread
                      for found, other in zip(batches, batches[1:] + batches[:1], strict=True))
    return holding, overlapping


@pytest.mark.parametrize("count", [2, 3, 32])
def test_the_interval_is_that_of_a_t_test(count):
    values = np.random.default_rng(count).normal(0.1, 0.3, count)
    found, interval = average(values), ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert (found.mean - found.spread, found.mean + found.spread) == pytest.approx(tuple(interval), rel=1e-12)
    assert found.positive == np.sum(values > 0.0)


@pytest.mark.filterwarnings("error")
def test_equal_values_have_no_interval_and_no_warning():
    assert average(np.full(7, 0.3)).spread == pytest.approx(0.0, abs=1e-15)


def test_starts_are_those_of_one_process():
    scene = vibro_ros.load_scene("damped")
    assert list(speeds_of_starts(scene, 0.5, 3, batch=2)) == [speed_of_start(scene, 0.5, 2, k) for k in range(3)]


def test_starts_are_independent_and_repeatable():
    scene = vibro_ros.load_scene("damped")
    first, again, others = (speeds_of_starts(scene, 0.2, 6, batch) for batch in (0, 0, 1))
    assert np.array_equal(first, again) and not np.intersect1d(first, others).size
    assert len(np.unique(first)) == 6
    device = drawn_start(scene, 3)
    device.advance_to(3.0)
    assert device.state.motor_speed == scene["motor.speed"]
    assert device.state.upper_plate_position == pytest.approx(scene["crank.upper_rod"] + scene["upper.gap"], abs=1e-12)


def test_intervals_hold_as_often_as_they_say():
    """95 % of 400, within 4 standard deviations; and an interval that is too narrow is seen."""
    draw = np.random.default_rng(5).normal(-0.1, 0.03, (400, 16))
    holding, overlapping = covered(draw.ravel(), 16)
    assert abs(holding - 380) < 4.0 * (400 * 0.95 * 0.05) ** 0.5
    assert overlapping > 390
    drifting = draw + np.linspace(-0.1, 0.1, 400)[:, None]
    assert covered(drifting.ravel(), 16)[0] < 100


def test_intervals_of_a_chaotic_scene_hold():
    """Eight batches of exact's 16 starts: by chance one or two miss, hardly ever three."""
    values = speeds_of_starts(vibro_ros.load_scene("paper"), 2.0, 8 * 16, batch=7)
    holding, overlapping = covered(values, 16)
    assert holding >= 6 and overlapping >= 7
    assert average(values).spread < 0.01


@pytest.mark.parametrize("seed", range(20))
def test_starts_of_one_motion_stay_together_and_those_of_two_come_apart(seed):
    draw = np.random.default_rng(seed)
    one, other = draw.normal(-61.0, 0.5, 12), draw.normal(-26.0, 0.2, 4)
    assert [len(group) for group in motions_of(one)] == [12]
    assert [len(group) for group in motions_of(draw.uniform(0.0, 1.0, 16))] == [16]
    both = motions_of(draw.permutation(np.concatenate([one, other])))
    assert [len(group) for group in both] == [12, 4] and set(both[1]) == set(other)


def test_starts_that_repeat_one_motion_have_no_interval():
    settled = 0.0372 * (1.0 + 1e-12 * np.arange(16))
    assert average(settled).is_one_motion and len(motions_of(settled)) == 1
    assert not average(np.array([0.0372, 0.0373])).is_one_motion
