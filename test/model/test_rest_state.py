"""The printed normal force below zero with a body that nothing drives: eq. (5) leaves it at rest."""

import math

import pytest

from vibro_ros import Scene, simulate


@pytest.mark.parametrize(("radius", "angle"), [(0.0599, math.pi / 2), (0.06, 1.126), (0.02, 0.9)])
def test_a_mass_at_rest_on_a_standing_slider_leaves_the_body_at_rest(radius, angle):
    # The upper mass, pressed on its plate, makes N negative again and again; F_in of the inclined one is exactly 0.
    scene = Scene().with_parameters({
        "crank.radius": radius, "guide.angle": angle, "motor.speed": 0.0, "inclined.gap": 0.02,
    })
    run = simulate(scene, duration=1.0, rate=1000.0)
    assert run.normal_force.min() < 0.0
    assert not run.body_position.any()
    assert not run.body_velocity.any()
