"""A branch from its first orbit to its end: the range is left, the branch closes, joins another one, or is lost."""

from collections.abc import Callable

import numpy as np

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.branch import Branch, Special
from vibro_ros.orbits.branch_point import BranchPoint, LostError, corrected, point_at
from vibro_ros.orbits.continuation import follow_on
from vibro_ros.orbits.event_order import same_order
from vibro_ros.orbits.family import Family, Place
from vibro_ros.orbits.special_points import SpecialPoint, special_points
from vibro_ros.orbits.turn_map import TURN, TurnMap
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator

_JOINED = 1e-6  # in units of the machine: an orbit that repeats itself so closely after half its turns has joined them
_CLOSES = 0.75  # of a step: a branch that comes so near to its begin is closed


#: Is told how many orbits of a branch are found, and the value of the parameter [its unit] at the last one.
Notice = Callable[[int, float], object]


def whole_branch(start: BranchPoint, points: int, notice: Notice | None = None) -> Branch:
    """The branch from `start` along its tangent, of at most so many orbits; `notice` hears of each."""
    found: list[BranchPoint] = []
    special: list[tuple[int, SpecialPoint]] = []
    family, end = start.family, f"{points} orbits, the most that were asked for"
    closing = _Closing(start)
    try:
        for before, after in follow_on(start):
            if not 0.0 <= after.place.share <= 1.0:
                end = _leaves(family, after.place.share)
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


def _leaves(family: Family, share: float) -> str:
    unit = BY_NAME[family.name].unit.replace("1", "")
    return f"{family.name} leaves its range at {family.high if share > 1.0 else family.low:g} {unit}".rstrip()


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
    strobe = [_strobe(point) for point in points]
    return Branch(
        family.name, family.turns, np.array([point.value for point in points]),
        np.array([point.mean_speed for point in points]),
        np.array([point.multipliers for point in points], dtype=complex).reshape(-1, n),
        np.array([point.family.phase for point in points]),
        np.array([point.place.state for point in points]).reshape(-1, n),
        {name: np.array([getattr(one, name) for one in strobe]).reshape(-1, family.turns) for name in names},
        tuple(_special(at, one) for at, one in special), end)


def _strobe(point: BranchPoint) -> Samples[np.ndarray]:
    """The device each time its crank passes the angle 0 within a passage."""
    turn_map = point.family.map_at(point.place.share)
    device = Simulator(turn_map.scene)
    turn_map.put(device, point.place.state)
    ahead = -turn_map.phase % TURN / TURN
    return device.sample((ahead + np.arange(point.family.turns)) * turn_map.period)


def _special(at: int, one: SpecialPoint) -> Special:
    point = one.point
    return Special(one.kind, point.value, one.width, point.mean_speed, point.multipliers, one.change,
                   point.family.phase, point.place.state, at)
