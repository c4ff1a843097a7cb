"""Quantities computed from the solver's samples: the same bits one by one and all at once, and the torque of a crank
that stands.
"""

import numpy as np
import pytest

import vibro_ros
from vibro_ros.simulation import motion
from vibro_ros.simulation.motion import Motion
from vibro_ros.simulation.samples import FIELDS

TIMES = np.arange(300) / 1000.0


def commanded(scene: str, method: str) -> Motion:
    return Motion(vibro_ros.load_scene(scene).with_parameters({"solver.method": method}))


@pytest.mark.parametrize("scene", ["device", "paper", "frictionless"])
@pytest.mark.parametrize("method", ["exact", "rk4"])
def test_one_by_one_and_at_once_give_the_same_bits(scene, method, monkeypatch):
    """In groups of seven instants, with a motor that stands, turns and stands again."""
    monkeypatch.setattr(motion, "AT_ONCE", 7)
    one_by_one, at_once = commanded(scene, method), commanded(scene, method)
    for speed, times in ((0.0, TIMES[:100]), (40.0, TIMES[100:200]), (0.0, TIMES[200:])):
        one_by_one.command(speed, {})
        at_once.command(speed, {})
        found = at_once.sampled(times)
        assert list(found) == list(FIELDS)
        for k, time in enumerate(times):
            one_by_one.advance_to(time)
            assert one_by_one.now().tobytes() == np.array([found[name][k] for name in FIELDS]).tobytes()


def test_groups_of_instants_meet_ends_of_disturbances_and_edges_as_all_at_once_do(monkeypatch):
    """A push ends at the last instant of a group and a stall at the first of one; a patch ends within a group."""
    runs = []
    for group in (7, len(TIMES)):
        monkeypatch.setattr(motion, "AT_ONCE", group)
        device = vibro_ros.Simulator(vibro_ros.load_scene("damped"), acceleration_bandwidth=100.0)
        device.push(TIMES[20], force_x=40.0)
        device.fail("motor_stall", duration=TIMES[35])
        device.fail("friction_patch", duration=TIMES[200], value=0.02, from_x=-1.0, to_x=0.001)
        samples, accelerations = device.sample_filtered(TIMES)
        assert device.disturbances == {} and samples.body_position.max() > 0.001
        runs.append([*(values.tobytes() for values in vars(samples).values()), accelerations.tobytes()])
    assert runs[0] == runs[1]


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
