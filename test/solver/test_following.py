"""A stiff coordinate that follows a slow forcing, against the solution in closed form."""

import numpy as np
import pytest
from small_system import Integration, build, cosine_table

from vibro_ros.solver.system import Channels

SPEED = 5.0  # rad/s
CHANNELS = Channels(coordinates=2, dynamic=2, signals=1, ramps=0)


def driven(stiffness, damping):
    """Two coordinates, each q'' = K (cos(5 t) - q) - C q'."""
    rows = np.zeros((2, CHANNELS.count))
    for i in range(2):
        rows[i, CHANNELS.signal(0)], rows[i, CHANNELS.position(i)] = stiffness[i], -stiffness[i]
        rows[i, CHANNELS.velocity(i)] = -damping[i]
    return Integration(build(CHANNELS, [rows], signals=cosine_table()), [1.0, 1.0], [0.0, 0.0], speed=SPEED)


def steady(stiffness, damping, times):
    """Real part of K e^{i w t} / (K - w² + i C w), and its rate."""
    motion = stiffness / (stiffness - SPEED**2 + 1j * damping * SPEED) * np.exp(1j * SPEED * times)
    return motion.real, (1j * SPEED * motion).real


@pytest.mark.parametrize("damping", [1e3, 2e4, 1e5])
def test_it_takes_few_segments_and_its_exact_place(damping):
    """Under, at and above critical damping; the second coordinate is soft, and moves as ever."""
    integration = driven([1e8, 30.0], [damping, 8.0])
    times = np.linspace(12.0, 15.0, 500)
    integration.sample(times[:1])
    before = integration.segments
    points, _, _ = integration.sample(times)
    assert integration.segments - before < 3 * 50  # while it moves by itself, 3000 a second
    for i, of_coordinate in enumerate(zip([1e8, 30.0], [damping, 8.0], strict=True)):
        place, rate = steady(*of_coordinate, times)
        np.testing.assert_allclose(points[:, CHANNELS.position(i)], place, rtol=0.0, atol=3e-14)
        np.testing.assert_allclose(points[:, CHANNELS.velocity(i)], rate, rtol=0.0, atol=1e-11)  # rounding times 1e4/s


def test_without_a_damper_it_never_follows():
    """Its own motion, of a ten-millionth of its place, goes on for ever."""
    integration = driven([1e8, 30.0], [0.0, 8.0])
    times = np.linspace(2.0, 2.01, 2000)
    points, _, _ = integration.sample(times)
    own = points[:, CHANNELS.position(0)] - steady(1e8, 0.0, times)[0]
    assert 1e-7 < abs(own).max() < 4e-7
    assert integration.segments > 5000


def test_how_its_time_is_cut_up_changes_no_bit():
    """Where it begins to follow is told by the motion alone."""
    times = np.linspace(0.0, 1.0, 3001)
    at_once, _, _ = driven([1e8, 30.0], [2e4, 8.0]).sample(times)
    one_by_one = driven([1e8, 30.0], [2e4, 8.0])
    for time, expected in zip(times, at_once, strict=True):
        np.testing.assert_array_equal(one_by_one.sample([time])[0][0], expected)
