"""Commands and parameters that change while the device runs, and the reset: against other devices, laws and limits."""

import numpy as np
import pytest
from commanded_device import RAMP, SWINGING, assert_go_on_alike, of_kind, refused, running
from commanded_device import device as device_with

import vibro_ros
from vibro_ros.model.parameters import LIVE

SCENES = ("paper", "unilateral", "damped", "frictionless", "rigid", "device", "no_impact")


@pytest.mark.parametrize("method", ["exact", "rk4", "rk4_located"])
def test_a_change_to_the_same_value_is_a_command_to_the_same_value(method: str):
    changed, commanded = running("device", solver__method=method), running("device", solver__method=method)
    for device in (changed, commanded):
        device.advance_to(0.3)
    changed.set_parameters({"ground.friction": changed.scene["ground.friction"]})
    commanded.command(motor_speed=100.0)
    assert_go_on_alike(changed, commanded, 0.5)


@pytest.mark.parametrize("scene", SCENES)
def test_another_floor_goes_on_from_the_same_state_and_keeps_the_energy_balance(scene: str):
    device = running(scene, solver__accounts=True)
    device.advance_to(0.3)
    for friction in (0.0, 0.1, 0.2, 0.0, 0.15):
        state_before = device.state
        device.set_parameters({"ground.friction": friction})
        after = device.state
        for name in ("body_position", "body_velocity", "upper_position", "inclined_velocity"):
            assert getattr(state_before, name) == getattr(after, name)
        # The segment that begins here counts the phase from another place: the last digit of its sum may differ.
        assert after.crank_angle == pytest.approx(state_before.crank_angle, rel=3e-16, abs=0.0)
        device.advance_to(device.time + 0.05)
    assert abs(device.statistics["energy_accounts"]["residual"]) < 1e-12  # J, of some joules exchanged


@pytest.mark.parametrize("scene", ["unilateral", "damped", "rigid", "device"])
def test_another_floor_moves_the_robot_as_a_robot_that_was_built_for_it(scene: str):
    """Between two coefficients above 0 the tables keep their shape, so the rest of a checkpoint fits both."""
    device, built_for_it = running(scene), running(scene, ground__friction=0.1)
    device.advance_to(0.3)
    checkpoint = device.checkpoint()
    checkpoint[1 + LIVE.index("ground.friction")] = 0.1
    built_for_it.restore(checkpoint)
    built_for_it.command(motor_speed=100.0)
    device.set_parameters({"ground.friction": 0.1})
    assert_go_on_alike(device, built_for_it, 0.6)


def test_stribeck_s_decaying_term_comes_and_goes_with_the_floor():
    device = running("unilateral", effects__friction="stribeck", solver__accounts=True)
    device.advance_to(0.2)
    with pytest.raises(ValueError, match="ground.static_friction: 0.25 is below ground.friction"):
        device.set_parameters({"ground.friction": 0.3})
    for friction in (0.25, 0.1, 0.0, 0.25, 0.2):  # without the term where it is the static coefficient
        device.set_parameters({"ground.friction": friction})
        device.advance_to(device.time + 0.05)
    assert abs(device.statistics["energy_accounts"]["residual"]) < 1e-12


def test_a_body_that_sticks_slips_when_the_floor_becomes_smoother():
    device = running("damped", ground__friction=1e3)
    device.advance_to(0.1)
    assert device.state.body_velocity == 0.0
    device.set_parameters({"ground.friction": 0.0})
    device.advance_to(0.2)
    assert device.state.body_velocity != 0.0 and device.state.friction_force == 0.0
    device.set_parameters({"ground.friction": 1e3})
    device.advance_to(0.3)
    assert device.state.body_velocity == 0.0


@pytest.mark.parametrize(("start", "command", "change", "field", "values"), [
    ({"effects__motor": "ramp", "motor__acceleration": 200.0}, {"motor_speed": 100.0}, {"motor.acceleration": 400.0},
     "motor_speed", {0.25: 50.0, 0.3: 70.0, 0.5: 100.0}),
    ({"effects__motor": "lag", "motor__time_constant": 0.25}, {"motor_speed": 100.0}, {"motor.time_constant": 0.02},
     "motor_speed", {0.25: 100.0 * -np.expm1(-1.0), 0.31: 100.0 * -np.expm1(-4.0)}),
    ({}, {"upper_gap": 0.002}, {"gap_actuator.speed": 0.001},
     "upper_plate_position", {0.25: 0.06125, 0.35: 0.06135, 1.0: 0.062})], ids=["ramp", "lag", "plate"])
def test_a_ramp_in_progress_continues_with_the_new_parameter(start, command, change, field, values):
    """The parameter is changed at 0.25 s, while motor and plate still move."""
    device = running("damped", motor__speed=0.0, **start)
    device.command(**command)
    for time, value in values.items():
        device.advance_to(time)
        assert getattr(device.state, field) == pytest.approx(value, rel=1e-9)
        if time == 0.25:
            device.set_parameters(change)


@pytest.mark.parametrize(("changes", "words"), [
    ({"mass.body": 2.0}, "mass.body: makes another machine"),
    ({"ground.friction": -0.1}, "ground.friction: -0.1 is out of range"),
    ({"ground.friction": float("nan")}, "ground.friction: nan is not finite"),
    ({"ground.friction": 1e3}, "Painlevé's paradox"),
    ({"motor.max_speed": 99.0}, "motor.max_speed"),
    ({"motor.acceleration": 0.0}, "motor.acceleration: 0 rad/s² lets no ramp motor"),
    ({"motor.acceleration": 1.0, "gap_actuator.speed": "fast"}, "gap_actuator.speed"),
    ({"ground.frictoin": 0.1}, "did you mean ground.friction?"),
])
def test_a_refused_change_changes_nothing(changes: dict, words: str):
    device = running("device")
    device.advance_to(0.2)
    scene_before = device.scene
    with refused(device, words):
        device.set_parameters(changes)
    assert device.scene == scene_before


def test_no_limit_falls_below_the_speed_that_was_commanded():
    device = vibro_ros.Simulator(vibro_ros.load_scene("device"))
    device.command(motor_speed=120.0)
    with refused(device, "below the commanded motor speed, 120 rad/s"):
        device.set_parameters({"motor.max_speed": 110.0})
    device.command(motor_speed=80.0)
    device.set_parameters({"motor.max_speed": 110.0})
    with refused(device, "the limit is motor.max_speed"):
        device.command(motor_speed=120.0)


@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("scene", ["paper", "device", "rigid"])
def test_after_a_reset_the_device_is_a_new_one(scene: str, method: str):
    device, new = (running(scene, solver__method=method) for _ in range(2))
    device.command(motor_speed=120.0, upper_gap=0.001)
    device.advance_to(0.33)
    device.reset()
    assert device.state == new.state and len(device.take_events()) == len(new.take_events())
    for each in (device, new):
        each.command(motor_speed=90.0)
    assert_go_on_alike(device, new, 0.2)
    assert device.statistics == new.statistics


def test_a_reset_keeps_the_parameters_that_were_changed():
    device = running("device")
    device.set_parameters({"ground.friction": 0.1, "motor.acceleration": 50.0})
    device.reset()
    assert (device.scene["ground.friction"], device.scene["motor.acceleration"]) == (0.1, 50.0)
    assert_go_on_alike(device, vibro_ros.Simulator(device.scene), 0.2)


def test_an_empty_command_changes_nothing_but_rounding():
    made, untouched = device_with(scene="damped"), device_with(scene="damped")
    made.advance_to(0.013)
    made.command()
    for each in (made, untouched):
        each.advance_to(0.1)
    np.testing.assert_allclose(made.state.upper_position, untouched.state.upper_position, rtol=0, atol=1e-13)
    np.testing.assert_allclose(made.state.body_position, untouched.state.body_position, rtol=0, atol=1e-13)


def test_asking_for_the_present_speed_or_gap_is_no_ramp():
    made = device_with(RAMP | SWINGING)
    made.command(motor_speed=0.0, upper_gap=0.0)
    made.advance_to(0.1)
    assert len(of_kind(made.take_events(), "motor_ramp_end", "gap_reached")) == 0


def test_the_gap_moves_at_its_speed():
    made = device_with({"gap_actuator.speed": 0.005} | RAMP)
    made.command(upper_gap=0.001, inclined_gap=-0.0005)
    for time in (0.0, 0.05, 0.0999):
        made.advance_to(time)
        assert made.state.upper_plate_position == pytest.approx(0.06 + 0.005 * time, abs=1e-15)
        assert made.state.inclined_plate_position == pytest.approx(0.06 - 0.005 * time, abs=1e-15)
        assert (made.state.upper_plate_velocity, made.state.inclined_plate_velocity) == (0.005, -0.005)
    made.advance_to(0.3)
    assert (made.state.upper_plate_position, made.state.inclined_plate_position) == (0.06 + 0.001, 0.06 - 0.0005)
    assert made.state.upper_plate_velocity == 0.0
    reached = of_kind(made.take_events(), "gap_reached")
    np.testing.assert_allclose(reached["time"], [0.1, 0.2], rtol=1e-12)


@pytest.mark.parametrize("scene", ["paper", "unilateral", "damped"])
def test_a_flood_of_commands_at_one_instant(scene):
    """The last of 1000 commands counts. Each jump of the speed causes a jump of the dampers' force, and none is taken
    for a lack of progress.
    """
    made = device_with({"upper.spring.damping": 50.0, "inclined.spring.damping": 50.0}, scene)
    made.advance_to(0.0155)
    for index in range(1000):
        made.command(motor_speed=500.0 * (index % 2), upper_gap=0.001 * (index % 3))
    made.command(motor_speed=90.0, upper_gap=0.0)
    made.advance_to(0.1)
    assert made.state.motor_speed == 90.0
