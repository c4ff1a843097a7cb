"""The trajectory must not depend on how time is divided: bit for bit, with commands, changed parameters, faults and
checkpoints.
"""

import dataclasses

import numpy as np
import pytest
from commanded_device import assert_balanced, disturb_in_every_way

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.simulation import motion
from vibro_ros.solver.methods import SCHEMES

COMMANDS = ((0.1, {"motor_speed": 120.0}), (0.2, {"upper_gap": 0.0005, "inclined_gap": -0.0002}),
            (0.25, {"upper_gap": -0.0003}),
            (0.25, {"motor_speed": -80.0}), (0.5, {"motor_speed": 0.0}))
FAULTS, CHANGED = 0.2, 0.25  # s
CHANGES = {"ground.friction": 0.15, "motor.acceleration": 400.0, "motor.time_constant": 0.06,
           "motor.integral_gain": 0.7, "gap_actuator.speed": 0.01}
END = 0.6
DC = {"effects.motor": "dc", "motor.speed": 40.0, "motor.voltage": 12.0, "motor.control_rate": 400.0}
LINKAGE = {"mass.upper_slider": 0.01, "mass.inclined_slider": 0.02, "mass.crank_pin": 0.05, "effects.reaction": True}
EXTRA = {
    "stribeck": ("unilateral", {"effects.friction": "stribeck", "ground.static_friction": 0.3}),
    "lag and reaction": ("damped", {"effects.motor": "lag", "effects.reaction": True}),
    "ramp": ("paper", {"effects.motor": "ramp", "motor.acceleration": 900.0}),
    "oil": ("device", {"ground.viscous_friction": 2.0}),
    "voltage": ("device", DC | {"motor.control": "voltage", "motor.winding_inductance": 0.0}),
    "speed by voltage": ("device", DC | {"motor.control": "speed_by_voltage", "motor.winding_inductance": 2.81e-4}),
    "speed by current, struck crank": ("rigid", DC | LINKAGE | {
        "motor.control": "speed_by_current", "effects.normal_force": "hop", "ground.restitution": 0.3})}
SCENES = {name: (name, {}) for name in shipped_scenes()} | EXTRA | {f"{method}-{name}": (
    name, {"motor.speed": 100.0, "effects.motor": "ramp", "solver.method": method, "solver.step": 2e-5})
    for name in ("device", "rigid") for method in sorted(SCHEMES)}
QUICK = ("damped", "device", "paper", "rk4-device")  # of `make check`; the others take seconds each


def new_device(scene):
    return vibro_ros.Simulator(scene, 300.0 * (scene["solver.method"] == "exact"))


def trajectory(scene, piece):
    """States at the instants of the commands and at the end, all events, and the device; advanced `piece` seconds at a
    time, and every 50 pieces by another device, from a checkpoint."""
    device, states, events, count = new_device(scene), [], [], 0
    for instant, change in (*COMMANDS, (END, {})):
        index, began = 0, device.time
        while began + (index + 1) * piece < instant:
            index += 1
            count += 1
            device.advance_to(began + index * piece)
            events.append(device.take_events())
            if count % 50 == 0:
                predecessor, device = device, new_device(scene)
                device.restore(predecessor.checkpoint())
        device.advance_to(instant)
        states.append(dataclasses.astuple(device.state))
        if instant == FAULTS:
            disturb_in_every_way(device)
        if instant == CHANGED:  # the devices that go on from checkpoints begin without these changes
            device.set_parameters(CHANGES)
        if scene.motor_command == "motor_voltage" and "motor_speed" in change:
            change = {"motor_voltage": change["motor_speed"] / 10.0}
        device.command(**change)
    return np.array(states), np.concatenate([*events, device.take_events()]), device


@pytest.mark.parametrize(("name", "changes"), [
    pytest.param(*case, id=key, marks=() if key in QUICK else pytest.mark.process) for key, case in SCENES.items()])
def test_every_cut_of_time_gives_the_same_bits(name, changes):
    """A35, A66, A72. Only commands begin a new segment, so samples do not disturb the motion; nor do they a step's.
    Through 0, a push, every fault and changed parameters, with the filtered acceleration; and the energy balances."""
    exact = "solver.method" not in changes
    scene = vibro_ros.load_scene(name).with_parameters({"solver.accounts": exact, **changes})
    whole, events, expected = trajectory(scene, np.inf)
    assert np.all(np.isfinite(whole))
    for piece in (1e-3, 0.37e-3, 1e-2, 17e-6 * np.pi):
        states, events_of_pieces, device = trajectory(scene, piece)
        np.testing.assert_array_equal(states, whole, err_msg=f"pieces of {piece} s")
        assert events_of_pieces.tobytes() == events.tobytes(), f"events in pieces of {piece} s"
        if exact:
            assert device.filtered_acceleration() == expected.filtered_acceleration()
            assert device.statistics["energy_accounts"] == expected.statistics["energy_accounts"]
    if exact:
        assert_balanced(expected)


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("name", shipped_scenes())
def test_samples_are_states(name, method, monkeypatch):
    """`simulate` and `Simulator` are one code path, and sampling does not disturb. Samples are computed in groups of
    seven, of a motor that stands, turns and stands again."""
    monkeypatch.setattr(motion, "AT_ONCE", 7)
    scene = vibro_ros.load_scene(name).with_parameters({"solver.method": method, "motor.speed": 0.0})
    commands = [(0.1025, {scene.motor_command: 12.0}), (0.2025, {scene.motor_command: 0.0})]
    run = vibro_ros.simulate(scene, duration=0.3, rate=200.0, commands=commands)
    coarse = vibro_ros.simulate(scene, times=run.time[::7], commands=commands)
    device, waiting = vibro_ros.Simulator(scene), [*commands]
    for index, time in enumerate(run.time):
        if waiting and waiting[0][0] < time:
            instant, command = waiting.pop(0)
            device.advance_to(instant)
            device.command(**command)
        device.advance_to(time)
        for field in dataclasses.fields(device.state):
            assert getattr(run, field.name)[index] == getattr(device.state, field.name), (field.name, time)
    for field in dataclasses.fields(device.state):
        np.testing.assert_array_equal(getattr(coarse, field.name), getattr(run, field.name)[::7])


def test_groups_of_instants_meet_ends_of_disturbances_and_edges_as_all_at_once_do(monkeypatch):
    """A push ends at the last instant of a group and a stall at the first of one; a patch ends within a group."""
    runs, times = [], np.arange(300) / 1000.0
    for group in (7, len(times)):
        monkeypatch.setattr(motion, "AT_ONCE", group)
        device = vibro_ros.Simulator(vibro_ros.load_scene("damped"), acceleration_bandwidth=100.0)
        device.push(times[20], force_x=40.0)
        device.fail("motor_stall", duration=times[35])
        device.fail("friction_patch", duration=times[200], value=0.02, from_x=-1.0, to_x=0.001)
        samples, accelerations = device.sample_filtered(times)
        assert device.disturbances == {} and samples.body_position.max() > 0.001
        runs.append([*(values.tobytes() for values in vars(samples).values()), accelerations.tobytes()])
    assert runs[0] == runs[1]
