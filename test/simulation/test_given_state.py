"""`Simulator.set_state` and `start.state: given`: any possible state is accepted, and an impossible one changes
nothing.
"""

import math
import re

import numpy as np
import pytest
from commanded_device import assert_balanced, assert_go_on_alike, refused

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.simulation.given_state import UNITS

INTERVAL = 0.005  # s, between two samples of a robot


def given_of(device) -> dict[str, float]:
    return {name: getattr(device.state, name) for name in UNITS}


def running(name: str, **changes) -> vibro_ros.Simulator:
    device = vibro_ros.Simulator(vibro_ros.load_scene(name).with_parameters(changes))
    device.command(motor_speed=100.0)
    return device


@pytest.mark.parametrize("name", [name for name in shipped_scenes() if name != "machine"])  # whose controller remembers
def test_a_device_given_the_state_of_another_moves_like_it(name):
    """A device that is given another device's state continues like that device: at 200 instants, in flight, on plates
    and in the air, from 0.3 s on, when a ramp has reached its speed.
    """
    times = np.sort(np.random.default_rng(5).uniform(0.3, 2.0, 200))
    device = running(name)
    for time in times:
        device.advance_to(time)
        other = running(name)
        other.advance_to(1e-3)
        other.set_state(**given_of(device))
        there = vibro_ros.Simulator(device.scene)
        there.restore(device.checkpoint())
        there.advance_to(time + INTERVAL)
        other.advance_to(1e-3 + INTERVAL)
        for field in UNITS:
            scale = {"m/s": 1e-10, "m": 1e-12}.get(UNITS[field], 1e-11)
            assert getattr(other.state, field) == pytest.approx(getattr(there.state, field), abs=scale), (time, field)


def test_a_method_of_fixed_step_continues_from_a_given_state():
    device = running("damped", **{"solver.method": "rk4", "solver.step": 1e-6})
    device.advance_to(0.2)
    device.set_state(upper_position=0.05, crank_angle=7.0, body_velocity=0.1)
    state = device.state
    assert (state.upper_position, state.body_velocity) == (0.05, 0.1) and state.crank_angle == pytest.approx(7.0)
    device.advance_to(0.3)
    exact = running("damped")
    exact.advance_to(0.2)
    exact.set_state(**{name: getattr(state, name) for name in UNITS})
    exact.advance_to(0.3)
    assert device.state.upper_position == pytest.approx(exact.state.upper_position, abs=2e-4)


def test_fields_that_are_not_given_keep_their_bits():
    device, other = running("device"), running("device")
    for each in (device, other):
        each.advance_to(1.2345)
    other.set_state(body_velocity=device.state.body_velocity)
    for name in UNITS:
        assert getattr(other.state, name) == getattr(device.state, name)


def test_commands_go_on_and_an_ideal_motor_keeps_its_speed():
    device = running("device")
    device.advance_to(1.0)
    device.command(upper_gap=0.001)
    device.set_state(motor_speed=50.0, upper_plate_position=0.07)
    device.advance_to(4.0)
    assert device.state.motor_speed == 100.0
    assert device.state.upper_plate_position == device.scene["crank.upper_rod"] + 0.001
    ideal = running("damped")
    ideal.set_state(motor_speed=60.0)
    ideal.advance_to(1.0)
    assert ideal.state.motor_speed == ideal.commanded_motor_speed == 60.0


@pytest.mark.parametrize("angle", [0.0, 1e-9, math.pi, math.nextafter(2.0 * math.pi, 0.0), 2.0 * math.pi, 12345.678,
                                   1e9, -1e-300, -1.0, -2.0 * math.pi, -1e9])
@pytest.mark.parametrize("speed", [100.0, -100.0])
def test_any_crank_angle_is_taken_up(angle, speed):
    device = running("damped")
    device.command(motor_speed=speed)
    device.set_state(crank_angle=angle)
    assert device.state.crank_angle == pytest.approx(angle, abs=1e-15 * max(1.0, abs(angle)))
    device.advance_to(0.02)
    assert device.state.crank_angle == pytest.approx(angle + 0.02 * speed, abs=1e-15 * max(10.0, abs(angle)))


@pytest.mark.parametrize("name", ["damped", "unilateral", "device", "rigid"])
def test_energy_stays_balanced(name):
    """The energy that a given state adds is booked as a change from outside, so the residual does not contain it."""
    device, chance = running(name, **{"solver.accounts": True}), np.random.default_rng(3)
    for number in range(20):
        device.advance_to(0.1 * (number + 1))
        state = device.state
        device.set_state(upper_position=min(state.upper_plate_position, 0.05 + 0.01 * chance.uniform()),
                         inclined_velocity=chance.uniform(-1.0, 1.0), body_velocity=chance.uniform(-0.2, 0.2),
                         crank_angle=chance.uniform(0.0, 20.0))
    device.advance_to(2.5)
    assert_balanced(device, 1e-11)


REFUSED = [
    ({"time": 1.0}, "'time': cannot be given; give any of body_position"),
    ({"upper_position": math.nan}, "upper_position: nan is not finite; give a number"),
    ({"upper_position": "0.05"}, "upper_position: '0.05' is not a number; give a number from -1e+06 to 1e+06 m"),
    ({"body_velocity": 1e7}, "give a number from -1e+06 to 1e+06 m/s"),
    ({"crank_angle": -1e10}, "crank_angle: -1e+10 is out of range"),
    ({"motor_speed": 1e6}, "motor.max_speed"),
    ({"upper_plate_position": 0.2}, "upper_plate_position: 0.2 is out of range; give a number from 0 to 0.12 m"),
    ({"upper_position": 0.07}, "upper_position: 0.07 m lies beyond the rigid plate at 0.06 m; give at most 0.06 m"),
    ({"body_height": 0.01}, "body_height: 0.01 m, but it stays 0 in this scene; leave it out, or give 0"),
]


COMPLIANT = [
    ({}, "a state: no number is given; give any of body_position"),
    ({"upper_position": 0.5}, "0.5 m lies beyond the plate at 0.06 m, deeper than any blow of this machine; give at "
                              "most 0.0633534405 m"),
    ({"inclined_plate_position": 0.0}, "beyond the plate at 0 m"),
]


@pytest.mark.parametrize(("given", "words"), COMPLIANT)
def test_a_compliant_plate_yields_as_far_as_the_hardest_blow_drives_a_mass(given, words):
    """The energy of a mass of 100 g at 2 l ω, and at the speeds of its stretched spring and of a fall, on 1e7 N/m."""
    device = running("damped")
    device.advance_to(0.5)
    with refused(device, words):
        device.set_state(**given)
    speed = 2.0 * 0.02 * 500.0 + 0.12 * math.sqrt(1e3 / 0.1) + math.sqrt(2.0 * 9.81 * 0.12)
    deepest = device.scene.deepest_penetration("upper")
    assert 0.5 * 1e7 * deepest**2 == pytest.approx(0.5 * 0.1 * speed**2)
    plate = device.state.upper_plate_position
    device.set_state(upper_position=plate + deepest)
    device.set_state(body_velocity=0.1)  # the mass is where it was
    assert device.state.upper_position == plate + deepest
    with refused(device, "give at most"):
        device.set_state(upper_position=plate + 1.001 * deepest)


@pytest.mark.parametrize("name", ["damped", "device", "machine"])
def test_a_reset_into_a_state_is_that_of_a_new_device(name):
    device, new = running(name), vibro_ros.Simulator(running(name).scene)
    device.advance_to(0.5)
    with refused(device, "give any of body_position"):
        device.reset(mass=1.0)
    device.reset(body_velocity=0.3, crank_angle=1.0)
    new.set_state(body_velocity=0.3, crank_angle=1.0)
    assert device.time == 0.0 and device.state == new.state
    assert_go_on_alike(device, new, 0.4)


def test_a_state_that_the_device_reaches_can_be_given():
    """The deepest penetrations in ten seconds of the scenes with the hardest blows; no blow comes near the limit."""
    for name in ("unilateral", "device", "machine"):
        device = running(name)
        device.advance_to(10.0)
        blows = device.take_events()
        for side in device.scene.plates:
            hardest = blows["peak_force"][blows["kind"] == f"{side}_contact"].max()
            assert hardest / device.scene[f"{side}.plate.stiffness"] < 0.3 * device.scene.deepest_penetration(side)


@pytest.mark.parametrize(("given", "words"), REFUSED)
def test_an_impossible_state_is_refused_and_changes_nothing(given, words):
    device = vibro_ros.Simulator(vibro_ros.load_scene("rigid").with_parameters({"effects.normal_force": "unilateral"}))
    device.advance_to(0.5)
    with refused(device, re.escape(words)):
        device.set_state(**given)


def scene_of(name, **start):
    return vibro_ros.load_scene(name).with_parameters(
        {"start.state": "given", "motor.speed": 100.0, **{f"start.{field}": value for field, value in start.items()}})


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_given_start_of_zeros_is_the_start_zero_bit_for_bit(name):
    given, zero = (vibro_ros.Simulator(scene_of(name).with_parameters({
        "start.state": state})) for state in ("given", "zero"))
    assert_go_on_alike(given, zero, 0.5)
    assert given.statistics["steps"] == zero.statistics["steps"]
    assert np.array_equal(given.take_events(), zero.take_events())


@pytest.mark.parametrize("method", ["exact", "rk4"])
def test_every_method_begins_at_the_given_start(method):
    """With a standing crank, a mass of the frequency W that starts d from its slider at speed v moves by d cos Wt + v/W
    sin Wt.
    """
    start = {"crank_angle": math.pi, "upper_position": 0.02, "upper_velocity": -0.3, "body_position": 0.7}
    scene = scene_of("no_impact", **start).with_parameters({
        "motor.speed": 0.0, "solver.method": method, "solver.step": 1e-5})
    device = vibro_ros.Simulator(scene)
    assert device.state.crank_angle == math.pi and device.state.body_position == 0.7
    device.advance_to(0.05)
    slider, rate = 0.04, math.sqrt(scene["upper.spring.stiffness"] / scene["mass.upper"])
    expected = slider - 0.02 * math.cos(rate * 0.05) - 0.3 / rate * math.sin(rate * 0.05)
    error = {"exact": 1e-12, "rk4": 1e-9}[method]
    assert device.state.upper_position == pytest.approx(expected, abs=error)


def test_a_body_thrown_up_flies_a_parabola_and_reset_throws_it_again():
    device = vibro_ros.Simulator(scene_of("device", body_height=0.5, body_vertical_velocity=1.0, body_velocity=0.3)
                                 .with_parameters({"effects.upper_mass": False, "motor.speed": 0.0,
                                                   "start.inclined_position": 0.05, "effects.inclined_contact": "none",
                                                   "inclined.spring.stiffness": 0.0, "inclined.spring.damping": 0.0}))
    for _ in range(2):
        assert (device.state.body_height, device.state.body_velocity) == (0.5, 0.3)
        device.advance_to(0.3)
        assert device.state.body_height == pytest.approx(0.5 + 0.3 - 0.5 * 9.81 * 0.09, abs=1e-12)
        assert device.state.body_position == pytest.approx(0.09, abs=1e-12)
        device.reset()


@pytest.mark.parametrize(("changes", "words"), [
    ({"start.upper_position": 0.07},
     "start.upper_position: 0.07 m lies beyond the rigid plate at 0.06 m; give at most 0.06 m"),
    ({"start.body_height": 0.1}, "start.body_height: 0.1 m, but it stays 0 in this scene; leave it out, or give 0"),
    ({"effects.upper_mass": False, "start.upper_velocity": 1.0}, "start.upper_velocity: 1 m/s, but it stays 0")])
def test_an_impossible_start_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        scene_of("rigid").with_parameters(changes)
    assert scene_of("rigid").with_parameters(changes | {name: 0.0 for name in changes if name.startswith("start.")})


def test_a_mass_on_a_rigid_plate_as_far_as_rounding_goes_is_put_on_it():
    assert vibro_ros.Simulator(scene_of("rigid", upper_position=0.06 + 1e-15)).state.upper_position == 0.06


def test_the_numbers_of_a_start_that_is_not_given_change_nothing():
    scene = vibro_ros.load_scene("rigid").with_parameters({"start.upper_position": 9.0, "start.body_height": 1.0})
    assert vibro_ros.Simulator(scene).state == vibro_ros.Simulator(vibro_ros.load_scene("rigid")).state
