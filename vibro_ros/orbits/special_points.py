"""Where a branch of orbits changes its nature: folds, period doublings, Neimark-Sacker points, grazings and corners.

The first three have a test function that changes its sign there (Yu. A. Kuznetsov, Elements of Applied Bifurcation
Theory, section 10.2); with the multipliers lambda:

- a fold, where the parameter turns back: the parameter's part of the branch's tangent;
- a period doubling: the product of lambda_i + 1;
- a Neimark-Sacker point, where a motion of another frequency is born: the product of lambda_i lambda_j - 1 over all
  pairs, at a pair of complex multipliers.

The others lie where the order of the orbit's events changes (M. di Bernardo, C. J. Budd, A. R. Champneys, P. Kowalczyk,
Piecewise-smooth Dynamical Systems, Springer 2008):

- a grazing, where a contact of a plate or a landing of the body appears or vanishes;
- a corner, where other events appear, vanish or change their order, and the branch changes its direction or its
  multipliers jump: sliding bifurcations and boundary-intersection crossings.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vibro_ros.orbits.branch_point import BranchPoint, LostError, corrected, point_at
from vibro_ros.orbits.continuation import located
from vibro_ros.orbits.event_order import change_in_words, contacts_of, same_order

FOLD, DOUBLING, TORUS, GRAZING, CORNER = "fold", "period doubling", "Neimark-Sacker", "grazing", "corner"
KINDS = (FOLD, DOUBLING, TORUS, GRAZING, CORNER)
TOLERANCE = 1e-10
"""Of a special point's place, as a share of the parameter's range."""
_UNIT = 1e-3  # how far from 1 in magnitude the pair of a Neimark-Sacker point may be found
_BEHIND = 1e-5  # arc behind an edge at which the other side is compared with this one
_SMOOTH = 5e-3  # changes there of the tangent's cosine and, relatively, of the multipliers that are no corner


@dataclass(frozen=True)
class SpecialPoint:
    """A change of nature.

    Attributes
    ----------
    kind : str
        Of `KINDS`.
    point : BranchPoint
        The branch there.
    width : float
        Width of the interval of the parameter [its unit] in which it was found.
    change : str
        What becomes of the events, such as ``stick vanishes``, and whether the branch turns back there; empty for a
        point at which the order of events stays.
    """

    kind: str
    point: BranchPoint
    width: float
    change: str = ""


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
    if not same_order(before.passage.order, after.passage.order):
        yield from _crossing(before, after)
        return
    tests = {FOLD: fold_test, DOUBLING: doubling_test, TORUS: torus_test}
    for kind, test in tests.items():
        if (test(before) > 0.0) != (test(after) > 0.0):
            point, width = located(before, after, test, TOLERANCE)
            if kind != TORUS or _has_unit_pair(point):
                yield SpecialPoint(kind, point, width)


def _crossing(before: BranchPoint, after: BranchPoint) -> Iterator[SpecialPoint]:
    """The grazing or corner at `before`, behind which the events are those of `after`."""
    orders = before.passage.order, after.passage.order
    change = change_in_words(*orders)
    if before.tangent[-1] * after.tangent[-1] < 0.0:
        change += "; the branch turns back"
    if contacts_of(orders[0]) != contacts_of(orders[1]):
        yield SpecialPoint(GRAZING, before, before.width, change)
    elif not _is_smooth(before, after):
        yield SpecialPoint(CORNER, before, before.width, change)


def _is_smooth(before: BranchPoint, after: BranchPoint) -> bool:
    """Whether a branch goes straight on across an edge, and its multipliers with it."""
    family, start = before.family, before.place.vector
    direction = (after.place.vector - start) / np.linalg.norm(after.place.vector - start)
    try:
        vector, _ = corrected(family, start + _BEHIND * direction, direction, _BEHIND)
        near = point_at(family, vector, direction, _BEHIND)
    except LostError:
        return False
    here, there = np.poly(before.multipliers), np.poly(near.multipliers)
    return bool(1.0 - before.tangent @ near.tangent < _SMOOTH
                and np.abs(here - there).max() < _SMOOTH * np.abs(here).max())


def _has_unit_pair(point: BranchPoint) -> bool:
    """Whether a complex pair lies on the unit circle: real multipliers whose product is 1 are a neutral saddle."""
    complex_ones = point.multipliers[np.abs(point.multipliers.imag) > 0.0]
    return bool(len(complex_ones) and np.abs(np.abs(complex_ones) - 1.0).min() < _UNIT)
