"""The 0-1 test on series whose nature is known."""

import numpy as np
import pytest

import vibro_lab
import vibro_ros
from vibro_lab.orbits.turn_map import Stroboscope, free_cut


def logistic(rate, count=1000):
    values = [0.3]
    for _ in range(count + 199):
        values.append(rate * values[-1] * (1.0 - values[-1]))
    return np.array(values[200:])


@pytest.mark.parametrize("series", [
    np.full(400, 0.3), np.tile([0.1, 0.7], 500), logistic(3.55), np.cos(1.234 * np.arange(1000)),
    np.cos(0.7 * np.arange(1000)) + 0.5 * np.sin(np.sqrt(2.0) * np.arange(1000)), 1e9 * np.tile([1.0, 2.0, 4.0], 300)],
    ids=["constant", "period 2", "period 8", "circle", "torus", "large numbers"])
def test_regular_series_are_near_0(series):
    """A46. Whatever the size of their numbers."""
    assert abs(vibro_lab.zero_one_test(series)) < 0.1


@pytest.mark.parametrize("series", [logistic(3.97), logistic(4.0), np.random.default_rng(1).normal(size=1000)],
                         ids=["logistic 3.97", "logistic 4", "noise"])
def test_chaos_and_noise_are_near_1(series):
    """A46. The test does not distinguish chaos from noise."""
    assert vibro_lab.zero_one_test(series) > 0.95


def test_motions_of_the_robot():
    """`damped` repeats itself every turn, `unilateral` has an exponent of 6 1/s."""
    found = {}
    for name in ("damped", "unilateral"):
        stroboscope = Stroboscope(free_cut(vibro_ros.load_scene(name)))
        stroboscope.begin_as()
        stroboscope.turns(200)
        found[name] = vibro_lab.zero_one_test(stroboscope.turns(1000).states[:, 0])
    assert abs(found["damped"]) < 0.1 and found["unilateral"] > 0.9


@pytest.mark.parametrize(("series", "words"), [
    (np.zeros(20), "give at least 200 values"), (np.zeros((200, 2)), "has shape"),
    (np.full(300, np.nan), "not finite; give numbers alone")])
def test_what_is_no_series_is_refused(series, words):
    with pytest.raises(ValueError, match=words):
        vibro_lab.zero_one_test(series)
