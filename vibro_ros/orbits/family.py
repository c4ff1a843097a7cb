"""Orbits of one machine with one parameter that changes: the equations that a branch follows, and its points."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.orbit import CLOSED, STEP
from vibro_ros.orbits.passage import EventOrder, Passage, ordered, passage
from vibro_ros.orbits.turn_map import TurnMap, share_of_turn
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import Simulator

LONGEST_STEP = 0.05
"""Longest step along a branch: in units of the machine and shares of the parameter's range."""
_MOST_ITERATIONS = 24
_SLOW = 0.1  # a step that leaves a larger part of the residual has an old derivative
_MAPS = 8  # that are kept: those of a derivative by the parameter, and of a step
_LEAST_STEP = 1e-9  # of the differences, which rounding then leaves five digits
_PART = 0.1  # of the reach, and of the nearest miss
_SHARE = 0.005  # of the square of the softest contact's speed


class Place(NamedTuple):
    """A state at the cut together with the parameter: where a branch is.

    Attributes
    ----------
    state : ndarray, shape (n,)
        In units of the machine.
    share : float
        The parameter's place between the ends of its range: 0 at the one, 1 at the other; dimensionless.
    """

    state: np.ndarray
    share: float

    @property
    def vector(self) -> np.ndarray:
        """State and share, shape (n + 1,)."""
        return np.append(self.state, self.share)

    @classmethod
    def of(cls, vector: np.ndarray) -> "Place":
        """The place of a vector, shape (n + 1,)."""
        return cls(vector[:-1], float(vector[-1]))


class Family:
    """What comes back after `turns` turns, for each value of a parameter.

    Parameters
    ----------
    scene : Scene
        The machine.
    name : str
        A number among its parameters.
    low, high : float
        Range of the parameter, in its unit.
    turns : int
        Turns of the crank after which orbits repeat themselves.
    phase : float
        Crank angle at the cut [rad].

    Attributes
    ----------
    scene, name, low, high, turns, phase
        The parameters.
    units : ndarray, shape (n,)
        What 1 is of each coordinate [m or m/s], all along the branch.

    Raises
    ------
    ValueError
        For a range that is none, or a value that the scene refuses.
    """

    def __init__(self, scene: Scene, name: str, low: float, high: float, turns: int, phase: float):
        if not low < high:
            raise ValueError(f"{name}: from {low:g} to {high:g} is no range; give the smaller value first")
        if name == "motor.speed" and low < 0.0 < high:
            raise ValueError(f"{name}: from {low:g} to {high:g} rad/s holds 0, which turns no crank; give a range "
                             "on one side of it")
        self.scene, self.name, self.low, self.high, self.turns, self.phase = scene, name, low, high, turns, phase
        self.units = TurnMap(scene, 0.0).units
        self.map_at = lru_cache(_MAPS)(self._map_at)

    def value(self, share: float) -> float:
        """The parameter at a share of its range, in its unit."""
        return self.low + share * (self.high - self.low)

    def share(self, value: float) -> float:
        """The share of the range at a value of the parameter."""
        return (value - self.low) / (self.high - self.low)

    def scene_at(self, share: float) -> Scene:
        """The machine there (ValueError where the scene refuses the value)."""
        return self.scene.with_parameters({self.name: self.value(share)})

    def _map_at(self, share: float) -> TurnMap:
        turn_map = TurnMap(self.scene_at(share), self.phase)
        turn_map.units = self.units  # the same all along the branch
        return turn_map

    def residual(self, place: Place) -> np.ndarray:
        """By how much the state does not come back, shape (n,)."""
        return self.map_at(place.share)(place.state, self.turns).state - place.state

    def held(self, place: Place) -> np.ndarray:
        """Coordinates that something holds at the cut, shape (n,) of bool."""
        return self.map_at(place.share).held(place.state)

    def order(self, place: Place) -> EventOrder:
        """The order of the events between the cut and `turns` turns later."""
        return ordered(self.map_at(place.share), place.state, self.turns)[1]

    def jacobian(self, place: Place, held: np.ndarray, reach: float = 1.0,
                 fine: bool = False) -> np.ndarray:
        """Derivative of the residual by state and share, shape (n, n + 1); what is held stays, whatever else moves.

        A mass that arrives at its plate with the speed v would miss the plate from v² / 2 farther back, in units of the
        machine. Central differences stay far within that, because the map has the root of this distance there; they let
        no mass touch that misses its plate; they stay within `reach`, over which the branch is straight; and they are
        shortened, down to 1e-9, until all their ends have the same events in the same order, because elsewhere the map
        has other derivatives. With `fine`, differences over half the step cancel the leading error of the step
        (L. F. Richardson's extrapolation).
        """
        seen = passage(self.map_at(place.share), place.state, self.turns)
        order = self.order(place)
        step = max(_LEAST_STEP, min(STEP, _SHARE * seen.softest**2, _PART * seen.miss, _PART * reach))
        while True:
            matrix, same = self._differences(place, ~held, order, step)
            if same or step <= _LEAST_STEP:
                break
            step = max(_LEAST_STEP, 0.1 * step)
        return (4.0 * self._differences(place, ~held, order, 0.5 * step)[0] - matrix) / 3.0 if fine else matrix

    def _differences(self, place: Place, free: np.ndarray, order: EventOrder, step: float) -> tuple[np.ndarray, bool]:
        """The derivative by central differences, and whether all their ends have the events of `order`."""
        n, vector = len(place.state), place.vector
        matrix, same = np.zeros((n, n + 1)), True
        for i in np.flatnonzero(np.append(free, True)):
            ends = []
            for sign in (step, -step):
                moved = vector.copy()
                moved[i] += sign
                there = Place.of(moved)
                end, along = ordered(self.map_at(there.share), there.state, self.turns)
                ends.append(end.state)
                same = same and along == order
            matrix[free, i] = (ends[0] - ends[1])[free] / (2.0 * step)
        matrix[:, :n] -= np.eye(n)
        return matrix, same

    def with_turns(self, turns: int) -> "Family":
        """The same family for orbits that repeat themselves after another number of turns."""
        return Family(self.scene, self.name, self.low, self.high, turns, self.phase)

    def with_phase(self, phase: float) -> "Family":
        """The same family cut at another crank angle [rad]."""
        return Family(self.scene, self.name, self.low, self.high, self.turns, phase)

    def recut(self, phase: float, places: Iterator[Place]) -> tuple["Family", list[Place]]:
        """The same family cut at another phase, and there the states to which the given ones lead."""
        other = self.with_phase(phase)
        ahead, found = share_of_turn(self.scene, self.phase, phase), []
        for place in places:
            here, there = self.map_at(place.share), other.map_at(place.share)
            device = Simulator(here.scene)
            here.put(device, place.state)
            device.advance_to(ahead * here.period)
            found.append(Place(there.read(device.state), place.share))
        return other, found


class PlacedOrbit(NamedTuple):
    """An orbit of a family: its place, the mean speed of the body [m/s], and its contacts."""

    place: Place
    mean_speed: float
    passage: Passage


@dataclass(frozen=True)
class BranchPoint:
    """One orbit of a branch.

    Attributes
    ----------
    family : Family
        The equations, with the cut that was used.
    place : Place
        State and parameter.
    tangent : ndarray, shape (n + 1,)
        Unit vector along the branch.
    multipliers : ndarray of complex, shape (n,)
        Floquet multipliers, the largest first.
    mean_speed : float
        Of the body [m/s].
    passage : Passage
        Its contacts.
    width : float
        Where the order of events changes just behind this point: width of the interval of the parameter [its unit] in
        which it changes; else 0.
    """

    family: Family
    place: Place
    tangent: np.ndarray
    multipliers: np.ndarray
    mean_speed: float
    passage: Passage
    width: float = 0.0

    @property
    def value(self) -> float:
        """The parameter, in its unit."""
        return self.family.value(self.place.share)

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return bool(np.abs(self.multipliers).max(initial=0.0) < 1.0)


class LostError(RuntimeError):
    """A branch cannot be followed further; the message says why."""


def corrected(family: Family, guess: np.ndarray, normal: np.ndarray,
              reach: float = LONGEST_STEP) -> tuple[np.ndarray, int]:
    """The orbit on the plane through `guess` that is perpendicular to `normal`, and how many derivatives it took.

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
        Where Newton's method does not converge.
    """
    at, best, closest, matrix, derivatives = guess.copy(), np.inf, guess, None, 0
    for _ in range(_MOST_ITERATIONS):
        try:
            place = Place.of(at)
            held, residual = family.held(place), family.residual(place)
            size = float(np.abs(residual).max())
            if size <= CLOSED and size >= 0.25 * best:  # as good as rounding lets it become
                return closest if best < size else at, derivatives
            if matrix is None or size > _SLOW * best:
                matrix, derivatives = np.vstack([family.jacobian(place, held, reach), normal]), derivatives + 1
            if size < best:
                best, closest = size, at
            residual[held] = 0.0
            at = at - np.linalg.solve(matrix, np.append(residual, normal @ (at - guess)))
        except (np.linalg.LinAlgError, SimulationError, ValueError) as error:
            raise LostError(str(error)) from error
        if not np.all(np.isfinite(at)) or np.abs(at - guess).max() > 10.0 * LONGEST_STEP:
            break
    if best <= CLOSED:
        return closest, derivatives
    raise LostError(f"Newton's method does not close an orbit near {family.name} = {family.value(guess[-1]):.9g}")


def point_at(family: Family, vector: np.ndarray, along: np.ndarray,
             reach: float = LONGEST_STEP, fine: bool = False) -> BranchPoint:
    """The branch's point at a solution, shape (n + 1,); `reach` and `fine` as for `Family.jacobian`."""
    here, n = orbit_of(family, Place.of(vector)), len(vector) - 1
    matrix = family.jacobian(here.place, family.held(here.place), reach, fine)
    *_, rows = np.linalg.svd(matrix)
    tangent = rows[-1] if rows[-1] @ along >= 0.0 else -rows[-1]
    found = np.linalg.eigvals(matrix[:, :n] + np.eye(n))
    return BranchPoint(family, here.place, tangent, found[np.argsort(-np.abs(found), kind="stable")], here.mean_speed,
                       here.passage)


def orbit_of(family: Family, place: Place) -> PlacedOrbit:
    """What the orbit at a place does, without derivatives."""
    turn_map = family.map_at(place.share)
    advance = turn_map(place.state, family.turns).advance
    return PlacedOrbit(place, advance / (family.turns * turn_map.period), passage(turn_map, place.state, family.turns))
