"""A scene: one choice of every parameter and effect, checked as a whole."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar

from vibro_ros.model.parameter_checks import check_together
from vibro_ros.model.parameter_values import ParameterValues
from vibro_ros.model.parameters import BY_NAME, SCENE_PARAMETERS, Value, checked_parameters
from vibro_ros.model.possible_state import given_start

# Parameters of how a machine is started, driven and solved. They enter no equation, so that a sweep over them needs the
# machine compiled only once.
_OPERATION = frozenset({
    *(parameter.name for parameter in SCENE_PARAMETERS if parameter.name.startswith("start.")),
    "effects.motor", "motor.speed", "motor.max_speed", "motor.acceleration", "motor.time_constant",
    "upper.gap", "inclined.gap", "gap_actuator.speed",
    "solver.method", "solver.step", "solver.tolerance", "solver.accuracy"})

_DEFAULTS = {parameter.name: parameter.default for parameter in SCENE_PARAMETERS}


@dataclass(frozen=True)
class Scene(ParameterValues):
    """Every parameter of a simulation; immutable.

    Attributes
    ----------
    name : str
        Name of the scene in logs and recordings.
    parameters : Mapping
        Name to value, complete; SI units. `SCENE_PARAMETERS` describes each.

    Raises
    ------
    ValueError
        If a parameter is unknown, of the wrong type or out of range, or if parameters
        contradict each other; the message names the value, the limit and the remedy.

    Examples
    --------
    >>> scene = vibro_ros.Scene("heavy", {"mass.body": 2.0})
    >>> scene["mass.body"], scene["crank.radius"]
    (2.0, 0.02)
    """

    # A method that the package `model` puts here: its body reads scenes, so that an import would close a circle.
    describe: ClassVar[Callable[["Scene"], str]]

    def __post_init__(self) -> None:
        complete = _DEFAULTS | checked_parameters(self.parameters, SCENE_PARAMETERS)
        object.__setattr__(self, "parameters", MappingProxyType(complete))
        check_together(self)
        self.checked_motor_speed(self["motor.speed"])
        for side in ("upper", "inclined"):
            self.checked_gap(side, self[f"{side}.gap"])
        if self["start.state"] == "given":
            given_start(self)

    def __reduce__(self):
        return _scene_once_checked, (self.name, dict(self.parameters))

    def __hash__(self) -> int:
        return hash((self.name, tuple(self.parameters.values())))

    def with_parameters(self, changes: Mapping[str, object]) -> "Scene":
        """This scene with the values of `changes`, a mapping from names to values.

        Raises
        ------
        ValueError
            As for the constructor.

        Examples
        --------
        >>> steep = vibro_ros.load_scene("paper").with_parameters({"guide.angle": 1.2})
        >>> steep["guide.angle"]
        1.2
        >>> steep.with_parameters({"guide.angle": 4.0})
        Traceback (most recent call last):
        ValueError: guide.angle: 4 is out of range; give a number from 0 to 3.14159 rad
        """
        return Scene(self.name, {**self.parameters, **changes}) if changes else self

    def checked_motor_speed(self, value: object) -> float:
        """`value` as a motor speed [rad/s] that the motor can reach; else a ValueError."""
        limited = replace(BY_NAME["motor.speed"], maximum=self["motor.max_speed"])
        try:
            return limited.checked(value)
        except ValueError as error:
            raise ValueError(f"{error} (the limit is motor.max_speed)") from None

    def checked_gap(self, side: str, value: object) -> float:
        """`value` as a gap [m] of the `upper` or `inclined` plate within the mechanism; else a ValueError.

        The plate stands at rod + gap from the crank's centre; it must stay on its side of the
        centre and within twice the rod's length.
        """
        rod = self[f"crank.{side}_rod"]
        limited = replace(BY_NAME[f"{side}.gap"], minimum=-rod, maximum=rod)
        try:
            return limited.checked(value)
        except ValueError as error:
            raise ValueError(f"{error} (the limit is the rod's length)") from None

    @property
    def machine(self) -> "Scene":
        """The part of this scene that is compiled: no name, and no parameters of its operation.

        To read such a parameter where equations are compiled is a KeyError.
        """
        return _unchecked("", {name: value for name, value in self.parameters.items() if name not in _OPERATION})


def _scene_once_checked(name: str, parameters: dict[str, Value]) -> Scene:
    """A pickled scene as it was, which another process need not check again."""
    return _unchecked(name, _DEFAULTS | parameters)


def _unchecked(name: str, parameters: dict[str, Value]) -> Scene:
    scene = object.__new__(Scene)
    object.__setattr__(scene, "name", name)
    object.__setattr__(scene, "parameters", MappingProxyType(parameters))
    return scene
