"""Newton's method for states to which the turn map comes back, with the map's derivative by central differences."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from vibro_ros.orbits.turn_map import TurnMap
from vibro_ros.simulation.motion import SimulationError

STEP = 1e-5
"""Of the central differences, in units of the machine: its square and rounding / step are errors of about 1e-9."""
CLOSED = 1e-11
"""Largest residual of an orbit, in units of the machine; rounding along a turn makes 1e-14 to 1e-12."""
_MOST_STEPS = 40
_SHORTEST = 2.0**-10  # part of a Newton step that is tried


class Closed(NamedTuple):
    """A state that comes back.

    Attributes
    ----------
    state : ndarray, shape (n,)
        In units of the machine.
    residual : float
        Largest difference between the state and the one that follows, in units of the machine.
    """

    state: np.ndarray
    residual: float


def derivative(turn_map: TurnMap, state: np.ndarray, turns: int, free: np.ndarray, step: float = STEP) -> np.ndarray:
    """Derivative of the map over `turns` by the coordinates that are `free`, shape (free, free).

    Central differences of a map that is exact to rounding: the error is that of their step, where nothing grazes
    a plate within it.
    """
    columns = []
    for i in np.flatnonzero(free):
        ends = []
        for sign in (step, -step):
            moved = state.copy()
            moved[i] += sign
            ends.append(turn_map(moved, turns).state)
        columns.append((ends[0] - ends[1])[free] / (2.0 * step))
    return np.array(columns).T


def close(turn_map: TurnMap, guess: np.ndarray, turns: int,
          derivative_of: Callable[..., np.ndarray] = derivative) -> Closed | None:
    """The orbit that Newton's method finds from `guess`; None when there is none within its reach.

    A full step that makes the residual larger is halved. What a plate, the ground or friction holds at the cut is held.
    """
    state, residual = guess, _residual(turn_map, guess, turns)
    for _ in range(_MOST_STEPS):
        free = ~turn_map.held(state)
        difference = np.zeros_like(state)
        try:
            matrix = derivative_of(turn_map, state, turns, free) - np.eye(int(free.sum()))
            difference[free] = np.linalg.solve(matrix, residual[free])
        except (np.linalg.LinAlgError, SimulationError, ValueError):
            return None
        better = _shortened(turn_map, state, residual, difference, turns)
        if better is None:
            break
        state, residual = better
    size = float(np.abs(residual).max(initial=0.0))
    return Closed(state, size) if size <= CLOSED else None


def _shortened(turn_map: TurnMap, state: np.ndarray, residual: np.ndarray, difference: np.ndarray,
               turns: int) -> tuple[np.ndarray, np.ndarray] | None:
    """State and residual after a Newton step or a part of it that makes the residual smaller; None without any."""
    part = 1.0
    while part >= _SHORTEST:
        moved = state - part * difference
        try:
            after = _residual(turn_map, moved, turns)
        except (SimulationError, ValueError):
            after = np.full_like(residual, np.inf)
        if np.abs(after).max() < np.abs(residual).max():
            return moved, after
        part *= 0.5
    return None


def _residual(turn_map: TurnMap, state: np.ndarray, turns: int) -> np.ndarray:
    return turn_map(state, turns).state - state
