"""Continuation: a branch of periodic orbits as a parameter changes, by pseudo-arclength, through folds.

The method is H. B. Keller's, in P. H. Rabinowitz (ed.), Applications of Bifurcation Theory, 1977, pp. 359-384: a step
along the branch's tangent, then Newton's method on the plane across its end.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from vibro_ros.orbits.family import Family, Place
from vibro_ros.orbits.newton import CLOSED
from vibro_ros.orbits.passage import Passage, passage
from vibro_ros.simulation.motion import SimulationError

FIRST_STEP, LONGEST_STEP, SHORTEST_STEP = 0.01, 0.05, 1e-10
"""Steps along the branch: in units of the machine and shares of the parameter's range."""
GRAZES = 1e-6
"""Nearest miss of a rigid plate [crank radii] that is followed."""
NEAREST_EVENT = 0.01
"""Share of a turn that the cut keeps from all events; nearer, the branch is cut elsewhere."""
_AHEAD = 1e-6  # along the branch: where its direction is looked for when the cut changes
_MOST_ITERATIONS = 12
_FEW_ITERATIONS = 4  # after which the next step is longer
_STRAIGHT = 0.9  # cosine between tangents of neighbours, at least: else the corner is rounded by a shorter step


@dataclass(frozen=True)
class BranchPoint:
    """One orbit of a branch.

    Attributes
    ----------
    family : Family
        The equations, with the cut that was used.
    place : Place
        State and parameter.
    tangent : ndarray, shape (n + 1,)
        Unit vector along the branch.
    multipliers : ndarray of complex, shape (n,)
        Floquet multipliers, the largest first.
    mean_speed : float
        Of the body [m/s].
    passage : Passage
        Its contacts.
    """

    family: Family
    place: Place
    tangent: np.ndarray
    multipliers: np.ndarray
    mean_speed: float
    passage: Passage

    @property
    def value(self) -> float:
        """The parameter, in its unit."""
        return self.family.value(self.place.share)

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return bool(np.abs(self.multipliers).max(initial=0.0) < 1.0)


class LostError(RuntimeError):
    """A branch cannot be followed further; the message says why."""


def corrected(family: Family, guess: np.ndarray, normal: np.ndarray,
              reach: float = LONGEST_STEP) -> tuple[np.ndarray, int]:
    """The orbit on the plane through `guess` that is perpendicular to `normal`, and Newton's iterations.

    Parameters
    ----------
    family : Family
        The equations.
    guess, normal : ndarray, shape (n + 1,)
        State and share; the plane's normal.
    reach : float
        See `Family.jacobian`; dimensionless.

    Raises
    ------
    LostError
        Where Newton's method does not converge.
    """
    at, best, closest = guess.copy(), np.inf, guess
    for iteration in range(_MOST_ITERATIONS):
        try:
            place = Place.of(at)
            held, residual = family.held(place), family.residual(place)
            size = float(np.abs(residual).max())
            if size <= CLOSED and size >= 0.25 * best:  # as good as rounding lets it become
                return at, iteration
            if size < best:
                best, closest = size, at
            matrix = np.vstack([family.jacobian(place, held, reach), normal])
            residual[held] = 0.0
            at = at - np.linalg.solve(matrix, np.append(residual, normal @ (at - guess)))
        except (np.linalg.LinAlgError, SimulationError, ValueError) as error:
            raise LostError(str(error)) from error
        if not np.all(np.isfinite(at)) or np.abs(at - guess).max() > 10.0 * LONGEST_STEP:
            break
    if best <= CLOSED:
        return closest, _MOST_ITERATIONS
    raise LostError(f"Newton's method does not close an orbit near {family.name} = {family.value(guess[-1]):.9g}")


def tangent_at(family: Family, place: Place, along: np.ndarray,
               reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Unit tangent of the branch in the direction of `along`, and the derivative of the map by the state, (n, n)."""
    held, n = family.held(place), len(place.state)
    matrix = family.jacobian(place, held, reach)
    *_, rows = np.linalg.svd(matrix)
    tangent = rows[-1] if rows[-1] @ along >= 0.0 else -rows[-1]
    return tangent, matrix[:, :n] + np.eye(n)


def point_at(family: Family, vector: np.ndarray, along: np.ndarray,
             reach: float = LONGEST_STEP) -> BranchPoint:
    """The branch's point at a solution, shape (n + 1,)."""
    place = Place.of(vector)
    tangent, matrix = tangent_at(family, place, along, reach)
    found = np.linalg.eigvals(matrix)
    turn_map = family.map_at(place.share)
    advance = turn_map(place.state, family.turns).advance
    return BranchPoint(family, place, tangent, found[np.argsort(-np.abs(found), kind="stable")],
                       advance / (family.turns * turn_map.period), passage(turn_map, place.state, family.turns))


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
    point, step = _well_cut(point_at(family, vector, along)), FIRST_STEP
    yield point, point
    while 0.0 <= point.place.share <= 1.0:
        after, step = _next(point, step)
        yield point, after
        _stop_at_graze(point, after)
        point = _well_cut(after)


def _stop_at_graze(point: BranchPoint, after: BranchPoint) -> None:
    """Say where the branch ends because a mass that misses its rigid plate is about to touch it.

    There the branch has a corner, and behind it the map has the root of the distance. A compliant plate rounds both.
    """
    scene, left = after.family.scene, after.passage.miss
    rigid = any(scene[f"effects.{side}_contact"] == "restitution" for side in scene.plates)
    if rigid and left < GRAZES and left < point.passage.miss:
        rate = (after.value - point.value) / (point.passage.miss - left)
        raise LostError(f"the branch ends at {after.family.name} = {after.value + rate * left:.9g}, where a mass "
                        "grazes its rigid plate")


def _next(point: BranchPoint, step: float) -> tuple[BranchPoint, float]:
    """The next point, and the step after it."""
    family, reason = point.family, ""
    while step >= SHORTEST_STEP:
        guess = point.place.vector + step * point.tangent
        try:
            vector, iterations = corrected(family, guess, point.tangent, step)
            after = point_at(family, vector, point.tangent, step)
            if after.tangent @ point.tangent >= _STRAIGHT:
                longer = 1.5 if iterations <= _FEW_ITERATIONS else 1.0
                return after, min(LONGEST_STEP, step * longer)
            reason = f"the branch bends too sharply near {family.name} = {after.value:.9g}"
        except LostError as error:
            reason = str(error)
        step *= 0.5
    raise LostError(reason)


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
    while (high - low) * length > 0.1 * tolerance:
        middle = _between(low, high, at_low, at_high)
        vector, _ = corrected(family, start + middle * span, normal, length)
        point = point_at(family, vector, before.tangent, length)
        at = test(point)
        if (at > 0.0) == (at_low > 0.0):
            low, at_low, at_high, low_point = middle, at, 0.5 * at_high, point
        else:
            high, at_high, at_low, high_point = middle, at, 0.5 * at_low, point
        if at == 0.0 or abs(low_point.place.share - high_point.place.share) < 1e-15:
            break
    best = low_point if abs(test(low_point)) < abs(test(high_point)) else high_point
    return best, abs(high_point.value - low_point.value)


def _between(low: float, high: float, at_low: float, at_high: float) -> float:
    secant = low + (high - low) * at_low / (at_low - at_high)
    return min(max(secant, low + 1e-3 * (high - low)), high - 1e-3 * (high - low))
