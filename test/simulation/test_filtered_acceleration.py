"""The filtered acceleration of the body against closed forms and an independent integration."""

import math

import numpy as np
import pytest

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.simulator import Simulator

BANDWIDTH = 300.0
POLE = 2.0 * math.pi * BANDWIDTH * math.sqrt(0.5) * (-1.0 + 1.0j)
GAIN = math.sqrt(2.0) * abs(POLE)

ALONE = {"effects.upper_mass": False, "effects.inclined_mass": False, "start.state": "given", "motor.speed": 0.0}


def filtered(state: complex) -> float:
    return GAIN * state.imag


def falling_body(time: float) -> float:
    """Return the filtered vertical acceleration of a body that falls from 0.1 m at rest, lands, and lies."""
    landing = math.sqrt(2.0 * 0.1 / 9.81)
    falls = min(time, landing)
    state = -9.81 * (np.exp(POLE * (time - falls)) - np.exp(POLE * time)) / -POLE
    return filtered(state + (9.81 * landing * np.exp(POLE * (time - landing)) if time > landing else 0.0))


def test_a_landing_is_a_step_of_the_speed():
    """A61."""
    scene = Scene("fall", {**ALONE, "effects.upper_mass": True, "upper.spring.stiffness": 0.0,
                           "effects.upper_contact": "none", "effects.normal_force": "hop", "start.body_height": 0.1})
    device = Simulator(scene, BANDWIDTH)
    for time in (0.01, 0.1, 0.142, 0.1433, 0.15, 0.2):  # it lands at 0.14278 s
        device.advance_to(time)
        assert device.filtered_acceleration()[1] == pytest.approx(falling_body(time), abs=1e-9 * GAIN)


def test_a_body_that_oil_stops():
    """A61."""
    scene = Scene("oil", {**ALONE, "effects.friction": "none", "ground.viscous_friction": 40.0,
                          "start.body_velocity": 2.0})
    device, rate = Simulator(scene, BANDWIDTH), 40.0 / scene.total_mass
    for time in (0.001, 0.01, 0.1):
        device.advance_to(time)
        state = -2.0 * rate * (np.exp(-rate * time) - np.exp(POLE * time)) / (-rate - POLE)
        assert device.filtered_acceleration()[0] == pytest.approx(filtered(state), rel=1e-11)


def by_fine_steps(scene: Scene, until: float, count: int) -> np.ndarray:
    """Return filtered accelerations along x and z from samples of the speed and the middle of each step, at order 2."""
    times = np.linspace(0.0, until, count + 1)
    run = Simulator(scene).sample(times)
    kernel = np.exp(POLE * (until - 0.5 * (times[1:] + times[:-1])))
    return np.array([filtered(np.diff(speed) @ kernel) for speed in (run.body_velocity, run.body_vertical_velocity)])


@pytest.mark.parametrize("name, changes", [
    ("damped", {}), ("unilateral", {"effects.friction": "stribeck"}), ("damped", {"effects.reaction": True}),
    ("device", {"motor.speed": 100.0})])
def test_agrees_with_fine_steps(name, changes):
    scene, until = load_scene(name).with_parameters(changes), 0.1
    device = Simulator(scene, BANDWIDTH)
    for time in np.linspace(0.0, until, 27):
        device.advance_to(time)
        device.filtered_acceleration()
    exact, coarse, fine = device.filtered_acceleration(), *(by_fine_steps(scene, until, n) for n in (20000, 200000))
    # A landing within a step leaves an error of order 1: of the step of 0.5 us, some 1e-3 of the pole's rate.
    assert np.abs(exact - fine).max() < 2e-3 * max(1.0, np.abs(fine).max()) if name == "device" else (
        np.abs(exact - fine).max() < 0.02 * np.abs(exact - coarse).max() + 1e-9)


@pytest.mark.parametrize("name", ["damped", "device"])
def test_an_array_has_the_bits_of_single_calls(name):
    """Across the ends of a push, and the edges of a patch of ice, at which the solver's system changes."""
    scene = load_scene(name).with_parameters({"motor.speed": 100.0})
    arrays, single = (Simulator(scene, BANDWIDTH) for _ in range(2))
    times = np.linspace(0.0, 0.6, 601)
    for device in (arrays, single):
        device.push(0.05, force_x=20.0)
        device.fail("friction_patch", 1.0, value=0.02, from_x=-0.02, to_x=0.01)
    samples, accelerations = arrays.sample_filtered(times)
    for k, time in enumerate(times):
        single.advance_to(time)
        assert tuple(accelerations[k]) == single.filtered_acceleration()
        assert samples.body_position[k] == single.state.body_position
    assert np.abs(samples.body_position).max() > 0.02 and (accelerations[:, 1] != 0.0).any() == scene.body_hops


def test_a_device_without_a_filter_has_no_array_of_it():
    with pytest.raises(ValueError, match="acceleration_bandwidth: .* made without a filter"):
        Simulator(load_scene("damped")).sample_filtered([0.1])


def test_a_forged_filter_is_refused():
    scene = load_scene("damped")
    device = Simulator(scene, BANDWIDTH)
    good, filters = device.checkpoint(), device._motion.state.lowpass
    filters["channel"] += 10**6  # which a kernel would read from foreign memory
    forged = device.checkpoint()
    filters["channel"] -= 10**6
    assert np.count_nonzero(forged != good) == 1
    with pytest.raises(ValueError, match="no state that this device can be in"):
        device.restore(forged)


def test_no_filter_by_steps_of_fixed_length():
    with pytest.raises(ValueError, match="choose exact"):
        Simulator(load_scene("paper").with_parameters({"solver.method": "rk4"}), BANDWIDTH)


def test_reading_the_energy_does_not_change_the_filter():
    """To read the accounts, the mode is ended in a copy of the state, so the filters of the device do not change."""
    scene = load_scene("device").with_parameters({"motor.speed": 100.0, "solver.accounts": True})
    device, left_alone = Simulator(scene, BANDWIDTH), Simulator(scene, BANDWIDTH)
    for tick in range(1, 101):
        for each in (device, left_alone):
            each.advance_to(0.005 * tick)
        assert abs(device.statistics["energy_accounts"]["residual"]) < 1e-9
    assert device.filtered_acceleration() == left_alone.filtered_acceleration()
