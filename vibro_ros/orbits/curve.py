"""Curves of special points over two parameters: folds, period doublings and grazings.

Where a branch over one parameter has a special point, the special points of its neighbours over a second parameter form
a curve. The curve is followed by pseudo-arclength (H. B. Keller 1977) in the state and both parameters; its equations
are those of `plane`.

A curve is smooth as long as the order of the orbit's events stays. Where it changes, the curve is sought on the other
side, as a branch is; it may end there.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.branch import MOST_POINTS, Branch, OrbitSequence, Special, SpecialOrbit
from vibro_ros.orbits.continuation import FIRST_STEP, GRAZING, NEAREST_EVENT, STRAIGHT
from vibro_ros.orbits.family import LONGEST_STEP, LostError
from vibro_ros.orbits.passage import change_in_words, same_order
from vibro_ros.orbits.plane import FOLLOWED, CurvePoint, Plane, away, corrected, where
from vibro_ros.orbits.turn_map import TURN, units_of
from vibro_ros.simulation.motion import SimulationError

EDGE = "change of events"
_FEW = 6  # iterations of Newton's method at most before a step that is longer
_SHORTEST, _SHORT = 1e-8, 1e-5  # steps along a curve: the least, and that at which the other side of events is tried
_ARCS = (1e-5, 1e-4, 1e-3)  # to the first point on the other side
_ASIDE = 3.0  # arcs that a curve may turn aside within an arc at a change of events
_AHEAD = 1e-6  # along the curve: where its direction is looked for when the cut changes
_NUDGES = (1e-6, -1e-6, 1e-5, -1e-5, 1e-4, -1e-4, 1e-3, -1e-3)  # of a parameter, to the side of a grazing without it
_FOUND = 1e-5  # units of the machine, shares and m/s: how near special points of a curve and of a branch are
_CLOSES = 0.75  # of a step: a curve that comes so near to its begin is closed


@dataclass(frozen=True)
class CurveSpecial(SpecialOrbit):
    """A change of the order of events on a curve, a `SpecialOrbit`.

    Attributes
    ----------
    values : ndarray, shape (2,)
        The parameters, in their units.
    """

    values: np.ndarray


@dataclass(frozen=True)
class Curve(OrbitSequence):
    """Special points of one kind over two parameters, an `OrbitSequence`.

    Attributes
    ----------
    kind : str
        ``fold``, ``period doubling`` or ``grazing``.
    names : tuple of str
        Both parameters.
    special_points : tuple of CurveSpecial
        In the order of the curve.
    """

    kind: str
    names: tuple[str, str]
    special_points: tuple[CurveSpecial, ...]


def follow_bifurcation(branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]],
                       upwards: bool = True, points: int = 400) -> Curve:
    """The curve of folds, period doublings or grazings through a special point of a branch.

    Pseudo-arclength continuation in the state and two parameters; see `vibro_ros.orbits.curve`.

    Parameters
    ----------
    branch : Branch
        As `follow_orbit` gives it.
    special : Special
        One of its special points; no corner, no Neimark-Sacker point, and no grazing of the body on the ground.
    ranges : mapping of str to (float, float)
        The branch's parameter and another number among the scene's parameters, with their ranges, in their units.
    upwards : bool
        Whether to begin towards larger values of the other parameter.
    points : int
        Most orbits on the way, from 2 to 100 000.

    Returns
    -------
    Curve
        The orbits, and the changes of the order of events between them.

    Raises
    ------
    ValueError
        For a special point that has no curve, parameters that are not these two, a range that is none or does not hold
        the special point, or a number of points out of range.

    Examples
    --------
    >>> orbit = vibro_ros.find_orbit(vibro_ros.load_scene("damped"))
    >>> branch = vibro_ros.follow_orbit(orbit, "motor.speed", 99.0, 109.0, points=30)
    >>> fold = branch.special_points[0]
    >>> curve = vibro_ros.follow_bifurcation(branch, fold, {"motor.speed": (99.0, 109.0), "upper.gap": (0.0, 1e-4)})
    >>> curve.kind, f"{curve.values[0, 0]:.6f}", curve.end
    ('fold', '107.959911', 'upper.gap leaves its range at 0.0001 m')
    """
    if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 2 <= points <= MOST_POINTS:
        raise ValueError(f"points: {points!r} is out of range; give a whole number from 2 to {MOST_POINTS}")
    return whole_curve(branch, special, ranges, upwards, points)


def _plane(branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]]) -> Plane:
    """The equations, the branch's parameter first (ValueError as `follow_bifurcation` has it)."""
    if not has_curve(special):
        change = f" ({special.change})" if special.change else ""
        raise ValueError(f"special: a {special.kind}{change} has no curve; give a fold, a period doubling, or a "
                         "grazing of a plate")
    if branch.name not in ranges:
        raise ValueError(f"ranges: has no {branch.name}, the branch's parameter; give its range and that of another")
    plane = Plane(branch.scene, {name: ranges[name] for name in sorted(ranges, key=branch.name.__ne__)}, branch.turns,
                  special.phase, units_of(branch.scene))
    for name, value in zip(plane.names, (special.value, branch.scene[plane.names[1]]), strict=True):
        if not ranges[name][0] <= value <= ranges[name][1]:
            raise ValueError(f"{name}: the special point's {value:g} is not from {ranges[name][0]:g} to "
                             f"{ranges[name][1]:g}; give a range that holds it")
    return plane


def _start(plane: Plane, branch: Branch, special: Special, upwards: bool) -> CurvePoint:
    """The special point as the first of a curve (LostError)."""
    here = np.array([special.value, branch.scene[plane.names[1]]])
    guess = np.append(special.state, plane.shares(here))
    across, nudge = np.zeros((2, len(guess)))
    across[-1], nudge[-2] = 1.0 if upwards else -1.0, 1.0
    reason = ""
    for size in _NUDGES if special.kind == GRAZING else (0.0,):
        try:
            start, _ = corrected(plane, special.kind, guess + size * nudge, across, None)
        except LostError as error:
            reason = reason or str(error)
            continue
        if np.abs(start.exact - guess).max() < _FOUND:
            return start
        reason = f"another {special.kind} was found in its place"
    raise LostError(f"the special point was not found again: {reason}")


def has_curve(special: Special) -> bool:
    """Whether special points like this one are followed over two parameters."""
    return special.kind in FOLLOWED and (special.kind != GRAZING or "_contact" in special.change)


def whole_curve(branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]], upwards: bool, points: int,
                notice: Callable[[int, np.ndarray], object] | None = None) -> Curve:
    """As `follow_bifurcation`; `notice` hears how many orbits are found, and the parameters at the last, shape (2,)."""
    plane = _plane(branch, special, ranges)
    try:
        start = _start(plane, branch, special, upwards)
    except (LostError, SimulationError) as error:
        return _gathered(plane, special.kind, [], [], str(error))
    return curve_from(start, points, notice)


def curve_from(start: CurvePoint, points: int, notice: Callable[[int, np.ndarray], object] | None = None) -> Curve:
    """The curve from `start` along its tangent, of at most so many orbits; `notice` as `whole_curve` has it."""
    found, met, end = list[CurvePoint](), list[tuple[int, CurvePoint, str]](), ""
    closing = _Closing(start)
    try:
        for before, after in follow(start):
            bound = _bound(after)
            if bound:
                end, after = bound[0], _at_bound(before, after, bound[1])
            if found and closing.closes(before, after):
                end = "closes on itself"
                break
            orders = before.passage.order, after.passage.order
            if not same_order(*orders):
                met.append((len(found), before, change_in_words(*orders)))
            found.append(after)
            if notice:
                notice(len(found), after.values)
            if end:
                break
            if len(found) >= points:
                end = f"{points} orbits, the most that were asked for"
                break
    except (LostError, SimulationError) as error:
        end = str(error)
    return _gathered(start.plane, start.kind, found, met, end)


def _gathered(plane: Plane, kind: str, found: list[CurvePoint], met: list[tuple[int, CurvePoint, str]],
              end: str) -> Curve:
    """The curve of some points, with the number of points before each change of events."""
    n = len(plane.units)
    return Curve(
        kind=kind, names=plane.names, turns=plane.turns,
        values=np.array([point.values for point in found]).reshape(-1, 2),
        mean_speeds=np.array([point.mean_speed for point in found]),
        multipliers=np.array([point.multipliers for point in found], dtype=complex).reshape(-1, n),
        phases=np.array([point.plane.phase for point in found]),
        states=np.array([point.exact[:-2] for point in found]).reshape(-1, n),
        special_points=tuple(
            CurveSpecial(EDGE, point.mean_speed, point.multipliers, change, point.plane.phase, point.exact[:-2], at,
                         point.values) for at, point, change in met), end=end)


def _bound(point: CurvePoint) -> tuple[str, np.ndarray] | None:
    """In words, which range a point has left, and the outward normal of this bound; None inside."""
    shares = point.exact[-2:]
    out = np.maximum(-shares, shares - 1.0)
    which = int(np.argmax(out))
    if out[which] <= 0.0:
        return None
    name, normal = point.plane.names[which], np.zeros(len(point.exact))
    normal[which - 2] = 1.0 if shares[which] > 1.0 else -1.0
    value = point.plane.ranges[name][int(shares[which] > 1.0)]
    return f"{name} leaves its range at {value:g} {BY_NAME[name].unit.replace('1', '')}".rstrip(), normal


def _at_bound(before: CurvePoint, after: CurvePoint, normal: np.ndarray) -> CurvePoint:
    """The point between two neighbours at which the curve leaves a range."""
    bound = max(0.0, np.sign(normal[-2:].sum()))
    part = (bound - abs(normal) @ before.exact) / (abs(normal) @ (after.exact - before.exact))
    guess = before.vector + part * (after.vector - before.vector)
    guess += (bound - abs(normal) @ guess) * abs(normal)
    return corrected(before.plane, before.kind, guess, normal, before.frame, away(before, normal))[0]


class _Closing:
    """Whether a curve has come back to its begin."""

    def __init__(self, start: CurvePoint):
        self._start, self._plane, self._left = start, start.plane, False
        self._begins = [start.vector]

    def closes(self, before: CurvePoint, after: CurvePoint) -> bool:
        """Whether it has come back between two neighbours, after having left."""
        if after.plane is not self._plane:
            self._plane, (vector,) = self._start.plane.recut(after.plane.phase, [self._start.vector])
            turn_map = self._plane.map_at(vector[-2:])
            self._begins = [np.append(turn_map(vector[:-2], turns).state, vector[-2:])
                            for turns in range(1, after.plane.turns + 1)]
            self._plane = after.plane
        step = float(np.linalg.norm(after.vector - before.vector))
        near = any(np.linalg.norm(after.vector - begin) < _CLOSES * step for begin in self._begins)
        self._left = self._left or not near
        return near and self._left


def passes(curve: Curve, branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a curve through another special point of this kind passes through a special point of a branch, too."""
    if not len(curve) or (curve.kind, curve.turns) != (special.kind, branch.turns):
        return False
    units, across = units_of(branch.scene), np.eye(len(special.state) + 2)[-1]
    beside = curve.values[:, 1] - branch.scene[curve.names[1]]
    for k in np.flatnonzero(beside[1:] * beside[:-1] <= 0.0):
        near = k if abs(beside[k]) <= abs(beside[k + 1]) else k + 1
        plane = Plane(branch.scene, {name: ranges[name] for name in curve.names}, curve.turns, curve.phases[near],
                      units)
        guess = np.append(curve.states[near], plane.shares(curve.values[near]))
        guess[-1] = plane.shares(np.array([0.0, branch.scene[curve.names[1]]]))[1]
        share = plane.shares(np.array([special.value, 0.0]))[0]
        try:
            found, _ = corrected(plane, special.kind, guess, across, None)
        except LostError:
            continue
        if abs(found.exact[-2] - share) < _FOUND and abs(found.mean_speed - special.mean_speed) < _FOUND:
            return True
    return False


def follow(start: CurvePoint) -> Iterator[tuple[CurvePoint, CurvePoint]]:
    """Neighbours on a curve from a point on, along its tangent, until it leaves the range of a parameter.

    Yields
    ------
    CurvePoint, CurvePoint
        A point and the next, with one cut; first the start and itself.

    Raises
    ------
    LostError
        Where the curve cannot be followed.
    """
    point, step = _well_cut(start), FIRST_STEP
    yield point, point
    while np.all((point.vector[-2:] >= 0.0) & (point.vector[-2:] <= 1.0)):
        after, step = _next(point, step)
        yield point, after
        point = _well_cut(after)


def _next(point: CurvePoint, step: float) -> tuple[CurvePoint, float]:
    """The next point, also beyond a change of events; and the step after it."""
    plane, reason, apart = point.plane, "", away(point, point.tangent)
    while step >= _SHORTEST:
        guess, crosses = point.vector + step * point.tangent, False
        try:
            after, iterations = corrected(plane, point.kind, guess, point.tangent, point.frame, apart)
            crosses = not same_order(after.passage.order, point.passage.order)
            if not crosses and after.tangent @ point.tangent >= STRAIGHT:
                return after, min(LONGEST_STEP, step * (1.5 if iterations <= _FEW else 1.0))
            reason = f"the curve bends too sharply near {where(plane, after.vector)}"
        except LostError as error:
            reason = str(error)
            try:
                crosses = not same_order(plane.order(guess), point.passage.order)
            except (SimulationError, ValueError):
                crosses = False
        if crosses and step < _SHORT:
            return _beyond(point), FIRST_STEP
        step *= 0.5
    raise LostError(reason)


def _beyond(point: CurvePoint) -> CurvePoint:
    """The first point of the curve on the other side of a change of events."""
    change = ""
    for arc in _ARCS:
        guess = point.vector + arc * point.tangent
        try:
            order = point.plane.order(guess)
            change = change or change_in_words(point.passage.order, order)
            after, _ = corrected(point.plane, point.kind, guess, point.tangent, None)
        except (LostError, SimulationError, ValueError):
            continue
        same = same_order(after.passage.order, point.passage.order)
        if not same and np.linalg.norm(after.vector - guess) < _ASIDE * arc:
            return after
    raise LostError(f"the curve ends at {where(point.plane, point.exact)}, where its events change ({change}); no "
                    f"{point.kind} was found beyond")


def _well_cut(point: CurvePoint) -> CurvePoint:
    """The same orbit, cut far from all events, and from the instant of a grazing."""
    plane, seen = point.plane, point.passage

    def from_grazing(phase: float) -> float:
        return abs((point.frame.angle - phase + 0.5 * TURN) % TURN - 0.5 * TURN) / TURN if point.frame.side else 1.0

    if min(seen.clear, from_grazing(plane.phase)) >= NEAREST_EVENT:
        return point
    phase = (seen.best + 0.5 if point.frame.side and not seen.order else seen.best) % TURN
    if from_grazing(phase) < NEAREST_EVENT:
        phase = (phase + 2.0 * NEAREST_EVENT * TURN) % TURN
    plane, (vector, ahead) = plane.recut(phase, [point.vector, point.vector + _AHEAD * point.tangent])
    along = (ahead - vector) / np.linalg.norm(ahead - vector)
    try:
        return corrected(plane, point.kind, vector, along, None)[0]
    except LostError:
        return point
