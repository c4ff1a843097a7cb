"""Equations of a periodic orbit of a scene with a varied parameter; the points of branches.

The *unknowns* are the state at the cut, in units of the machine, followed by the *share*: the parameter, scaled from 0
at the lower end of its range to 1 at the upper.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vibro_lab.orbits.orbit import CLOSED, STEP, differences
from vibro_lab.orbits.passage import EventOrder, Passage, end_and_order, passage
from vibro_lab.orbits.turn_map import TurnEnd, TurnMap, at_cut, check_closes, units_of
from vibro_ros import PARAMETERS, Scene, SimulationError, parameter_named

_CACHED_MAPS = 16  # turn maps in the cache: enough for a derivative with respect to the parameter and for a step


@dataclass(frozen=True)
class ContinuationSettings:
    """Settings of the continuation; `test_continuation_settings.py` halves and doubles each of them.

    Arcs and steps lie along the branch, in units of the machine and shares of the parameter's range.
    """

    # Steps along the branch.
    first_step: float = 0.01  # short beside most curves; an easy step is lengthened at once
    longest_step: float = 0.05  # two special points of one kind are rarely so close together
    shortest_step: float = 1e-10  # ten times the residual of an orbit: below, no step has a direction
    easy_iterations: int = 2  # most derivatives of a step after which the next is longer: the branch is straight
    bend: float = 0.1  # largest 1 - cosine between the tangents of neighbours: a larger one may skip a fold
    nearest_event: float = 0.01  # least distance of the cut from all events, as a share of a turn; nearer, it is moved
    direction_arc: float = 1e-6  # to a second point, which gives the branch's direction when the cut changes
    # Where shorter steps meet a larger multiplier, the branch ends as too unstable: rounding would lead it astray.
    stiff_step: float = 1e-4
    stiff_multiplier: float = 1e3

    # Newton's method and its differences.
    most_iterations: int = 24  # three times as many as the slowest orbit of the tests needs
    slow_convergence: float = 0.1  # the derivative is computed again after a step that leaves more of the residual
    least_difference: float = 1e-9  # step of the differences, of which rounding then leaves five digits
    difference_per_reach: float = 0.1  # longest step as a part of the reach, and of the nearest miss
    difference_per_speed: float = 0.005  # and as a part of the square of the softest contact's speed

    # Edges, where the order of events changes.
    edge_search_step: float = 1e-5  # a step that fails and is shorter is searched for an edge
    edge_arc: float = 1e-12  # to which the edge is located: the residual of an orbit, and no digit more
    beyond_arc: float = 1e-9  # beyond the edge, where the order must differ: far beyond the rounding of event times
    most_rounds: int = 8  # renewals of the derivative in the search; each leaves a small part of the way
    most_chords: int = 40  # iterations with one derivative: enough for a convergence of 0.7 an iteration
    before_arc: float = 1e-6  # before the edge, where its multipliers are computed: so near, they have not changed
    # A branch is entered beyond its edge by Newton's method from guesses in these orders, up to 128 of them. Most edges
    # take one or two. Others need a derivative from farther off (the near side is too curved), a first point from
    # nearer or farther, a start deeper by this multiple of the arc's square (beyond a grazing the branch begins along
    # the edge), or the opposite direction (the branch turns back). Guesses cost some turns each, and are rare.
    derivative_arcs: tuple[float, ...] = (1e-6, 1e-5, 1e-4, 1e-3)
    first_point_arcs: tuple[float, ...] = (1e-4, 1e-5, 1e-3, 1e-6)
    depths: tuple[float, ...] = (0.0, 1.0, 10.0, 0.1)

    # Special points.
    tolerance: float = 1e-10  # of the parameter's value, as a share of its range: rounding allows no smaller one
    least_arc: float = 1e-6  # below it, the width of a special point's interval is that of the parameter, as at a fold
    circle: float = 1e-3  # largest distance from 1 of the magnitude of a Neimark-Sacker point's multipliers
    compared_arc: float = 1e-5  # beyond an edge, where the other side is compared with this one
    smooth_change: float = 5e-3  # largest changes there of the tangent (1 - cosine) and of multipliers, if smooth
    # Doubled, it takes a corner of `device` for smooth; of all settings that are halved and doubled this one matters.


class Family:
    """Equations of orbits with a period of `turns` turns, over a parameter of a scene.

    `limits` are the ends of the parameter's range, the smaller first, in its unit; `phase` is the crank angle at the
    cut [rad]. The `units` of the coordinates [m, m/s, rad/s or A], shape (n,), are the same for all values of the
    parameter.
    """

    def __init__(self, scene: Scene, name: str, limits: tuple[float, float], turns: int, phase: float,
                 settings: ContinuationSettings = ContinuationSettings()):
        _check_range(scene, name, *limits)
        self.settings = settings
        self.scene, self.name, self.limits, self.turns, self.phase = scene, name, limits, turns, phase
        check_closes(scene)
        self.units = units_of(scene)
        self._map_of = lru_cache(_CACHED_MAPS)(self._make_map)

    def value(self, unknowns: np.ndarray) -> float:
        """Value of the parameter at some unknowns, in its unit."""
        return self._value(float(unknowns[-1]))

    def _value(self, share: float) -> float:
        return self.limits[0] + self.span(share)

    def scaled(self, value: float) -> float:
        """Share of the range at a value of the parameter, dimensionless."""
        return (value - self.limits[0]) / (self.limits[1] - self.limits[0])

    def span(self, share: float) -> float:
        """Convert a share of the parameter's range to its unit."""
        return share * (self.limits[1] - self.limits[0])

    def where(self, unknowns: np.ndarray) -> str:
        """Name and value of the parameter at some unknowns, as text."""
        return f"{self.name} = {self.value(unknowns):.9g}"

    def map_at(self, unknowns: np.ndarray) -> TurnMap:
        """Return the turn map at the parameter's value of some unknowns (ValueError if the scene refuses the value)."""
        return self._map_of(float(unknowns[-1]))

    def _make_map(self, share: float) -> TurnMap:
        turn_map = TurnMap(self.scene.with_parameters({self.name: self._value(share)}), self.phase)
        turn_map.units = self.units
        return turn_map

    def state(self, unknowns: np.ndarray) -> np.ndarray:
        """State at the cut of some unknowns, shape (n,)."""
        return unknowns[:len(self.units)]

    def end(self, unknowns: np.ndarray) -> TurnEnd:
        """Return the end of `turns` turns."""
        return self.map_at(unknowns)(self.state(unknowns), self.turns)

    def residual(self, unknowns: np.ndarray) -> np.ndarray:
        """Residual of periodicity: the state after `turns` turns minus the state, shape (n,)."""
        return self.end(unknowns).state - self.state(unknowns)

    def mean_speed(self, unknowns: np.ndarray) -> float:
        """Mean speed of the body [m/s]."""
        end = self.end(unknowns)
        return end.advance / end.duration

    def free(self, unknowns: np.ndarray) -> np.ndarray:
        """Unknowns that are not held at the cut by friction, ground or a plate, shape (n + 1,) of bool."""
        return np.append(~self.map_at(unknowns).held(self.state(unknowns)), True)

    def order(self, unknowns: np.ndarray) -> EventOrder:
        """Order of the events between the cut and `turns` turns later."""
        return end_and_order(self.map_at(unknowns), self.state(unknowns), self.turns)[1]

    def passage(self, unknowns: np.ndarray) -> Passage:
        """Events from the cut over `turns` turns."""
        return passage(self.map_at(unknowns), self.state(unknowns), self.turns)

    def jacobian(self, unknowns: np.ndarray, reach: float = 1.0, fine: bool = False) -> np.ndarray:
        """Jacobian of the residual with respect to the unknowns, shape (n, n + 1), by central differences.

        Held coordinates do not move. The step of the differences is limited in four ways:

        - A mass that arrives at its plate with the speed v would miss the plate if it were v² / 2 farther back, in
          units of the machine. The step is far below that, because there the map behaves like a square root.
        - It is below the distance of the nearest miss, so that no other mass touches its plate.
        - It is below `reach`, the arc over which the branch is straight.
        - It is at most `orbit.STEP`, and it is reduced, down to 1e-9, until the order of events is the same at all
          displaced points, because for another order the map has other derivatives.

        With `fine`, differences over half the step cancel the leading error (L. F. Richardson's extrapolation).
        """
        free, events, least = self.free(unknowns), self.passage(unknowns), self.settings.least_difference
        near = self.settings.difference_per_reach * min(events.miss, reach)
        step = max(least, min(STEP, self.settings.difference_per_speed * events.softest**2, near))
        while True:
            matrix, has_same_order = self._differences(unknowns, free, events.order, step)
            if has_same_order or step <= least:
                break
            step = max(least, 0.1 * step)
        return (4.0 * self._differences(unknowns, free, events.order, 0.5 * step)[0] - matrix) / 3.0 if fine else matrix

    def _differences(self, unknowns: np.ndarray, free: np.ndarray, order: EventOrder,
                     step: float) -> tuple[np.ndarray, bool]:
        """Jacobian by central differences, and whether all displaced points have the order of events `order`."""
        n = len(self.units)
        orders = list[EventOrder]()

        def end_of(moved: np.ndarray) -> np.ndarray:
            end, moved_order = end_and_order(self.map_at(moved), self.state(moved), self.turns)
            orders.append(moved_order)
            return end.state

        matrix = differences(end_of, unknowns, free, step)
        matrix[~free[:n]] = 0.0
        matrix[:, :n] -= np.eye(n)
        return matrix, all(moved_order == order for moved_order in orders)

    def with_turns(self, turns: int) -> "Family":
        """Return the same family for orbits that repeat themselves after another number of turns."""
        return Family(self.scene, self.name, self.limits, turns, self.phase, self.settings)

    def with_phase(self, phase: float) -> "Family":
        """Return the same family, cut at another crank angle [rad]."""
        return Family(self.scene, self.name, self.limits, self.turns, phase, self.settings)

    def recut(self, phase: float, points: Sequence[np.ndarray]) -> tuple["Family", list[np.ndarray]]:
        """Return the same family, cut at another phase, and the points advanced to the new cut."""
        recut_family, advanced = self.with_phase(phase), []
        for unknowns in points:
            state = at_cut(self.map_at(unknowns), self.state(unknowns), recut_family.map_at(unknowns))
            advanced.append(np.append(state, unknowns[-1]))
        return recut_family, advanced

    def starts_along(self, unknowns: np.ndarray) -> list[np.ndarray]:
        """Unknowns of the same orbit at the cut of each of its turns."""
        turn_map, share = self.map_at(unknowns), unknowns[-1]
        return [np.append(turn_map(self.state(unknowns), turns).state, share) for turns in range(1, self.turns + 1)]


def _check_range(scene: Scene, name: str, low: float, high: float) -> None:
    """Raise a ValueError for a parameter that is not numeric, an empty range, or ends that the scene refuses."""
    parameter = parameter_named(name, PARAMETERS)
    if not isinstance(parameter.default, float):
        raise ValueError(f"{name}: is {parameter.type_name}, along which no branch can be followed; choose a number")
    low, high = parameter.checked(low), parameter.checked(high)
    if not low < high:
        raise ValueError(f"{name}: from {low:g} to {high:g} is no range; give the smaller value first")
    if name == "motor.speed" and low < 0.0 < high:
        raise ValueError(f"{name}: from {low:g} to {high:g} rad/s holds 0, which turns no crank; give a range on one "
                         "side of it")
    for end in (low, high):
        scene.with_parameters({name: end})


@dataclass(frozen=True)
class BranchPoint:
    """One orbit of a branch."""

    family: Family  # the equations, with the cut that was used
    unknowns: np.ndarray  # shape (n + 1,): state and share of the parameter
    tangent: np.ndarray  # shape (n + 1,): unit vector along the branch
    multipliers: np.ndarray  # shape (n,): Floquet multipliers, the largest first
    mean_speed: float  # mean speed of the body [m/s]
    passage: Passage  # events of the orbit
    # If the order of events changes just beyond this point: width of the interval of the parameter [its unit] in which
    # it changes; else 0.
    width: float = 0.0

    @property
    def state(self) -> np.ndarray:
        """State at the cut, in units of the machine, shape (n,)."""
        return self.family.state(self.unknowns)

    @property
    def value(self) -> float:
        """Value of the parameter, in its unit."""
        return self.family.value(self.unknowns)

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return bool(np.abs(self.multipliers).max(initial=0.0) < 1.0)


class LostError(RuntimeError):
    """A branch cannot be followed further; the message says why."""


def corrected_orbit(family: Family, guess: np.ndarray, normal: np.ndarray,
                    reach: float = math.inf) -> tuple[np.ndarray, int]:
    """Return the orbit in the plane through `guess` perpendicular to `normal`, and the number of Jacobians computed.

    LostError if Newton's method does not converge. `reach` is that of `Family.jacobian`, at most the longest step.
    """
    reach = min(reach, family.settings.longest_step)
    unknowns, best, closest, matrix, derivatives = guess.copy(), np.inf, guess, None, 0
    for _ in range(family.settings.most_iterations):
        try:
            free, residual = family.free(unknowns), family.residual(unknowns)
            size = float(np.abs(residual).max())
            if size <= CLOSED and size >= 0.25 * best:  # rounding allows no smaller residual
                return closest if best < size else unknowns, derivatives
            if matrix is None or size > family.settings.slow_convergence * best:
                matrix, derivatives = np.vstack([family.jacobian(unknowns, reach), normal]), derivatives + 1
            if size < best:
                best, closest = size, unknowns
            residual[~free[:-1]] = 0.0
            unknowns = unknowns - np.linalg.solve(matrix, np.append(residual, normal @ (unknowns - guess)))
        except (np.linalg.LinAlgError, SimulationError, ValueError) as error:
            raise LostError(str(error)) from error
        if not np.all(np.isfinite(unknowns)) or np.abs(unknowns - guess).max() > 10.0 * family.settings.longest_step:
            break
    if best <= CLOSED:
        return closest, derivatives
    raise LostError(f"Newton's method does not close an orbit near {family.where(guess)}")


def point_at(family: Family, unknowns: np.ndarray, along: np.ndarray,
             reach: float = math.inf, fine: bool = False) -> BranchPoint:
    """Return the branch's point at a solution, shape (n + 1,), with a tangent in the sense of `along`.

    `reach` and `fine` are arguments of `Family.jacobian`.
    """
    matrix = family.jacobian(unknowns, min(reach, family.settings.longest_step), fine)
    n = len(unknowns) - 1
    *_, rows = np.linalg.svd(matrix)
    tangent = rows[-1] if rows[-1] @ along >= 0.0 else -rows[-1]
    return BranchPoint(family, unknowns, tangent, multipliers_of(matrix[:, :n]), family.mean_speed(unknowns),
                       family.passage(unknowns))


def multipliers_of(matrix: np.ndarray) -> np.ndarray:
    """Floquet multipliers, the largest first, from the residual's Jacobian with respect to the state, shape (n, n)."""
    multipliers = np.linalg.eigvals(matrix + np.eye(len(matrix)))
    return multipliers[np.argsort(-np.abs(multipliers), kind="stable")]
