"""One mass on its drive spring, no contact: known answers A1, A5 and A23, through the public interface.

Tolerances: the positions are about 0.1 m, so one rounding is 1e-17 m; resonance piles up some thousand.
"""

import numpy as np
import pytest
from exact_motion import duhamel, slider
from scipy.special import ellipe

import vibro_ros

TIMES = np.linspace(0.0, 0.3, 61)
NO_CONTACT = {"effects.upper_contact": "none", "effects.inclined_contact": "none"}


def run(changes, times=TIMES):
    return vibro_ros.simulate(vibro_ros.load_scene("paper").with_parameters(NO_CONTACT | changes), times=times)


def test_mean_slider_position():
    """A1. (2/π) L E(m = (l/L)²); the slider is read off the drive spring's force."""
    times = np.arange(64) * (2 * np.pi / 100.0 / 64)  # a periodic mean by 64 points converges to rounding
    motion = run({}, times)
    sliders = motion.upper_position + motion.upper_drive_force / 1e3
    exact = 2 / np.pi * 0.06 * ellipe((0.02 / 0.06) ** 2)
    assert exact == pytest.approx(0.0582969, abs=5e-8)
    assert sliders.mean() == pytest.approx(exact, abs=1e-15)
    np.testing.assert_allclose(sliders, slider(100.0 * times, 0.02, 0.06), rtol=0, atol=1e-15)


def test_crank_as_long_as_the_rod_has_a_kink_twice_a_turn():
    """A5. s = l cos θ + l |cos θ|, against Duhamel's integral cut at the kinks."""
    motion = run({"crank.radius": 0.06, "guide.angle": 0.9})
    upper = duhamel(TIMES, 100.0, 100.0, 0.12, 0.06, 0.06)
    inclined = duhamel(TIMES, 100.0, np.sqrt(1e3 / 0.08), slider(-0.9, 0.06, 0.06), 0.06, 0.06, 0.9)
    np.testing.assert_allclose(motion.upper_position, upper, rtol=0, atol=1e-13)
    np.testing.assert_allclose(motion.inclined_position, inclined, rtol=0, atol=1e-13)


def test_crank_as_long_as_the_rod_is_the_limit_of_shorter_ones():
    """A23. With l = L(1-ε) the motion comes nearer in proportion to ε ln(1/ε), so 100 times less ε: > 40 times."""
    limit = run({"crank.radius": 0.06})
    gaps = []
    for epsilon in (1e-4, 1e-6, 1e-8):
        near = run({"crank.radius": 0.06 * (1 - epsilon)})
        gaps.append(max(np.abs(near.upper_position - limit.upper_position).max(),
                        np.abs(near.inclined_position - limit.inclined_position).max()))
    assert gaps[0] > 40 * gaps[1] > 1600 * gaps[2]
    assert gaps[2] < 1e-7


@pytest.mark.parametrize("epsilon", [1e-12, 1e-15])
def test_crank_a_rounding_shorter_than_the_rod_neither_breaks_nor_differs(epsilon):
    """A23. Contacts included, over 0.1 s: ε ln(1/ε) times the contact's amplification of about 1e3."""
    scene = vibro_ros.load_scene("unilateral")
    limit = vibro_ros.simulate(scene.with_parameters({"crank.radius": 0.06}), duration=0.1, rate=100.0)
    near = vibro_ros.simulate(scene.with_parameters({"crank.radius": 0.06 * (1 - epsilon)}), duration=0.1, rate=100.0)
    np.testing.assert_allclose(near.body_position, limit.body_position, rtol=0, atol=1e-7)
    np.testing.assert_allclose(near.upper_position, limit.upper_position, rtol=0, atol=1e-7)
