"""The simple bounds by which the checks of a scene save their long computations are bounds of what these compute."""

import math

import numpy as np

from vibro_ros.model import parameter_checks
from vibro_ros.model.parameter_checks import FASTEST_RATE, LEAST_INERTIA, fastest_rate, least_inertia
from vibro_ros.model.parameter_values import ParameterValues
from vibro_ros.model.parameters import BY_NAME

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
