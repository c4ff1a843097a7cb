"""Random starts are independent and repeatable, and intervals over them contain the mean as often as stated."""

import numpy as np
import pytest
from scipy.stats import ttest_1samp

import vibro_ros
from vibro_lab.orbits.chaos import half_interval
from vibro_lab.orbits.starts import SETTLING, drawn_start


def speed(scene, number, batch, duration):
    """Mean speed of a start after `SETTLING`."""
    device = drawn_start(scene, number, batch)
    device.advance_to(SETTLING)
    begin = device.state.body_position
    device.advance_to(SETTLING + duration)
    return (device.state.body_position - begin) / duration


def covered(values: np.ndarray, starts: int) -> tuple[int, int]:
    """Return how many of the intervals of batches of so many starts contain the mean of all, and how many overlap the
    next.
    """
    batches = [(batch.mean(), half_interval(batch)) for batch in values.reshape(-1, starts)]
    holding = sum(abs(mean - values.mean()) <= spread for mean, spread in batches)
    overlapping = sum(abs(mean - other) <= spread + more for (mean, spread), (other, more) in
                      zip(batches, batches[1:] + batches[:1], strict=True))
    return holding, overlapping


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("count", [2, 32])
def test_the_interval_is_that_of_a_t_test(count):
    """Equal values have no interval and cause no warning."""
    assert half_interval(np.full(7, 0.3)) == pytest.approx(0.0, abs=1e-15)
    values = np.random.default_rng(count).normal(0.1, 0.3, count)
    spread, interval = half_interval(values), ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert (values.mean() - spread, values.mean() + spread) == pytest.approx(tuple(interval), rel=1e-12)


def test_starts_are_independent_and_repeatable():
    scene = vibro_ros.load_scene("damped")
    first, again, others = (np.array([speed(scene, number, batch, 0.2) for number in range(6)]) for batch in (0, 0, 1))
    assert np.array_equal(first, again) and not np.intersect1d(first, others).size
    assert len(np.unique(first)) == 6
    device = drawn_start(scene, 3)
    device.advance_to(3.0)
    assert device.state.motor_speed == scene["motor.speed"]
    assert device.state.upper_plate_position == pytest.approx(scene["crank.upper_rod"] + scene["upper.gap"], abs=1e-12)


def test_intervals_hold_as_often_as_they_say():
    """95 % of 400 intervals contain the mean, within 4 standard deviations; intervals that are too narrow fail this
    test.
    """
    draw = np.random.default_rng(5).normal(-0.1, 0.03, (400, 16))
    holding, overlapping = covered(draw.ravel(), 16)
    assert abs(holding - 380) < 4.0 * (400 * 0.95 * 0.05) ** 0.5
    assert overlapping > 390
    drifting = draw + np.linspace(-0.1, 0.1, 400)[:, None]
    assert covered(drifting.ravel(), 16)[0] < 100


def test_intervals_of_a_chaotic_scene_hold():
    """Eight batches of exact's 16 starts: by chance one or two intervals miss the mean, hardly ever three."""
    scene = vibro_ros.load_scene("paper")
    values = np.array([speed(scene, number, 7, 2.0) for number in range(8 * 16)])
    holding, overlapping = covered(values, 16)
    assert holding >= 6 and overlapping >= 7
    assert half_interval(values) < 0.01
