"""The stateful device at the limits of its parameters: nothing infinite, no endless turns, energy accounted for."""

import math

import numpy as np
import pytest
from commanded_device import RAMP, SWINGING, booked_energy, device

from vibro_ros.model.slider import Slider

LIGHT = {"mass.body": 1e-3, "mass.upper": 1e-3, "mass.inclined": 1e-3}


@pytest.mark.parametrize("changes", [
    {"guide.angle": 0.0}, {"guide.angle": math.pi / 2}, {"guide.angle": math.pi}, {"gravity": 0.0},
    {"gravity": 0.0, "guide.angle": math.pi / 2}, {"ground.friction": 0.0},
    {"ground.friction": 1e3, "effects.reaction": False}, LIGHT,
    {"upper.spring.stiffness": 0.0, "inclined.spring.stiffness": 0.0},
    {"upper.plate.stiffness": 0.0, "inclined.plate.stiffness": 0.0},
    {"upper.plate.stiffness": 0.0, "inclined.plate.stiffness": 0.0, "effects.adhesion": False,
     "upper.plate.damping": 10.0, "inclined.plate.damping": 10.0},
    {"upper.plate.stiffness": 1e9, "inclined.plate.stiffness": 1e3},
    {"upper.plate.damping": 1e4, "inclined.plate.damping": 1e4},
    {"upper.spring.damping": 1e3, "inclined.spring.damping": 1e3},
    {"upper.gap": 0.06, "inclined.gap": -0.06}, {"upper.gap": -0.06, "inclined.gap": 0.06},
    {"motor.speed": 0.01}, {"motor.speed": 500.0}, {"motor.speed": 0.0}, {"crank.radius": 1e-12},
    {"crank.radius": 0.06, "motor.speed": 0.0}, {"crank.radius": 0.06, "guide.angle": math.pi / 2},
    {"effects.upper_mass": False}, {"effects.inclined_mass": False},
    {"effects.upper_mass": False, "effects.inclined_mass": False}, {"mass.body": 1e-3}, {"mass.body": 1e6}],
    ids=lambda changes: ",".join(f"{name}={value:g}" for name, value in changes.items())[:60])
@pytest.mark.parametrize("scene", ["paper", "unilateral", "damped", "device"])
def test_extremes(scene, changes):
    """No exception, nothing infinite, no mass beyond an open plate, friction within its bound, energy accounted for."""
    made = device(changes | {"solver.accounts": True}, scene)
    made.advance_to(0.05)
    made.command(motor_speed=80.0, upper_gap=0.0003, inclined_gap=-0.0003)
    samples = made._motion.sampled(np.linspace(0.05, 0.4, 1500))
    assert all(np.isfinite(values).all() for values in samples.values())
    for side in ("upper", "inclined"):
        if made.scene[f"effects.{side}_mass"] and made.scene["effects.adhesion"]:
            depth = samples[f"{side}_position"] - samples[f"{side}_plate_position"]
            stiff = made.scene[f"{side}.plate.stiffness"] > 0.0
            assert not np.any((samples[f"{side}_plate_force"] == 0.0) & (depth > 1e-12) & stiff)
    limit = made.scene["ground.friction"] * np.abs(samples["normal_force"])
    assert np.all(np.abs(samples["friction_force"]) <= limit + 1e-8 * max(1.0, made.scene["ground.friction"]))
    accounts = made.statistics["energy_accounts"]
    assert abs(accounts["residual"]) <= 1e-11 * booked_energy(accounts) + 1e-13


@pytest.mark.parametrize("damping", [0.0, 2.0, 300.0])
@pytest.mark.parametrize("adhesion", [True, False])
@pytest.mark.parametrize("load", [0.0, 1e-18, -1e-18, 1e-16, 1e-15, 1e-13, -1e-13])
def test_a_mass_that_rests_on_its_plate_without_load(load, damping, adhesion):
    """Preloads whose penetration is lost in rounding: contact and no contact must not take turns for ever."""
    rest = float(Slider(0.02, 0.06, 0.9).position(0.0))
    made = device(RAMP | {
        "guide.angle": 0.9, "effects.adhesion": adhesion, "upper.gap": 0.02 + load, "inclined.gap": rest - 0.06 + load,
        "upper.plate.stiffness": 1e9, "inclined.plate.stiffness": 1e7, "upper.spring.damping": damping,
        "inclined.spring.damping": damping, "upper.plate.damping": damping, "inclined.plate.damping": damping})
    made.advance_to(0.1)
    made.command(motor_speed=60.0)
    made.advance_to(0.2)
    made.command(motor_speed=0.0)
    made.advance_to(0.6)
    assert made.state.motor_speed == 0.0


# Scenes found by a search with random parameters; each ended with events that took turns at one instant.
@pytest.mark.parametrize(("changes", "speed"), [
    ({"crank.radius": 1.0215784556433672e-08, "guide.angle": math.pi, "inclined.gap": -0.02, "motor.speed": 5.68,
      "effects.normal_force": "printed", "mass.upper": 0.0809123920584814, "upper.gap": -1e-12, "mass.body": 0.0338,
      "upper.plate.stiffness": 1e9, "upper.spring.damping": 2.0, "upper.spring.stiffness": 20.87844653605529}, None),
    ({"effects.adhesion": False, "guide.angle": 0.9, "inclined.gap": 0.010350759266887128, "motor.speed": 0.0,
      "inclined.plate.stiffness": 1e3, "inclined.spring.damping": 78.6217151368093, "effects.motor": "ramp",
      "inclined.spring.stiffness": 81708.80232874175, "upper.gap": 0.019999999999841755,
      "upper.plate.damping": 100.0, "upper.plate.stiffness": 1657589.3619618749, "upper.spring.damping": 2.0,
      "upper.spring.stiffness": 1353.8469751853938}, 50.0)])
def test_modes_that_contradict_each_other_within_rounding(changes, speed):
    made = device(changes)
    made.advance_to(0.3)
    made.command(motor_speed=speed)
    made.advance_to(0.6)
    assert made.time == 0.6


def test_an_hour_of_standing_still_is_cheap():
    """The masses hang freely: one segment a tenth of their period, and the state stays what it was."""
    made = device(SWINGING | {"motor.speed": 0.0})
    before = made.state.upper_position
    made.advance_to(3600.0)
    assert made.state.upper_position == pytest.approx(before, abs=1e-15)
    assert made.statistics["steps"] < 3600 * 112 / 2 * 1.1
