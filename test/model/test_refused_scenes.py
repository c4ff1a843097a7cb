"""A scene that no robot can be is refused in one line, which names the parameter, its value, and the remedy; the simple
bounds by which these checks save long computations are bounds of what they compute.
"""

import math

import numpy as np
import pytest

import vibro_ros
from vibro_ros.model import parameter_checks
from vibro_ros.model.parameter_checks import FASTEST_RATE, LEAST_INERTIA, fastest_rate, least_inertia
from vibro_ros.model.parameter_values import ParameterValues
from vibro_ros.model.parameters import BY_NAME

DC = {"effects.motor": "dc", "motor.acceleration": 0.0}
MISPRINT = {"effects.misprint": True}
STRIBECK = {"effects.friction": "stribeck", "ground.static_friction": 0.35, "ground.stribeck_speed": 0.02}
# Shipped scene and changes, and further changes by the words of the refusal.
REFUSED = [
    ("rigid", {}, {
        "effects.normal_force: 'printed' makes friction drive the body infinitely": {"effects.normal_force": "printed"},
        "guide.angle: 2 rad points the inclined guide down": {"guide.angle": 2.0},
        "upper.plate.restitution: 1.5 is out of range; give a number from 0 to 1": {"upper.plate.restitution": 1.5}}),
    ("paper", {}, {
        "ground.friction_backward: -0.5 is below 0; give at least 0, or -1": {"ground.friction_backward": -0.5},
        "choose coulomb, or give -1": {"ground.friction_backward": 0.3, "effects.friction": "static"},
        "choose weight for effects.normal_force, or give at most 1000": {"ground.friction_backward": 1e4},
        "give at most 10000 N·s/m": {"ground.viscous_friction": 1e5, "mass.body": 1e-3},
        "ground.slope: 1.6 is out of range; give a number from -1.5 to 1.5 rad": {"ground.slope": 1.6},
        "mass.upper_slider: 0.02 kg would be struck twice a turn.*at least 0.06006 m": {
            "mass.upper_slider": 0.02, "crank.radius": 0.06},
        **{f"mass.{side}_slider: 0.5 kg .*give 0, or true for effects.{side}_mass": {
            f"effects.{side}_mass": False, f"mass.{side}_slider": 0.5} for side in ("upper", "inclined")}}),
    ("paper", MISPRINT, {f"^effects.misprint: true .*{words}.*, or set effects.misprint to false$": changes
                         for words, changes in {
        "give true for effects.upper_mass": {"effects.upper_mass": False},
        "give true for effects.inclined_mass": {"effects.inclined_mass": False},
        "choose compliant": {"effects.inclined_contact": "none"},
        "restitution.*choose compliant": {"effects.inclined_contact": "restitution", "effects.normal_force": "weight"},
        "inclined.plate.stiffness is 0 N/m": {"inclined.plate.stiffness": 0.0},
        "give false for effects.reaction": {"effects.reaction": True}}.items()}),
    ("paper", DC, {
        "motor.static_friction: 0.01 N·m is below motor.friction, 0.03 N·m": {"motor.static_friction": 0.01},
        "motor.winding_inductance: 1e-09 H .*give 0, or at least 1.43e-07 H": {"motor.winding_inductance": 1e-9},
        "motor.crank_inertia: 0 kg·m² leaves .*at least 1e-09": {
            "motor.rotor_inertia": 0.0, "motor.crank_inertia": 0.0},
        "crank.upper_rod: 0.06 m is as long as the crank.*give at least 0.06006 m": {"crank.radius": 0.06},
        "motor.voltage: 40 is out of range.*motor.supply_voltage": {
            "motor.control": "voltage", "motor.voltage": 40.0}}),
    ("unilateral", STRIBECK, {
        "ground.static_friction: at 200 .*Painlevé": {"effects.reaction": True, "ground.static_friction": 200.0},
        "ground.static_friction: 0.19 .*0.2": {"ground.static_friction": 0.19},
        **{f"ground.stribeck_speed: {speed:g} .*1e-06.*1000 m/s": {"ground.stribeck_speed": speed}
           for speed in (0.0, 1e4)}}),
]


@pytest.mark.parametrize(("name", "changes", "words"), [
    (name, {**base, **changes}, words) for name, base, rows in REFUSED for words, changes in rows.items()])
def test_a_scene_that_no_robot_can_be_is_refused(name, changes, words):
    with pytest.raises(ValueError, match=words) as refusal:
        vibro_ros.load_scene(name).with_parameters(changes)
    assert "\n" not in str(refusal.value)


DEFAULTS = {name: parameter.default for name, parameter in BY_NAME.items()}


def drawn_values(seed: int) -> ParameterValues:
    """Values, unchecked, of a machine with the reaction, from sound to impossible ones."""
    rng = np.random.default_rng([51, seed])
    masses = {f"mass.{name}": 10.0 ** rng.uniform(-4.0, 1.0) for name in (
        "body", "upper", "inclined", "upper_slider", "inclined_slider", "crank_pin")}
    springs = {f"{side}.{part}.{kind}": 10.0 ** rng.uniform(0.0, most) for side in ("upper", "inclined")
               for part in ("spring", "plate") for kind, most in (("stiffness", 13.0), ("damping", 7.0))}
    return ParameterValues("drawn", DEFAULTS | masses | springs | {
        "effects.reaction": True, "effects.normal_force": str(rng.choice(["hop", "unilateral", "printed"])),
        "effects.motor": str(rng.choice(["dc", "ramp"])), "effects.friction": str(rng.choice(["coulomb", "stribeck"])),
        "motor.crank_inertia": 10.0 ** rng.uniform(-9.0, -3.0), "guide.angle": rng.uniform(0.0, math.pi),
        "ground.friction": 10.0 ** rng.uniform(-2.0, 1.0), "ground.static_friction": 10.0 ** rng.uniform(-2.0, 2.0),
        "effects.inclined_contact": str(rng.choice(["compliant", "restitution"]))})


def test_a_machine_that_is_accepted_by_bounds_has_enough_inertia_and_is_slow_enough():
    little = [values for values in map(drawn_values, range(1000)) if parameter_checks._yields_little(values)]
    assert 50 < len(little) < 900
    for values in little:
        assert least_inertia(values) >= LEAST_INERTIA and fastest_rate(values) <= FASTEST_RATE


def test_a_friction_that_is_accepted_by_its_bound_is_below_the_limit_at_every_angle_of_the_crank():
    for values in map(drawn_values, range(200)):
        (along, across), _ = np.moveaxis(parameter_checks._shock_inertia(values, values.guides), 0, -1)
        bound = 2.0 * values["mass.body"] / (values.total_mass - values["mass.body"])
        assert (along >= bound * abs(across) - 1e-9 * values.total_mass).all()
