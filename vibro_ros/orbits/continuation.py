"""Continuation: a branch of periodic orbits as a parameter changes, by pseudo-arclength, through folds.

The method is H. B. Keller's, in P. H. Rabinowitz (ed.), Applications of Bifurcation Theory, 1977, pp. 359-384: a step
along the branch's tangent, then Newton's method on the plane across its end.

Where the order of events along an orbit changes, a branch has an edge: how to find it, and how to go on beyond it.

On each side of the edge the turn map is smooth, and the branch with it; at the edge the branch has a corner, may turn
back, or goes on with the root of a distance. So no step of the continuation and no difference of a derivative goes
across: the branch is followed up to the edge with the map of the one side, and begun anew beyond it with the map of the
other side.

Special points are where a branch changes its nature: folds, period doublings, Neimark-Sacker points, grazings and
corners.

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

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibro_ros.orbits.family import LONGEST_STEP, BranchPoint, Family, LostError, corrected, point_at
from vibro_ros.orbits.orbit import CLOSED
from vibro_ros.orbits.passage import change_in_words, contacts_of, same_order
from vibro_ros.simulation.motion import SimulationError

FIRST_STEP, SHORTEST_STEP = 0.01, 1e-10
"""Steps along the branch: in units of the machine and shares of the parameter's range."""
NEAREST_EVENT = 0.01
"""Share of a turn that the cut keeps from all events; nearer, the branch is cut elsewhere."""
_ARC = 1e-6  # in which a special point is, where the parameter alone would tell no more, as at a fold
_AHEAD = 1e-6  # along the branch: where its direction is looked for when the cut changes
_FEW = 2  # derivatives that Newton's method takes at most before a step that is longer
_CREEP, _WILD = 1e-4, 1e3  # shortest step, and largest multiplier, of orbits that are followed in spite of the other
_SHORT = 1e-5  # a step that fails: the branch may have an edge within it
STRAIGHT = 0.9
"""Cosine between tangents of neighbours, at least: else the bend is rounded by a shorter step."""
_SHARP = 1e-12  # arc that may be left to the edge
_CLEAR = 1e-9  # arc behind the edge at which events are others
_MOST_ROUNDS = 8
_BACK = 1e-6  # arc before the edge at which its multipliers are taken
_PROBES = (1e-6, 1e-5, 1e-4, 1e-3)  # arcs beyond the edge at which the other side's derivative is taken
_ENTRIES = (1e-4, 1e-5, 1e-3, 1e-6)  # arcs to the first point of the other side
_DEPTHS = (0.0, 1.0, 10.0, 0.1)
_MOST_CHORDS = 40
FOLD, DOUBLING, TORUS, GRAZING, CORNER = "fold", "period doubling", "Neimark-Sacker", "grazing", "corner"
KINDS = (FOLD, DOUBLING, TORUS, GRAZING, CORNER)
TOLERANCE = 1e-10
"""Of a special point's place, as a share of the parameter's range."""
_UNIT = 1e-3  # how far from 1 in magnitude the pair of a Neimark-Sacker point may be found
_BEHIND = 1e-5  # arc behind an edge at which the other side is compared with this one
_SMOOTH = 5e-3  # changes there of the tangent's cosine and, relatively, of the multipliers that are no corner


class EdgeError(LostError):
    """A branch ends where its events change; `grazing` is the special point there, None where it is another one."""

    def __init__(self, message: str, grazing: "SpecialPoint | None"):
        super().__init__(message)
        self.grazing = grazing


def follow(family: Family, unknowns: np.ndarray, direction: float) -> Iterator[tuple[BranchPoint, BranchPoint]]:
    """Neighbours on the branch through a known orbit, until it leaves the parameter's range.

    Parameters
    ----------
    family : Family
        The equations.
    unknowns : ndarray, shape (n + 1,)
        A known orbit.
    direction : float
        1.0 towards larger values of the parameter, -1.0 towards smaller; dimensionless.

    Yields
    ------
    BranchPoint, BranchPoint
        A point and the next, with one cut; first the known orbit and itself.

    Raises
    ------
    LostError
        Where the branch cannot be followed.
    """
    along = direction * np.eye(len(unknowns))[-1]
    unknowns, _ = corrected(family, unknowns, along)
    yield from follow_on(point_at(family, unknowns, along))


def follow_on(point: BranchPoint) -> Iterator[tuple[BranchPoint, BranchPoint]]:
    """Neighbours on the branch from a point on, along its tangent; as `follow`, which see."""
    point, step = _well_cut(point), FIRST_STEP
    yield point, point
    while 0.0 <= point.unknowns[-1] <= 1.0:
        neighbours, step = _next(point, step)
        for after in neighbours:
            yield point, after
            point = after
        point = _well_cut(point)


def stepped(point: BranchPoint, begin: np.ndarray, step: float, shortest: float,
            solved: Callable[[np.ndarray, float], tuple[Any, bool]], across: Callable[[float, bool], list[Any]],
            what: str) -> tuple[list[Any], float]:
    """The next point of a branch or curve, or those at a change of events and beyond; and the step after it.

    Parameters
    ----------
    point : BranchPoint
        Gives tangent and order of events.
    begin : ndarray
        From where the step goes along the tangent.
    step, shortest : float
        The first arc that is tried, and the least; an arc that fails is halved.
    solved : callable
        The point near a guess at the end of an arc, and whether Newton's method was quick (LostError).
    across : callable
        For an arc that fails, and whether events change within it: the points at and beyond the change, or none.
    what : str
        What is followed, for users.
    """
    family, reason = point.family, ""
    while step >= shortest:
        guess, crosses = begin + step * point.tangent, False
        try:
            after, is_quick = solved(guess, step)
            crosses = not same_order(after.passage.order, point.passage.order)
            if not crosses and after.tangent @ point.tangent >= STRAIGHT:
                return [after], min(LONGEST_STEP, step * (1.5 if is_quick else 1.0))
            reason = f"the {what} bends too sharply near {family.where(after.unknowns)}"
        except LostError as error:
            reason = str(error)
            try:
                crosses = not same_order(family.order(guess), point.passage.order)
            except (SimulationError, ValueError):
                crosses = False
        if found := across(step, crosses):
            return found, FIRST_STEP
        step *= 0.5
    raise LostError(reason)


def _next(point: BranchPoint, step: float) -> tuple[list[BranchPoint], float]:
    """The next point, or an edge and the first point beyond it; and the step after it."""
    family = point.family

    def solved(guess: np.ndarray, step: float) -> tuple[BranchPoint, bool]:
        unknowns, derivatives = corrected(family, guess, point.tangent, step)
        return point_at(family, unknowns, point.tangent, step), derivatives <= _FEW

    def across(step: float, crosses: bool) -> list[BranchPoint]:
        if (crosses or step < _SHORT) and (last := edge(point, step)):
            return [last, beyond(last)]
        if step < 2.0 * _CREEP and abs(point.multipliers[0]) > _WILD:
            raise LostError(f"too unstable to be followed beyond {family.where(point.unknowns)}: a disturbance grows "
                            f" {abs(point.multipliers[0]):.4g}-fold until the motion repeats itself")
        return []

    return stepped(point, point.unknowns, step, SHORTEST_STEP, solved, across, "branch")


def _well_cut(point: BranchPoint) -> BranchPoint:
    """The same orbit, cut far from all events."""
    if point.passage.clear >= NEAREST_EVENT:
        return point
    family, (here, ahead) = point.family.recut(point.passage.best, [
        point.unknowns, point.unknowns + _AHEAD * point.tangent])
    along = (ahead - here) / np.linalg.norm(ahead - here)
    try:
        unknowns, _ = corrected(family, here, along)
    except LostError:
        return point
    return point_at(family, unknowns, along)


def located(before: BranchPoint, after: BranchPoint, test: Callable[[BranchPoint], float],
            tolerance: float) -> tuple[BranchPoint, float]:
    """The point between two neighbours where a test function changes its sign, by bisection and secant (Illinois).

    Parameters
    ----------
    before, after : BranchPoint
        Neighbours with one cut.
    test : callable
        Of different signs there; +-1 where only the sign is known, which is then bisected.
    tolerance : float
        Of the parameter, as a share of its range, dimensionless.

    Returns
    -------
    BranchPoint, float
        The point, and the width of the interval of the parameter [its unit] that holds the change.
    """
    family, start, end = before.family, before.unknowns, after.unknowns
    span = end - start
    length = float(np.linalg.norm(span))
    normal = span / length
    low, high, at_low, at_high = 0.0, 1.0, test(before), test(after)
    low_point, high_point = before, after
    while (high - low) * length > 0.1 * tolerance and _width(low_point, high_point, (high - low) * length) > tolerance:
        secant = low + (high - low) * at_low / (at_low - at_high)
        middle = min(max(secant, low + 1e-3 * (high - low)), high - 1e-3 * (high - low))
        unknowns, _ = corrected(family, start + middle * span, normal, length)
        point = point_at(family, unknowns, before.tangent, length, fine=True)
        at = test(point)
        if (at > 0.0) == (at_low > 0.0):
            low, at_low, at_high, low_point = middle, at, 0.5 * at_high, point
        else:
            high, at_high, at_low, high_point = middle, at, 0.5 * at_low, point
        if at == 0.0 or abs(low_point.unknowns[-1] - high_point.unknowns[-1]) < 1e-15:
            break
    best = low_point if abs(test(low_point)) < abs(test(high_point)) else high_point
    width = _width(low_point, high_point, (high - low) * length)
    return best, family.span(width)


def _width(low: BranchPoint, high: BranchPoint, arc: float) -> float:
    """How much of the parameter's range lies between two points; at a fold the tangents tell, not the difference."""
    within = max(abs(low.tangent[-1]), abs(high.tangent[-1])) * arc
    return float(max(within, abs(low.unknowns[-1] - high.unknowns[-1]), 0.0 if arc < _ARC else arc))


def edge(point: BranchPoint, step: float) -> BranchPoint | None:
    """The farthest point of the branch, within an arc of `step`, with the events of `point` in their order.

    Returns
    -------
    BranchPoint or None
        Its tangent and multipliers are those of this side; None where the branch does not end at another order.
    """
    low, far, family = point, step, point.family
    try:
        for _ in range(_MOST_ROUNDS):
            unknowns, width = _last_of_side(low, far)
            ahead = unknowns + max(_CLEAR, 10.0 * width) * low.tangent
            apart = float(np.linalg.norm(unknowns - low.unknowns))
            if not same_order(family.order(ahead), low.passage.order):
                side = point_at(family, unknowns - min(_BACK, 0.5 * apart) * low.tangent, low.tangent, _BACK)
                return replace(side, unknowns=unknowns, passage=family.passage(unknowns),
                               mean_speed=family.mean_speed(unknowns), width=family.span(abs(width * low.tangent[-1])))
            if apart == 0.0:
                return None
            low, far = point_at(family, unknowns, low.tangent, far), far - apart  # the derivative had changed too much
    except (LostError, SimulationError, ValueError):
        pass
    return None


def _last_of_side(low: BranchPoint, far: float) -> tuple[np.ndarray, float]:
    """The last point within `far` that is found and has the events of `low`, and the arc in which that changes.

    By bisection, with the derivative at `low` for Newton's method: near the edge, differences would reach across.
    """
    family = low.family
    held = ~family.free(low.unknowns)[:-1]
    inverse = np.linalg.pinv(np.vstack([family.jacobian(low.unknowns, far), low.tangent]))

    def ahead(guess: np.ndarray) -> np.ndarray | None:
        at, before = guess.copy(), np.inf
        for _ in range(_MOST_CHORDS):
            residual = family.residual(at)
            residual[held] = 0.0
            size = float(np.abs(residual).max())
            if size <= 0.1 * CLOSED or size >= 0.7 * before:
                break
            at, before = at - inverse @ np.append(residual, low.tangent @ (at - guess)), size
        closes = size <= CLOSED and same_order(family.order(at), low.passage.order)
        return at if closes else None

    near, last = 0.0, low.unknowns
    while far - near > _SHARP:
        middle = 0.5 * (near + far)
        try:
            found = ahead(last + (middle - near) * low.tangent)
        except (SimulationError, ValueError):
            found = None
        if found is None:
            far = middle
        else:
            near, last = middle, found
    return last, far - near


def beyond(before: BranchPoint) -> BranchPoint:
    """The first point of the branch on the other side of an edge.

    The derivative of the map is taken on the prolongation of this side's branch, which lies on the other side; its null
    vector is the branch's direction there, forwards or back.

    Raises
    ------
    LostError
        Where no orbit is found there.
    """
    family = before.family
    for probe in _PROBES:
        try:
            direction = _direction(family, before, probe)
        except (SimulationError, ValueError, np.linalg.LinAlgError):
            continue
        if direction is not None:
            for arc, sign, depth in itertools.product(_ENTRIES, (1.0, -1.0), _DEPTHS):
                if found := _entered(before, sign * direction, arc, depth):
                    return found
    change, grazes = "which ones was not found", False
    for probe in (_CLEAR, *_PROBES):
        order = family.order(before.unknowns + probe * before.tangent)
        if not same_order(order, before.passage.order):
            change = change_in_words(before.passage.order, order)
            grazes = contacts_of(order) != contacts_of(before.passage.order)
            break
    raise EdgeError(f"the branch ends at {family.where(before.unknowns)}, where its events change ({change}); no "
                    "orbit was found beyond", SpecialPoint(GRAZING, before, before.width, change) if grazes else None)


def _direction(family: Family, before: BranchPoint, probe: float) -> np.ndarray | None:
    """Of the branch on the other side, towards that side if this can be told; None where it is not reached."""
    there = before.unknowns + probe * before.tangent
    if same_order(family.order(there), before.passage.order):
        return None
    *_, rows = np.linalg.svd(family.jacobian(there, probe))
    along: np.ndarray = rows[-1] if rows[-1] @ before.tangent >= 0.0 else -rows[-1]
    sides = [same_order(family.order(before.unknowns + sign * probe * along), before.passage.order)
             for sign in (1.0, -1.0)]
    return -along if sides == [True, False] else along


def _entered(before: BranchPoint, direction: np.ndarray, arc: float, depth: float) -> BranchPoint | None:
    """The orbit near `arc` along a direction from the edge; None where it is not one of the other side.

    Behind a grazing with the root of a distance, the branch begins along the edge, and is on the other side by the
    square of the arc only. So Newton's method begins deeper there, by `depth` times this square.
    """
    family = before.family
    guess = before.unknowns + arc * direction + depth * arc**2 * before.tangent
    try:
        if same_order(family.order(guess), before.passage.order):
            return None
        unknowns, _ = corrected(family, guess, direction, arc)
        if np.linalg.norm(unknowns - guess) > arc:
            return None
        found = point_at(family, unknowns, direction, arc)
    except (LostError, SimulationError, ValueError):
        return None
    return None if same_order(found.passage.order, before.passage.order) else found


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


def _torus_test(point: BranchPoint) -> float:
    first, second = np.triu_indices(len(point.multipliers), 1)
    return float(np.prod(point.multipliers[first] * point.multipliers[second] - 1.0).real)


_TESTS: dict[str, Callable[[BranchPoint], float]] = {
    FOLD: lambda point: float(point.tangent[-1]),
    DOUBLING: lambda point: float(np.prod(point.multipliers + 1.0).real), TORUS: _torus_test}


def special_points(before: BranchPoint, after: BranchPoint) -> Iterator[SpecialPoint]:
    """Special points between two neighbours of a branch, in the order of their kinds.

    A pair of special points of one kind between two neighbours is not seen: neighbours are at most
    `continuation.LONGEST_STEP` apart, and closer where the branch bends.
    """
    orders = before.passage.order, after.passage.order
    if not same_order(*orders):
        turns_back = before.tangent[-1] * after.tangent[-1] < 0.0
        change = change_in_words(*orders) + ("; the branch turns back" if turns_back else "")
        if contacts_of(orders[0]) != contacts_of(orders[1]):
            yield SpecialPoint(GRAZING, before, before.width, change)
        elif not _is_smooth(before, after):
            yield SpecialPoint(CORNER, before, before.width, change)
        return
    for kind, test in _TESTS.items():
        if (test(before) > 0.0) != (test(after) > 0.0):
            point, width = located(before, after, test, TOLERANCE)
            pair = np.abs(point.multipliers[point.multipliers.imag != 0.0])
            # Real multipliers whose product is 1 are a neutral saddle, which is no Neimark-Sacker point.
            if kind != TORUS or (len(pair) and np.abs(pair - 1.0).min() < _UNIT):
                yield SpecialPoint(kind, point, width)


def _is_smooth(before: BranchPoint, after: BranchPoint) -> bool:
    """Whether a branch goes straight on across an edge, and its multipliers with it."""
    family, start = before.family, before.unknowns
    direction = (after.unknowns - start) / np.linalg.norm(after.unknowns - start)
    try:
        unknowns, _ = corrected(family, start + _BEHIND * direction, direction, _BEHIND)
        near = point_at(family, unknowns, direction, _BEHIND)
    except LostError:
        return False
    here, there = np.poly(before.multipliers), np.poly(near.multipliers)
    return bool(1.0 - before.tangent @ near.tangent < _SMOOTH
                and np.abs(here - there).max() < _SMOOTH * np.abs(here).max())
