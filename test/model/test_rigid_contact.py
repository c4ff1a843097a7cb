"""Rigid plates: Newton's restitution, rest on the plate, and the limit of stiff ones."""


import numpy as np
import pytest

import vibro_ros

RIGID = vibro_ros.load_scene("rigid")
REACTION = {"effects.reaction": True, "effects.mass_weight": True}


def test_a_plate_that_moves_takes_its_mass_along_and_lets_it_go():
    device = vibro_ros.Simulator(RIGID.with_parameters({"motor.speed": 0.0}))
    device.advance_to(0.1)
    device.command(upper_gap=-0.002)
    device.advance_to(0.3)
    assert device.state.upper_velocity == -0.005
    assert device.state.upper_position == pytest.approx(0.06 - 0.2 * 0.005, abs=1e-15)
    device.advance_to(1.0)
    assert device.state.upper_velocity == 0.0
    assert device.state.upper_position == pytest.approx(0.058, abs=1e-15)
    device.command(upper_gap=0.03)
    device.advance_to(8.0)
    assert device.state.upper_plate_force == 0.0
    assert abs(device.state.upper_position - 0.08) < 0.01  # swings about its slider at rest


def test_a_contact_that_its_plate_ends_by_moving_is_reported():
    """By a command and by the end of the plate's way: each rest once, up to the instant of the change of speed."""
    device = vibro_ros.Simulator(RIGID.with_parameters({"motor.speed": 0.0}))
    device.advance_to(0.1)
    device.command(upper_gap=-0.002)  # 0.4 s of motion inwards, the mass before the plate
    device.advance_to(1.0)
    device.command(upper_gap=0.03)
    device.advance_to(1.1)
    events = device.take_events()
    rests = events[(events["kind"] == "upper_contact") & (events["duration"] > 0.01)]
    np.testing.assert_allclose(rests["time"] + rests["duration"], [0.1, 0.5, 1.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(rests["time"], [0.0, 0.1, 0.5], rtol=0, atol=1e-3)  # after the bounces of the new blow


@pytest.mark.parametrize(("changes", "reason"), [
    ({"effects.normal_force": "printed"}, "effects.normal_force: 'printed' makes friction drive the body infinitely"),
    ({"guide.angle": 2.0}, "guide.angle: 2 rad points the inclined guide down"),
    ({"upper.plate.restitution": 1.5}, "upper.plate.restitution: 1.5 is out of range; give a number from 0 to 1")])
def test_rigid_plates_that_contradict_other_parameters_are_refused(changes, reason):
    with pytest.raises(ValueError, match=reason.split(";")[0]):
        RIGID.with_parameters(changes)
