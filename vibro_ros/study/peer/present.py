"""What holds now: the integrator's state and run-time parameters by name, forces, and what has happened so far."""

import math

import heyoka as hy
import numpy as np

from vibro_ros.study.peer.equations import Equations, Guide

_SHORT_FLIGHT = 1e-5  # s; a step is about 1e-3 s, and finding a root at a small part of it may take heyoka too long
_TIME = hy.expression("t")


class Present:
    """The integrator's arrays, changed in place, and the list of events.

    Parameters
    ----------
    equations : Equations
    state, switches : ndarray
        The integrator's own.

    Attributes
    ----------
    events : list of (float, str, float, float)
        Instant [s], kind, speed of a contact's approach or a landing's fall [m/s], else 0, and a contact's duration [s]
        (infinite while it lasts), else 0.
    origin : float
        Instant [s] from which the integrator counts time.
    flight : float
        About how long [s] the bounce takes that has just begun, if heyoka cannot find its end in a step of the usual
        length; else 0.
    """

    def __init__(self, equations: Equations, state: np.ndarray, switches: np.ndarray):
        self.state, self.switches = state, switches
        self._number = equations.switches.number
        sides = [guide.side for guide in equations.guides]
        self._push = {side: 2 + i for i, side in enumerate(sides)}
        self._support = {side: 2 + len(sides) + i for i, side in enumerate(sides)}
        pushes = [guide.push for guide in equations.guides]
        # One array of inputs: heyoka takes longer over its arguments than over these formulas.
        wanted = [equations.normal, equations.inertial, *pushes, *map(equations.forces.get, sides), equations.rise]
        parameters = hy.make_vars(*(f"p{i}" for i in range(len(switches))))
        given = {hy.par[i]: parameter for i, parameter in enumerate(parameters)}
        self._forces = hy.cfunc([hy.subs(force, given | {hy.time: _TIME}) for force in wanted],
                                vars=[*(variable for variable, _ in equations.system), *parameters, _TIME])
        self._inputs = np.empty(len(state) + len(switches) + 1)
        self._state_input, self._switch_input = self._inputs[:len(state)], self._inputs[len(state):-1]
        self.begin()

    def begin(self) -> None:
        """Forget what has happened."""
        self.events: list[tuple[float, str, float, float]] = []
        self._lasting: dict[str, int] = {}  # number of each guide's contact that has not ended
        self.origin = self.flight = 0.0

    def set(self, name: str, value: float) -> None:
        """Set a run-time parameter, where the scene has it."""
        number = self._number.get(name)
        if number is not None:
            self.switches[number] = value

    def ground(self, time: float) -> list[float]:
        """N and F_in [N] in the present mode."""
        return self._read(time)[:2].tolist()

    def push(self, time: float, guide: Guide) -> float:
        """k d + c d' [N] of a compliant plate."""
        return float(self._read(time)[self._push[guide.side]])

    def support(self, time: float, guide: Guide) -> float:
        """Force [N] that presses a mass on its rigid plate."""
        return float(self._read(time)[self._support[guide.side]])

    def rise(self, time: float) -> float:
        """y'' [m/s^2] of a body in the air."""
        return float(self._read(time)[-1])

    def expect(self, flight: float) -> None:
        """Announce a bounce that ends after about `flight` [s], if that is short."""
        if flight < _SHORT_FLIGHT:
            self.flight = min(flight, self.flight or flight)

    def _read(self, time: float) -> np.ndarray:
        self._state_input[:], self._switch_input[:], self._inputs[-1] = self.state, self.switches, time
        return self._forces(self._inputs)

    def note(self, time: float, kind: str, speed: float = 0.0) -> None:
        """An event without duration; a landing's `speed` [m/s] is that of the fall."""
        self.events.append((self.origin + time, kind, speed, 0.0))

    def begin_contact(self, time: float, side: str, speed: float) -> None:
        """A mass has met its plate with `speed` [m/s]."""
        self._lasting[side] = len(self.events)
        self.events.append((self.origin + time, f"{side}_contact", float(speed), math.inf))

    def end_contact(self, time: float, side: str) -> None:
        """The mass has left the plate."""
        number = self._lasting.pop(side)
        began, kind, speed, _ = self.events[number]
        self.events[number] = began, kind, speed, self.origin + time - began
