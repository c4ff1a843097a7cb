"""Branches of periodic orbits: through an orbit or from a period doubling on, from the first orbit to the end.

A branch ends where it leaves the range of the parameter, closes, joins another branch, or is lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.continuation import EdgeError, SpecialPoint, follow_on, special_points
from vibro_ros.orbits.family import BranchPoint, Family, LostError, corrected, point_at
from vibro_ros.orbits.orbit import Orbit, Seed, is_same
from vibro_ros.orbits.passage import same_order
from vibro_ros.orbits.turn_map import TurnMap
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import Simulator

MOST_POINTS = 100_000
_AMPLITUDES = (1e-2, 3e-3, 1e-3)  # in units of the machine, at which an orbit of doubled period is looked for
_JOINED = 1e-6  # in units of the machine: an orbit that repeats itself so closely after half its turns has joined them
_CLOSES = 0.75  # of a step: a branch that comes so near to its begin is closed


@dataclass(frozen=True)
class Special:
    """An orbit at which a branch changes its nature.

    Attributes
    ----------
    kind : str
        Over one parameter ``fold``, ``period doubling``, ``Neimark-Sacker``, ``grazing`` or ``corner``; over two
        ``change of events``.
    mean_speed : float
        Of the body [m/s].
    multipliers : ndarray of complex, shape (n,)
        Floquet multipliers; where the order of events changes those on this side.
    change : str
        What becomes of the events, and whether the branch turns back, where their order changes; else empty.
    phase : float
        Crank angle at the cut [rad].
    state : ndarray, shape (n,)
        At the cut, in units of the machine.
    at : int
        How many orbits lie before it.
    values : ndarray, shape (1,) or (2,)
        The parameters there, in their units.
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
        """The only parameter, in its unit."""
        return float(self.values[0])


@dataclass(frozen=True)
class Branch:
    """Orbits that follow each other as one or two parameters change; along a branch a parameter may turn back.

    Attributes
    ----------
    scene : Scene
        What moves so, apart from the values of the parameters.
    names : tuple of str
        The parameters.
    kind : str
        Over two parameters what all orbits are: ``fold``, ``period doubling`` or ``grazing``; else empty.
    turns : int
        Turns of the crank after which the orbits repeat themselves.
    values : ndarray
        The parameters, in their units, in the order of the orbits: shape (points,) of one, (points, 2) of two.
    mean_speeds : ndarray, shape (points,)
        Of the body [m/s].
    multipliers : ndarray of complex, shape (points, n)
        Floquet multipliers, the largest first; of grazings over two parameters those without the contact.
    phases : ndarray, shape (points,)
        Crank angle of the cut [rad].
    states : ndarray, shape (points, n)
        At the cut, in units of the machine, `turn_map.units_of` the scene.
    strobe : dict of str to ndarray, shape (points, turns)
        Over one parameter the state [m, m/s, rad/s, A] each time the crank passes the angle 0, by the names of
        `Samples`; else empty.
    special_points : tuple of Special
        In the order of the branch.
    end : str
        Why they were not followed further.
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
        """The first parameter."""
        return self.names[0]

    @property
    def stable(self) -> np.ndarray:
        """Whether small disturbances of an orbit die out, shape (points,) of bool."""
        return np.abs(self.multipliers).max(axis=1, initial=0.0) < 1.0


def follow_orbit(orbit: Orbit, name: str, low: float, high: float, upwards: bool = True, points: int = 1000) -> Branch:
    """The branch of periodic orbits through `orbit` as a parameter changes, through folds, grazings and corners.

    Pseudo-arclength continuation of the turn map (H. B. Keller 1977), which ends and begins anew where the order of
    events changes, because the map is smooth only in between (M. di Bernardo et al., Piecewise-smooth Dynamical
    Systems, Springer 2008).

    Parameters
    ----------
    orbit : Orbit
        As `find_orbit` gives it.
    name : str
        A number among the scene's parameters.
    low, high : float
        Range of the parameter, in its unit; the orbit's own value lies within.
    upwards : bool
        Whether to begin towards larger values.
    points : int
        Most orbits on the way, from 2 to 100 000.

    Returns
    -------
    Branch
        The orbits, and the special points between them.

    Raises
    ------
    ValueError
        For a parameter that is no number, a range that is none or does not hold the orbit's value, or a number of
        points out of range.

    Examples
    --------
    >>> orbit = vibro_ros.find_orbit(vibro_ros.load_scene("damped"))
    >>> branch = vibro_ros.follow_orbit(orbit, "motor.speed", 99.0, 103.0)
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
    """The branch through a known orbit, towards larger values of the parameter with `direction` 1.0, else -1.0."""
    along = direction * np.eye(len(unknowns))[-1]
    try:
        unknowns, _ = corrected(family, unknowns, along)
        start = point_at(family, unknowns, along)
    except (LostError, SimulationError, ValueError) as error:
        return gathered(family, [], [], str(error))
    return whole_branch(start, points)


def doubled_branch_from(family: Family, begin: np.ndarray, points: int) -> Branch:
    """The branch of orbits of twice the period that begins at a period doubling of `family`.

    Its orbits leave along the eigenvector of the multiplier -1. The other side of the eigenvector holds the same
    orbits, half a period later.
    """
    twice, matrix = family.with_turns(2 * family.turns), family.jacobian(begin)[:, :-1]
    values, vectors = np.linalg.eig(matrix + np.eye(len(matrix)))
    away = np.append(np.real(vectors[:, np.argmin(np.abs(values + 1.0))]), 0.0)
    away /= np.linalg.norm(away)
    for amplitude in _AMPLITUDES:
        try:
            unknowns, _ = corrected(twice, begin + amplitude * away, away, amplitude)
            start = point_at(twice, unknowns, unknowns - begin, amplitude)
        except (LostError, SimulationError, ValueError):
            continue
        return whole_branch(start, points)
    return gathered(twice, [], [], "no orbit of doubled period was found beside the period doubling")


def lies_on(family: Family, seed: Seed, value: float, branch: Branch) -> bool:
    """Whether a branch of the same family passes through a seed at a value of the parameter."""
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
            unknowns, _ = corrected(own, np.append(guess, own.scaled(value)), np.eye(len(guess) + 1)[-1])
            there, (unknowns,) = own.recut(seed.phase, [unknowns])
        except (LostError, SimulationError, ValueError):
            continue
        if is_same(there.map_at(unknowns), there.state(unknowns), seed.state, seed.turns):
            return True
    return False


def whole_branch(start: BranchPoint, points: int) -> Branch:
    """The branch from `start` along its tangent, of at most so many orbits."""
    found: list[BranchPoint] = []
    special: list[tuple[int, SpecialPoint]] = []
    family, end = start.family, f"{points} orbits, the most that were asked for"
    closing = Closing(start)
    try:
        for before, after in follow_on(start):
            if left := range_left(after.family, after.unknowns):
                end, normal = left
                last = _at_end(before, after, normal)
                special += [(len(found), one) for one in special_points(before, last)]
                found.append(last)
                break
            if found and (reason := closing.reason(before, after)):
                end = reason
                break
            special += [(len(found), one) for one in special_points(before, after)]
            found.append(after)
            if len(found) >= points:
                break
    except (LostError, SimulationError, ValueError) as error:
        end = closing.reason_at(found[-1]) if found else ""
        if isinstance(error, EdgeError) and error.grazing and not end:
            special.append((len(found), error.grazing))
        end = end or str(error)
    return gathered(family, found, special, end)


def range_left(family: Family, unknowns: np.ndarray) -> tuple[str, np.ndarray] | None:
    """In words, which range the unknowns have left, and the outward normal of this bound; None inside."""
    shares = unknowns[len(family.units):]
    out = np.maximum(-shares, shares - 1.0)
    which = int(np.argmax(out))
    if out[which] <= 0.0:
        return None
    name, high, normal = family.names[which], bool(shares[which] > 1.0), np.zeros(len(unknowns))
    normal[len(family.units) + which] = 1.0 if high else -1.0
    value = family.ranges[name][high]
    return f"{name} leaves its range at {value:g} {BY_NAME[name].unit.replace('1', '')}".rstrip(), normal


def _at_end(before: BranchPoint, after: BranchPoint, normal: np.ndarray) -> BranchPoint:
    """The point between two neighbours at which the branch leaves the range of the parameter."""
    share = max(0.0, normal[-1])
    part = (share - before.unknowns[-1]) / (after.unknowns[-1] - before.unknowns[-1])
    guess = before.unknowns + part * (after.unknowns - before.unknowns)
    guess[-1] = share
    unknowns, _ = corrected(before.family, guess, abs(normal))
    unknowns[-1] = share
    return point_at(before.family, unknowns, before.tangent)


class Closing:
    """Whether a branch has come back to its begin, or joins the orbits of half its period."""

    def __init__(self, start: BranchPoint):
        self._start, self._family, self._begins, self._left = start, start.family, [start.unknowns], False

    def reason(self, before: BranchPoint, after: BranchPoint) -> str:
        """Why the branch ends between two neighbours; empty where it does not."""
        half = after.family.turns // 2
        joins = 2 * half == after.family.turns and len(after.family.names) == 1
        if joins and self._apart(before, half) @ self._apart(after, half) < 0.0:
            return f"joins the branch of {half} turn{'s' if half > 1 else ''} at a period doubling"
        step = float(np.linalg.norm(after.unknowns - before.unknowns))
        near = any(np.linalg.norm(after.unknowns - begin) < _CLOSES * step for begin in self._begins_at(after.family))
        self._left = self._left or not near
        closes = near and self._left and same_order(after.passage.order, self._start.passage.order)
        return "closes on itself" if closes else ""

    def reason_at(self, last: BranchPoint) -> str:
        """Why the branch ends at a point that is not followed by another one; empty where that is not known."""
        half = last.family.turns // 2
        if 2 * half == last.family.turns and np.abs(self._apart(last, half)).max() < _JOINED:
            return f"joins the branch of {half} turn{'s' if half > 1 else ''} at a corner"
        return ""

    def _apart(self, point: BranchPoint, half: int) -> np.ndarray:
        return point.family.map_at(point.unknowns)(point.state, half).state - point.state

    def _begins_at(self, family: Family) -> list[np.ndarray]:
        """The begin at the cut of a family, on each of its turns."""
        if family is not self._family:
            there, (unknowns,) = self._start.family.recut(family.phase, [self._start.unknowns])
            self._family, self._begins = family, there.starts_along(unknowns)
        return self._begins


def gathered(family: Family, points: list[BranchPoint], special: list[tuple[int, SpecialPoint]], end: str) -> Branch:
    """The branch of some points over one parameter, with the number of points before each special point."""
    names = TurnMap(family.scene, family.phase).names
    strobe = [_strobe(point) for point in points]  # shapes (turns, n)
    return sequence_of(family, points, end, strobe={
        name: np.array([one[:, k] for one in strobe]).reshape(-1, family.turns) for k, name in enumerate(names)},
        special_points=tuple(
            Special(one.kind, one.point.mean_speed, one.point.multipliers, one.change, one.point.family.phase,
                    one.point.state, at, one.point.values, one.width) for at, one in special))


def sequence_of(family: Family, points: Sequence[BranchPoint], end: str, strobe: dict[str, np.ndarray],
                special_points: tuple[Special, ...], kind: str = "") -> Branch:
    """The branch of some points."""
    n = len(family.units)
    values = np.array([point.values for point in points]).reshape(-1, len(family.names))
    return Branch(
        scene=family.scene, names=family.names, kind=kind, turns=family.turns,
        values=values if len(family.names) > 1 else values[:, 0],
        mean_speeds=np.array([point.mean_speed for point in points]),
        multipliers=np.array([point.multipliers for point in points], dtype=complex).reshape(-1, n),
        phases=np.array([point.family.phase for point in points]),
        states=np.array([point.state for point in points]).reshape(-1, n),
        strobe=strobe, special_points=special_points, end=end)


def _strobe(point: BranchPoint) -> np.ndarray:
    """The state, SI units, each time the crank passes the angle 0 within a passage, shape (turns, n)."""
    here = point.family.map_at(point.unknowns)
    device, there = Simulator(here.scene), TurnMap(here.scene, 0.0)
    here.put(device, point.state)
    return there.cuts(device, point.family.turns).states * there.units
