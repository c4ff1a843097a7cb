"""The state of a run: the integrator's arrays, run-time parameters by name, the forces, and the events so far."""

import math

import heyoka as hy
import numpy as np

from vibro_ros.peer.equations import Equations
from vibro_ros.peer.guide import Guide

_SHORT_FLIGHT = 1e-5  # s; heyoka may take too long to find a root in a small part of a step, which lasts about 1e-3 s
_TIME = hy.expression("t")


class RunState:
    """The integrator's arrays, which are changed in place, and the list of events.

    Parameters
    ----------
    equations : Equations
        The equations of the scene.
    state, parameters : ndarray, shapes (n,) and (m,)
        The integrator's own arrays of state and run-time parameters.

    Attributes
    ----------
    events : list of (float, str, float, float)
        Instant [s], kind, speed of a contact's approach or a landing's fall [m/s], else 0, and a contact's duration [s]
        (infinite while it lasts), else 0.
    time_origin : float
        Instant [s] from which the integrator counts time.
    flight : float
        Approximate duration [s] of the bounce that has just begun, if heyoka cannot find the bounce's end in a step of
        the usual length; else 0.
    """

    def __init__(self, equations: Equations, state: np.ndarray, parameters: np.ndarray):
        self.state, self.parameters = state, parameters
        self._number = equations.parameters.number
        sides = [guide.side for guide in equations.guides]
        self._plate_force_index = {side: 2 + i for i, side in enumerate(sides)}
        self._pressing_force_index = {side: 2 + len(sides) + i for i, side in enumerate(sides)}
        pushes = [guide.push for guide in equations.guides]
        # All inputs stand in one array, because heyoka spends more time on its arguments than on these formulas.
        wanted = [equations.normal, equations.inertial, *pushes, *map(equations.forces.get, sides), equations.rise]
        symbols = hy.make_vars(*(f"p{i}" for i in range(len(parameters))))
        given = {hy.par[i]: symbol for i, symbol in enumerate(symbols)}
        self._forces = hy.cfunc([hy.subs(force, given | {hy.time: _TIME}) for force in wanted],
                                vars=[*(variable for variable, _ in equations.system), *symbols, _TIME])
        self._inputs = np.empty(len(state) + len(parameters) + 1)
        self._state_input, self._parameter_input = self._inputs[:len(state)], self._inputs[len(state):-1]
        self.reset()

    def reset(self) -> None:
        """Delete all events and begin to count time at 0."""
        self.events: list[tuple[float, str, float, float]] = []
        self._lasting: dict[str, int] = {}  # index in `events` of each guide's contact that has not ended
        self.time_origin = self.short_flight = 0.0

    def set_parameter(self, name: str, value: float) -> None:
        """Set a run-time parameter; do nothing if the scene's equations do not have the parameter."""
        number = self._number.get(name)
        if number is not None:
            self.parameters[number] = value

    def ground_forces(self, time: float) -> list[float]:
        """N and F_in [N] at `time` [s] in the present mode."""
        return self._read(time)[:2].tolist()

    def plate_force(self, time: float, guide: Guide) -> float:
        """Force of a compliant plate, k d + c d' [N], at `time` [s]."""
        return float(self._read(time)[self._plate_force_index[guide.side]])

    def pressing_force(self, time: float, guide: Guide) -> float:
        """Force [N] that presses a mass on its rigid plate at `time` [s]."""
        return float(self._read(time)[self._pressing_force_index[guide.side]])

    def upward_acceleration(self, time: float) -> float:
        """y'' [m/s²] of a body in the air at `time` [s]."""
        return float(self._read(time)[-1])

    def announce_flight(self, flight: float) -> None:
        """Store that a bounce ends after about `flight` [s], if heyoka needs short steps to find that end."""
        if flight < _SHORT_FLIGHT:
            self.short_flight = min(flight, self.short_flight or flight)

    def _read(self, time: float) -> np.ndarray:
        """N, F_in, the plates' forces, the forces on resting masses and y'' at `time` [s]."""
        self._state_input[:], self._parameter_input[:], self._inputs[-1] = self.state, self.parameters, time
        return self._forces(self._inputs)

    def add_event(self, time: float, kind: str, speed: float = 0.0) -> None:
        """Add an event without duration; the `speed` [m/s] of a landing is that of the fall."""
        self.events.append((self.time_origin + time, kind, speed, 0.0))

    def begin_contact(self, time: float, side: str, speed: float) -> None:
        """Add the contact of a mass that meets its plate with `speed` [m/s]."""
        self._lasting[side] = len(self.events)
        self.events.append((self.time_origin + time, f"{side}_contact", float(speed), math.inf))

    def end_contact(self, time: float, side: str) -> None:
        """Give the contact of a mass that leaves its plate its duration."""
        number = self._lasting.pop(side)
        began, kind, speed, _ = self.events[number]
        self.events[number] = began, kind, speed, self.time_origin + time - began
