"""Continuation of a branch of periodic orbits over one parameter, and location of its special points.

The method is H. B. Keller's pseudo-arclength continuation, in P. H. Rabinowitz (ed.), Applications of Bifurcation
Theory, 1977, pp. 359-384: a step along the branch's tangent, then Newton's method on the plane across its end. It
passes folds.

Where the order of events along an orbit changes, a branch has an *edge*. On each side of the edge the turn map is
smooth, and so is the branch; at the edge the branch has a corner, may turn back, or goes on like the square root of the
distance. So no step of the continuation and no difference of a derivative crosses an edge: the branch is followed up to
the edge with the map of this side, and restarted beyond it with the map of the other side.

Special points are folds, period doublings, Neimark-Sacker points, grazings and corners.

The first three have a test function that changes its sign there (Yu. A. Kuznetsov, Elements of Applied Bifurcation
Theory, section 10.2); with the multipliers lambda:

- a fold, where the parameter turns back: the parameter's component of the branch's tangent;
- a period doubling: the product of lambda_i + 1;
- a Neimark-Sacker point, where a motion with a second frequency is born: the product of lambda_i lambda_j - 1 over all
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

import numpy as np

from vibro_lab.orbits.family import BranchPoint, Family, LostError, corrected_orbit, point_at
from vibro_lab.orbits.orbit import CLOSED
from vibro_lab.orbits.passage import change_in_words, contacts_of, same_order
from vibro_ros import SimulationError

FOLD, DOUBLING, TORUS, GRAZING, CORNER = "fold", "period doubling", "Neimark-Sacker", "grazing", "corner"


class EdgeError(LostError):
    """A branch ends where its events change; `grazing` is the special point there, or None if it is not a grazing."""

    def __init__(self, message: str, grazing: "SpecialPoint | None"):
        super().__init__(message)
        self.grazing = grazing


def follow(point: BranchPoint) -> Iterator[tuple[BranchPoint, BranchPoint]]:
    """Follow the branch from a point, along its tangent, until it leaves the parameter's range (else LostError).

    Yields each point with the next one, both with the same cut; first the point twice.
    """
    point, step = _well_cut(point), point.family.settings.first_step
    yield point, point
    while 0.0 <= point.unknowns[-1] <= 1.0:
        neighbours, step = _next(point, step)
        for neighbour in neighbours:
            yield point, neighbour
            point = neighbour
        point = _well_cut(point)


def _next(point: BranchPoint, step: float) -> tuple[list[BranchPoint], float]:
    """Return the next point, or an edge and the first point beyond it, and the length of the following step.

    An arc that fails is halved, down to the shortest step (LostError if none succeeds).
    """
    family, settings, reason = point.family, point.family.settings, ""
    while step >= settings.shortest_step:
        guess = point.unknowns + step * point.tangent
        try:
            unknowns, derivatives = corrected_orbit(family, guess, point.tangent, step)
            next_point = point_at(family, unknowns, point.tangent, step)
            crosses = not same_order(next_point.passage.order, point.passage.order)
            if not crosses and 1.0 - next_point.tangent @ point.tangent <= settings.bend:
                growth = 1.5 if derivatives <= settings.easy_iterations else 1.0
                return [next_point], min(settings.longest_step, step * growth)
            reason = f"the branch bends too sharply near {family.where(next_point.unknowns)}"
        except LostError as error:
            reason, crosses = str(error), _changes_order(point, guess)
        if (crosses or step < settings.edge_search_step) and (edge := point_before_edge(point, step)):
            return [edge, point_beyond_edge(edge)], settings.first_step
        if step < 2.0 * settings.stiff_step and abs(point.multipliers[0]) > settings.stiff_multiplier:
            raise LostError(f"too unstable to be followed beyond {family.where(point.unknowns)}: a disturbance grows "
                            f"{abs(point.multipliers[0]):.4g}-fold until the motion repeats itself")
        step *= 0.5
    raise LostError(reason)


def _changes_order(point: BranchPoint, guess: np.ndarray) -> bool:
    """Whether the events at a guess have another order than at a point of the branch; False if the guess cannot run."""
    try:
        return not same_order(point.family.order(guess), point.passage.order)
    except (SimulationError, ValueError):
        return False


def _well_cut(point: BranchPoint) -> BranchPoint:
    """Return the same orbit with a cut that is far from all events."""
    settings = point.family.settings
    if point.passage.clear >= settings.nearest_event:
        return point
    family, (start, ahead) = point.family.recut(point.passage.best, [
        point.unknowns, point.unknowns + settings.direction_arc * point.tangent])
    direction = (ahead - start) / np.linalg.norm(ahead - start)
    try:
        unknowns, _ = corrected_orbit(family, start, direction)
    except LostError:
        return point
    return point_at(family, unknowns, direction)


def locate_zero(first: BranchPoint, second: BranchPoint, test: Callable[[BranchPoint], float],
                tolerance: float) -> tuple[BranchPoint, float]:
    """Locate the zero of a test function between two neighbours by the Illinois method (secant and bisection).

    The test has different signs at both neighbours, which have the same cut; with values +-1 the method bisects.
    Returns the point, and the width of the interval of the parameter [its unit] that contains the zero; `tolerance`
    limits this width, as a share of the parameter's range.
    """
    family, start, end = first.family, first.unknowns, second.unknowns
    span = end - start
    length = float(np.linalg.norm(span))
    normal = span / length
    low, high, value_low, value_high = 0.0, 1.0, test(first), test(second)
    low_point, high_point = first, second
    while (high - low) * length > 0.1 * tolerance and _width(low_point, high_point, (high - low) * length) > tolerance:
        secant = low + (high - low) * value_low / (value_low - value_high)
        middle = min(max(secant, low + 1e-3 * (high - low)), high - 1e-3 * (high - low))
        unknowns, _ = corrected_orbit(family, start + middle * span, normal, length)
        point = point_at(family, unknowns, first.tangent, length, fine=True)
        value = test(point)
        if (value > 0.0) == (value_low > 0.0):
            low, value_low, value_high, low_point = middle, value, 0.5 * value_high, point
        else:
            high, value_high, value_low, high_point = middle, value, 0.5 * value_low, point
        if value == 0.0 or np.abs(low_point.unknowns - high_point.unknowns).max() < 1e-15:
            break  # not where the parameter alone is equal, as it is on both sides of a fold
    best = low_point if abs(test(low_point)) < abs(test(high_point)) else high_point
    return best, family.span(_width(low_point, high_point, (high - low) * length))


def _width(low: BranchPoint, high: BranchPoint, arc: float) -> float:
    """Share of the parameter's range between two points; at a fold from the tangents, because the difference is small.
    """
    within, least_arc = max(abs(low.tangent[-1]), abs(high.tangent[-1])) * arc, low.family.settings.least_arc
    return float(max(within, abs(low.unknowns[-1] - high.unknowns[-1]), 0.0 if arc < least_arc else arc))


def point_before_edge(point: BranchPoint, step: float) -> BranchPoint | None:
    """Return the farthest point of the branch, within an arc of `step`, with the same order of events as `point`.

    It has tangent and multipliers of this side; None if the order of events does not change there.
    """
    low, far, family, settings = point, step, point.family, point.family.settings
    try:
        for _ in range(settings.most_rounds):
            unknowns, width = _last_of_side(low, far)
            probe = unknowns + max(settings.beyond_arc, 10.0 * width) * low.tangent
            distance = float(np.linalg.norm(unknowns - low.unknowns))
            if not same_order(family.order(probe), low.passage.order):
                near_edge = unknowns - min(settings.before_arc, 0.5 * distance) * low.tangent
                side = point_at(family, near_edge, low.tangent, settings.before_arc)
                return replace(side, unknowns=unknowns, passage=family.passage(unknowns),
                               mean_speed=family.mean_speed(unknowns), width=family.span(abs(width * low.tangent[-1])))
            if distance == 0.0:
                return None
            # The order ahead is the same: the search failed because the derivative at `low` was too old.
            low, far = point_at(family, unknowns, low.tangent, far), far - distance
    except (LostError, SimulationError, ValueError):
        pass
    return None


def _last_of_side(low: BranchPoint, far: float) -> tuple[np.ndarray, float]:
    """Find the last point within the arc `far` that has the order of events of `low`, and the arc left uncertain.

    By bisection; Newton's method uses the derivative at `low`, because differences near the edge would cross it.
    """
    family, settings = low.family, low.family.settings
    held = ~family.free(low.unknowns)[:-1]
    inverse = np.linalg.pinv(np.vstack([family.jacobian(low.unknowns, far), low.tangent]))

    def closed_orbit(guess: np.ndarray) -> np.ndarray | None:
        unknowns, last_size = guess.copy(), np.inf
        for _ in range(settings.most_chords):
            residual = family.residual(unknowns)
            residual[held] = 0.0
            size = float(np.abs(residual).max())
            if size <= 0.1 * CLOSED or size >= 0.7 * last_size:
                break
            unknowns, last_size = unknowns - inverse @ np.append(residual, low.tangent @ (unknowns - guess)), size
        closes = size <= CLOSED and same_order(family.order(unknowns), low.passage.order)
        return unknowns if closes else None

    near, last = 0.0, low.unknowns
    while far - near > settings.edge_arc:
        middle = 0.5 * (near + far)
        try:
            orbit = closed_orbit(last + (middle - near) * low.tangent)
        except (SimulationError, ValueError):
            orbit = None
        if orbit is None:
            far = middle
        else:
            near, last = middle, orbit
    return last, far - near


def point_beyond_edge(edge: BranchPoint) -> BranchPoint:
    """Return the first point of the branch on the other side of an edge.

    The derivative of the residual is computed on the extrapolation of this side's branch, which lies on the other side;
    its null vector is the branch's direction there, forwards or backwards.
    """
    family, settings = edge.family, edge.family.settings
    for probe in settings.derivative_arcs:
        try:
            direction = _direction(family, edge, probe)
        except (SimulationError, ValueError, np.linalg.LinAlgError):
            continue
        if direction is not None:
            for arc, sign, depth in itertools.product(settings.first_point_arcs, (1.0, -1.0), settings.depths):
                if first_point := _entered(edge, sign * direction, arc, depth):
                    return first_point
    change, grazes = "which ones was not found", False
    for probe in (settings.beyond_arc, *settings.derivative_arcs):
        order = family.order(edge.unknowns + probe * edge.tangent)
        if not same_order(order, edge.passage.order):
            change = change_in_words(edge.passage.order, order)
            grazes = contacts_of(order) != contacts_of(edge.passage.order)
            break
    raise EdgeError(f"the branch ends at {family.where(edge.unknowns)}, where its events change ({change}); no "
                    "orbit was found beyond", SpecialPoint(GRAZING, edge, edge.width, change) if grazes else None)


def _direction(family: Family, edge: BranchPoint, probe: float) -> np.ndarray | None:
    """Direction of the branch on the other side, pointing into that side if known; None if `probe` does not reach it.
    """
    probe_point = edge.unknowns + probe * edge.tangent
    if same_order(family.order(probe_point), edge.passage.order):
        return None
    *_, rows = np.linalg.svd(family.jacobian(probe_point, probe))
    direction: np.ndarray = rows[-1] if rows[-1] @ edge.tangent >= 0.0 else -rows[-1]
    sides = [same_order(family.order(edge.unknowns + sign * probe * direction), edge.passage.order)
             for sign in (1.0, -1.0)]
    return -direction if sides == [True, False] else direction


def _entered(edge: BranchPoint, direction: np.ndarray, arc: float, depth: float) -> BranchPoint | None:
    """Orbit at about the distance `arc` from the edge along a direction; None if it is not on the other side.

    Beyond a grazing where the map behaves like a square root, the branch begins along the edge, and its distance from
    the edge grows only with the square of the arc. So Newton's method begins deeper, by `depth` times this square.
    """
    family = edge.family
    guess = edge.unknowns + arc * direction + depth * arc**2 * edge.tangent
    try:
        if same_order(family.order(guess), edge.passage.order):
            return None
        unknowns, _ = corrected_orbit(family, guess, direction, arc)
        if np.linalg.norm(unknowns - guess) > arc:
            return None
        entered = point_at(family, unknowns, direction, arc)
    except (LostError, SimulationError, ValueError):
        return None
    return None if same_order(entered.passage.order, edge.passage.order) else entered


@dataclass(frozen=True)
class SpecialPoint:
    """A special point of a branch."""

    kind: str  # `FOLD`, `DOUBLING`, `TORUS`, `GRAZING` or `CORNER`
    point: BranchPoint  # point of the branch there
    width: float  # width of the interval of the parameter [its unit] in which it was found
    # Change of the order of events, such as ``stick vanishes``, and whether the branch turns back there; empty if the
    # order does not change.
    change: str = ""


def _torus_test(point: BranchPoint) -> float:
    first, second = np.triu_indices(len(point.multipliers), 1)
    return float(np.prod(point.multipliers[first] * point.multipliers[second] - 1.0).real)


_TESTS: dict[str, Callable[[BranchPoint], float]] = {
    FOLD: lambda point: float(point.tangent[-1]),
    DOUBLING: lambda point: float(np.prod(point.multipliers + 1.0).real), TORUS: _torus_test}


def special_points(first: BranchPoint, second: BranchPoint) -> Iterator[SpecialPoint]:
    """Special points between two neighbours of a branch, in the order of their kinds.

    Two special points of the same kind between two neighbours are not found. Neighbours are at most the longest step
    apart, and closer where the branch bends.
    """
    orders = first.passage.order, second.passage.order
    if not same_order(*orders):
        turns_back = first.tangent[-1] * second.tangent[-1] < 0.0
        change = change_in_words(*orders) + ("; the branch turns back" if turns_back else "")
        if contacts_of(orders[0]) != contacts_of(orders[1]):
            yield SpecialPoint(GRAZING, first, first.width, change)
        elif not _is_smooth(first, second):
            yield SpecialPoint(CORNER, first, first.width, change)
        return
    for kind, test in _TESTS.items():
        if (test(first) > 0.0) != (test(second) > 0.0):
            point, width = locate_zero(first, second, test, first.family.settings.tolerance)
            pair = np.abs(point.multipliers[point.multipliers.imag != 0.0])
            # Real multipliers whose product is 1 are a neutral saddle, not a Neimark-Sacker point.
            if kind != TORUS or (len(pair) and np.abs(pair - 1.0).min() < first.family.settings.circle):
                yield SpecialPoint(kind, point, width)


def _is_smooth(first: BranchPoint, second: BranchPoint) -> bool:
    """Whether neither the tangent nor the multipliers of a branch jump across an edge."""
    family, start, arc = first.family, first.unknowns, first.family.settings.compared_arc
    direction = (second.unknowns - start) / np.linalg.norm(second.unknowns - start)
    try:
        unknowns, _ = corrected_orbit(family, start + arc * direction, direction, arc)
        near = point_at(family, unknowns, direction, arc)
    except LostError:
        return False
    polynomial, beyond = np.poly(first.multipliers), np.poly(near.multipliers)
    largest = family.settings.smooth_change
    return bool(1.0 - first.tangent @ near.tangent < largest
                and np.abs(polynomial - beyond).max() < largest * np.abs(polynomial).max())
