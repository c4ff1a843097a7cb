"""Where a branch of orbits changes its nature: folds, period doublings, Neimark-Sacker points and grazings.

Each has a test function that changes its sign there (Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, section
10.2); with the multipliers lambda:

- a fold, where the parameter turns back: the parameter's part of the branch's tangent;
- a period doubling: the product of lambda_i + 1;
- a Neimark-Sacker point, where a motion of another frequency is born: the product of lambda_i lambda_j - 1 over all
  pairs, at a pair of complex multipliers;
- a grazing, where a contact appears or vanishes: the number of contacts, which only changes.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from vibro_ros.orbits.continuation import BranchPoint, located

FOLD, DOUBLING, TORUS, GRAZING = "fold", "period doubling", "Neimark-Sacker", "grazing"
TOLERANCE = 1e-9
"""Of a special point's place, as a share of the parameter's range."""
_UNIT = 1e-3  # how far from 1 in magnitude the pair of a Neimark-Sacker point may be found


@dataclass(frozen=True)
class SpecialPoint:
    """A change of nature.

    Attributes
    ----------
    kind : str
        `FOLD`, `DOUBLING`, `TORUS` or `GRAZING`.
    point : BranchPoint
        The branch there.
    width : float
        Width of the interval of the parameter [its unit] in which it was found.
    """

    kind: str
    point: BranchPoint
    width: float


def fold_test(point: BranchPoint) -> float:
    """The parameter's part of the tangent."""
    return float(point.tangent[-1])


def doubling_test(point: BranchPoint) -> float:
    """Product of lambda + 1."""
    return float(np.prod(point.multipliers + 1.0).real)


def torus_test(point: BranchPoint) -> float:
    """Product of lambda_i lambda_j - 1 over all pairs."""
    first, second = np.triu_indices(len(point.multipliers), 1)
    return float(np.prod(point.multipliers[first] * point.multipliers[second] - 1.0).real)


def special_points(before: BranchPoint, after: BranchPoint) -> Iterator[SpecialPoint]:
    """Special points between two neighbours of a branch, in the order of their kinds.

    A pair of special points of one kind between two neighbours is not seen: neighbours are at most
    `continuation.LONGEST_STEP` apart, and closer where the branch bends.
    """
    tests = {FOLD: fold_test, DOUBLING: doubling_test, TORUS: torus_test, GRAZING: _contacts_of(before)}
    for kind, test in tests.items():
        if (test(before) > 0.0) != (test(after) > 0.0):
            point, width = located(before, after, test, TOLERANCE)
            if kind != TORUS or _has_unit_pair(point):
                yield SpecialPoint(kind, point, width)


def _contacts_of(before: BranchPoint) -> Callable[[BranchPoint], float]:
    """1 where an orbit has the contacts of `before`, else -1."""
    return lambda point: 1.0 if point.passage.contacts == before.passage.contacts else -1.0


def _has_unit_pair(point: BranchPoint) -> bool:
    """Whether a complex pair lies on the unit circle: real multipliers whose product is 1 are a neutral saddle."""
    complex_ones = point.multipliers[np.abs(point.multipliers.imag) > 0.0]
    return bool(len(complex_ones) and np.abs(np.abs(complex_ones) - 1.0).min() < _UNIT)
