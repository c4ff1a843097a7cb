"""Grazing from both sides, compliant and rigid: once a period inside, never outside, and the square-root law.

Damped motion under the crank forgets its past, e^-62 a turn; its highest point comes from a Fourier sum.
"""

import numpy as np
import pytest
from exact_motion import SteadyMotion

import vibro_ros

TURN = 2.0 * np.pi / 100.0
STIFFNESS, DAMPING = 1e5, 200.0
MASS = {"upper": 0.1, "inclined": 0.08}


def steady_motion(side):
    return SteadyMotion(100.0, MASS[side], STIFFNESS, DAMPING, 0.02, 0.06)


def touched(side, kind, depth, stiffness=1e7):
    """Contacts after the third turn with the plate `depth` inside the steady motion's highest point."""
    steady = steady_motion(side)
    instant, highest = steady.highest(TURN)
    other = {"upper": "inclined", "inclined": "upper"}[side]
    scene = vibro_ros.load_scene("unilateral").with_parameters({
        f"{side}.plate.stiffness": stiffness, f"{side}.spring.stiffness": STIFFNESS, f"{side}.spring.damping": DAMPING,
        f"{side}.gap": highest - depth - 0.06, f"effects.{side}_contact": kind, f"{side}.plate.restitution": 0.8,
        f"effects.{other}_contact": "none", f"{other}.spring.damping": 5.0})
    events = vibro_ros.simulate(scene, duration=8 * TURN, rate=100.0).events
    events = events[(events["kind"] == f"{side}_contact") & (events["time"] > 2.5 * TURN)]
    return events, -steady.derivative(instant, 2)


@pytest.mark.parametrize("kind", ["compliant", "restitution"])
@pytest.mark.parametrize("side", ["upper", "inclined"])
def test_a_nanometre_outside_is_never_touched(side, kind):
    """A11. The event that must not happen."""
    assert len(touched(side, kind, -1e-9)[0]) == 0


@pytest.mark.parametrize("side", ["upper", "inclined"])
def test_a_nanometre_inside_is_touched_once_a_turn(side):
    """A11. The steady motion is a Fourier sum good to 1e-16 m, the simulated one to about 1e-15 m."""
    events, pull = touched(side, "compliant", 1e-9)
    assert len(events) == 5
    np.testing.assert_allclose(np.diff(events["time"]), TURN, rtol=0, atol=1e-9)  # 1e-15 m of a depth of 1e-9 m
    steady = steady_motion(side)
    instant, highest = steady.highest(TURN)
    instant -= np.sqrt(2e-9 / pull)
    for _ in range(5):
        instant -= (steady.derivative(instant) - highest + 1e-9) / steady.derivative(instant, 1)
    # 1e-15 m of 1e-9 m moves the speed √(2ad) by 5e-7 of itself
    np.testing.assert_allclose(events["speed"], steady.derivative(instant, 1), rtol=2e-6)


@pytest.mark.parametrize("side", ["upper", "inclined"])
def test_a_nanometre_inside_a_rigid_plate_chatters_and_leaves_once_a_turn(side):
    """The bounces of each turn, begun at √(2 a d), end while the steady motion would be beyond the plate, 2√(2d/a),
    stretched by the rebounds: the first of each turn strikes, the others follow within 4 such times."""
    events, pull = touched(side, "restitution", 1e-9)
    starts = events[np.diff(events["time"], prepend=0.0) > 0.5 * TURN]
    assert len(starts) == 5
    # after the first, steady motion is reached again: e^-62
    np.testing.assert_allclose(starts["speed"], np.sqrt(2.0 * pull * 1e-9), rtol=1e-3)
    within = events["time"] - starts["time"][np.searchsorted(starts["time"], events["time"], side="right") - 1]
    assert within.max() < 8.0 * np.sqrt(2e-9 / pull)


@pytest.mark.parametrize("kind", ["compliant", "restitution"])
@pytest.mark.parametrize("side", ["upper", "inclined"])
def test_approach_speeds_follow_the_square_root_law(side, kind):
    """A11. √(2 a d), a the deceleration at the top, over four decades; next term √d of the stroke: 1e-3 at most."""
    for depth in (1e-11, 1e-9, 1e-7):
        events, pull = touched(side, kind, depth)
        first = events[np.diff(events["time"], prepend=0.0) > 0.5 * TURN]
        assert len(first) == 5
        np.testing.assert_allclose(first["speed"], np.sqrt(2.0 * pull * depth), rtol=3e-3)


@pytest.mark.parametrize("side", ["upper", "inclined"])
def test_compliant_depth_follows_the_square_root_law(side):
    """Peak force v √(km), so √d again, on plates so stiff that they stop the mass on a way v/ω_c of 1 % of d."""
    forces = []
    for depth in (1e-6, 4e-6):
        events, _ = touched(side, "compliant", depth, stiffness=1e12)
        forces.append(events["peak_force"][np.diff(events["time"], prepend=0.0) > 0.5 * TURN])
    assert len(forces[0]) == len(forces[1]) == 5
    np.testing.assert_allclose(forces[1] / forces[0], 2.0, rtol=0.01)
