"""Free parameters of an identification: their ranges, and the coordinates in which the fit changes them.

A positive parameter is the exponential of its coordinate, so that a step of the fit is a share of it; any other number
is its coordinate times a unit. A recording hardly tells stiffness k and damping c of a plate apart, but it tells their
combination c / sqrt(k), which decides the restitution. So where both are free, the coordinate of the damping is the
logarithm of that combination.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vibro_ros import PARAMETERS, Scene, quoted

#: Units of coordinates that are no logarithms.
_UNITS = {"m": 1e-3, "rad": 0.1}
_LEAST = 1e-9  # of a positive parameter; its logarithm is then finite
_SIDES = ("upper", "inclined")


@dataclass(frozen=True)
class Unknown:
    """One free parameter.

    Attributes
    ----------
    name : str
        Name of the scene's parameter.
    low, high : float
        Range within which it is searched, in its SI unit.
    unit : float
        Change of the parameter by one of its coordinate; 0 if the coordinate is the logarithm.
    """

    name: str
    low: float
    high: float
    unit: float

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value."""
        return value / self.unit if self.unit else math.log(max(value, _LEAST))

    def value(self, coordinate: float) -> float:
        """Return the value of a coordinate; beyond the range it is the range's end."""
        value = coordinate * self.unit if self.unit else math.exp(min(coordinate, 100.0))
        return min(max(value, self.low), self.high)

    def slope(self, value: float) -> float:
        """Derivative of the value by the coordinate."""
        return self.unit or value


def unknown_of(scene: Scene, name: str, limits: tuple[float, float] | None = None) -> Unknown:
    """Return the unknown of a parameter; `limits` is its range, by default all that the parameter permits.

    Raises
    ------
    ValueError
        For a name that no parameter has, a parameter that is not a number of the robot, and a range that is empty,
        exceeds the parameter's or does not include the scene's value.
    """
    parameter = PARAMETERS.get(name)
    if parameter is None or not isinstance(parameter.default, float) or name.startswith(("solver.", "sensors.")):
        raise ValueError(f"free: {quoted(name)} is no number of the robot; give names such as ground.friction, "
                         "upper.gap or mass.body (docs/guide/parameters.md has all)")
    try:
        low, high = map(float, limits if limits is not None else (parameter.minimum, parameter.maximum))
    except (TypeError, ValueError):
        raise ValueError(f"range of {name}: {quoted(limits)} is no range; give two numbers, low and high") from None
    if not parameter.minimum <= low < high <= parameter.maximum:
        raise ValueError(f"range of {name}: {low:g} to {high:g} is no range within {parameter.minimum:g} to "
                         f"{parameter.maximum:g} {parameter.unit}; give LOW:HIGH within it")
    if not low <= scene[name] <= high:
        raise ValueError(f"range of {name}: {low:g} to {high:g} does not include the scene's value, {scene[name]:g}; "
                         "change one of them")
    positive = parameter.minimum >= 0.0 < scene[name] and parameter.unit != "rad"
    return Unknown(name, low, high, 0.0 if positive else _UNITS.get(parameter.unit, 1.0))


@dataclass(frozen=True)
class Unknowns:
    """The free parameters of a fit, and the scene that has all others.

    Attributes
    ----------
    scene : Scene
        The scene to begin with.
    each : tuple of Unknown
        The free parameters.
    directions : ndarray, shape (unknowns, unknowns)
        Row k times the coordinates is the coordinate of parameter k by itself, `Unknown.coordinate` of its value.
    """

    scene: Scene
    each: tuple[Unknown, ...]
    directions: np.ndarray

    @classmethod
    def of(cls, scene: Scene, free: Sequence[str], ranges: Mapping[str, tuple[float, float]]) -> "Unknowns":
        """Return the unknowns with the names `free` and the `ranges` of some of them (ValueError)."""
        if (isinstance(free, str) or not free or not all(isinstance(name, str) for name in free)
                or len(set(free)) != len(free)):
            raise ValueError(f"free: {quoted(free)}; give a list of names of parameters, each once")
        for name in ranges:
            if name not in free:
                raise ValueError(f"range of {name}: the parameter is not free; free it, or leave its range out")
        directions = np.eye(len(free))
        for stiffness, damping in plates_in(free):
            directions[list(free).index(damping), list(free).index(stiffness)] = 0.5
        return cls(scene, tuple(unknown_of(scene, name, ranges.get(name)) for name in free), directions)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(unknown.name for unknown in self.each)

    def coordinates(self, values: Mapping[str, float]) -> np.ndarray:
        """Return the coordinates of values by name, shape (unknowns,)."""
        coordinates_of_each = np.array([unknown.coordinate(values[unknown.name]) for unknown in self.each])
        return np.linalg.solve(self.directions, coordinates_of_each)

    def values(self, coordinates: np.ndarray) -> dict[str, float]:
        """Return the values of coordinates by name, within their ranges."""
        coordinates_of_each = (self.directions @ coordinates).tolist()
        return {unknown.name: unknown.value(coordinate)
                for unknown, coordinate in zip(self.each, coordinates_of_each, strict=True)}

    def slopes(self, coordinates: np.ndarray) -> np.ndarray:
        """Return the derivatives of the values by the coordinates, shape (unknowns, unknowns)."""
        values = self.values(coordinates)
        return np.array([unknown.slope(values[unknown.name]) for unknown in self.each])[:, None] * self.directions

    def limits(self, count: int) -> list[tuple[np.ndarray, float, float]]:
        """Return the limits of the parameters, for `Shooting.limits`, among `count` coordinates."""
        return [(np.concatenate([direction, np.zeros(count - len(self.each))]), unknown.coordinate(unknown.low),
                 unknown.coordinate(unknown.high))
                for direction, unknown in zip(self.directions, self.each, strict=True)]

    def scene_of(self, coordinates: np.ndarray, settings: Mapping[str, float] | None = None) -> Scene:
        """Return the scene with the values of coordinates, and with `settings` (ValueError: if they contradict each
        other)."""
        return self.scene.with_parameters(self.values(coordinates) | dict(settings or {}))


def plates_in(free: Sequence[str]) -> list[tuple[str, str]]:
    """Return the names of stiffness and damping of each plate of which both are free."""
    pairs = [(f"{side}.plate.stiffness", f"{side}.plate.damping") for side in _SIDES]
    return [pair for pair in pairs if set(pair) <= set(free)]
