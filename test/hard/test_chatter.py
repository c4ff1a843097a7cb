"""A body that leaves stick does so only once, under every force of the ground, and under a force that a new row adds.
"""

import numpy as np
import pytest
from commanded_device import assert_balanced
from test_thousand_random_scenes import check_instants

import vibro_ros
from vibro_ros.model import parameter_values
from vibro_ros.model.parameter_values import GROUND_FORCES, GroundForce

#: A spring between body and world, in place of the drag.
SPRING = GroundForce("F_k", "ground.drag", lambda values: (0.0, 0.0, values["ground.drag"]))
# Numbers that no other test has: compiled scenes are kept by their parameters.
NUMBERS = {"ground.slope": (0.05123,), "ground.viscous_friction": (1.0123e-9, 2.0123), "ground.drag": (0.5123,)}
CASES = [(force, number) for force in GROUND_FORCES for number in NUMBERS[force.parameter]] + [
    (SPRING, number) for number in (0.5124, 50.123, 5012.3)]


@pytest.mark.parametrize("name", ["damped", "unilateral", "device"])
@pytest.mark.parametrize(("force", "number"), CASES, ids=[f"{force.symbol} {number}" for force, number in CASES])
def test_no_state_begins_twice_at_one_instant_and_energy_balances(monkeypatch, name, force, number):
    """A56. At the end of a stick the body is at rest to rounding, whatever held it."""
    monkeypatch.setattr(parameter_values, "GROUND_FORCES", (*(other for other in GROUND_FORCES if (
        other.parameter != force.parameter)), force))
    scene = vibro_ros.load_scene(name).with_parameters({
        "motor.speed": 100.0, "solver.accounts": True, force.parameter: number})
    assert f"{force.symbol} = " in scene.describe()
    run = vibro_ros.simulate(scene, duration=2.0, rate=100.0)
    check_instants(run.events)
    changes = run.events["time"][np.isin(run.events["kind"], ("stick", "slip_forward", "slip_backward"))]
    assert len(changes) > 20
    assert_balanced(run, 1e-11)


def test_a_spring_between_ground_and_body_makes_the_body_oscillate(monkeypatch):
    """x'' = -k/M x without friction: x(t) = cos(omega t), to 1e-13."""
    monkeypatch.setattr(parameter_values, "GROUND_FORCES", (SPRING,))
    scene = vibro_ros.load_scene("damped").with_parameters({
        "effects.upper_mass": False, "effects.inclined_mass": False, "effects.friction": "none",
        "ground.drag": 40.124, "start.state": "given", "start.body_position": 1.0})
    run = vibro_ros.simulate(scene, duration=3.0, rate=100.0)
    expected = np.cos(np.sqrt(40.124 / scene.total_mass) * run.time)
    np.testing.assert_allclose(run.body_position, expected, rtol=0, atol=1e-13)
