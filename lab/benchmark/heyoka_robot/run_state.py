"""The state of a run: the integrator's arrays, run-time parameters by name, the forces, the events so far;
and the signs of guards just after an instant.
"""

import math

import heyoka as hy
import numpy as np

from benchmark.heyoka_robot.equations import Equations, Guide

_SHORT_FLIGHT = 1e-5  # s; heyoka may take too long to find a root in a small part of a step, which lasts about 1e-3 s
_TIME = hy.expression("t")
#: Number of powers of time that are looked at.
_POWERS = 6
#: Rounding error of a sum of a few terms, relative to the largest term.
_NOISE = 64.0 * np.finfo(float).eps


class IntegrationState:
    """The integrator's own arrays `state` and `parameters`, which are changed in place, and the list of events.

    Attributes
    ----------
    events : list of (float, str, float, float)
        Instant [s], kind, speed of a contact's approach or a landing's fall [m/s], else 0, and a contact's duration [s]
        (infinite while it lasts), else 0.
    time_origin : float
        Instant [s] from which the integrator counts time.
    short_flight : float
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
        self._rise_index = len(wanted) - 1
        if equations.has_rotor:
            wanted += [equations.torque, equations.wanted_voltage, *equations.coupling]
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
        return float(self._read(time)[self._rise_index])

    def motor_torque(self, time: float) -> float:
        """K i + T of a dc motor [N m] at `time` [s]."""
        return float(self._read(time)[self._rise_index + 1])

    def wanted_voltage(self, time: float) -> float:
        """What a dc motor's current loop would apply without limits [V] at `time` [s]."""
        return float(self._read(time)[self._rise_index + 2])

    def coupling(self, time: float) -> tuple[float, float, float]:
        """`Equations.coupling` of a dc motor at `time` [s]; zero of another."""
        coupling = self._read(time)[self._rise_index + 3:].tolist()
        return tuple(coupling) if coupling else (0.0, 0.0, 0.0)

    def announce_flight(self, flight: float) -> None:
        """Store that a bounce ends after about `flight` [s], if heyoka needs short steps to find that end."""
        if flight < _SHORT_FLIGHT:
            self.short_flight = min(flight, self.short_flight or flight)

    def _read(self, time: float) -> np.ndarray:
        """N, F_in, the plates' forces, the forces on resting masses, y'', and a dc motor's numbers at `time` [s]."""
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


class GuardSeries:
    """Taylor coefficients of a scene's guards, from an integrator without events.

    A start, a command or an event may leave a guard exactly at zero; the sign just after decides the mode.

    The integrator's own arrays `state` and `parameters` are read at each call.
    """

    def __init__(self, equations: Equations, state: np.ndarray, parameters: np.ndarray):
        self._equations, self._state, self._parameters = equations, state, parameters
        # Two more variables have N and F_in as rates. The tolerance asks for 10 powers of time; the step is not used.
        rates = list(zip(hy.make_vars("impulse", "momentum"), (equations.normal, equations.inertial), strict=True))
        self._probe = hy.taylor_adaptive(sys=equations.system + rates, state=np.append(state, [0.0, 0.0]), tol=1e-7)
        scene = equations.scene
        stiffest = max(((scene[f"{g.side}.spring.stiffness"] + g.plate_stiffness) / g.mass for g in equations.guides),
                       default=0.0)
        rate = max(math.sqrt(stiffest), scene["motor.speed"], 1.0)
        powers = np.arange(_POWERS + 2)
        # Rounding errors [m/s^n] of the coefficients of a position of 0.1 m.
        self._rounding = _NOISE * 0.1 * rate**powers / np.array([math.factorial(n) for n in powers])

    def _expand(self, time: float) -> np.ndarray:
        """Taylor coefficients of the state and of the integrals of N and F_in at `time` [s], shape (len(state) + 2,
        _POWERS + 2)."""
        probe = self._probe
        probe.state[:-2], probe.state[-2:] = self._state, 0.0
        probe.pars[:] = self._parameters[:len(probe.pars)]  # guards have more
        probe.time = time
        probe.step(max_delta_t=1e-12, write_tc=True)
        return probe.tc[:, :_POWERS + 2]

    def depth_sign(self, time: float, guide: Guide) -> int:
        """Sign of d just after `time` [s]: -1, 0 or 1."""
        series = self._expand(time)[2 * self._equations.guides.index(guide)]
        return leading_sign(series, np.append(0.0, self._rounding[1:]))

    def plate_force_sign(self, time: float, guide: Guide) -> int:
        """Sign of k d + c d' just after `time` [s]: -1, 0 or 1."""
        series = self._expand(time)[2 * self._equations.guides.index(guide)]
        factor = guide.plate_stiffness, guide.plate_damping
        push = factor[0] * series[:-1] + factor[1] * _derivative(series)
        return leading_sign(push, factor[0] * self._rounding[:-1] + factor[1] * _derivative(self._rounding))

    def ground_force_series(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients of N and F_in at `time` [s], and their rounding errors [N/s^n], each shape (_POWERS,)."""
        series, equations = self._expand(time), self._equations
        noise = np.zeros(_POWERS)
        noise[0] = _NOISE * (equations.total * equations.down + abs(equations.pull))
        noise += equations.viscous * self._rounding[1:_POWERS + 1]
        inertia = sum(guide.mass for guide in equations.guides) + sum(part.mass for part in equations.linkage)
        noise += inertia * _derivative(_derivative(self._rounding))
        if equations.scene["effects.misprint"]:
            stiffness = float(self._parameters[equations.parameters.number["inclined.spring"]])
            noise += 2.0 * stiffness * self._rounding[:_POWERS]
        normal, inertial = (_derivative(integral)[:_POWERS] for integral in series[-2:])
        return normal, inertial, noise


def _derivative(series: np.ndarray) -> np.ndarray:
    """Coefficients of the derivative, one fewer."""
    return series[1:] * np.arange(1, len(series))


def leading_sign(series: np.ndarray, noise: np.ndarray) -> int:
    """Sign of the first coefficient above the noise, 0 if there is none."""
    first = np.flatnonzero(np.abs(series) > noise)
    return int(np.sign(series[first[0]])) if len(first) else 0
