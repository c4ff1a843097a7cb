"""Equations of a periodic orbit of a scene with a varied parameter; the points of branches.

The *unknowns* are the state at the cut, in units of the machine, followed by the *share*: the parameter, scaled from 0
at the lower end of its range to 1 at the upper.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vibro_lab.orbits.orbit import CLOSED, STEP, differences
from vibro_lab.orbits.passage import EventOrder, Passage, end_and_order, passage
from vibro_lab.orbits.turn_map import TurnEnd, TurnMap, at_cut, check_closes, units_of
from vibro_ros import PARAMETERS, Scene, SimulationError, parameter_named

LONGEST_STEP = 0.05
"""Longest step along a branch: in units of the machine and shares of the parameter's range."""
_MOST_ITERATIONS = 24
_SLOW_CONVERGENCE = 0.1  # the derivative is computed again after a step that leaves a larger part of the residual
_CACHED_MAPS = 16  # turn maps in the cache: enough for a derivative with respect to the parameter and for a step
_LEAST_STEP = 1e-9  # of the differences, of which rounding then leaves five digits
_STEP_PER_REACH = 0.1  # longest step of differences as a part of the reach, and of the nearest miss
_STEP_PER_SPEED = 0.005  # the same as a part of the square of the softest contact's speed


class Family:
    """Equations of orbits with a period of `turns` turns, over a parameter of a scene.

    Parameters
    ----------
    scene : Scene
        The machine.
    name : str
        One of its numeric parameters.
    limits : (float, float)
        Ends of the parameter's range, the smaller first, in its unit.
    turns : int
        Turns of the crank after which orbits repeat themselves.
    phase : float
        Crank angle at the cut [rad].

    Attributes
    ----------
    scene, name, limits, turns, phase
        The parameters.
    units : ndarray, shape (n,)
        Unit of each coordinate [m, m/s, rad/s or A], the same for all values of the parameter.
    """

    def __init__(self, scene: Scene, name: str, limits: tuple[float, float], turns: int, phase: float):
        _check_range(scene, name, *limits)
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
        free, seen = self.free(unknowns), self.passage(unknowns)
        step = max(_LEAST_STEP, min(STEP, _STEP_PER_SPEED * seen.softest**2, _STEP_PER_REACH * seen.miss,
                                    _STEP_PER_REACH * reach))
        while True:
            matrix, same = self._differences(unknowns, free, seen.order, step)
            if same or step <= _LEAST_STEP:
                break
            step = max(_LEAST_STEP, 0.1 * step)
        return (4.0 * self._differences(unknowns, free, seen.order, 0.5 * step)[0] - matrix) / 3.0 if fine else matrix

    def _differences(self, unknowns: np.ndarray, free: np.ndarray, order: EventOrder,
                     step: float) -> tuple[np.ndarray, bool]:
        """Jacobian by central differences, and whether all displaced points have the order of events `order`."""
        n = len(self.units)
        orders = list[EventOrder]()

        def end_of(moved: np.ndarray) -> np.ndarray:
            end, along = end_and_order(self.map_at(moved), self.state(moved), self.turns)
            orders.append(along)
            return end.state

        matrix = differences(end_of, unknowns, free, step)
        matrix[~free[:n]] = 0.0
        matrix[:, :n] -= np.eye(n)
        return matrix, all(along == order for along in orders)

    def with_turns(self, turns: int) -> "Family":
        """Return the same family for orbits that repeat themselves after another number of turns."""
        return Family(self.scene, self.name, self.limits, turns, self.phase)

    def with_phase(self, phase: float) -> "Family":
        """Return the same family, cut at another crank angle [rad]."""
        return Family(self.scene, self.name, self.limits, self.turns, phase)

    def recut(self, phase: float, points: Sequence[np.ndarray]) -> tuple["Family", list[np.ndarray]]:
        """Return the same family, cut at another phase, and the points advanced to the new cut."""
        other, found = self.with_phase(phase), []
        for unknowns in points:
            state = at_cut(self.map_at(unknowns), self.state(unknowns), other.map_at(unknowns))
            found.append(np.append(state, unknowns[-1]))
        return other, found

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
    multipliers: np.ndarray  # shape (n,): floquet multipliers, the largest first
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
              reach: float = LONGEST_STEP) -> tuple[np.ndarray, int]:
    """Return the orbit in the plane through `guess` perpendicular to `normal`, and the number of Jacobians computed.

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
        If Newton's method does not converge.
    """
    at, best, closest, matrix, derivatives = guess.copy(), np.inf, guess, None, 0
    for _ in range(_MOST_ITERATIONS):
        try:
            free, residual = family.free(at), family.residual(at)
            size = float(np.abs(residual).max())
            if size <= CLOSED and size >= 0.25 * best:  # rounding allows no smaller residual
                return closest if best < size else at, derivatives
            if matrix is None or size > _SLOW_CONVERGENCE * best:
                matrix, derivatives = np.vstack([family.jacobian(at, reach), normal]), derivatives + 1
            if size < best:
                best, closest = size, at
            residual[~free[:-1]] = 0.0
            at = at - np.linalg.solve(matrix, np.append(residual, normal @ (at - guess)))
        except (np.linalg.LinAlgError, SimulationError, ValueError) as error:
            raise LostError(str(error)) from error
        if not np.all(np.isfinite(at)) or np.abs(at - guess).max() > 10.0 * LONGEST_STEP:
            break
    if best <= CLOSED:
        return closest, derivatives
    raise LostError(f"Newton's method does not close an orbit near {family.where(guess)}")


def point_at(family: Family, unknowns: np.ndarray, along: np.ndarray,
             reach: float = LONGEST_STEP, fine: bool = False) -> BranchPoint:
    """Return the branch's point at a solution, shape (n + 1,), with a tangent in the sense of `along`.

    `reach` and `fine` are arguments of `Family.jacobian`.
    """
    matrix, n = family.jacobian(unknowns, reach, fine), len(unknowns) - 1
    *_, rows = np.linalg.svd(matrix)
    tangent = rows[-1] if rows[-1] @ along >= 0.0 else -rows[-1]
    return BranchPoint(family, unknowns, tangent, multipliers_of(matrix[:, :n]), family.mean_speed(unknowns),
                       family.passage(unknowns))


def multipliers_of(matrix: np.ndarray) -> np.ndarray:
    """Floquet multipliers, the largest first, from the residual's Jacobian with respect to the state, shape (n, n)."""
    found = np.linalg.eigvals(matrix + np.eye(len(matrix)))
    return found[np.argsort(-np.abs(found), kind="stable")]
