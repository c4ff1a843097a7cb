"""Quantities computed from the solver's samples: the torque of a crank that stands."""

import numpy as np
import pytest

import vibro_ros


def test_the_torque_of_a_crank_that_stands_is_the_limit_of_that_of_one_that_creeps():
    """Power over speed equals the drive forces times the sliders' slopes, at every angle; central differences of the
    positions give a slope to 1e-9.
    """
    device = vibro_ros.Simulator(vibro_ros.load_scene("device").with_parameters({"effects.motor": "ideal"}))
    for stop in (0.21, 0.37, 0.52):
        device.command(motor_speed=30.0)
        device.advance_to(stop)
        device.command(motor_speed=0.0)
        device.advance_to(stop + 0.01)
        state, scene = device.state, device.scene
        slopes = {}
        for side in scene.guides:
            angle = state.crank_angle - scene.guide_angle(side)
            radius, rod, around = scene["crank.radius"], scene[f"crank.{side}_rod"], angle + np.array([-1e-5, 1e-5])
            before, behind = radius * np.cos(around) + np.sqrt(rod**2 - (radius * np.sin(around))**2)
            slopes[side] = (behind - before) / 2e-5
        forces = {"upper": state.upper_drive_force, "inclined": state.inclined_drive_force}
        assert state.motor_speed == 0.0
        assert state.motor_torque == pytest.approx(sum(forces[side] * slopes[side] for side in slopes), rel=1e-7)
