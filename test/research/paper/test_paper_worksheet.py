"""The worksheet, which shares no code with the robot, against the robot."""

import numpy as np
import pytest

import vibro_ros
from research.paper.readings import Point, Reading
from research.paper.worksheet import rkadapt, rkfixed

TIMES = np.array([0.05, 0.1])


FIRST = Point("angle", 60.0)


def scene_of(equations, rule, start, point=FIRST):
    return Reading("rkfixed", 1e-6, equations, rule, start, "eq5").scene(point)


@pytest.mark.parametrize("equations", ["corrected", "misprint"])
@pytest.mark.parametrize("rule", ["printed", "unilateral", "weight"])
@pytest.mark.parametrize("start", ["zero", "rest"])
def test_fine_steps_find_the_motion_of_the_robot(equations, rule, start):
    """Off by the events within its steps of 1e-6 s: a force of 1e4 N (1e5 N with the misprint) for as long."""
    scene = scene_of(equations, rule, start)
    exact = vibro_ros.Simulator(scene).sample(TIMES).body_position
    found = rkfixed(scene, "eq5", 0.0, 1e-6, TIMES)
    allowed = 1e-2 * np.abs(exact).max() if equations == "misprint" else 2e-4
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=allowed)
    assert np.abs(exact).max() > 1e-4


def test_a_crank_that_is_ahead_moves_the_masses_as_a_later_start_would():
    """Without plates, friction and start transients of the masses: the drive alone, half a turn on."""
    scene = scene_of("corrected", "weight", "zero", Point("crank", 0.06))
    assert not np.allclose(rkfixed(scene, "eq5", 0.0, 1e-5, TIMES), rkfixed(scene, "eq5", 0.3, 1e-5, TIMES))
    turned = rkfixed(scene, "eq5", 2.0 * np.pi, 1e-5, TIMES)
    np.testing.assert_allclose(turned, rkfixed(scene, "eq5", 0.0, 1e-5, TIMES), rtol=0.0, atol=1e-9)


def test_reversed_friction_is_the_other_sign_and_smooth_friction_nearly_the_same():
    """Over the first turn of the crank. Reversed, friction drives the body on."""
    scene = scene_of("corrected", "weight", "zero")
    eq5, smooth, turned = (rkfixed(scene, friction, 0.0, 1e-5, TIMES) for friction in ("eq5", "smooth", "reversed"))
    assert np.abs(smooth - eq5).max() < 0.1 * np.abs(eq5).max()
    assert np.abs(turned).max() > 2.0 * np.abs(eq5).max()


def test_steps_longer_than_a_contact_diverge():
    """A contact of 0.3 ms on 1e7 N/m is unstable with steps of 1 ms."""
    found = rkfixed(scene_of("misprint", "printed", "rest"), "eq5", 0.0, 1e-3, np.array([1.0]))
    assert not abs(found[0]) < 1e6


def test_adaptive_steps_find_the_first_turn():
    """To some per cent, with a tolerance of 1e-3."""
    scene = scene_of("misprint", "printed", "rest")
    exact = vibro_ros.Simulator(scene).sample(TIMES).body_position
    np.testing.assert_allclose(rkadapt(scene, "eq5", 0.0, TIMES), exact, rtol=0.5)
