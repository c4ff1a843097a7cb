"""Friction that falls with the speed, mu(v) = mu + (mu_s - mu) exp(-|v| / v_s), and its limits."""

import numpy as np
import pytest

import vibro_ros

KINETIC, STATIC, SPEED = 0.2, 0.35, 0.02
RULES = ("unilateral", "weight", "printed")


def scene(name="damped", **changes):
    stribeck = {"effects.friction": "stribeck", "ground.static_friction": STATIC, "ground.stribeck_speed": SPEED,
                "upper.gap": 1e-3, "inclined.gap": 1e-3, "motor.speed": 92.0}
    return vibro_ros.load_scene(name).with_parameters(stribeck | changes)


def distances(limit, speeds, duration=0.5):
    """Greatest distance [m] of the body from its motion in the scene `limit`, for each v_s."""
    times = np.linspace(0.0, duration, 501)
    wanted = vibro_ros.simulate(limit, times=times).body_position
    return [abs(vibro_ros.simulate(scene(**{"ground.stribeck_speed": speed}), times=times).body_position
                - wanted).max() for speed in speeds]


def test_a_slow_decay_tends_to_coulombs_law_with_the_static_coefficient():
    """A26. At first order in 1/v_s: mu(v) = mu_s - (mu_s - mu) v / v_s; the second is v/v_s, 1e-2 and 1e-3, of it."""
    near, nearer = distances(scene(**{"effects.friction": "coulomb", "ground.friction": STATIC}), [30.0, 300.0])
    assert near < 1e-3
    assert near / nearer == pytest.approx(10.0, rel=0.1)


def test_a_fast_decay_tends_to_the_static_law():
    """A26. mu_s at rest and mu beyond: a body that leaves v_s behind at once is moved by about v_s times the time."""
    far, near, nearest = distances(scene(**{"effects.friction": "static"}), [1e-2, 1e-4, 1e-6])
    assert nearest < 0.05 * near < 0.05 * 0.05 * far


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("speed", [1e-6, 1e3])
def test_the_extremes_of_the_stribeck_speed_are_simulated(rule, speed):
    """However fast the decay: each stop and each start takes some forty steps through it, measured up to 13 times as
    many in all as by the static law."""
    steps = {friction: vibro_ros.simulate(
        scene("unilateral", **{"effects.friction": friction, "effects.normal_force": rule,
                               "ground.stribeck_speed": speed}), duration=1.0, rate=100.0).statistics["steps"]
        for friction in ("static", "stribeck")}
    assert steps["stribeck"] < 15 * steps["static"]


def test_a_body_that_passes_stribecks_speed_within_1e_19_s():
    """The misread force of 1e10 N on a gram: a segment's first trial is 1e13 times too long, and its series overflows.
    Beside 1e4 m/s v_s changes the motion by 1e-11 of its way, and rounding by less."""
    both = [scene("paper", **{
        "effects.friction": friction, "ground.stribeck_speed": 1e-6, "mass.body": 1e-3, "effects.misprint": True,
        "inclined.plate.stiffness": 1e12, "solver.tolerance": 1e-3}) for friction in ("stribeck", "static")]
    stribeck, static = (vibro_ros.simulate(each, duration=0.01, rate=1000.0) for each in both)
    assert np.abs(static.body_velocity).max() > 1e4
    np.testing.assert_allclose(stribeck.body_position, static.body_position, rtol=1e-9, atol=1e-6)
