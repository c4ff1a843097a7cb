"""`start.state: given`: the device starts in the state of the parameters, and an impossible state is refused."""

import math

import numpy as np
import pytest
from commanded_device import assert_go_on_alike

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes


def scene_of(name, **start):
    return vibro_ros.load_scene(name).with_parameters(
        {"start.state": "given", "motor.speed": 100.0, **{f"start.{field}": value for field, value in start.items()}})


@pytest.mark.parametrize("name", shipped_scenes())
def test_with_every_number_0_it_is_the_start_zero_bit_for_bit(name):
    given, zero = (vibro_ros.Simulator(scene_of(name).with_parameters({
        "start.state": state})) for state in ("given", "zero"))
    assert_go_on_alike(given, zero, 0.5)
    assert given.statistics["steps"] == zero.statistics["steps"]
    assert np.array_equal(given.take_events(), zero.take_events())


@pytest.mark.parametrize("method", ["exact", "rk4"])
def test_every_method_begins_there(method):
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
def test_what_cannot_be_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        scene_of("rigid").with_parameters(changes)
    assert scene_of("rigid").with_parameters(changes | {name: 0.0 for name in changes if name.startswith("start.")})


def test_a_mass_on_a_rigid_plate_as_far_as_rounding_goes_is_put_on_it():
    assert vibro_ros.Simulator(scene_of("rigid", upper_position=0.06 + 1e-15)).state.upper_position == 0.06


def test_the_numbers_of_a_start_that_is_not_given_change_nothing():
    scene = vibro_ros.load_scene("rigid").with_parameters({"start.upper_position": 9.0, "start.body_height": 1.0})
    assert vibro_ros.Simulator(scene).state == vibro_ros.Simulator(vibro_ros.load_scene("rigid")).state
