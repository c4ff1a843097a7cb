"""Continuation: a branch of periodic orbits as a parameter changes, by pseudo-arclength, through folds.

The method is H. B. Keller's, in P. H. Rabinowitz (ed.), Applications of Bifurcation Theory, 1977, pp. 359-384: a step
along the branch's tangent, then Newton's method on the plane across its end.
"""

from collections.abc import Callable, Iterator

import numpy as np

from vibro_ros.orbits.branch_point import LONGEST_STEP, BranchPoint, LostError, corrected, point_at
from vibro_ros.orbits.crossing import STRAIGHT, beyond, edge
from vibro_ros.orbits.event_order import same_order
from vibro_ros.orbits.family import Family, Place
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


def follow(family: Family, state: np.ndarray, share: float,
           direction: float) -> Iterator[tuple[BranchPoint, BranchPoint]]:
    """Neighbours on the branch through a known orbit, until it leaves the parameter's range.

    Parameters
    ----------
    family : Family
        The equations.
    state : ndarray, shape (n,)
        An orbit at `share`.
    share : float
        Where to begin, dimensionless.
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
    along = np.append(np.zeros_like(state), direction)
    vector, _ = corrected(family, np.append(state, share), along)
    yield from follow_on(point_at(family, vector, along))


def follow_on(point: BranchPoint) -> Iterator[tuple[BranchPoint, BranchPoint]]:
    """Neighbours on the branch from a point on, along its tangent; as `follow`, which see."""
    point, step = _well_cut(point), FIRST_STEP
    yield point, point
    while 0.0 <= point.place.share <= 1.0:
        neighbours, step = _next(point, step)
        for after in neighbours:
            yield point, after
            point = after
        point = _well_cut(point)


def _next(point: BranchPoint, step: float) -> tuple[list[BranchPoint], float]:
    """The next point, or an edge and the first point beyond it; and the step after it."""
    family, reason = point.family, ""
    while step >= SHORTEST_STEP:
        guess = point.place.vector + step * point.tangent
        crosses = False
        try:
            vector, derivatives = corrected(family, guess, point.tangent, step)
            after = point_at(family, vector, point.tangent, step)
            crosses = not same_order(after.passage.order, point.passage.order)
            if not crosses and after.tangent @ point.tangent >= STRAIGHT:
                longer = 1.5 if derivatives <= _FEW else 1.0
                return [after], min(LONGEST_STEP, step * longer)
            reason = f"the branch bends too sharply near {family.name} = {after.value:.9g}"
        except LostError as error:
            reason, crosses = str(error), _differs(point, guess)
        if (crosses or step < _SHORT) and (last := edge(point, step)):
            return [last, beyond(last)], FIRST_STEP
        step *= 0.5
        if step < _CREEP and abs(point.multipliers[0]) > _WILD:
            raise LostError(f"too unstable to be followed beyond {family.name} = {point.value:.9g}: a disturbance "
                            f"grows {abs(point.multipliers[0]):.4g}-fold until the motion repeats itself")
    raise LostError(reason)


def _differs(point: BranchPoint, guess: np.ndarray) -> bool:
    """Whether the events of a guess come in another order than those of a point."""
    try:
        return not same_order(point.family.order(Place.of(guess)), point.passage.order)
    except (SimulationError, ValueError):
        return False


def _well_cut(point: BranchPoint) -> BranchPoint:
    """The same orbit, cut far from all events."""
    if point.passage.clear >= NEAREST_EVENT:
        return point
    beyond = Place.of(point.place.vector + _AHEAD * point.tangent)
    family, (place, beyond) = point.family.recut(point.passage.best, iter([point.place, beyond]))
    along = (beyond.vector - place.vector) / np.linalg.norm(beyond.vector - place.vector)
    try:
        vector, _ = corrected(family, place.vector, along)
    except LostError:
        return point
    return point_at(family, vector, along)


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
    family, start, end = before.family, before.place.vector, after.place.vector
    span = end - start
    length = float(np.linalg.norm(span))
    normal = span / length
    low, high, at_low, at_high = 0.0, 1.0, test(before), test(after)
    low_point, high_point = before, after
    while (high - low) * length > 0.1 * tolerance and _width(low_point, high_point, (high - low) * length) > tolerance:
        middle = _between(low, high, at_low, at_high)
        vector, _ = corrected(family, start + middle * span, normal, length)
        point = point_at(family, vector, before.tangent, length, fine=True)
        at = test(point)
        if (at > 0.0) == (at_low > 0.0):
            low, at_low, at_high, low_point = middle, at, 0.5 * at_high, point
        else:
            high, at_high, at_low, high_point = middle, at, 0.5 * at_low, point
        if at == 0.0 or abs(low_point.place.share - high_point.place.share) < 1e-15:
            break
    best = low_point if abs(test(low_point)) < abs(test(high_point)) else high_point
    width = _width(low_point, high_point, (high - low) * length)
    return best, width * (family.high - family.low)


def _width(low: BranchPoint, high: BranchPoint, arc: float) -> float:
    """How much of the parameter's range lies between two points; at a fold the tangents tell, not the difference."""
    within = max(abs(low.tangent[-1]), abs(high.tangent[-1])) * arc
    return float(max(within, abs(low.place.share - high.place.share), 0.0 if arc < _ARC else arc))


def _between(low: float, high: float, at_low: float, at_high: float) -> float:
    secant = low + (high - low) * at_low / (at_low - at_high)
    return min(max(secant, low + 1e-3 * (high - low)), high - 1e-3 * (high - low))
