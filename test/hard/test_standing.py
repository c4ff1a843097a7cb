"""Masses at rest: held in long segments once their motion has decayed, and never before."""

import math
from fractions import Fraction

import numpy as np
import pytest

import vibro_ros
from vibro_ros.model.slider import Slider


def settled_device(scene, seconds=12.0):
    """A device whose motor has run and stopped, and whose masses have had time to settle."""
    device = vibro_ros.Simulator(scene)
    device.command(motor_speed=50.0)
    device.advance_to(2.0)
    device.command(motor_speed=0.0)
    device.advance_to(seconds)
    return device


@pytest.mark.parametrize("changes", [
    {}, {"effects.adhesion": False}, {"effects.friction": "stribeck", "effects.reaction": False,
                                      "effects.normal_force": "unilateral"}, {"effects.motor": "lag"},
    {"upper.plate.stiffness": 1e5, "inclined.plate.stiffness": 1e9},
    {"upper.plate.damping": 2e3, "inclined.plate.damping": 50.0}],
    ids=["as shipped", "no adhesion", "stribeck", "lag", "soft and stiff", "over and under damped"])
@pytest.mark.parametrize("name", ["damped", "device"])
def test_masses_pressed_on_compliant_plates_take_few_segments(name, changes):
    pressed = {"upper.gap": -0.02, "inclined.gap": -0.02}  # wherever the crank stops
    device = settled_device(vibro_ros.load_scene(name).with_parameters(pressed | changes))
    steps_before, state = device.statistics["steps"], device.state
    device.advance_to(22.0)
    assert device.statistics["steps"] - steps_before <= 10 * 50  # in 10 s; those that move take thousands a second
    assert device.state.upper_velocity == device.state.inclined_velocity == 0.0
    assert device.state.upper_position == state.upper_position
    assert device.state.body_position == state.body_position


def test_they_stand_where_the_springs_balance():
    """k1 (s - u) = k (u - plate) in exact arithmetic; the crank stands at 0, where the slider is r beyond the rod."""
    scene = vibro_ros.load_scene("damped").with_parameters({"motor.speed": 0.0, "upper.gap": -0.001})
    device = vibro_ros.Simulator(scene)
    device.advance_to(10.0)
    assert device.statistics["steps"] < 5000
    rod = Fraction(scene["crank.upper_rod"])
    slider, plate = rod + Fraction(scene["crank.radius"]), rod + Fraction(scene["upper.gap"])
    drive, stop = Fraction(scene["upper.spring.stiffness"]), Fraction(scene["upper.plate.stiffness"])
    balance = float((drive * slider + stop * plate) / (drive + stop))
    assert device.state.upper_plate_force > 10.0
    assert device.state.upper_position == pytest.approx(balance, abs=4.0 * math.ulp(balance), rel=0.0)


def test_a_motion_of_a_tenth_of_a_picometre_without_dampers_goes_on():
    """The least disturbance that is more than rounding is a motion, however long it lasts."""
    scene = vibro_ros.load_scene("paper").with_parameters({
        "motor.speed": 0.0, "start.state": "rest", "upper.gap": 0.02 - 1e-9})
    run = vibro_ros.simulate(scene, duration=5.0, rate=997.0)
    first, last = run.upper_position[:500], run.upper_position[-500:]
    assert 1e-13 < np.ptp(first) < 3e-13
    assert np.ptp(last) == pytest.approx(np.ptp(first), rel=0.05)


@pytest.mark.parametrize("command", [{"motor_speed": 80.0}, {"upper_gap": 0.002}, {"inclined_gap": -0.002}],
                         ids=["motor", "upper", "inclined"])
def test_held_masses_answer_a_command_as_those_that_have_just_settled(command):
    """After a command, the displacements of body and masses are the same after a minute of standing as after a few
    seconds.
    """
    ways = []
    for stood in (8.0, 60.0):
        device = settled_device(vibro_ros.load_scene("device"), stood)
        state_before = device.state
        device.command(**command)
        device.advance_to(stood + 0.25)
        after = device.state
        ways.append([after.body_position - state_before.body_position, after.upper_position, after.inclined_position])
    assert ways[0] != [0.0] * 3
    np.testing.assert_allclose(ways[0], ways[1], atol=1e-12, rtol=0.0)


@pytest.mark.parametrize("damping", [0.0, 2.0, 300.0])
@pytest.mark.parametrize("adhesion", [True, False])
@pytest.mark.parametrize("load", [0.0, 1e-18, -1e-18, 1e-16, 1e-15, 1e-13, -1e-13])
def test_a_mass_that_rests_on_its_plate_without_load(load, damping, adhesion):
    """Preloads whose penetration is below rounding: contact and no contact must not alternate for ever."""
    rest = float(Slider(0.02, 0.06, 0.9).position(0.0))
    device = vibro_ros.Simulator(vibro_ros.load_scene("unilateral").with_parameters({
        "effects.motor": "ramp", "motor.speed": 0.0, "guide.angle": 0.9, "effects.adhesion": adhesion,
        "upper.gap": 0.02 + load, "inclined.gap": rest - 0.06 + load, "upper.plate.stiffness": 1e9,
        "inclined.plate.stiffness": 1e7, **{f"{side}.{part}.damping": damping for side in ("upper", "inclined")
                                            for part in ("spring", "plate")}}))
    for time, speed in ((0.1, 60.0), (0.2, 0.0)):
        device.advance_to(time)
        device.command(motor_speed=speed)
    device.advance_to(0.6)
    assert device.state.motor_speed == 0.0
