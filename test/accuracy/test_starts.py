"""Mean speeds over starts: the interval of a t-test, and the same numbers however many processes work."""

import numpy as np
import pytest
from scipy.stats import ttest_1samp

import vibro_ros
from vibro_ros.accuracy.starts import average, speed_of_start, speeds_of_starts


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
