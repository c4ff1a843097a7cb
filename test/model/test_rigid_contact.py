"""Rigid plates that move: they take a mass along, let it go, and end contacts."""

import numpy as np
import pytest

import vibro_ros

RIGID = vibro_ros.load_scene("rigid")


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
