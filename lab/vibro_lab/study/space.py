"""Search space of the optimisation: the paper's seventeen parameters, their bounds, and the reasons for the bounds.

A candidate is a point of the unit cube. Lengths depend on each other: a crank longer than a rod jams, and a plate that
the slider never approaches has no effect. So the bounds of the crank's radius end at the shorter rod, those of a gap at
the radius, and a coordinate is a share of the remaining interval: in these respects, every point of the cube is a robot
that can be built.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibro_ros import PARAMETERS, Scene, parameter_named

#: A coordinate nearer than this to an end of its interval counts as on the bound.
ON_BOUND = 0.01

Point = Sequence[float] | np.ndarray
"""A point of the unit cube, shape (dimension,)."""


@dataclass(frozen=True)
class Variable:
    """A parameter that the optimisation varies.

    Attributes
    ----------
    name : str
        Name of the scene's parameter.
    symbol : str
        The paper's symbol.
    low, high : float
        Bounds, in the parameter's unit.
    logarithmic : bool
        Whether equal steps of the coordinate are equal ratios of the value; else equal differences.
    reason : str
        Reason for the bounds.
    """

    name: str
    symbol: str
    low: float
    high: float
    logarithmic: bool
    reason: str

    def value(self, share: float, low: float, high: float) -> float:
        """Value at `share` (0 to 1) of the interval from `low` to `high`, clipped to it."""
        if self.logarithmic:
            return min(max(low * (high / low)**share, low), high)
        return min(max(low + share * (high - low), low), high)

    def share(self, value: float, low: float, high: float) -> float:
        """Share of the interval at a value: the inverse of `value`; 0.5 for an interval without length."""
        if high <= low:
            return 0.5
        return math.log(value / low) / math.log(high / low) if self.logarithmic else (value - low) / (high - low)


_TWICE = "from half to twice the paper's"
_DAMPER = "from a tenth to ten times that of `device`"
_SPRING = "a decade either way of the paper's"
_PLATE = "from hard rubber to the paper's steel"
_GAP = "a plate at the slider's mid-stroke, aside by one crank radius at most"
_MASS = "from the lightest to the heaviest mass of the paper's Fig. 3(a)"

VARIABLES: tuple[Variable, ...] = (
    Variable("mass.upper", "m2", 0.02, 0.25, True, _MASS),
    Variable("mass.inclined", "m3", 0.02, 0.25, True, _MASS),
    Variable("crank.upper_rod", "l_AB", 0.03, 0.12, True, _TWICE),
    Variable("crank.inclined_rod", "l_AC", 0.03, 0.12, True, _TWICE),
    Variable("crank.radius", "l_DA", 0.003, 0.06, True, "up to the longest of the paper's Fig. 3(b); never longer than "
             "a rod"),
    Variable("guide.angle", "φ", math.radians(10.0), math.radians(90.0), False, "beyond 90° the guide points into the "
             "ground; at 0° nothing drives the body"),
    Variable("inclined.plate.stiffness", "k1", 1e5, 1e7, True, _PLATE),
    Variable("upper.spring.stiffness", "k2", 1e2, 1e4, True, _SPRING),
    Variable("inclined.spring.stiffness", "k3", 1e2, 1e4, True, _SPRING),
    Variable("upper.plate.stiffness", "k4", 1e5, 1e7, True, _PLATE),
    Variable("inclined.plate.damping", "c1", 10.0, 1000.0, True, _DAMPER),
    Variable("upper.spring.damping", "c2", 0.2, 20.0, True, _DAMPER),
    Variable("inclined.spring.damping", "c3", 0.2, 20.0, True, _DAMPER),
    Variable("upper.plate.damping", "c4", 10.0, 1000.0, True, _DAMPER),
    Variable("motor.speed", "ω", 20.0, 200.0, True, "from a fifth to twice the paper's"),
    Variable("inclined.gap", "ξ_H - l_AC", -0.06, 0.06, False, _GAP),
    Variable("upper.gap", "ζ_E - l_AB", -0.06, 0.06, False, _GAP),
)
"""The paper's parameters of F_opt; parameters on which the bounds of others depend come first."""


class Space:
    """Search space of robots that differ from a scene in some of `VARIABLES`.

    Parameters
    ----------
    scene : Scene
        Scene with the values of all other parameters.
    variables : sequence of Variable
        The varied parameters, in the order of `VARIABLES`.

    Raises
    ------
    ValueError
        If nothing is varied, or if no robot lies within the bounds.
    """

    def __init__(self, scene: Scene, variables: Sequence[Variable] = VARIABLES):
        if not variables:
            raise ValueError("--fix: nothing is left to vary; fix fewer parameters")
        self.scene, self.variables = scene, tuple(variables)
        shortest = self.parameters([0.0] * self.dimension)  # of rods and crank
        for variable in self.variables:
            low, high = self.interval(variable, shortest)
            if low > high or (variable.logarithmic and low <= 0.0):
                raise ValueError(f"--vary {variable.name}: from {variable.low:g} to {variable.high:g} leaves no value "
                                 "where rods and crank are shortest; give bounds that the shortest rod and crank allow")
        for corner in (0.0, 1.0):
            self.robot([corner] * self.dimension)

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return len(self.variables)

    def parameters(self, point: Point) -> dict[str, float]:
        """Values of the varied parameters, by name, at a point of the unit cube, shape (dimension,)."""
        found: dict[str, float] = {}
        for variable, share in zip(self.variables, point, strict=True):
            found[variable.name] = variable.value(float(share), *self.interval(variable, found))
        return found

    def robot(self, point: Point) -> Scene:
        """Return the scene at a point of the unit cube (ValueError if the scene refuses the values)."""
        return self.scene.with_parameters(self.parameters(point))

    def buildable(self, point: Point) -> Scene | None:
        """Return the scene at a point of the unit cube; None if limits on combinations of parameters refuse it.

        Such limits, for example Painlevé's paradox, depend on the scene: no choice of coordinates avoids them all.
        """
        try:
            return self.robot(point)
        except ValueError:
            return None

    def point(self, parameters: Mapping[str, float]) -> np.ndarray:
        """Coordinates of given values of the varied parameters, shape (dimension,); outside 0 to 1 if out of bounds."""
        return np.array([one.share(parameters[one.name], *self.interval(one, parameters)) for one in self.variables])

    def interval(self, variable: Variable, parameters: Mapping[str, float]) -> tuple[float, float]:
        """Interval of `variable`, in its unit, for values of the other `parameters`; if not given, the scene's values.
        """
        def length(name: str) -> float:
            return parameters.get(name, self.scene[name])

        if variable.name == "crank.radius":
            return variable.low, min(variable.high, length("crank.upper_rod"), length("crank.inclined_rod"))
        if variable.name.endswith(".gap"):
            radius = length("crank.radius")
            return max(variable.low, -radius), min(variable.high, radius)
        return variable.low, variable.high

    def on_bound(self, point: Point) -> list[str]:
        """Bound on which each variable lies, `low` or `high`; an empty text away from its bounds."""
        return ["low" if share < ON_BOUND else "high" if share > 1.0 - ON_BOUND else "" for share in point]


def chosen_variables(fixed: Sequence[str], varied: Mapping[str, tuple[float, float]]) -> tuple[Variable, ...]:
    """Return `VARIABLES` without the fixed ones, and with the given bounds of the varied ones.

    Parameters
    ----------
    fixed : sequence of str
        Names of fixed parameters.
    varied : mapping
        Lower and upper bound by name, in the parameter's unit, already checked as a `variation.Range`.

    Raises
    ------
    ValueError
        For a name that is not in `VARIABLES`, a name that is fixed and varied, and a bound that is not above 0 of a
        logarithmic parameter.
    """
    names = {variable.name: variable for variable in VARIABLES}
    for option, name in [*(("--fix", name) for name in fixed), *(("--vary", name) for name in varied)]:
        if name not in names:
            parameter_named(name, PARAMETERS)
            raise ValueError(f"{option} {name}: is not among the paper's parameters of F_opt, which are "
                             f"{', '.join(names)}; write it into a scene file")
    for name, (low, high) in varied.items():
        if name in fixed:
            raise ValueError(f"--vary {name}: is fixed as well; leave out --fix or --vary")
        if names[name].logarithmic and low <= 0.0:
            raise ValueError(f"--vary {name}={low:g}:{high:g}: is varied in equal ratios; give bounds above 0 "
                             f"{PARAMETERS[name].unit}")
    return tuple(replace(variable, low=varied[name][0], high=varied[name][1], reason="as asked for")
                 if name in varied else variable for name, variable in names.items() if name not in fixed)
