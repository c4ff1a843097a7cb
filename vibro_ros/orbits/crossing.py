"""Where the order of events along an orbit changes, a branch has an edge: how to find it, and how to go on beyond it.

On each side of the edge the turn map is smooth, and the branch with it; at the edge the branch has a corner, may turn
back, or goes on with the root of a distance. So no step of the continuation and no difference of a derivative goes
across: the branch is followed up to the edge with the map of the one side, and begun anew beyond it with the map of the
other side.
"""

import itertools
from dataclasses import replace

import numpy as np

from vibro_ros.orbits.branch_point import BranchPoint, LostError, corrected, orbit_of, point_at
from vibro_ros.orbits.event_order import change_in_words, same_order
from vibro_ros.orbits.family import Family, Place
from vibro_ros.orbits.newton import CLOSED
from vibro_ros.simulation.motion import SimulationError

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
            vector, width = _last_of_side(low, far)
            ahead = Place.of(vector + max(_CLEAR, 10.0 * width) * low.tangent)
            apart = float(np.linalg.norm(vector - low.place.vector))
            if not same_order(family.order(ahead), low.passage.order):
                side = point_at(family, vector - min(_BACK, 0.5 * apart) * low.tangent, low.tangent, _BACK)
                width = abs(width * low.tangent[-1]) * (family.high - family.low)
                here = orbit_of(family, Place.of(vector))
                return replace(side, place=here.place, passage=here.passage, mean_speed=here.mean_speed, width=width)
            if apart == 0.0:
                return None
            low, far = point_at(family, vector, low.tangent, far), far - apart  # the derivative had changed too much
    except (LostError, SimulationError, ValueError):
        pass
    return None


def _last_of_side(low: BranchPoint, far: float) -> tuple[np.ndarray, float]:
    """The last point within `far` that is found and has the events of `low`, and the arc in which that changes.

    By bisection, with the derivative at `low` for Newton's method: near the edge, differences would reach across.
    """
    family = low.family
    held = family.held(low.place)
    inverse = np.linalg.pinv(np.vstack([family.jacobian(low.place, held, far), low.tangent]))

    def ahead(guess: np.ndarray) -> np.ndarray | None:
        at, before = guess.copy(), np.inf
        for _ in range(_MOST_CHORDS):
            residual = family.residual(Place.of(at))
            residual[held] = 0.0
            size = float(np.abs(residual).max())
            if size <= 0.1 * CLOSED or size >= 0.7 * before:
                break
            at, before = at - inverse @ np.append(residual, low.tangent @ (at - guess)), size
        closes = size <= CLOSED and same_order(family.order(Place.of(at)), low.passage.order)
        return at if closes else None

    near, last = 0.0, low.place.vector
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
    raise LostError(f"the branch ends at {family.name} = {before.value:.9g}, where its events change "
                    f"({_change_ahead(before)}); no orbit was found beyond")


def _change_ahead(before: BranchPoint) -> str:
    """What is different beyond an edge, in words."""
    for probe in (_CLEAR, *_PROBES):
        order = before.family.order(Place.of(before.place.vector + probe * before.tangent))
        if not same_order(order, before.passage.order):
            return change_in_words(before.passage.order, order)
    return "which ones was not found"


def _direction(family: Family, before: BranchPoint, probe: float) -> np.ndarray | None:
    """Of the branch on the other side, towards that side if this can be told; None where it is not reached."""
    place = Place.of(before.place.vector + probe * before.tangent)
    if same_order(family.order(place), before.passage.order):
        return None
    *_, rows = np.linalg.svd(family.jacobian(place, family.held(place), probe))
    along: np.ndarray = rows[-1] if rows[-1] @ before.tangent >= 0.0 else -rows[-1]
    sides = [same_order(family.order(Place.of(before.place.vector + sign * probe * along)), before.passage.order)
             for sign in (1.0, -1.0)]
    return -along if sides == [True, False] else along


def _entered(before: BranchPoint, direction: np.ndarray, arc: float, depth: float) -> BranchPoint | None:
    """The orbit near `arc` along a direction from the edge; None where it is not one of the other side.

    Behind a grazing with the root of a distance, the branch begins along the edge, and is on the other side by the
    square of the arc only. So Newton's method begins deeper there, by `depth` times this square.
    """
    family = before.family
    guess = before.place.vector + arc * direction + depth * arc**2 * before.tangent
    try:
        if same_order(family.order(Place.of(guess)), before.passage.order):
            return None
        vector, _ = corrected(family, guess, direction, arc)
        if np.linalg.norm(vector - guess) > arc:
            return None
        found = point_at(family, vector, direction, arc)
    except (LostError, SimulationError, ValueError):
        return None
    return None if same_order(found.passage.order, before.passage.order) else found
