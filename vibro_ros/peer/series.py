"""Signs of guards just after an instant, from the first power of time whose coefficient is not zero.

A start, a command or an event may leave a guard exactly at zero; the sign just after decides the mode.
"""

import math

import heyoka as hy
import numpy as np

from vibro_ros.peer.equations import Equations
from vibro_ros.peer.guide import Guide

#: Number of powers of time that are looked at.
_POWERS = 6
#: Rounding error of a sum of a few terms, relative to the largest term.
_NOISE = 64.0 * np.finfo(float).eps


class Series:
    """Taylor coefficients of a scene's guards, from an integrator without events.

    Parameters
    ----------
    equations : Equations
        The equations of the scene.
    state, parameters : ndarray, shapes (n,) and (m,)
        The integrator's own arrays of state and run-time parameters, which are read at each call.
    """

    def __init__(self, equations: Equations, state: np.ndarray, parameters: np.ndarray):
        self._equations, self._state, self._parameters = equations, state, parameters
        # The tolerance asks for 10 powers of time; the step itself is not used.
        self._probe = hy.taylor_adaptive(sys=equations.system, state=state.copy(), tol=1e-7)
        scene = equations.scene
        stiffest = max((scene[f"{g.side}.spring.stiffness"] + g.plate_stiffness) / g.mass for g in equations.guides)
        rate = max(math.sqrt(stiffest), scene["motor.speed"], 1.0)
        powers = np.arange(_POWERS + 2)
        # Rounding errors [m/s^n] of the coefficients of a position of 0.1 m.
        self._rounding = _NOISE * 0.1 * rate**powers / np.array([math.factorial(n) for n in powers])

    def _expand(self, time: float) -> np.ndarray:
        """Taylor coefficients of the state at `time` [s], shape (len(state), _POWERS + 2)."""
        probe = self._probe
        probe.state[:], probe.pars[:] = self._state, self._parameters[:len(probe.pars)]  # guards have more
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
        normal, inertial, noise = np.zeros((3, _POWERS))
        normal[0] = equations.total * equations.scene["gravity"]
        noise[0] = _NOISE * normal[0]
        share = {"upper": (1.0, 0.0), "inclined": (equations.cosine, equations.sine)}
        for i, guide in enumerate(equations.guides):
            inertia = guide.mass * _derivative(series[2 * i + 1])[:_POWERS]
            normal += share[guide.side][0] * inertia * (equations.rule != "weight")
            inertial += share[guide.side][1] * inertia
            noise += guide.mass * _derivative(_derivative(self._rounding))
        if equations.scene["effects.misprint"]:
            misread, rounding = self._misread_load(time, series)
            normal += equations.cosine * misread * (equations.rule != "weight")
            inertial += equations.sine * misread
            noise += rounding
        return normal, inertial, noise

    def _misread_load(self, time: float, series: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients of `Equations.misread_load` at `time` [s], and their rounding errors [N/s^n]."""
        stiffness = self._parameter("inclined.spring")
        positions = series[(0, 2), :_POWERS]  # of the upper and of the inclined mass
        for position, guide in zip(positions, self._equations.guides, strict=True):
            speed = self._parameter(f"{guide.side}.plate_speed")
            position[0] += self._parameter(f"{guide.side}.plate") + speed * time
            position[1] += speed
        return stiffness * (positions[1] - positions[0]), 2.0 * stiffness * self._rounding[:_POWERS]

    def _parameter(self, name: str) -> float:
        """Present value of a run-time parameter."""
        return float(self._parameters[self._equations.parameters.number[name]])


def _derivative(series: np.ndarray) -> np.ndarray:
    """Coefficients of the derivative, one fewer."""
    return series[1:] * np.arange(1, len(series))


def leading_sign(series: np.ndarray, noise: np.ndarray) -> int:
    """Sign of the first coefficient above the noise, 0 if there is none."""
    first = np.flatnonzero(np.abs(series) > noise)
    return int(np.sign(series[first[0]])) if len(first) else 0
