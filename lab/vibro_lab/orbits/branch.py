"""Whole branches of periodic orbits: over one parameter, through a given orbit or from a period doubling on; and over
two parameters, as curves of folds, period doublings and grazings.

A branch ends where it leaves the range of a parameter, closes, joins another branch, or is lost.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibro_lab.orbits.bifurcation import FOLLOWED, Bifurcation, away, follow_bifurcations, found_near
from vibro_lab.orbits.continuation import GRAZING, EdgeError, SpecialPoint, follow_on, special_points
from vibro_lab.orbits.family import BranchPoint, Family, LostError, corrected_orbit, point_at
from vibro_lab.orbits.orbit import Orbit, Seed, is_same
from vibro_lab.orbits.passage import change_in_words, same_order
from vibro_lab.orbits.turn_map import TurnMap, state_names
from vibro_ros import PARAMETERS, Scene, SimulationError, Simulator

MOST_POINTS = 100_000
_AMPLITUDES = (1e-2, 3e-3, 1e-3)  # units of the machine: distances from a doubling at which the doubled orbit is tried
_HALF_PERIOD_CHANGE = 1e-6  # units of the machine: change in half a period below which an orbit has half the period
_CLOSING_DISTANCE = 0.75  # steps: distance from its first orbit at which a branch is closed


@dataclass(frozen=True)
class Special:
    """A special point of a branch: a bifurcation, or a change of the order of events.

    Attributes
    ----------
    kind : str
        Over one parameter ``fold``, ``period doubling``, ``Neimark-Sacker``, ``grazing`` or ``corner``; over two
        ``change of events``.
    mean_speed : float
        Mean speed of the body [m/s].
    multipliers : ndarray of complex, shape (n,)
        Floquet multipliers; at a change of the order of events, those before the change.
    change : str
        Change of the order of events in words, and whether the branch turns back; empty if the order does not change.
    phase : float
        Crank angle at the cut [rad].
    state : ndarray, shape (n,)
        State at the cut, in units of the machine.
    at : int
        Number of the branch's orbits that lie before it.
    values : ndarray, shape (1,) or (2,)
        Values of the parameters, in their units.
    width : float
        Width of the interval of the parameter [its unit] in which it was found; over two parameters 0.
    """

    kind: str
    mean_speed: float
    multipliers: np.ndarray
    change: str
    phase: float
    state: np.ndarray
    at: int
    values: np.ndarray
    width: float = 0.0

    @property
    def value(self) -> float:
        """Value of the first parameter, in its unit; the only one over one parameter."""
        return float(self.values[0])


@dataclass(frozen=True)
class Branch:
    """A sequence of neighbouring orbits over one or two parameters; along a branch a parameter may turn back.

    Attributes
    ----------
    scene : Scene
        Scene of the orbits, apart from the values of the varied parameters.
    names : tuple of str
        Names of the varied parameters.
    kind : str
        Over two parameters the kind of special point of all orbits: ``fold``, ``period doubling`` or ``grazing``; else
        empty.
    turns : int
        Turns of the crank after which the orbits repeat themselves.
    values : ndarray
        Values of the parameters, in their units, in the order of the orbits: shape (points,) for one parameter,
        (points, 2) for two.
    mean_speeds : ndarray, shape (points,)
        Mean speeds of the body [m/s].
    multipliers : ndarray of complex, shape (points, n)
        Floquet multipliers, the largest first; for grazings over two parameters those without the contact.
    phases : ndarray, shape (points,)
        Crank angles of the cuts [rad].
    states : ndarray, shape (points, n)
        States at the cuts, in units of the machine (`turn_map.units_of` the scene).
    strobe : dict of str to ndarray, shape (points, turns)
        Over one parameter the state [m, m/s, rad/s, A] each time the crank passes the angle 0, by the names of
        `Samples`; else empty.
    special_points : tuple of Special
        Special points in the order of the branch.
    end : str
        Reason why the branch ends.
    """

    scene: Scene
    names: tuple[str, ...]
    kind: str
    turns: int
    values: np.ndarray
    mean_speeds: np.ndarray
    multipliers: np.ndarray
    phases: np.ndarray
    states: np.ndarray
    strobe: dict[str, np.ndarray]
    special_points: tuple[Special, ...]
    end: str

    def __len__(self) -> int:
        """Number of orbits."""
        return len(self.values)

    @property
    def name(self) -> str:
        """Name of the first parameter."""
        return self.names[0]

    @property
    def stable(self) -> np.ndarray:
        """Whether small disturbances of an orbit die out, shape (points,) of bool."""
        return np.abs(self.multipliers).max(axis=1, initial=0.0) < 1.0


def follow_orbit(orbit: Orbit, name: str, low: float, high: float, upwards: bool = True, points: int = 1000) -> Branch:
    """Follow the branch of periodic orbits through `orbit` as a parameter changes, past folds, grazings and corners.

    Pseudo-arclength continuation of the turn map (H. B. Keller 1977). It is restarted where the order of events
    changes, because the map is smooth only between these changes (M. di Bernardo et al., Piecewise-smooth Dynamical
    Systems, Springer 2008).

    Parameters
    ----------
    orbit : Orbit
        As returned by `find_orbit`.
    name : str
        A numeric parameter of the scene.
    low, high : float
        Range of the parameter, in its unit; the orbit's own value lies within.
    upwards : bool
        Whether to begin towards larger values.
    points : int
        Largest number of orbits, from 2 to 100 000.

    Returns
    -------
    Branch
        The orbits, and the special points between them.

    Raises
    ------
    ValueError
        For a parameter that is not numeric, a range that is empty or does not contain the orbit's value, or a number of
        points out of range.

    Examples
    --------
    >>> orbit = vibro_lab.find_orbit(vibro_ros.load_scene("damped"))
    >>> branch = vibro_lab.follow_orbit(orbit, "motor.speed", 99.0, 103.0)
    >>> branch.end, bool(branch.stable.all()), len(branch.special_points)
    ('motor.speed leaves its range at 103 rad/s', True, 0)
    """
    if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 2 <= points <= MOST_POINTS:
        raise ValueError(f"points: {points!r} is out of range; give a whole number from 2 to {MOST_POINTS}")
    family, here = Family(orbit.scene, {name: (low, high)}, orbit.turns, orbit.state.crank_angle), orbit.scene[name]
    if not low <= here <= high:
        raise ValueError(f"{name}: the orbit's {here:g} is not from {low:g} to {high:g}; give a range that holds it")
    turn_map = TurnMap(orbit.scene, orbit.state.crank_angle)
    state = turn_map.read(orbit.state) * turn_map.units / family.units
    return branch_from(family, np.append(state, family.scaled(here)), 1.0 if upwards else -1.0, points)


def branch_from(family: Family, unknowns: np.ndarray, direction: float, points: int) -> Branch:
    """Return the branch through a known orbit; `direction` is 1.0 towards larger values of the parameter, else -1.0."""
    along = direction * np.eye(len(unknowns))[-1]
    try:
        unknowns, _ = corrected_orbit(family, unknowns, along)
        start = point_at(family, unknowns, along)
    except (LostError, SimulationError, ValueError) as error:
        return make_branch(family, [], [], str(error))
    return whole_branch(start, points)


def doubled_branch_from(family: Family, begin: np.ndarray, points: int) -> Branch:
    """Return the branch of orbits of twice the period that begins at the period doubling `begin` of `family`.

    The branch leaves along the eigenvector of the multiplier -1. The opposite direction leads to the same orbits, half
    a period later.
    """
    twice, matrix = family.with_turns(2 * family.turns), family.jacobian(begin)[:, :-1]
    values, vectors = np.linalg.eig(matrix + np.eye(len(matrix)))
    away = np.append(np.real(vectors[:, np.argmin(np.abs(values + 1.0))]), 0.0)
    away /= np.linalg.norm(away)
    for amplitude in _AMPLITUDES:
        try:
            unknowns, _ = corrected_orbit(twice, begin + amplitude * away, away, amplitude)
            start = point_at(twice, unknowns, unknowns - begin, amplitude)
        except (LostError, SimulationError, ValueError):
            continue
        return whole_branch(start, points)
    return make_branch(twice, [], [], "no orbit of doubled period was found beside the period doubling")


def lies_on(family: Family, seed: Seed, value: float, branch: Branch) -> bool:
    """Whether a branch of the family contains the orbit of `seed` at a value of the parameter."""
    if branch.turns != seed.turns:
        return False
    beside = branch.values - value
    for k in np.flatnonzero(beside[1:] * beside[:-1] <= 0.0):
        if branch.phases[k] != branch.phases[k + 1] or beside[k] == beside[k + 1]:
            continue
        part = beside[k] / (beside[k] - beside[k + 1])
        guess = branch.states[k] + part * (branch.states[k + 1] - branch.states[k])
        own = family.with_turns(branch.turns).with_phase(float(branch.phases[k]))
        try:
            unknowns, _ = corrected_orbit(own, np.append(guess, own.scaled(value)), np.eye(len(guess) + 1)[-1])
            there, (unknowns,) = own.recut(seed.phase, [unknowns])
        except (LostError, SimulationError, ValueError):
            continue
        if is_same(there.map_at(unknowns), there.state(unknowns), seed.state, seed.turns):
            return True
    return False


def whole_branch(start: BranchPoint, points: int) -> Branch:
    """Return the branch from `start` along its tangent, with at most `points` orbits."""
    return make_branch(start.family, *_along(follow_on(start), start, points, _at_end, special_points))


Between = Callable[[BranchPoint, BranchPoint], Iterable[SpecialPoint]]
"""Function that returns the special points between two neighbours."""


def _along(neighbours: Iterator[tuple[Any, Any]], start: BranchPoint, points: int, at_bound: Callable[..., Any],
           special_between: Between) -> tuple[list[Any], list[tuple[int, SpecialPoint]], str]:
    """Collect the points of a branch until it leaves a range, closes or is lost, at most `points` of them.

    Returns
    -------
    list of BranchPoint
        The points. If the branch leaves a range, the last one lies on its bound, as computed by `at_bound`.
    list of (int, SpecialPoint)
        Each special point, with the number of points before it.
    str
        Reason why the branch ends.
    """
    found, special = list[Any](), list[tuple[int, SpecialPoint]]()
    end, closing = f"{points} orbits, the most that were asked for", Closing(start)
    try:
        for before, after in neighbours:
            if left := range_left(after.family, after.unknowns):
                end, after = left[0], at_bound(before, after, left[1])
            elif found and (reason := closing.reason(before, after)):
                end = reason
                break
            special += [(len(found), one) for one in special_between(before, after)]
            found.append(after)
            if left or len(found) >= points:
                break
    except (LostError, SimulationError, ValueError) as error:
        end = closing.reason_at(found[-1]) if found else ""
        if isinstance(error, EdgeError) and error.grazing and not end:
            special.append((len(found), error.grazing))
        end = end or str(error)
    return found, special, end


def range_left(family: Family, unknowns: np.ndarray) -> tuple[str, np.ndarray] | None:
    """Text that names the range that the unknowns have left, and the outward normal of its bound; None if inside."""
    shares = unknowns[len(family.units):]
    out = np.maximum(-shares, shares - 1.0)
    which = int(np.argmax(out))
    if out[which] <= 0.0:
        return None
    name, high, normal = family.names[which], bool(shares[which] > 1.0), np.zeros(len(unknowns))
    normal[len(family.units) + which] = 1.0 if high else -1.0
    value = family.ranges[name][high]
    return f"{name} leaves its range at {value:g} {PARAMETERS[name].unit.replace('1', '')}".rstrip(), normal


def _at_end(before: BranchPoint, after: BranchPoint, normal: np.ndarray) -> BranchPoint:
    """Return the point between two neighbours at which the branch leaves the range of the parameter."""
    share = max(0.0, normal[-1])
    part = (share - before.unknowns[-1]) / (after.unknowns[-1] - before.unknowns[-1])
    guess = before.unknowns + part * (after.unknowns - before.unknowns)
    guess[-1] = share
    unknowns, _ = corrected_orbit(before.family, guess, abs(normal))
    unknowns[-1] = share
    return point_at(before.family, unknowns, before.tangent)


class Closing:
    """Test whether a branch has come back to its first orbit, or joins the orbits of half its period."""

    def __init__(self, start: BranchPoint):
        self._start, self._family, self._begins, self._left = start, start.family, [start.unknowns], False

    def reason(self, before: BranchPoint, after: BranchPoint) -> str:
        """Reason why the branch ends between two neighbours; empty if it does not."""
        half = after.family.turns // 2
        joins = 2 * half == after.family.turns and len(after.family.names) == 1
        if joins and self._apart(before, half) @ self._apart(after, half) < 0.0:
            return f"joins the branch of {half} turn{'s' if half > 1 else ''} at a period doubling"
        step = float(np.linalg.norm(after.unknowns - before.unknowns))
        near = any(np.linalg.norm(after.unknowns - begin) < _CLOSING_DISTANCE * step
                   for begin in self._begins_at(after.family))
        self._left = self._left or not near
        closes = near and self._left and same_order(after.passage.order, self._start.passage.order)
        return "closes on itself" if closes else ""

    def reason_at(self, last: BranchPoint) -> str:
        """Reason why the branch ends at its last point, where continuation failed; empty if unknown."""
        half = last.family.turns // 2
        joins = 2 * half == last.family.turns and len(last.family.names) == 1
        if joins and np.abs(self._apart(last, half)).max() < _HALF_PERIOD_CHANGE:
            return f"joins the branch of {half} turn{'s' if half > 1 else ''} at a corner"
        return ""

    def _apart(self, point: BranchPoint, half: int) -> np.ndarray:
        return point.family.map_at(point.unknowns)(point.state, half).state - point.state

    def _begins_at(self, family: Family) -> list[np.ndarray]:
        """Unknowns of the first orbit at the cut of a family, on each of its turns."""
        if family is not self._family:
            there, (unknowns,) = self._start.family.recut(family.phase, [self._start.unknowns])
            self._family, self._begins = family, there.starts_along(unknowns)
        return self._begins


def make_branch(family: Family, points: Sequence[BranchPoint], special: Sequence[tuple[int, SpecialPoint]], end: str,
             kind: str = "") -> Branch:
    """Make a `Branch` from its points, and from special points with the number of points before each.

    `kind` is the kind of special point of a curve over two parameters, else empty.
    """
    n, strobe = len(family.units), {}
    if not kind:
        states = [_strobe(point) for point in points]  # shapes (turns, n)
        strobe = {name: np.array([one[:, k] for one in states]).reshape(-1, family.turns)
                  for k, name in enumerate(state_names(family.scene))}
    values = np.array([point.values for point in points]).reshape(-1, len(family.names))
    return Branch(
        scene=family.scene, names=family.names, kind=kind, turns=family.turns, values=values if kind else values[:, 0],
        mean_speeds=np.array([point.mean_speed for point in points]),
        multipliers=np.array([point.multipliers for point in points], dtype=complex).reshape(-1, n),
        phases=np.array([point.family.phase for point in points]),
        states=np.array([point.state for point in points]).reshape(-1, n), strobe=strobe, end=end,
        special_points=tuple(
            Special(one.kind, one.point.mean_speed, one.point.multipliers, one.change, one.point.family.phase,
                    one.point.state, at, one.point.values, one.width) for at, one in special))


def _strobe(point: BranchPoint) -> np.ndarray:
    """States in SI units each time the crank passes the angle 0 during one period, shape (turns, n)."""
    here = point.family.map_at(point.unknowns)
    device, there = Simulator(here.scene), TurnMap(here.scene, 0.0)
    here.put(device, point.state)
    return there.cuts(device, point.family.turns).states * there.units


EDGE = "change of events"
# Shares of a range: shifts to a grazing's side without contact.
_GRAZING_SHIFTS = (1e-6, -1e-6, 1e-5, -1e-5, 1e-4, -1e-4, 1e-3, -1e-3)
_SAME_POINT = 1e-5  # units of the machine, shares and m/s: largest difference of two computations of a special point


def follow_bifurcation(branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]],
                       upwards: bool = True, points: int = 400) -> Branch:
    """Follow the curve of folds, period doublings or grazings through a special point of a branch.

    Pseudo-arclength continuation (H. B. Keller 1977) in the state and two parameters; see `orbits.bifurcation`.

    Parameters
    ----------
    branch : Branch
        As returned by `follow_orbit`.
    special : Special
        One of its special points; not a corner, a Neimark-Sacker point or a grazing of the body on the ground.
    ranges : mapping of str to (float, float)
        The branch's parameter and another numeric parameter of the scene, with their ranges, in their units.
    upwards : bool
        Whether to begin towards larger values of the other parameter.
    points : int
        Largest number of orbits, from 2 to 100 000.

    Returns
    -------
    Branch
        The orbits, over two parameters, and the changes of the order of events between them.

    Raises
    ------
    ValueError
        For a special point that has no curve, parameters other than these two, a range that is empty or does not
        contain the special point, or a number of points out of range.

    Examples
    --------
    >>> orbit = vibro_lab.find_orbit(vibro_ros.load_scene("damped"))
    >>> branch = vibro_lab.follow_orbit(orbit, "motor.speed", 99.0, 109.0, points=30)
    >>> fold = branch.special_points[0]
    >>> curve = vibro_lab.follow_bifurcation(branch, fold, {"motor.speed": (99.0, 109.0), "upper.gap": (0.0, 1e-4)})
    >>> curve.kind, f"{curve.values[0, 0]:.6f}", curve.end
    ('fold', '107.959911', 'upper.gap leaves its range at 0.0001 m')
    """
    if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 2 <= points <= MOST_POINTS:
        raise ValueError(f"points: {points!r} is out of range; give a whole number from 2 to {MOST_POINTS}")
    return whole_curve(branch, special, ranges, upwards, points)


def _family(branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]]) -> Family:
    """Equations over two parameters, the branch's parameter first (ValueError as in `follow_bifurcation`)."""
    if not has_curve(special):
        change = f" ({special.change})" if special.change else ""
        raise ValueError(f"special: a {special.kind}{change} has no curve; give a fold, a period doubling, or a "
                         "grazing of a plate")
    if len(ranges) != 2:
        raise ValueError(f"ranges: {len(ranges)} parameters; give two, such as "
                         "{'motor.speed': (95.0, 115.0), 'upper.gap': (0.0, 0.002)}")
    if branch.name not in ranges:
        raise ValueError(f"ranges: has no {branch.name}, the branch's parameter; give its range and that of another")
    family = Family(branch.scene, {name: ranges[name] for name in sorted(ranges, key=branch.name.__ne__)}, branch.turns,
                    special.phase)
    for name, value in zip(family.names, (special.value, branch.scene[family.names[1]]), strict=True):
        if not ranges[name][0] <= value <= ranges[name][1]:
            raise ValueError(f"{name}: the special point's {value:g} is not from {ranges[name][0]:g} to "
                             f"{ranges[name][1]:g}; give a range that holds it")
    return family


def _start(family: Family, branch: Branch, special: Special, upwards: bool) -> Bifurcation:
    """Compute the special point as the first point of a curve (LostError if it is not found again)."""
    guess = np.append(special.state, family.scaled(special.value, branch.scene[family.names[1]]))
    across, nudge = np.zeros((2, len(guess)))
    across[-1], nudge[-2] = 1.0 if upwards else -1.0, 1.0
    reason = ""
    for size in _GRAZING_SHIFTS if special.kind == GRAZING else (0.0,):
        try:
            start, _ = found_near(family, special.kind, guess + size * nudge, across, None)
        except LostError as error:
            reason = reason or str(error)
            continue
        if np.abs(start.unknowns - guess).max() < _SAME_POINT:
            return start
        reason = f"another {special.kind} was found in its place"
    raise LostError(f"the special point was not found again: {reason}")


def has_curve(special: Special) -> bool:
    """Whether the curve of a special point can be followed over two parameters."""
    return special.kind in FOLLOWED and (special.kind != GRAZING or "_contact" in special.change)


def whole_curve(branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]], upwards: bool, points: int
                ) -> Branch:
    """Implement `follow_bifurcation`, for a number of points that was checked."""
    family = _family(branch, special, ranges)
    try:
        start = _start(family, branch, special, upwards)
    except (LostError, SimulationError) as error:
        return make_branch(family, [], [], str(error), special.kind)
    return make_branch(family, *_along(follow_bifurcations(start), start, points, _at_bound, _changes), special.kind)


def _changes(before: BranchPoint, after: BranchPoint) -> Iterator[SpecialPoint]:
    """Yield a special point if the order of events changes between two neighbours of a curve."""
    orders = before.passage.order, after.passage.order
    if not same_order(*orders):
        yield SpecialPoint(EDGE, before, 0.0, change_in_words(*orders))


def _at_bound(before: Bifurcation, after: Bifurcation, normal: np.ndarray) -> Bifurcation:
    """Return the point between two neighbours at which the curve leaves a range."""
    bound = max(0.0, np.sign(normal[-2:].sum()))
    part = (bound - abs(normal) @ before.unknowns) / (abs(normal) @ (after.unknowns - before.unknowns))
    guess = before.near + part * (after.near - before.near)
    guess += (bound - abs(normal) @ guess) * abs(normal)
    return found_near(before.family, before.kind, guess, normal, before.frame, away(before, normal))[0]


def passes_through(curve: Branch, branch: Branch, special: Special, ranges: Mapping[str, tuple[float, float]]) -> bool:
    """Whether a curve, found from another special point, also passes through the special point of `branch`."""
    if not len(curve) or (curve.kind, curve.turns) != (special.kind, branch.turns):
        return False
    across, second = np.eye(len(special.state) + 2)[-1], branch.scene[curve.names[1]]
    beside = curve.values[:, 1] - second
    for k in np.flatnonzero(beside[1:] * beside[:-1] <= 0.0):
        near = k if abs(beside[k]) <= abs(beside[k + 1]) else k + 1
        family = Family(branch.scene, {name: ranges[name] for name in curve.names}, curve.turns,
                        float(curve.phases[near]))
        guess = np.append(curve.states[near], family.scaled(curve.values[near, 0], second))
        try:
            found, _ = found_near(family, special.kind, guess, across, None)
        except LostError:
            continue
        apart = abs(found.unknowns[-2] - family.scaled(special.value, second)[0])
        if apart < _SAME_POINT and abs(found.mean_speed - special.mean_speed) < _SAME_POINT:
            return True
    return False
