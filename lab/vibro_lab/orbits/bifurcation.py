"""Curves of folds, period doublings and grazings over two parameters: equations, Newton's method, continuation.

The unknowns are the state and both parameters. The equations are the periodicity of the orbit and a *second equation*
that defines the special point (Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, section 10.3; W. Govaerts,
Numerical Methods for Bifurcations of Dynamical Equilibria, SIAM 2000). With the derivative A of the turn map it is

- at a fold or a period doubling: g = 0 of the bordered system [A -+ 1, b; c, 0] [v; g] = [0; 1], which is regular
  there, with b and c from a neighbour's null vectors w and v;
- at a grazing: the mass turns back at its plate. The equation is solved on the side without the contact, where the map
  is smooth, at a distance of 1e-6 crank radii from the plate. The derivative extrapolates the point to distance 0, with
  an error of second order in this distance.

The equation of folds and doublings needs derivatives of A, which are second differences of the map. Their error affects
the speed of Newton's method, not its result.

A curve is followed by pseudo-arclength continuation, as a branch is. It is smooth as long as the order of the orbit's
events does not change; where it changes, the curve is searched for on the other side, and may end there.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vibro_lab.orbits.continuation import DOUBLING, FIRST_STEP, FOLD, GRAZING, NEAREST_EVENT, take_step
from vibro_lab.orbits.family import LONGEST_STEP, BranchPoint, Family, LostError, multipliers_of
from vibro_lab.orbits.orbit import CLOSED
from vibro_lab.orbits.passage import Miss, Passage, change_in_words, least_gap, same_order
from vibro_lab.orbits.turn_map import TURN, direction
from vibro_ros import SimulationError

FOLLOWED = (FOLD, DOUBLING, GRAZING)
"""Kinds of special points whose curves can be followed."""
_CRITICAL = {FOLD: 1.0, DOUBLING: -1.0}  # critical multipliers
_GRAZING_DISTANCE = 1e-6  # crank radii: distance from the plate at which grazing orbits are computed
_LARGEST_DEFECT = 1e-7  # largest defect of the second equation; rounding of the derivative makes 1e-10 to 1e-8
_DIFFERENCE_STEP = 1e-4  # units of the machine: with `fine`, rounding / step is the larger error, 1e-10
_MOST_ITERATIONS, _SLOW_CONVERGENCE = 16, 0.1
_LARGEST_ANGLE_CHANGE = 0.3  # rad: largest change of a grazing's crank angle in one step
_DEPTHS = (1e-5, 1e-4, 1e-3, 1e-2)  # crank radii: distances to start from where the mass touches in the prediction


class Frame(NamedTuple):
    """Reference data of the second equation: null vectors of a fold or doubling; plate and crank angle of a grazing."""

    left: np.ndarray
    right: np.ndarray
    side: str = ""
    angle: float = 0.0  # crank angle [rad], over all turns of the orbit


class _Second(NamedTuple):
    """The second equation at a point: its defect, its derivative with respect to all unknowns, and its frame there."""

    defect: float
    slope: Callable[[], np.ndarray]
    frame: Frame


@dataclass(frozen=True)
class Bifurcation(BranchPoint):
    """A special point over two parameters, a `BranchPoint`.

    Attributes
    ----------
    kind : str
        One of `FOLLOWED`.
    near : ndarray, shape (n + 2,)
        Computed solution: the same as `unknowns`, but for a grazing at the distance `_GRAZING_DISTANCE` from the plate.
    matrix : ndarray, shape (n + 1, n + 2)
        Jacobian of the equations at `near`.
    frame : Frame
        Reference data of the second equation.
    """

    kind: str = ""
    near: np.ndarray = field(default_factory=lambda: np.empty(0))
    matrix: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    frame: Frame = Frame(np.zeros(0), np.zeros(0))


def _second(family: Family, kind: str, unknowns: np.ndarray, matrix: np.ndarray, frame: Frame | None) -> _Second:
    """Evaluate the second equation; `matrix` is the Jacobian of the residual there."""
    if kind == GRAZING:
        miss = _miss(family, unknowns, frame)
        angle = _angle(family, unknowns, miss) % (TURN * family.turns)
        return _Second(_distance(family, unknowns, miss) - _GRAZING_DISTANCE,
                       lambda: _distance_slope(family, unknowns, miss),
                       Frame(np.zeros(0), np.zeros(0), miss.side, angle))
    n = len(unknowns) - 2
    turn = matrix[:, :n] + np.eye(n)
    singular = turn - _CRITICAL[kind] * np.eye(n)
    if frame is None:
        u, _, v = np.linalg.svd(singular)
        frame = Frame(u[:, -1], v[-1])
    bordered = np.block([[singular, frame.left[:, None]], [frame.right[None, :], np.zeros((1, 1))]])
    last = np.append(np.zeros(n), 1.0)
    right, left = np.linalg.solve(bordered, last), np.linalg.solve(bordered.T, last)
    own = Frame(left[:n] / np.linalg.norm(left[:n]), right[:n] / np.linalg.norm(right[:n]))
    return _Second(float(right[n]), lambda: _derivative_slope(family, unknowns, -left[:n], right[:n]), own)


def _reach(seen: Passage, longest: float) -> float:
    """Step of second differences, at most `longest`, that stays on one side of all grazings."""
    return max(1e-6, min(longest, 0.005 * seen.softest**2, 0.1 * seen.miss))


def _derivative_slope(family: Family, unknowns: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """l' (dA/dz) r for each unknown z, shape (n + 2,), by second differences.

    A is the map's derivative, l is `left` and r is `right`.
    """
    step, n = _reach(family.passage(unknowns), _DIFFERENCE_STEP), len(unknowns) - 2
    free, size, row = family.free(unknowns), float(np.linalg.norm(right)), np.zeros(n + 2)
    along = np.append(right / size, [0.0, 0.0]) * free
    for i in np.flatnonzero(free):
        unit = np.eye(n + 2)[i]
        ends = [family.residual(unknowns + step * (a * unit + b * along)) for a in (1, -1) for b in (1, -1)]
        row[i] = (left * free[:n]) @ (ends[0] - ends[1] - ends[2] + ends[3]) * size / (4.0 * step**2)
    return row


def _miss(family: Family, unknowns: np.ndarray, frame: Frame | None) -> Miss:
    """Near miss of the mass that grazes its plate (LostError if the mass touches the plate)."""
    found, around = family.passage(unknowns).misses, TURN * family.turns

    def apart(miss: Miss) -> float:
        if frame is None:
            return miss.gap
        return abs((_angle(family, unknowns, miss) - frame.angle + 0.5 * around) % around - 0.5 * around)

    near = min((miss for miss in found if frame is None or miss.side == frame.side), key=apart, default=None)
    if near is None or apart(near) > _LARGEST_ANGLE_CHANGE:
        raise LostError("the mass touches its plate, or does not turn back before it")
    return near


def _angle(family: Family, unknowns: np.ndarray, miss: Miss) -> float:
    """Crank angle [rad] at which a mass turns back, counted continuously from the angle of the cut."""
    turn_map = family.map_at(unknowns)
    (turns,), _ = turn_map.shares(family.state(unknowns), np.array([0.5 * (miss.first + miss.last)]), np.zeros(1))
    return family.phase + direction(turn_map.scene) * float(turns) * TURN


def _distance(family: Family, unknowns: np.ndarray, miss: Miss) -> float:
    """Distance of a mass from its plate where it turns back, in crank radii."""
    turn_map = family.map_at(unknowns)
    return least_gap(turn_map, family.state(unknowns), miss) / turn_map.length


def _distance_slope(family: Family, unknowns: np.ndarray, miss: Miss) -> np.ndarray:
    """Derivative of `_distance` with respect to the unknowns, shape (n + 2,)."""
    free = family.free(unknowns)
    step, row = max(1e-9, 0.1 * min(_DIFFERENCE_STEP, _distance(family, unknowns, miss))), np.zeros(len(unknowns))
    for i in np.flatnonzero(free):
        moved = np.zeros(len(unknowns))
        moved[i] = step
        row[i] = (_distance(family, unknowns + moved, miss) - _distance(family, unknowns - moved, miss)) / (2.0 * step)
    return row


def found_near(family: Family, kind: str, guess: np.ndarray, normal: np.ndarray, frame: Frame | None,
               away: np.ndarray | None = None) -> tuple[Bifurcation, int]:
    """Special point in the plane through `guess` that is perpendicular to `normal`, and number of Newton iterations.

    Parameters
    ----------
    family : Family
        The equations, over two parameters.
    kind : str
        One of `FOLLOWED`.
    guess, normal : ndarray, shape (n + 2,)
        State and shares of the parameters; the plane's normal, which is roughly the direction of the tangent.
    frame : Frame or None
        Frame of a neighbouring point, if known.
    away : ndarray, shape (n + 2,), optional
        Displacement in this plane that increases a grazing's distance from the plate by 1 to first order; see `away`.

    Raises
    ------
    LostError
        Where Newton's method does not converge.
    """
    at, row, best, last, step = guess, None, np.inf, None, np.zeros_like(guess)
    sideways = np.zeros_like(guess) if away is None else away
    depths = iter(_DEPTHS if kind == GRAZING and away is not None else ())
    found: tuple[np.ndarray, np.ndarray, _Second] | None = None
    try:
        for iteration in range(_MOST_ITERATIONS):  # noqa: B007  (its last value is returned)
            try:
                matrix = family.jacobian(at, fine=True, longest=_DIFFERENCE_STEP)
                second = _second(family, kind, at, matrix, frame)
            except LostError:
                if last is not None:
                    step = 0.5 * step
                    at = last - step
                    continue
                depth = next(depths, None)
                if depth is None:
                    raise
                at = guess + depth * sideways
                continue
            defects = np.where(family.free(at)[:-2], family.residual(at), 0.0)
            size = max(float(np.abs(defects).max()) / CLOSED, abs(second.defect) / _LARGEST_DEFECT)
            if best <= 1.0 and size >= 0.25 * best:  # rounding allows no smaller defect
                break
            if row is None or size > _SLOW_CONVERGENCE * best:
                row = second.slope()
            if size < best:
                best, found = size, (at, np.vstack([matrix, row]), second)
            last, step = at, family.free(at) * np.linalg.solve(np.vstack([matrix, row, normal]), np.append(
                defects, [second.defect, normal @ (at - guess)]))
            at = last - step
            if not np.all(np.isfinite(at)) or np.abs(at - guess).max() > 10.0 * LONGEST_STEP:
                break
        if found is not None and best <= 1.0:
            return _point(family, kind, *found, normal), iteration
    except (np.linalg.LinAlgError, SimulationError, ValueError) as error:
        raise LostError(str(error)) from error
    raise LostError(f"Newton's method does not find a {kind} near {family.where(guess)}")


def _point(family: Family, kind: str, near: np.ndarray, matrix: np.ndarray, second: _Second,
           along: np.ndarray) -> Bifurcation:
    """Return the special point at the solution `near` of the equations."""
    n, free = len(near) - 2, family.free(near)
    *_, rows = np.linalg.svd(matrix)
    # Rounding must not move what is held: a body at a height of -6e-27 m is refused.
    tangent, unknowns = free * (rows[-1] if rows[-1] @ along >= 0.0 else -rows[-1]), near
    if kind == GRAZING:
        change = np.linalg.solve(np.vstack([matrix, along]), np.eye(n + 2)[n])
        unknowns = near - (_GRAZING_DISTANCE + second.defect) * free * change
    speed = 2.0 * family.mean_speed(near) - family.mean_speed(2.0 * near - unknowns)  # extrapolated from `near`
    return Bifurcation(family, unknowns, tangent, multipliers_of(matrix[:n, :n]), speed, family.passage(near),
                       kind=kind, near=near, matrix=matrix, frame=second.frame)


def away(point: Bifurcation, normal: np.ndarray) -> np.ndarray:
    """Displacement perpendicular to `normal` that increases the second equation by 1; held coordinates do not move."""
    found = np.linalg.solve(np.vstack([point.matrix, normal]), np.eye(len(normal))[-2])
    return np.where(point.family.free(point.near), found, 0.0)


_EASY_ITERATIONS = 6  # most Newton iterations of a step after which the next step is longer
# Steps along a curve: the least, and that below which a change of events is crossed.
_SHORTEST_STEP, _CROSSING_STEP = 1e-8, 1e-5
_FIRST_POINT_ARCS = (1e-5, 1e-4, 1e-3)  # arcs to the first point beyond a change of events
_LARGEST_DEVIATION = 3.0  # largest distance, in arcs, of that point from the prediction
_DIRECTION_ARC = 1e-6  # arc to a second point, which gives the curve's direction when the cut changes


def follow_bifurcations(start: Bifurcation) -> Iterator[tuple[Bifurcation, Bifurcation]]:
    """Follow a curve from a point, along its tangent, until it leaves the range of a parameter.

    Yields
    ------
    Bifurcation, Bifurcation
        A point and the next one, with the same cut; first the start twice.

    Raises
    ------
    LostError
        Where the curve cannot be followed.
    """
    point, step = _well_cut(start), FIRST_STEP
    yield point, point
    while np.all((point.near[-2:] >= 0.0) & (point.near[-2:] <= 1.0)):
        (after,), step = _next(point, step)
        yield point, after
        point = _well_cut(after)


def _next(point: Bifurcation, step: float) -> tuple[list[Bifurcation], float]:
    """Return the next point, which may lie beyond a change of events, and the length of the step after it."""
    apart = away(point, point.tangent)

    def solved(guess: np.ndarray, _: float) -> tuple[Bifurcation, bool]:
        after, iterations = found_near(point.family, point.kind, guess, point.tangent, point.frame, apart)
        return after, iterations <= _EASY_ITERATIONS

    def across(step: float, crosses: bool) -> list[Bifurcation]:
        return [_beyond(point)] if crosses and step < _CROSSING_STEP else []

    return take_step(point, point.near, step, _SHORTEST_STEP, solved, across, "curve")


def _beyond(point: Bifurcation) -> Bifurcation:
    """Return the first point of the curve on the other side of a change of events (LostError if none is found)."""
    change = ""
    for arc in _FIRST_POINT_ARCS:
        guess = point.near + arc * point.tangent
        try:
            order = point.family.order(guess)
            change = change or change_in_words(point.passage.order, order)
            after, _ = found_near(point.family, point.kind, guess, point.tangent, None)
        except (LostError, SimulationError, ValueError):
            continue
        same = same_order(after.passage.order, point.passage.order)
        if not same and np.linalg.norm(after.near - guess) < _LARGEST_DEVIATION * arc:
            return after
    raise LostError(f"the curve ends at {point.family.where(point.unknowns)}, where its events change ({change}); no "
                    f"{point.kind} was found beyond")


def _well_cut(point: Bifurcation) -> Bifurcation:
    """Return the same orbit with a cut that is far from all events and from the crank angle of a grazing."""
    family, seen = point.family, point.passage

    def from_grazing(phase: float) -> float:
        return abs((point.frame.angle - phase + 0.5 * TURN) % TURN - 0.5 * TURN) / TURN if point.frame.side else 1.0

    if min(seen.clear, from_grazing(family.phase)) >= NEAREST_EVENT:
        return point
    phase = (seen.best + 0.5 if point.frame.side and not seen.order else seen.best) % TURN
    if from_grazing(phase) < NEAREST_EVENT:
        phase = (phase + 2.0 * NEAREST_EVENT * TURN) % TURN
    family, (here, ahead) = family.recut(phase, [point.near, point.near + _DIRECTION_ARC * point.tangent])
    along = (ahead - here) / np.linalg.norm(ahead - here)
    try:
        return found_near(family, point.kind, here, along, None)[0]
    except LostError:
        return point
