"""The contract of a method: what steps a `State` through time."""

from typing import Protocol

import numpy as np

from vibro_ros.solver import event_loop, fixed_step
from vibro_ros.solver.laws import Laws
from vibro_ros.solver.one_step import MOREAU, RK4, SEMI_IMPLICIT_EULER, new_track
from vibro_ros.solver.state import State
from vibro_ros.solver.system import System

#: Methods of fixed step, by name.
SCHEMES = {"rk4": RK4, "semi_implicit_euler": SEMI_IMPLICIT_EULER, "moreau": MOREAU}


class Method(Protocol):
    """Steps a state; arguments and results are those of `event_loop`'s functions."""

    def begin(self, state: State, point: np.ndarray) -> bool:
        """Begin with the positions and velocities of `point`, at the state's instant; False if it cannot."""

    def advance(self, state: State, times: np.ndarray, point: np.ndarray, points: np.ndarray, modes: np.ndarray,
                phases: np.ndarray, events: np.ndarray) -> tuple[int, int, int]:
        """Advance to each of `times` and sample there: status, number of samples taken and of events recorded."""

    def interrupt(self, state: State, time: float, point: np.ndarray) -> None:
        """Move clock and forcing to `time` and fill `point` with all channels; new rates and `begin` follow."""

    def lasting(self) -> list[np.ndarray]:
        """The arrays beside the state that the future depends on."""


class Exact:
    """The event loop."""

    def __init__(self, system: System):
        self._system = system

    def begin(self, state, point):
        """See `Method`."""
        return event_loop.begin_segment(self._system, state, point)

    def advance(self, state, times, point, points, modes, phases, events):
        """See `Method`."""
        return event_loop.advance(self._system, state, times, point, points, modes, phases, events)

    def interrupt(self, state, time, point):
        """See `Method`."""
        event_loop.interrupt(self._system, state, time, point)

    def lasting(self):
        """See `Method`."""
        return []


class FixedStep:
    """Steps of `step` [s] by one of `SCHEMES`; `laws` for `MOREAU`."""

    def __init__(self, system: System, scheme: int, step: float, laws: Laws | None = None):
        self._system = system
        self._track = new_track(system, scheme, step, laws)

    def begin(self, state, point):
        """See `Method`."""
        fixed_step.begin(self._system, state, self._track, point)
        return True

    def advance(self, state, times, point, points, modes, phases, events):
        """See `Method`."""
        return fixed_step.advance(self._system, state, self._track, times, points, modes, phases, events)

    def interrupt(self, state, time, point):
        """See `Method`."""
        fixed_step.interrupt(self._system, state, self._track, time, point)

    def lasting(self):
        """See `Method`."""
        track = self._track
        return [track.start, track.end, track.rates, track.impulse, track.approach, track.wanted, track.found]
