"""Branches of periodic orbits: through an orbit or from a period doubling on, from the first orbit to the end.

A branch ends where it leaves the range of the parameter, closes, joins another branch, or is lost.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.parameters import BY_NAME, parameter_named
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.continuation import EdgeError, SpecialPoint, follow_on, special_points
from vibro_ros.orbits.family import BranchPoint, Family, LostError, Place, corrected, point_at
from vibro_ros.orbits.orbit import Orbit, Seed, is_same
from vibro_ros.orbits.passage import same_order
from vibro_ros.orbits.turn_map import TurnMap
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import Simulator

MOST_POINTS = 100_000
_AMPLITUDES = (1e-2, 3e-3, 1e-3)  # in units of the machine, at which an orbit of doubled period is looked for
_JOINED = 1e-6  # in units of the machine: an orbit that repeats itself so closely after half its turns has joined them
_CLOSES = 0.75  # of a step: a branch that comes so near to its begin is closed

#: Is told how many orbits of a branch are found, and the value of the parameter [its unit] at the last one.
Notice = Callable[[int, float], object]


@dataclass(frozen=True)
class SpecialOrbit:
    """An orbit at which a branch, or a curve of special points, changes its nature.

    Attributes
    ----------
    kind : str
        Of a branch ``fold``, ``period doubling``, ``Neimark-Sacker``, ``grazing`` or ``corner``; of a curve ``change of
        events``.
    mean_speed : float
        Of the body [m/s].
    multipliers : ndarray of complex, shape (n,)
        Floquet multipliers; of a grazing, corner or change of events those on this side of it.
    change : str
        What becomes of the events, and whether the branch turns back, where their order changes; else empty.
    phase : float
        Crank angle at the cut [rad].
    state : ndarray, shape (n,)
        At the cut, in units of the machine.
    at : int
        How many orbits lie before it.
    """

    kind: str
    mean_speed: float
    multipliers: np.ndarray
    change: str
    phase: float
    state: np.ndarray
    at: int


@dataclass(frozen=True)
class Special(SpecialOrbit):
    """A special point of a branch, a `SpecialOrbit`.

    Attributes
    ----------
    value, width : float
        The parameter there, and the width of the interval in which it was found, in its unit.
    """

    value: float
    width: float


@dataclass(frozen=True)
class OrbitSequence:
    """Orbits that follow each other as parameters change.

    Attributes
    ----------
    turns : int
        Turns of the crank after which the orbits repeat themselves.
    values : ndarray
        The parameters, in their units, in the order of the orbits: shape (points,) of one, (points, 2) of two.
    mean_speeds : ndarray, shape (points,)
        Of the body [m/s].
    multipliers : ndarray of complex, shape (points, n)
        Floquet multipliers, the largest first; along a curve of grazings those without the contact.
    phases : ndarray, shape (points,)
        Crank angle of the cut [rad].
    states : ndarray, shape (points, n)
        At the cut, in units of the machine, `turn_map.units_of` the scene that the branch began with.
    end : str
        Why they were not followed further.
    """

    turns: int
    values: np.ndarray
    mean_speeds: np.ndarray
    multipliers: np.ndarray
    phases: np.ndarray
    states: np.ndarray
    end: str

    def __len__(self) -> int:
        """Number of orbits."""
        return len(self.values)


@dataclass(frozen=True)
class Branch(OrbitSequence):
    """The orbits over one parameter, an `OrbitSequence`; the parameter turns back at folds.

    Attributes
    ----------
    scene : Scene
        What moves so, apart from the value of the parameter.
    name : str
        The parameter.
    strobe : dict of str to ndarray, shape (points, turns)
        The state [m, m/s, rad/s, A] each time the crank passes the angle 0, by the names of `Samples`.
    special_points : tuple of Special
        In the order of the branch.
    """

    scene: Scene
    name: str
    strobe: dict[str, np.ndarray]
    special_points: tuple[Special, ...]

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
    family, here = family_of(orbit.scene, name, low, high, orbit.turns, orbit.state.crank_angle), orbit.scene[name]
    if not low <= here <= high:
        raise ValueError(f"{name}: the orbit's {here:g} is not from {low:g} to {high:g}; give a range that holds it")
    turn_map = TurnMap(orbit.scene, orbit.state.crank_angle)
    state = turn_map.read(orbit.state) * turn_map.units / family.units
    return branch_from(family, state, family.share(here), 1.0 if upwards else -1.0, points)


def family_of(scene: Scene, name: str, low: float, high: float, turns: int, phase: float) -> Family:
    """The orbits of a scene over a range of a parameter, both of whose ends are checked (ValueError)."""
    parameter = parameter_named(name, BY_NAME)
    if not isinstance(parameter.default, float):
        raise ValueError(f"{name}: is {parameter.type_name}, along which no branch can be followed; choose a number")
    family = Family(scene, name, parameter.checked(low), parameter.checked(high), turns, phase)
    for end in (0.0, 1.0):
        family.scene_at(end)
    return family


def branch_from(family: Family, state: np.ndarray, share: float, direction: float, points: int,
                notice: Notice | None = None) -> Branch:
    """The branch through a known orbit, towards larger values of the parameter with `direction` 1.0, else -1.0."""
    along = np.append(np.zeros_like(state), direction)
    try:
        vector, _ = corrected(family, np.append(state, share), along)
        start = point_at(family, vector, along)
    except (LostError, SimulationError, ValueError) as error:
        return gathered(family, [], [], str(error))
    return whole_branch(start, points, notice)


def doubled_branch_from(family: Family, state: np.ndarray, share: float, points: int,
                        notice: Notice | None = None) -> Branch:
    """The branch of orbits of twice the period that begins at a period doubling of `family`.

    Its orbits leave along the eigenvector of the multiplier -1. The other side of the eigenvector holds the same
    orbits, half a period later.
    """
    place, twice = Place(state, share), family.with_turns(2 * family.turns)
    matrix = family.jacobian(place, family.held(place))[:, :-1] + np.eye(len(state))
    values, vectors = np.linalg.eig(matrix)
    away = np.append(np.real(vectors[:, np.argmin(np.abs(values + 1.0))]), 0.0)
    away /= np.linalg.norm(away)
    for amplitude in _AMPLITUDES:
        try:
            vector, _ = corrected(twice, place.vector + amplitude * away, away, amplitude)
            start = point_at(twice, vector, vector - place.vector, amplitude)
        except (LostError, SimulationError, ValueError):
            continue
        return whole_branch(start, points, notice)
    return gathered(twice, [], [], "no orbit of doubled period was found beside the period doubling")


def lies_on(family: Family, seed: Seed, share: float, branch: Branch) -> bool:
    """Whether a branch of the same family passes through a seed at `share` of the parameter's range."""
    if branch.turns != seed.turns:
        return False
    shares = np.array([family.share(value) for value in branch.values])
    across = np.append(np.zeros(len(seed.state)), 1.0)
    for k in np.flatnonzero((shares[1:] - share) * (shares[:-1] - share) <= 0.0):
        if branch.phases[k] != branch.phases[k + 1] or shares[k] == shares[k + 1]:
            continue
        part = (share - shares[k]) / (shares[k + 1] - shares[k])
        guess = branch.states[k] + part * (branch.states[k + 1] - branch.states[k])
        own = family.with_turns(branch.turns).with_phase(float(branch.phases[k]))
        try:
            vector, _ = corrected(own, np.append(guess, share), across)
            _, (place,) = own.recut(seed.phase, iter([Place.of(vector)]))
        except (LostError, SimulationError, ValueError):
            continue
        turn_map = own.with_phase(seed.phase).map_at(share)
        if is_same(turn_map, place.state, seed.state, seed.turns):
            return True
    return False


def whole_branch(start: BranchPoint, points: int, notice: Notice | None = None) -> Branch:
    """The branch from `start` along its tangent, of at most so many orbits; `notice` hears of each."""
    found: list[BranchPoint] = []
    special: list[tuple[int, SpecialPoint]] = []
    family, end = start.family, f"{points} orbits, the most that were asked for"
    closing = _Closing(start)
    try:
        for before, after in follow_on(start):
            if not 0.0 <= after.place.share <= 1.0:
                unit = BY_NAME[family.name].unit.replace("1", "")
                value = family.high if after.place.share > 1.0 else family.low
                end = f"{family.name} leaves its range at {value:g} {unit}".rstrip()
                last = _at_end(before, after)
                special += [(len(found), one) for one in special_points(before, last)]
                found.append(last)
                break
            if found and (reason := closing.reason(before, after)):
                end = reason
                break
            special += [(len(found), one) for one in special_points(before, after)]
            found.append(after)
            if notice:
                notice(len(found), after.value)
            if len(found) >= points:
                break
    except (LostError, SimulationError, ValueError) as error:
        end = closing.reason_at(found[-1]) if found else ""
        if isinstance(error, EdgeError) and error.grazing and not end:
            special.append((len(found), error.grazing))
        end = end or str(error)
    return gathered(family, found, special, end)


def _at_end(before: BranchPoint, after: BranchPoint) -> BranchPoint:
    """The point between two neighbours at which the branch leaves the range of the parameter."""
    share = 1.0 if after.place.share > 1.0 else 0.0
    part = (share - before.place.share) / (after.place.share - before.place.share)
    guess = before.place.vector + part * (after.place.vector - before.place.vector)
    guess[-1] = share
    across = np.append(np.zeros(len(guess) - 1), 1.0)
    vector, _ = corrected(before.family, guess, across)
    vector[-1] = share
    return point_at(before.family, vector, before.tangent)


class _Closing:
    """Whether a branch has come back to its begin, or joins the orbits of half its period."""

    def __init__(self, start: BranchPoint):
        self._start, self._family = start, start.family
        self._begins = [start.place.vector]
        self._left = False

    def reason(self, before: BranchPoint, after: BranchPoint) -> str:
        """Why the branch ends between two neighbours; empty where it does not."""
        half = after.family.turns // 2
        if 2 * half == after.family.turns and self._apart(before, half) @ self._apart(after, half) < 0.0:
            return f"joins the branch of {half} turn{'s' if half > 1 else ''} at a period doubling"
        step = float(np.linalg.norm(after.place.vector - before.place.vector))
        near = any(np.linalg.norm(after.place.vector - begin) < _CLOSES * step
                   for begin in self._begins_at(after.family))
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
        turn_map = point.family.map_at(point.place.share)
        return turn_map(point.place.state, half).state - point.place.state

    def _begins_at(self, family: Family) -> list[np.ndarray]:
        """The begin at the cut of a family, on each of its turns."""
        if family is not self._family:
            _, (place,) = self._start.family.recut(family.phase, iter([self._start.place]))
            self._family, turn_map = family, family.map_at(place.share)
            self._begins = [Place(turn_map(place.state, turns).state, place.share).vector
                            for turns in range(1, family.turns + 1)]
        return self._begins


def gathered(family: Family, points: list[BranchPoint], special: list[tuple[int, SpecialPoint]], end: str) -> Branch:
    """The branch of some points, with the number of points before each special point."""
    names = TurnMap(family.scene, family.phase).names
    n = len(names)
    strobe = [_strobe(point) for point in points]  # shapes (turns, n)
    return Branch(
        scene=family.scene, name=family.name, turns=family.turns, values=np.array([point.value for point in points]),
        mean_speeds=np.array([point.mean_speed for point in points]),
        multipliers=np.array([point.multipliers for point in points], dtype=complex).reshape(-1, n),
        phases=np.array([point.family.phase for point in points]),
        states=np.array([point.place.state for point in points]).reshape(-1, n),
        strobe={name: np.array([one[:, k] for one in strobe]).reshape(-1, family.turns) for k, name in
                enumerate(names)},
        special_points=tuple(
            Special(one.kind, one.point.mean_speed, one.point.multipliers, one.change, one.point.family.phase,
                    one.point.place.state, at, one.point.value, one.width) for at, one in special), end=end)


def _strobe(point: BranchPoint) -> np.ndarray:
    """The state, SI units, each time the crank passes the angle 0 within a passage, shape (turns, n)."""
    here = point.family.map_at(point.place.share)
    device, there = Simulator(here.scene), TurnMap(here.scene, 0.0)
    here.put(device, point.place.state)
    return there.cuts(device, point.family.turns).states * there.units
