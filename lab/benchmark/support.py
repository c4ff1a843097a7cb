"""Table of the parameter values that each simulator supports.

The device's own methods integrate the compiled equations, so they support every parameter. Two simulators have
equations of their own: `lab/benchmark/heyoka_robot` and `lab/benchmark/rk4_by_hand.py`. `SUPPORT` lists for every
parameter the values that each of the two supports. Of a parameter that is not in the table they support only the
default, with which a new parameter has no effect; a new choice or number is therefore refused until its equations are
written.
"""

from collections.abc import Mapping

from vibro_ros import PARAMETERS, Scene, Value

SIMULATORS = ("heyoka_robot", "rk4_by_hand")
ANY = None
_SWITCH = (True, False)
_CONTACTS = ("none", "restitution", "compliant")
_FRICTIONS = ("none", "coulomb", "static", "stribeck")
_RULES = ("weight", "unilateral", "printed", "hop")

#: For each parameter, the values that each of `SIMULATORS` supports, in their order, or `ANY`. A number that matters
#: only with a choice that a simulator refuses counts as supported.
SUPPORT: Mapping[str, tuple[tuple[Value, ...] | None, ...]] = {
    **dict.fromkeys((
        "mass.body", "mass.upper", "mass.inclined", "body.inertia", "body.wheelbase", "body.crank_offset",
        "crank.radius", "crank.upper_rod", "crank.inclined_rod",
        "guide.angle", "upper.spring.stiffness", "upper.spring.damping", "upper.plate.stiffness",
        "upper.plate.damping", "upper.plate.restitution", "upper.gap", "inclined.spring.stiffness",
        "inclined.spring.damping", "inclined.plate.stiffness", "inclined.plate.damping", "inclined.plate.restitution",
        "inclined.gap", "ground.friction", "ground.static_friction", "ground.stribeck_speed", "gravity", "motor.speed",
        "motor.max_speed", "motor.acceleration", "motor.time_constant", "gap_actuator.speed", "start.body_position",
        "start.body_velocity", "start.body_height", "start.body_vertical_velocity", "start.upper_position",
        "start.upper_velocity", "start.inclined_position", "start.inclined_velocity", "start.crank_angle"),
        (ANY, ANY)),
    **dict.fromkeys(("ground.slope", "ground.viscous_friction", "ground.drag", "ground.restitution",
                     "mass.upper_slider", "mass.inclined_slider", "mass.crank_pin"), (ANY, (0.0,))),
    "ground.friction_backward": (ANY, (PARAMETERS["ground.friction_backward"].default,)),
    **dict.fromkeys((  # of a dc motor, which `rk4_by_hand` refuses
        "motor.control", "motor.voltage", "motor.supply_voltage", "motor.winding_resistance",
        "motor.winding_inductance", "motor.torque_constant", "motor.gear_ratio", "motor.rotor_inertia",
        "motor.crank_inertia", "motor.damping", "motor.friction", "motor.static_friction", "motor.current_limit",
        "motor.continuous_current", "motor.control_rate", "motor.proportional_gain", "motor.integral_gain",
        "motor.feed_forward", "motor.current_time_constant"), (ANY, ANY)),
    "start.state": (("rest", "zero", "given"), ("rest", "zero")),
    "effects.upper_mass": (_SWITCH, (True,)),
    "effects.inclined_mass": (_SWITCH, (True,)),
    "effects.upper_contact": (_CONTACTS, _CONTACTS),
    "effects.inclined_contact": (_CONTACTS, _CONTACTS),
    "effects.adhesion": (_SWITCH, _SWITCH),
    "effects.friction": (_FRICTIONS, ("none", "coulomb")),
    "effects.normal_force": (_RULES, _RULES),
    "effects.reaction": (_SWITCH, _SWITCH),
    "effects.misprint": (_SWITCH, (False,)),
    "effects.mass_weight": (_SWITCH, _SWITCH),
    "effects.motor": (("ideal", "ramp", "lag", "dc"), ("ideal", "ramp")),
}


def unsupported(values: Scene, simulator: str) -> str:
    """Return the first parameter of a scene that one of `SIMULATORS` does not support, with the value and the default.

    Empty if it supports all.
    """
    for name, value in values.parameters.items():
        default = PARAMETERS[name].default
        known = SUPPORT[name][SIMULATORS.index(simulator)] if name in SUPPORT else (default,)
        if known is not ANY and value not in known and not name.startswith(("solver.", "sensors.")):
            return f"{name}: {_shown(value)} is not simulated by {simulator}; give {_shown(default)}"
    return ""


def _shown(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value)
