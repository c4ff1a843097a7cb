"""Random scenes: every effect's every choice, and numbers from all of their legal ranges.

Everything is read off the parameter table, so that a new choice is drawn as soon as the table has it. Two scenes in
three are rich: both masses, both plates, friction, and mostly the reaction; or what happens only when effects meet
would hardly ever be drawn. The others are whatever comes. A draw depends on the state of its generator only, and each
parameter's value on the parameter's own generator, seeded by its name: a new parameter leaves the values of the others.
"""

import math
import zlib

import numpy as np

import vibro_ros
from vibro_ros.model.parameter_values import ParameterValues
from vibro_ros.model.parameters import SCENE_PARAMETERS

SIDES = ("upper", "inclined")
_TABLE = {parameter.name: parameter for parameter in SCENE_PARAMETERS}
# Where a range spans decades down to zero, the decades drawn end this far below the default or, where that is 0, at 1.
_DECADES = 3.0
_DRAWN_TOGETHER = {"effects.misprint", "guide.angle", "crank.radius", "upper.gap", "inclined.gap", "motor.speed",
                   "ground.static_friction", "ground.friction_backward", "motor.voltage", "motor.static_friction"}
_STARTS = "start.state"
_DRAWN_ALONE = [parameter for name, parameter in _TABLE.items()
                if name not in _DRAWN_TOGETHER and not name.startswith(("solver.", "sensors."))
                and (name == _STARTS or not name.startswith("start."))]
_FIXED = {"solver.accounts": True}
# Values of a rich scene, each as likely; of a choice, all but `none`.
_RICH_VALUES = {"effects.upper_mass": [True], "effects.inclined_mass": [True], "effects.adhesion": [True, False],
                "effects.reaction": [True, True, False], "effects.mass_weight": [True, False]}


def draw_scenario(rng):
    """A scene, up to two commands (instant [s], keywords), and the end of the run [s]."""
    scene = draw_scene(rng)
    end = slowest_time(scene) * _one_of(rng, [3.0, 20.0])
    parts = sorted(_between(rng, 0.0, 1.0) for _ in range(rng.integers(3)))
    return scene, [(part * end, _command(rng, scene)) for part in parts], end


def draw_scene(rng):
    """Draw a scene that `Scene` accepts; a refusal must name a parameter and a remedy, and another scene is drawn."""
    while True:
        try:
            return vibro_ros.Scene("any", _values(rng))
        except ValueError as refusal:
            name, _, reason = str(refusal).partition(":")
            assert name in _TABLE and ("give" in reason or "choose" in reason), refusal


def slowest_time(scene):
    """The longest of the scene's own times [s]: of a turn, or of a period of a mass on its spring."""
    turn = 2.0 * math.pi / abs(scene["motor.speed"]) if scene["motor.speed"] else 0.0
    periods = [2.0 * math.pi * math.sqrt(scene[f"mass.{side}"] / scene[f"{side}.spring.stiffness"])
               for side in scene.guides if scene[f"{side}.spring.stiffness"]]
    return max([turn, *periods]) or 1.0


def _command(rng, scene):
    """Draw the keywords of a command: a speed, and gaps equal to the scene's or some tenths of a millimetre off."""
    factor, faster = _one_of(rng, [0.0, 0.5, 1.0, 2.0]), _one_of(rng, [0.0, 10.0])
    commands = {"motor_speed": min(scene["motor.max_speed"], abs(scene["motor.speed"]) * factor + faster)}
    commands["motor_speed"] *= _one_of(rng, [1.0, -1.0])
    if scene.motor_command == "motor_voltage":
        commands = {"motor_voltage": _between(rng, -1.0, 1.0) * scene["motor.supply_voltage"]}
    if scene.linkage and scene["effects.motor"] == "ideal":  # whose speed may not jump then
        commands = {}
    for side in SIDES:
        gap, rod = scene[f"{side}.gap"] + _one_of(rng, [0.0, 1e-4, -1e-4, 1e-3, -1e-3]), scene[f"crank.{side}_rod"]
        commands[f"{side}_gap"] = min(max(gap, -rod), rod)
    return commands


def _values(rng):
    """Draw the values of all parameters."""
    seed = int(rng.integers(2**63))

    def rng_of(name):
        return np.random.default_rng([seed, zlib.crc32(name.encode())])

    wild, rich = _one_of(rng_of("wild"), [False, False, True]), _one_of(rng_of("rich"), [False, True, True])
    values = dict(_FIXED)
    for parameter in _DRAWN_ALONE:
        values[parameter.name] = _value(rng_of(parameter.name), parameter, wild, rich)
    if rich:
        values |= _compatible(values)
        values["ground.friction"] *= _one_of(rng_of("less friction"), [1.0, 0.1])  # or most bodies would hardly slip
    values |= _geometry(rng_of("geometry"), values)
    values |= {f"mass.{side}_slider": 0.0 for side in SIDES if not values[f"effects.{side}_mass"]}
    speed = rng_of("motor.speed")
    values["motor.speed"] = min(values["motor.max_speed"], _number(speed, _TABLE["motor.speed"], wild))
    values["motor.speed"] *= _one_of(speed, [1.0, -1.0])
    if values["effects.motor"] == "dc":
        values["motor.speed"] *= _one_of(speed, [1.0, 1.0, 0.0])
        values["motor.voltage"] = _between(rng_of("motor.voltage"), -1.0, 1.0) * values["motor.supply_voltage"]
        values["motor.static_friction"] = min(
            1e6, values["motor.friction"] * _one_of(rng_of("motor.static_friction"), [1.0, 1.2, 3.0]))
        values["crank.radius"] *= _one_of(rng_of("shorter crank"), [0.99, 0.3])
    values["effects.misprint"] = _may_be_misprinted(values) and _one_of(rng_of("effects.misprint"), [False, True])
    values["ground.static_friction"] = min(
        1e3, values["ground.friction"] * _one_of(rng_of("ground.static_friction"), [1.0, 1.2, 3.0]))
    if values["effects.friction"] == "coulomb":
        values["ground.friction_backward"] = _one_of(
            rng_of("ground.friction_backward"), [-1.0, min(1e3, values["ground.friction"] * 3.0), 0.0])
    return values | _given_start(rng_of("start"), values) if values[_STARTS] == "given" else values


def _value(rng, parameter, wild, rich):
    if rich and parameter.name in _RICH_VALUES:
        return _one_of(rng, _RICH_VALUES[parameter.name])
    if isinstance(parameter.default, bool):
        return _one_of(rng, [parameter.default, parameter.default, not parameter.default])
    if parameter.choices:
        return _one_of(rng, [choice for choice in parameter.choices if choice != "none" or not rich])
    return _number(rng, parameter, wild)


def _number(rng, parameter, wild):
    """Draw a number: near the default, the default itself, zero, or from all legal decades if `wild`."""
    if parameter.maximum <= 1.0:
        return _one_of(rng, [_between(rng, 0.0, 1.0), _one_of(rng, [0.0, 0.5, 1.0])])
    if _one_of(rng, [False, False, True]):
        return _one_of(rng, [parameter.default, parameter.default, parameter.default if parameter.positive else 0.0])
    centre = parameter.default or 1.0
    low, high = (centre * 10.0**-_DECADES, parameter.maximum) if wild else (centre / 3.0, centre * 3.0)
    high = min(high, parameter.maximum)
    return min(max(10.0 ** _between(rng, math.log10(low), math.log10(high)), low), high)


def _compatible(values):
    """Return changes of a rich scene that replace rigid plates by compliant ones under the rule `printed`, because the
    combination is refused and such scenes would become rare.
    """
    if values["effects.normal_force"] != "printed":
        return {}
    return {f"effects.{side}_contact": "compliant" for side in SIDES
            if values[f"effects.{side}_contact"] == "restitution"}


def _may_be_misprinted(values):
    """Whether the scene may have the misprint; other robots with the misprint are nearly always refused, so that the
    draw would be repeated.
    """
    has_both_masses = values["effects.upper_mass"] and values["effects.inclined_mass"]
    plate = values["effects.inclined_contact"] == "compliant" and values["inclined.plate.stiffness"] > 0.0
    return has_both_masses and plate and not values["effects.reaction"]


def _geometry(rng, values):
    """Draw crank, guide and gaps; the crank may be exactly as long as a rod, and the angle exactly 0, π/2 or π."""
    shorter = min(values["crank.upper_rod"], values["crank.inclined_rod"])
    radius = shorter * _one_of(rng, [1.0, _between(rng, 1e-3, 1.0), 1.0 / 3.0])
    angle = _one_of(rng, [_between(rng, 0.0, math.pi), _between(rng, 0.2, 1.4),
                          _one_of(rng, [0.0, math.pi / 2, math.pi])])
    gaps = {f"{side}.gap": _gap(rng, [radius, values[f"crank.{side}_rod"]]) for side in SIDES}
    return {"crank.radius": radius, "guide.angle": angle} | gaps


def _gap(rng, lengths):
    """Zero, or up to one of `lengths` either way, often tiny."""
    if _one_of(rng, [False, True]):
        return 0.0
    return _between(rng, -1.0, 1.0) * _one_of(rng, [0.0, 1e-9, 0.1, 0.5, 1.0]) * _one_of(rng, lengths)


def _given_start(rng, values):
    """Draw a given start: masses near their plates, not deep in them, moving in any direction."""
    start = {"start.crank_angle": _between(rng, -50.0, 50.0)}
    speed = values["crank.radius"] * abs(values["motor.speed"])
    for side in SIDES:
        if values[f"effects.{side}_mass"]:
            plate, rigid = values[f"crank.{side}_rod"] + values[f"{side}.gap"], values[f"effects.{side}_contact"]
            beyond = 0.0 if rigid == "restitution" else 1e-3 * values["crank.radius"]
            start[f"start.{side}_position"] = plate + _between(rng, -values["crank.radius"], beyond)
            start[f"start.{side}_velocity"] = _between(rng, -speed, speed)
    scene = ParameterValues("any", values)
    if scene.body_moves:
        start |= {"start.body_position": _between(rng, -1.0, 1.0), "start.body_velocity": _between(rng, -speed, speed)}
    if scene.body_hops:
        start |= {"start.body_height": _between(rng, 0.0, values["crank.radius"]),
                  "start.body_vertical_velocity": _between(rng, -speed, speed)}
    return start


def _between(rng, low, high):
    """A number from `low` to `high`; one in eight is an end, the next number to it, or the middle."""
    special = [low, math.nextafter(low, high), (low + high) / 2.0, math.nextafter(high, low), high]
    return _one_of(rng, special) if rng.random() < 0.125 else low + (high - low) * rng.random()


def _one_of(rng, values):
    """Draw one of `values` with equal probability; numpy's choice would convert it to a type of numpy."""
    return values[rng.integers(len(values))]
