"""What one more digit of every position costs, by each kind of method: a fit to the rows of a study.

Over the settings of a method, the logarithm of the cost is fitted by a straight line in the logarithm of the error of
every position; the price of a digit is ten to the power of minus its slope. Methods of a kind, and horizons, have a
slope in common and lines of their own. In one scene the 95 % interval is that of the slope; over several, that of the
mean of their slopes, by Student's distribution over the scenes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from vibro_ros.accuracy.measurement import NEED, REFERENCE, TRAJECTORY, Measurement
from vibro_ros.accuracy.precision import SHORT
from vibro_ros.accuracy.studied import BASELINE_STEP
from vibro_ros.accuracy.tables_by_scipy import SOLVERS
from vibro_ros.solver.methods import SCHEMES

#: Kind of method, in words, to the methods whose slope is fitted in common.
KINDS: Mapping[str, tuple[str, ...]] = {
    "heyoka": ("heyoka",), **{f"`{scheme}`": (scheme,) for scheme in SCHEMES},
    "scipy's solvers with events": tuple(SOLVERS)}
# Of a fit: errors above this are not small beside the robot's motion [m], and errors that are not so many times the
# reference's own have ended at rounding.
_LARGEST_ERROR, _ABOVE_REFERENCE = 1e-2, 10.0
_LEAST_POINTS = 3


@dataclass(frozen=True)
class Price:
    """The factor by which one more digit raises the cost, and its 95 % interval.

    Attributes
    ----------
    slope, spread : float
        Change of log10 of the cost by one digit, and half the width of its interval.
    points, scenes : int
        Number of settings, and of scenes, that it is known from.
    """

    slope: float
    spread: float
    points: int
    scenes: int

    @property
    def factor(self) -> float:
        """The factor itself."""
        return 10.0**self.slope

    def __str__(self):
        low, high = (10.0 ** (self.slope + sign * self.spread) for sign in (-1.0, 1.0))
        known = f"{self.scenes} scenes" if self.scenes > 1 else f"{self.points} settings"
        return f"{self.factor:.3g} times as much (95 % interval {low:.3g} to {high:.3g}, from {known})"


def price_of_a_digit(rows: Sequence[Measurement], methods: Sequence[str]) -> Price | None:
    """Fit of one scene, with one slope for all `methods`; None where too little was measured."""
    groups = [points for method in methods for kind in (TRAJECTORY, NEED)
              if len(points := _points(rows, method, kind)) >= 2]
    count = sum(len(points) for points in groups)
    if count < _LEAST_POINTS:
        return None
    digits = np.concatenate([points[:, 0] - points[:, 0].mean() for points in groups])
    costs = np.concatenate([points[:, 1] - points[:, 1].mean() for points in groups])
    free, scale = count - len(groups) - 1, float(digits @ digits)
    if free < 1 or scale == 0.0:
        return None
    slope = float(digits @ costs) / scale
    error = math.sqrt(float(np.sum((costs - slope * digits) ** 2)) / free / scale)
    return Price(slope, float(student.ppf(0.975, free)) * error, count, 1)


def price_over_scenes(rows: Mapping[str, Sequence[Measurement]], methods: Sequence[str]) -> Price | None:
    """Mean over scenes, or the fit of the only one; None where too little was measured."""
    found = [price for own in rows.values() if (price := price_of_a_digit(own, methods))]
    if len(found) < 2:
        return found[0] if found else None
    slopes = np.array([price.slope for price in found])
    error = float(slopes.std(ddof=1)) / math.sqrt(len(slopes))
    return Price(float(slopes.mean()), float(student.ppf(0.975, len(slopes) - 1)) * error,
                 sum(price.points for price in found), len(found))


def _points(rows: Sequence[Measurement], method: str, kind: str) -> np.ndarray:
    """Digits (minus log10 of the error) and log10 of the cost, shape (settings, 2), where the error still falls."""
    own = [row for row in rows if row.method == method and row.compared == kind
           and (kind == TRAJECTORY or row.horizon == SHORT)]
    known = [row.position_error for row in rows if row.compared == REFERENCE and own and row.horizon == own[0].horizon]
    floor = _ABOVE_REFERENCE * (known[-1] if known and math.isfinite(known[-1]) else 0.0)
    return np.array([(-math.log10(row.position_error), math.log10(row.cost)) for row in own
                     if floor < row.position_error < _LARGEST_ERROR and row.cost > 0.0]).reshape(-1, 2)


def prices_in_words(rows: Mapping[str, Sequence[Measurement]]) -> list[str]:
    """A sentence for each kind of method that was measured: what one more digit of every position costs by it."""
    told = [f"One more digit of every position by {kind} costs {price}." for kind, methods in KINDS.items()
            if (price := price_over_scenes(rows, methods))]
    exact = [row.cost for own in rows.values() for row in own
             if row.method == "exact" and row.compared == NEED and row.horizon == SHORT and math.isfinite(row.cost)]
    if exact:
        told.insert(0, "One more digit of every position by `exact` costs nothing: it is accurate to rounding, for "
                       f"{cost_range(exact)} of the baseline's cost.")
    return told


def baseline_in_words(rows: Mapping[str, Sequence[Measurement]]) -> str:
    """What `RK4 = 1` is, and how far off it is itself."""
    text = f"RK4 = 1 is the cost of fixed-step Runge-Kutta 4 of {BASELINE_STEP:g} s (`baseline`)"
    off = {name: row.position_error for name, own in rows.items() for row in own
           if row.method == "baseline" and row.compared == NEED and math.isfinite(row.position_error)}
    if not off:
        return f"{text}."
    worst, least = max(off, key=off.__getitem__), min(off, key=off.__getitem__)
    if worst == least:
        return f"{text}, which is itself off by {off[worst]:.1e} m within {SHORT:g} s."
    return (f"{text}, which is itself off by {off[least]:.1e} m (`{least}`) to {off[worst]:.1e} m (`{worst}`) within "
            f"{SHORT:g} s.")


def cost_range(costs: Sequence[float]) -> str:
    """From the least to the largest, without exponents."""
    low, high = two_digits(min(costs)), two_digits(max(costs))
    return low if low == high else f"{low} to {high}"


def two_digits(cost: float) -> str:
    """A cost without an exponent."""
    return f"{float(f'{cost:.2g}'):g}"
