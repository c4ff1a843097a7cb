"""Orbits of one machine with one parameter that changes: the equations that a branch of orbits follows."""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.event_order import EventOrder
from vibro_ros.orbits.newton import STEP
from vibro_ros.orbits.passage import passage
from vibro_ros.orbits.turn_map import TURN, TurnMap
from vibro_ros.simulation.simulator import Simulator

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
        self.scene, self.name, self.low, self.high, self.turns, self.phase = scene, name, low, high, turns, phase
        self.units = self.units_of(scene)
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

    @staticmethod
    def units_of(scene: Scene) -> np.ndarray:
        """What 1 is of each coordinate of a scene's own turn map [m or m/s], shape (n,)."""
        return TurnMap(scene, 0.0).units

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
        return self.map_at(place.share).ordered(place.state, self.turns)[1]

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
                end, along = self.map_at(there.share).ordered(there.state, self.turns)
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
        ahead, found = (phase - self.phase) % TURN / TURN, []
        for place in places:
            here, there = self.map_at(place.share), other.map_at(place.share)
            device = Simulator(here.scene)
            here.put(device, place.state)
            device.advance_to(ahead * here.period)
            found.append(Place(there.read(device.state), place.share))
        return other, found
