"""A scene: a value for every parameter, checked as a whole; and the checks of states that users give.

The scene's own start and `Simulator.set_state` are checked by the same functions, so that both refuse the same states.
"""

import functools
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar

from vibro_ros.model.parameter_checks import check_machine, check_operation
from vibro_ros.model.parameter_values import ParameterValues
from vibro_ros.model.parameters import BY_NAME, Parameter, Value, checked_parameters, quoted

# Parameters that decide how a robot is started, driven and solved. They enter no equation, so that a sweep over them
# compiles the equations only once.
_OPERATION = frozenset({
    *(name for name in BY_NAME if name.startswith(("start.", "sensors."))),
    "effects.motor", "motor.speed", "motor.max_speed", "motor.acceleration", "motor.time_constant",
    "motor.voltage", "motor.continuous_current", "body.inertia", "body.wheelbase", "body.crank_offset", "upper.gap",
    "inclined.gap", "gap_actuator.speed", "solver.method", "solver.step", "solver.tolerance"})

# Parameters that enter no equation without a dc motor.
_WITHOUT_DC_MOTOR = _OPERATION | {name for name in BY_NAME if name.startswith("motor.")}

_DEFAULTS = {name: parameter.default for name, parameter in BY_NAME.items()}

PREFIX = "start."  # prefix of the parameters of a given start; a field of `Samples` follows it
NUMBERS: Mapping[str, Parameter] = {
    name.removeprefix(PREFIX): replace(parameter, name=name.removeprefix(PREFIX), negligible=0.0)
    for name, parameter in BY_NAME.items() if name.startswith(PREFIX) and isinstance(parameter.default, float)}
"""Numbers of a given state besides motor speed and plates: fields of `Samples`, each with its unit and limits."""
ROUNDING = 1e-12
"""Penetration of a rigid plate [m] that counts as rounding in a given state; the mass is then put on the plate."""


@dataclass(frozen=True)
class Scene(ParameterValues):
    """Every parameter of a simulation; immutable.

    `name` is that in logs and recordings. `parameters` maps each name to its value in SI units; `PARAMETERS` describes
    each. ValueError if a parameter is unknown, of the wrong type or out of range, or if parameters contradict each
    other; the message names the value, the limit and the remedy.

    Examples
    --------
    >>> scene = vibro_ros.Scene("heavy", {"mass.body": 2.0})
    >>> scene["mass.body"], scene["crank.radius"]
    (2.0, 0.02)
    """

    # The package `model` sets this method, because the module of the method imports this one.
    describe: ClassVar[Callable[["Scene"], str]]
    """Return states, forcing, equations, modes, guards and events in the paper's symbols with values."""

    def __post_init__(self) -> None:
        complete = _DEFAULTS | checked_parameters(self.parameters, BY_NAME.values())
        object.__setattr__(self, "parameters", MappingProxyType(complete))
        self._check_together()

    def _check_together(self) -> None:
        """Refuse checked values that contradict each other."""
        _check_machine_once(self.machine)
        check_operation(self)
        self.checked_motor_speed(self["motor.speed"])
        if self.motor_command == "motor_voltage":
            self.checked_motor_voltage(self["motor.voltage"])
        for side in ("upper", "inclined"):
            self.checked_gap(side, self[f"{side}.gap"])
        if self["start.state"] == "given":
            given_start(self)

    def __reduce__(self):
        return _scene_once_checked, (self.name, dict(self.parameters))

    def __repr__(self) -> str:
        """Return the call that makes this scene; parameters with their default value are left out."""
        changed = {name: value for name, value in self.parameters.items() if value != _DEFAULTS[name]}
        return f"Scene({self.name!r}, {changed!r})"

    def __hash__(self) -> int:
        return hash((self.name, tuple(self.parameters.values())))

    def with_parameters(self, changes: Mapping[str, object]) -> "Scene":
        """Return this scene with the values of `changes`, a mapping from names to values (ValueError as for `Scene`).

        Examples
        --------
        >>> steep = vibro_ros.load_scene("paper").with_parameters({"guide.angle": 1.2})
        >>> steep["guide.angle"]
        1.2
        >>> steep.with_parameters({"guide.angle": 4.0})
        Traceback (most recent call last):
        ValueError: guide.angle: 4 is out of range; give a number from 0 to 3.14159 rad
        """
        if not changes:
            return self
        changed = checked_parameters(changes, BY_NAME.values())
        scene = _unchecked(self.name, {**self.parameters, **changed})
        scene._check_together()
        return scene

    def checked_motor_speed(self, value: object) -> float:
        """Return `value` as a motor speed [rad/s]; raise ValueError if the motor cannot reach it."""
        return _within("motor.speed", value, self["motor.max_speed"], "motor.max_speed")

    def checked_command(self, name: str, value: object) -> float:
        """Return the `value` of the command `name`, an argument of `Simulator.command`; raise ValueError if refused."""
        if name not in ("motor_speed", "motor_voltage"):
            return self.checked_gap(name.removesuffix("_gap"), value)
        if name == self.motor_command:
            return self.checked_motor_speed(value) if name == "motor_speed" else self.checked_motor_voltage(value)
        other = self.motor_command
        raise ValueError(f"{name}: {quoted(value)} is no command of this motor; command {other}, or choose "
                         + ("effects.motor dc and motor.control voltage" if name == "motor_voltage" else
                            "speed_by_voltage or speed_by_current for motor.control"))

    def checked_motor_voltage(self, value: object) -> float:
        """Return `value` as a voltage [V]; raise ValueError if the motor's supply cannot give it."""
        return _within("motor.voltage", value, self["motor.supply_voltage"], "motor.supply_voltage")

    def checked_gap(self, side: str, value: object) -> float:
        """Return `value` as a gap [m] of the `upper` or `inclined` plate; raise ValueError if it is out of range.

        The plate stands at rod + gap from the crank's centre; it must stay on its side of the
        centre and within twice the rod's length.
        """
        return _within(f"{side}.gap", value, self[f"crank.{side}_rod"], "the rod's length")

    @functools.cached_property
    def machine(self) -> "Scene":
        """The part of this scene that the equations depend on: no name, no parameters of `_OPERATION`, and those of a
        dc motor only with one.

        Code that checks or compiles equations and reads another parameter gets a KeyError.
        """
        absent = _OPERATION - {"effects.motor"} if self.has_rotor else _WITHOUT_DC_MOTOR
        return _unchecked("", {name: value for name, value in self.parameters.items() if name not in absent})


#: Refuses a machine (ValueError); one that was accepted is not checked again.
_check_machine_once = functools.lru_cache(maxsize=64)(check_machine)


def check_scene(scene: object) -> None:
    """Raise TypeError with the remedy if `scene` is not a `Scene`, for instance the name of one."""
    if not isinstance(scene, Scene):
        remedy = f"load_scene({scene!r})" if isinstance(scene, str) else "one that load_scene returns"
        raise TypeError(f"scene: {quoted(scene)} is no Scene; give {remedy}")


def _within(name: str, value: object, limit: float, of: str) -> float:
    """Return `value` as the parameter `name` within ± `limit` (ValueError: it also names `of`, what sets the limit)."""
    try:
        return _limited(name, limit).checked(value)
    except ValueError as error:
        raise ValueError(f"{error} (the limit is {of})") from None


@functools.lru_cache(maxsize=64)
def _limited(name: str, limit: float) -> Parameter:
    return replace(BY_NAME[name], minimum=-limit, maximum=limit)


def _scene_once_checked(name: str, parameters: dict[str, Value]) -> Scene:
    """Return an unpickled scene without checking it again."""
    return _unchecked(name, _DEFAULTS | parameters)


def _unchecked(name: str, parameters: dict[str, Value]) -> Scene:
    scene = object.__new__(Scene)
    object.__setattr__(scene, "name", name)
    object.__setattr__(scene, "parameters", MappingProxyType(parameters))
    return scene


def given_start(values: ParameterValues) -> dict[str, float]:
    """Return the given state at t = 0 of a scene, with the plates' positions [m] (ValueError if it is impossible)."""
    numbers = {name: values[f"{PREFIX}{name}"] for name in NUMBERS}
    check_parts(values, numbers, PREFIX)
    plates = {f"{side}_plate_position": values[f"crank.{side}_rod"] + values[f"{side}.gap"] if side in values.plates
              else 0.0 for side in ("upper", "inclined")}
    return outside_plates(values, numbers | plates, PREFIX)


def check_parts(values: ParameterValues, given: Mapping[str, float], prefix: str = "") -> None:
    """Refuse a nonzero number for a part that the scene lacks (ValueError); `prefix` begins its name in messages."""
    absent = {f"{side}_{field}" for side in ("upper", "inclined") if side not in values.guides
              for field in ("position", "velocity")}
    absent |= {f"{side}_plate_position" for side in ("upper", "inclined") if side not in values.plates}
    if not values.body_moves:
        absent |= {"body_position", "body_velocity"}
    if not values.body_hops:
        absent |= {"body_height", "body_vertical_velocity"}
    for name, value in given.items():
        if value != 0.0 and name in absent:
            unit = NUMBERS[name].unit if name in NUMBERS else "m"
            raise ValueError(f"{prefix}{name}: {value:g} {unit}, but it stays 0 in this scene; leave it out, or give 0")


def outside_plates(values: ParameterValues, state: Mapping[str, float], prefix: str = "",
                   placed: Collection[str] = ("upper", "inclined")) -> dict[str, float]:
    """Return the state after putting each mass that is beyond its rigid plate by rounding on that plate.

    `state` has at least the positions of masses and plates [m]. ValueError for a mass deeper in a compliant plate than
    `ParameterValues.deepest_penetration`, or farther beyond a rigid plate than `ROUNDING`, if it is of one of the sides
    `placed`: a mass that the device itself has moved deeper is not refused. `prefix` is as in `check_parts`.
    """
    moved = dict(state)
    for side in values.plates:
        mass, plate = state[f"{side}_position"], state[f"{side}_plate_position"]
        deepest = values.deepest_penetration(side)
        limit = f"{plate + deepest:.9g}"
        if side in placed and mass > max(float(limit), plate + max(deepest, ROUNDING)):
            kind, why = ("", ", deeper than any blow of this machine") if deepest else ("rigid ", "")
            raise ValueError(f"{prefix}{side}_position: {mass:.9g} m lies beyond the {kind}plate at {plate:.9g} m"
                             f"{why}; give at most {limit} m")
        if not deepest:
            moved[f"{side}_position"] = min(mass, plate)
    return moved
