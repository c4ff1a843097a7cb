"""The robots among which the optimum is sought: the paper's seventeen parameters, their bounds, and why these.

A candidate is a point of the unit cube. Lengths depend on each other: a crank longer than a rod jams, and a plate that
the slider never nears is no plate. So the bounds of the crank's radius end at the shorter rod, those of a gap at the
radius, and a coordinate is a share of what is left: every point of the cube is a robot that can be built.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibro_ros.model.parameters import BY_NAME, parameter_named
from vibro_ros.model.scene import Scene

#: A coordinate nearer than this to an end of its interval is said to be on the bound.
ON_BOUND = 0.01

Point = Sequence[float] | np.ndarray
"""A point of the unit cube, shape (dimension,)."""


@dataclass(frozen=True)
class Variable:
    """A parameter that is sought.

    Attributes
    ----------
    name : str
        Name of the scene's parameter.
    symbol : str
        The paper's symbol.
    low, high : float
        Bounds, in the parameter's unit.
    logarithmic : bool
        Whether equal steps of the coordinate are equal ratios, else equal differences.
    reason : str
        Why these bounds.
    """

    name: str
    symbol: str
    low: float
    high: float
    logarithmic: bool
    reason: str

    def value(self, share: float, low: float, high: float) -> float:
        """The parameter at `share` (0 to 1) of the interval from `low` to `high`; never outside it."""
        if self.logarithmic:
            return min(max(low * (high / low)**share, low), high)
        return min(max(low + share * (high - low), low), high)

    def share(self, value: float, low: float, high: float) -> float:
        """Inverse of `value`; 0.5 in an interval without length."""
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
"""The paper's parameters of F_opt, those first on which the bounds of others depend."""


class Space:
    """The robots that differ from a scene in some of `VARIABLES`.

    Parameters
    ----------
    scene : Scene
        Gives everything that is not varied.
    variables : sequence of Variable
        What is varied, in the order of `VARIABLES`.

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
        """The varied parameters at a point of the unit cube, shape (dimension,); by name."""
        found: dict[str, float] = {}
        for variable, share in zip(self.variables, point, strict=True):
            found[variable.name] = variable.value(float(share), *self.interval(variable, found))
        return found

    def robot(self, point: Point) -> Scene:
        """The scene at a point of the unit cube."""
        return self.scene.with_parameters(self.parameters(point))

    def buildable(self, point: Point) -> Scene | None:
        """The scene at a point of the unit cube; None where limits that join parameters refuse it.

        Such limits, as of Painlevé's paradox, depend on the scene: no choice of coordinates avoids them all.
        """
        try:
            return self.robot(point)
        except ValueError:
            return None

    def point(self, parameters: Mapping[str, float]) -> np.ndarray:
        """Coordinates of the varied parameters' values, shape (dimension,); outside 0 to 1 beyond the bounds."""
        return np.array([one.share(parameters[one.name], *self.interval(one, parameters)) for one in self.variables])

    def interval(self, variable: Variable, parameters: Mapping[str, float]) -> tuple[float, float]:
        """Ends of what `variable` may be, in its unit, beside the other `parameters`; the scene's where not given."""
        def length(name: str) -> float:
            return parameters.get(name, self.scene[name])

        if variable.name == "crank.radius":
            return variable.low, min(variable.high, length("crank.upper_rod"), length("crank.inclined_rod"))
        if variable.name.endswith(".gap"):
            radius = length("crank.radius")
            return max(variable.low, -radius), min(variable.high, radius)
        return variable.low, variable.high

    def on_bound(self, point: Point) -> list[str]:
        """For each variable `low`, `high` or, away from its bounds, an empty text."""
        return ["low" if share < ON_BOUND else "high" if share > 1.0 - ON_BOUND else "" for share in point]


def chosen_variables(fixed: Sequence[str], varied: Mapping[str, tuple[float, float]]) -> tuple[Variable, ...]:
    """`VARIABLES` without those that are fixed, and with the bounds of those that are varied.

    Parameters
    ----------
    fixed : sequence of str
        Names.
    varied : mapping
        Name to lower and upper bound, in the parameter's unit, as `variation.Range` has checked them.

    Raises
    ------
    ValueError
        For a name that is none of `VARIABLES`, one that is fixed and varied, and bounds without equal ratios.
    """
    names = {variable.name: variable for variable in VARIABLES}
    for option, name in [*(("--fix", name) for name in fixed), *(("--vary", name) for name in varied)]:
        if name not in names:
            parameter_named(name, BY_NAME)
            raise ValueError(f"{option} {name}: is not among the paper's parameters of F_opt, which are "
                             f"{', '.join(names)}; write it into a scene file")
    for name, (low, high) in varied.items():
        if name in fixed:
            raise ValueError(f"--vary {name}: is fixed as well; leave out --fix or --vary")
        if names[name].logarithmic and low <= 0.0:
            raise ValueError(f"--vary {name}={low:g}:{high:g}: is varied in equal ratios; give bounds above 0 "
                             f"{BY_NAME[name].unit}")
    return tuple(replace(variable, low=varied[name][0], high=varied[name][1], reason="as asked for")
                 if name in varied else variable for name, variable in names.items() if name not in fixed)
