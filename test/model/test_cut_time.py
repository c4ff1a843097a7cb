"""The trajectory must not depend on how time is cut: bit for bit, commands included."""

import dataclasses

import numpy as np
import pytest

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.solver.methods import SCHEMES

COMMANDS = ((0.1, {"motor_speed": 120.0}), (0.2, {"upper_gap": 0.0005, "inclined_gap": -0.0002}),
            (0.25, {"motor_speed": 80.0, "upper_gap": -0.0003}), (0.4, {"motor_speed": 0.0}))
END = 0.6


SCENES = [(name, {}) for name in shipped_scenes()]
SCENES += [(name, {"motor.speed": 100.0, "effects.motor": "ramp", "solver.method": method, "solver.step": 2e-5})
           for name in ("device", "paper") for method in sorted(SCHEMES)]


def trajectory(scene, piece):
    """States at the commands' instants and at the end, and all events; advanced `piece` seconds at a time."""
    device = vibro_ros.Simulator(scene)
    states, events = [], []
    for instant, change in (*COMMANDS, (END, {})):
        index = 0
        began = device.time
        while began + (index + 1) * piece < instant:
            index += 1
            device.advance_to(began + index * piece)
            events.append(device.take_events())
        device.advance_to(instant)
        states.append(dataclasses.astuple(device.state))
        device.command(**change)
    return np.array(states), np.concatenate([*events, device.take_events()])


@pytest.mark.parametrize(("name", "changes"), SCENES, ids=lambda one: one.get("solver.method", "exact") if isinstance(
    one, dict) else one)
def test_every_cut_of_time_gives_the_same_bits(name, changes):
    """A35. Only commands begin a new segment, so samples do not disturb the motion; nor do they a step's."""
    scene = vibro_ros.load_scene(name).with_parameters(changes)
    whole, events = trajectory(scene, np.inf)
    assert np.all(np.isfinite(whole))
    assert not changes or {"motor_ramp_end", "gap_reached"} & set(events["kind"])
    for piece in (1e-3, 0.37e-3, 1e-2, 17e-6 * np.pi):
        states, found = trajectory(scene, piece)
        np.testing.assert_array_equal(states, whole, err_msg=f"pieces of {piece} s")
        assert found.tobytes() == events.tobytes(), f"events in pieces of {piece} s"


@pytest.mark.parametrize("scene", shipped_scenes())
def test_samples_are_states(scene):
    """`simulate` and `Simulator` are one code path, and sampling does not disturb."""
    scene = vibro_ros.load_scene(scene)
    run = vibro_ros.simulate(scene, duration=0.3, rate=200.0)
    coarse = vibro_ros.simulate(scene, times=run.time[::7])
    device = vibro_ros.Simulator(scene)
    for index, time in enumerate(run.time):
        device.advance_to(time)
        for field in dataclasses.fields(device.state):
            assert getattr(run, field.name)[index] == getattr(device.state, field.name), (field.name, time)
    for field in dataclasses.fields(device.state):
        np.testing.assert_array_equal(getattr(coarse, field.name), getattr(run, field.name)[::7])


def test_commands_at_one_instant_act_in_their_order():
    """A second command at the same time replaces the first, whether or not advance_to lies between."""
    finals = []
    for repeat in (False, True):
        device = vibro_ros.Simulator(vibro_ros.load_scene("unilateral"))
        device.advance_to(0.05)
        if repeat:
            device.command(motor_speed=50.0, upper_gap=0.001)
            device.advance_to(0.05)
        device.command(motor_speed=110.0, upper_gap=0.0002)
        device.advance_to(0.2)
        finals.append(dataclasses.astuple(device.state))
    assert finals[0] == finals[1]
