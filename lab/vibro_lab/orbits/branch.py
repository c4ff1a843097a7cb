"""Whole branches of periodic orbits over a parameter: through a given orbit, or from a period doubling on.

A branch ends where it leaves the range of the parameter, closes, joins another branch, or is lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibro_lab.orbits.continuation import EdgeError, SpecialPoint, follow, special_points
from vibro_lab.orbits.family import BranchPoint, Family, LostError, corrected_orbit, point_at
from vibro_lab.orbits.orbit import Orbit, Seed, is_same
from vibro_lab.orbits.passage import same_order
from vibro_lab.orbits.turn_map import TurnMap, state_names, whole_number
from vibro_ros import PARAMETERS, Scene, SimulationError, Simulator

MOST_POINTS = 100_000
_AMPLITUDES = (1e-2, 3e-3, 1e-3)  # units of the machine: distances from a doubling at which the doubled orbit is tried
_HALF_PERIOD_CHANGE = 1e-6  # units of the machine: change in half a period below which an orbit has half the period
_CLOSING_DISTANCE = 0.75  # steps: distance from its first orbit at which a branch is closed


@dataclass(frozen=True)
class Special:
    """A special point of a branch: a bifurcation, or a change of the order of events."""

    kind: str  # ``fold``, ``period doubling``, ``Neimark-Sacker``, ``grazing`` or ``corner``
    mean_speed: float  # mean speed of the body [m/s]
    # Shape (n,): Floquet multipliers; at a change of the order of events, those before the change.
    multipliers: np.ndarray
    # Change of the order of events in words, and whether the branch turns back; empty if the order does not change.
    change: str
    phase: float  # crank angle at the cut [rad]
    state: np.ndarray  # shape (n,): state at the cut, in units of the machine
    at: int  # number of the branch's orbits that lie before it
    value: float  # value of the parameter, in its unit
    width: float  # width of the interval of the parameter [its unit] in which it was found


@dataclass(frozen=True)
class Branch:
    """A sequence of neighbouring orbits over a parameter; along a branch the parameter may turn back."""

    scene: Scene  # scene of the orbits, apart from the value of the varied parameter
    name: str  # name of the varied parameter
    turns: int  # turns of the crank after which the orbits repeat themselves
    values: np.ndarray  # shape (points,): values of the parameter, in its unit, in the order of the orbits
    mean_speeds: np.ndarray  # shape (points,): mean speeds of the body [m/s]
    multipliers: np.ndarray  # shape (points, n): Floquet multipliers, the largest first
    phases: np.ndarray  # shape (points,): crank angles of the cuts [rad]
    states: np.ndarray  # shape (points, n): states at the cuts, in units of the machine (`turn_map.units_of` the scene)
    # Shape (points, turns): state [m, m/s, rad/s, A] each time the crank passes the angle 0, by the names of `Samples`.
    strobe: dict[str, np.ndarray]
    special_points: tuple[Special, ...]  # special points in the order of the branch
    end: str  # reason why the branch ends

    def __len__(self) -> int:
        """Number of orbits."""
        return len(self.values)

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
    points = whole_number("points", points, 2, MOST_POINTS)
    family, value = Family(orbit.scene, name, (low, high), orbit.turns, orbit.state.crank_angle), orbit.scene[name]
    if not low <= value <= high:
        raise ValueError(f"{name}: the orbit's {value:g} is not from {low:g} to {high:g}; give a range that holds it")
    turn_map = TurnMap(orbit.scene, orbit.state.crank_angle)
    state = turn_map.read(orbit.state) * turn_map.units / family.units
    return branch_from(family, np.append(state, family.scaled(value)), 1.0 if upwards else -1.0, points)


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
    doubled_family, matrix = family.with_turns(2 * family.turns), family.jacobian(begin)[:, :-1]
    values, vectors = np.linalg.eig(matrix + np.eye(len(matrix)))
    direction = np.append(np.real(vectors[:, np.argmin(np.abs(values + 1.0))]), 0.0)
    direction /= np.linalg.norm(direction)
    for amplitude in _AMPLITUDES:
        try:
            unknowns, _ = corrected_orbit(doubled_family, begin + amplitude * direction, direction, amplitude)
            start = point_at(doubled_family, unknowns, unknowns - begin, amplitude)
        except (LostError, SimulationError, ValueError):
            continue
        return whole_branch(start, points)
    return make_branch(doubled_family, [], [], "no orbit of doubled period was found beside the period doubling")


def lies_on(family: Family, seed: Seed, value: float, branch: Branch) -> bool:
    """Whether a branch of the family contains the orbit of `seed` at a value of the parameter."""
    if branch.turns != seed.turns:
        return False
    differences = branch.values - value
    for k in np.flatnonzero(differences[1:] * differences[:-1] <= 0.0):
        if branch.phases[k] != branch.phases[k + 1] or differences[k] == differences[k + 1]:
            continue
        part = differences[k] / (differences[k] - differences[k + 1])
        guess = branch.states[k] + part * (branch.states[k + 1] - branch.states[k])
        family_of_branch = family.with_turns(branch.turns).with_phase(float(branch.phases[k]))
        try:
            unknowns = np.append(guess, family_of_branch.scaled(value))
            unknowns, _ = corrected_orbit(family_of_branch, unknowns, np.eye(len(guess) + 1)[-1])
            family_of_seed, (unknowns,) = family_of_branch.recut(seed.phase, [unknowns])
        except (LostError, SimulationError, ValueError):
            continue
        if is_same(family_of_seed.map_at(unknowns), family_of_seed.state(unknowns), seed.state, seed.turns):
            return True
    return False


def whole_branch(start: BranchPoint, points: int) -> Branch:
    """Return the branch from `start` along its tangent, with at most `points` orbits."""
    orbits, special = list[BranchPoint](), list[tuple[int, SpecialPoint]]()
    end, closing = f"{points} orbits, the most that were asked for", Closing(start)
    try:
        for first, second in follow(start):
            if leaves := not 0.0 <= second.unknowns[-1] <= 1.0:
                second = _at_bound(first, second)
                end = (f"{second.family.name} leaves its range at {second.value:g} "
                       f"{PARAMETERS[second.family.name].unit.replace('1', '')}").rstrip()
            elif orbits and (reason := closing.reason(first, second)):
                end = reason
                break
            special += [(len(orbits), point) for point in special_points(first, second)]
            orbits.append(second)
            if leaves or len(orbits) >= points:
                break
    except (LostError, SimulationError, ValueError) as error:
        end = closing.reason_at(orbits[-1]) if orbits else ""
        if isinstance(error, EdgeError) and error.grazing and not end:
            special.append((len(orbits), error.grazing))
        end = end or str(error)
    return make_branch(start.family, orbits, special, end)


def _at_bound(first: BranchPoint, second: BranchPoint) -> BranchPoint:
    """Return the point between two neighbours at which the branch leaves the range of the parameter."""
    share = min(max(0.0, second.unknowns[-1]), 1.0)
    part = (share - first.unknowns[-1]) / (second.unknowns[-1] - first.unknowns[-1])
    guess = first.unknowns + part * (second.unknowns - first.unknowns)
    guess[-1] = share
    unknowns, _ = corrected_orbit(first.family, guess, np.eye(len(guess))[-1])
    unknowns[-1] = share
    return point_at(first.family, unknowns, first.tangent)


class Closing:
    """Test whether a branch has come back to its first orbit, or joins the orbits of half its period."""

    def __init__(self, start: BranchPoint):
        self._start, self._family, self._begins, self._left = start, start.family, [start.unknowns], False

    def reason(self, first: BranchPoint, second: BranchPoint) -> str:
        """Reason why the branch ends between two neighbours; empty if it does not."""
        half = second.family.turns // 2
        if 2 * half == second.family.turns and self._apart(first, half) @ self._apart(second, half) < 0.0:
            return f"joins the branch of {half} turn{'s' if half > 1 else ''} at a period doubling"
        step = float(np.linalg.norm(second.unknowns - first.unknowns))
        near = any(np.linalg.norm(second.unknowns - begin) < _CLOSING_DISTANCE * step
                   for begin in self._begins_at(second.family))
        self._left = self._left or not near
        closes = near and self._left and same_order(second.passage.order, self._start.passage.order)
        return "closes on itself" if closes else ""

    def reason_at(self, last: BranchPoint) -> str:
        """Reason why the branch ends at its last point, where continuation failed; empty if unknown."""
        half = last.family.turns // 2
        if 2 * half == last.family.turns and np.abs(self._apart(last, half)).max() < _HALF_PERIOD_CHANGE:
            return f"joins the branch of {half} turn{'s' if half > 1 else ''} at a corner"
        return ""

    def _apart(self, point: BranchPoint, half: int) -> np.ndarray:
        return point.family.map_at(point.unknowns)(point.state, half).state - point.state

    def _begins_at(self, family: Family) -> list[np.ndarray]:
        """Unknowns of the first orbit at the cut of a family, on each of its turns."""
        if family is not self._family:
            recut_family, (unknowns,) = self._start.family.recut(family.phase, [self._start.unknowns])
            self._family, self._begins = family, recut_family.starts_along(unknowns)
        return self._begins


def make_branch(family: Family, points: Sequence[BranchPoint], special: Sequence[tuple[int, SpecialPoint]], end: str
                ) -> Branch:
    """Make a `Branch` from its points, and from special points with the number of points before each."""
    n, states = len(family.units), [_strobe(point) for point in points]  # shapes (turns, n)
    strobe = {name: np.array([state[:, k] for state in states]).reshape(-1, family.turns)
              for k, name in enumerate(state_names(family.scene))}
    return Branch(
        scene=family.scene, name=family.name, turns=family.turns, values=np.array([point.value for point in points]),
        mean_speeds=np.array([point.mean_speed for point in points]),
        multipliers=np.array([point.multipliers for point in points], dtype=complex).reshape(-1, n),
        phases=np.array([point.family.phase for point in points]),
        states=np.array([point.state for point in points]).reshape(-1, n), strobe=strobe, end=end,
        special_points=tuple(
            Special(located.kind, located.point.mean_speed, located.point.multipliers, located.change,
                    located.point.family.phase, located.point.state, at, located.point.value, located.width)
            for at, located in special))


def _strobe(point: BranchPoint) -> np.ndarray:
    """States in SI units each time the crank passes the angle 0 during one period, shape (turns, n)."""
    turn_map = point.family.map_at(point.unknowns)
    device, at_zero = Simulator(turn_map.scene), TurnMap(turn_map.scene, 0.0)
    turn_map.put(device, point.state)
    return at_zero.cuts(device, point.family.turns).states * at_zero.units
