"""A hypothesis strategy for scenes: every effect's every choice, and numbers from all of their legal ranges.

Everything is read off the parameter table, so that a new choice is drawn as soon as the table has it. Two scenes in
three are rich: both masses, both plates, friction, and mostly the reaction; or what happens only when effects meet
would hardly ever be drawn. The others are whatever comes.
"""

import functools
import math

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

import vibro_ros
from vibro_ros.model.parameters import SCENE_PARAMETERS

SIDES = ("upper", "inclined")
_TABLE = {parameter.name: parameter for parameter in SCENE_PARAMETERS}
# Where a range spans decades down to zero, the decades drawn end this far below the default or, where that is 0, at 1.
_DECADES = 3.0
_OTHERWISE = {"guide.angle", "crank.radius", "upper.gap", "inclined.gap", "motor.speed", "ground.static_friction"}
_FIXED = {"solver.audit": True}
# Values of a rich scene, each as likely; of a choice, all but `none`.
_RICH = {"effects.upper_mass": [True], "effects.inclined_mass": [True], "effects.adhesion": [True, False],
         "effects.reaction": [True, True, False], "effects.mass_weight": [True, False]}


def _log_uniform(low, high):
    return st.floats(math.log10(low), math.log10(high)).map(lambda exponent: min(max(10.0**exponent, low), high))


def _number(parameter, wild):
    """Within a factor of three of the default; from all of the legal decades if `wild`; or the default; or zero."""
    centre = parameter.default or 1.0
    usual = st.just(parameter.default)
    if not parameter.positive:
        usual = st.sampled_from([parameter.default, parameter.default, 0.0])
    if parameter.maximum <= 1.0:
        return st.one_of(st.floats(0.0, 1.0), st.sampled_from([0.0, 0.5, 1.0]))
    low, high = (centre * 10.0**-_DECADES, parameter.maximum) if wild else (centre / 3.0, centre * 3.0)
    drawn = _log_uniform(low, min(high, parameter.maximum))
    return st.one_of(drawn, drawn, usual)


def _value(parameter, wild, rich):
    if rich and parameter.name in _RICH:
        return st.sampled_from(_RICH[parameter.name])
    if isinstance(parameter.default, bool):
        return st.sampled_from([parameter.default, parameter.default, not parameter.default])
    if parameter.choices:
        return st.sampled_from([choice for choice in parameter.choices if choice != "none" or not rich])
    return _number(parameter, wild)


@functools.cache
def _drawn_alone(wild, rich):
    return {name: _value(parameter, wild, rich) for name, parameter in _TABLE.items()
            if name not in _OTHERWISE and not name.startswith("solver.")}


@st.composite
def scenes(draw):
    """A scene that `Scene` accepts; what it refuses must name a parameter and a remedy."""
    wild, rich = draw(st.sampled_from([False, False, True])), draw(st.sampled_from([False, True, True]))
    values = _FIXED | {name: draw(value) for name, value in _drawn_alone(wild, rich).items()}
    if rich and values["effects.friction"] == "stribeck":  # which is refused with these, and would be rare
        values["effects.reaction"] = False
        values["effects.normal_force"] = draw(st.sampled_from(
            [rule for rule in _TABLE["effects.normal_force"].choices if rule != "hop"]))
    if rich and values["effects.normal_force"] == "printed":  # which is refused with rigid plates
        for side in SIDES:
            if values[f"effects.{side}_contact"] == "restitution":
                values[f"effects.{side}_contact"] = "compliant"
    shorter = min(values["crank.upper_rod"], values["crank.inclined_rod"])
    values["crank.radius"] = shorter * draw(st.one_of(st.just(1.0), st.floats(1e-3, 1.0), st.just(1.0 / 3.0)))
    values["guide.angle"] = draw(st.one_of(st.floats(0.0, math.pi), st.floats(0.2, 1.4),
                                           st.sampled_from([0.0, math.pi / 2, math.pi])))
    for side in SIDES:
        near = st.sampled_from([0.0, 1e-9, 0.1, 0.5, 1.0])
        part = draw(st.floats(-1.0, 1.0)) * draw(near) if draw(st.booleans()) else 0.0
        values[f"{side}.gap"] = part * draw(st.sampled_from([values["crank.radius"], values[f"crank.{side}_rod"]]))
    if rich:
        values["ground.friction"] *= draw(st.sampled_from([1.0, 0.1]))  # or most bodies would hardly slip
    values["motor.speed"] = min(values["motor.max_speed"], draw(_number(_TABLE["motor.speed"], wild)))
    values["ground.static_friction"] = min(1e3, values["ground.friction"] * draw(st.sampled_from([1.0, 1.2, 3.0])))
    try:
        return vibro_ros.Scene("any", values)
    except ValueError as refusal:
        name, _, reason = str(refusal).partition(":")
        assert name in _TABLE and ("give" in reason or "choose" in reason), refusal
        assume(False)


def slowest_time(scene):
    """The longest of the scene's own times [s]: a turn, a period of a mass on its spring."""
    turn = 2.0 * math.pi / scene["motor.speed"] if scene["motor.speed"] else 0.0
    periods = [2.0 * math.pi * math.sqrt(scene[f"mass.{side}"] / scene[f"{side}.spring.stiffness"])
               for side in scene.guides if scene[f"{side}.spring.stiffness"]]
    return max([turn, *periods]) or 1.0


def affordable(scene, commands, end, steps):
    """`end`, or an instant before it by which the run has taken `steps` steps, at most about twice as many."""
    device, taken = vibro_ros.Simulator(scene), 0.0
    for start, stop, wanted in zip([0.0, *(at for at, _ in commands)], [*(at for at, _ in commands), end],
                                   [{}, *(wanted for _, wanted in commands)], strict=True):
        device.command(**wanted)
        for fraction in 2.0 ** np.arange(-30, 1):
            taken = min(start + (stop - start) * fraction, stop)  # a sum may be rounded up
            device.advance_to(taken)
            if device.statistics["steps"] > steps:
                return taken
    return taken


@st.composite
def scenarios(draw, steps=700):
    """A scene, up to two commands (instant [s], keywords), and the end of the run [s]."""
    scene = draw(scenes())
    end = slowest_time(scene) * draw(st.sampled_from([3.0, 20.0]))
    commands = []
    for part in sorted(draw(st.lists(st.floats(0.0, 1.0), max_size=2))):
        factor, faster = draw(st.sampled_from([0.0, 0.5, 1.0, 2.0])), draw(st.sampled_from([0.0, 10.0]))
        wanted = {"motor_speed": min(scene["motor.max_speed"], scene["motor.speed"] * factor + faster)}
        for side in SIDES:
            gap = scene[f"{side}.gap"] + draw(st.sampled_from([0.0, 1e-4, -1e-4, 1e-3, -1e-3]))
            rod = scene[f"crank.{side}_rod"]
            wanted[f"{side}_gap"] = min(max(gap, -rod), rod)
        commands.append((part * end, wanted))
    end = affordable(scene, commands, end, steps)
    return scene, [command for command in commands if command[0] <= end], end
