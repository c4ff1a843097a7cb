"""Signs just after an instant, from the first power of time that does not vanish: for starts, commands and ties."""

import math

import heyoka as hy
import numpy as np

from vibro_ros.study.peer.equations import Equations, Guide

_POWERS = 6
#: Rounding errors of a sum of a few terms, relative to the largest.
_NOISE = 64.0 * np.finfo(float).eps


class Series:
    """Taylor coefficients of a scene's guards, from an integrator without events.

    Parameters
    ----------
    equations : Equations
    state, switches : ndarray
        State and run-time parameters, read anew at each question.
    """

    def __init__(self, equations: Equations, state: np.ndarray, switches: np.ndarray):
        self._equations, self._state, self._switches = equations, state, switches
        # The tolerance asks for 10 powers of time; the step itself is not used.
        self._probe = hy.taylor_adaptive(sys=equations.system, state=state.copy(), tol=1e-7)
        scene = equations.scene
        stiffest = max((scene[f"{g.side}.spring.stiffness"] + g.plate_stiffness) / g.mass for g in equations.guides)
        rate = max(math.sqrt(stiffest), scene["motor.speed"], 1.0)
        powers = np.arange(_POWERS + 2)
        #: what rounding leaves of the coefficients of a position of 0.1 m [m/s^n]
        self._floor = _NOISE * 0.1 * rate**powers / np.array([math.factorial(n) for n in powers])

    def _expand(self, time: float) -> np.ndarray:
        probe = self._probe
        probe.state[:], probe.pars[:] = self._state, self._switches[:len(probe.pars)]  # guards have more
        probe.time = time
        probe.step(max_delta_t=1e-12, write_tc=True)
        return probe.tc[:, :_POWERS + 2]

    def depth(self, time: float, guide: Guide) -> int:
        """Sign of d just after now: -1, 0 or 1."""
        series = self._expand(time)[2 * self._equations.guides.index(guide)]
        return leading(series, np.append(0.0, self._floor[1:]))

    def push(self, time: float, guide: Guide) -> int:
        """Sign of k d + c d' just after now."""
        series = self._expand(time)[2 * self._equations.guides.index(guide)]
        factor = guide.plate_stiffness, guide.plate_damping
        push = factor[0] * series[:-1] + factor[1] * _derivative(series)
        return leading(push, factor[0] * self._floor[:-1] + factor[1] * _derivative(self._floor))

    def ground(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients of N and F_in [N/s^n], and their rounding errors."""
        series, equations = self._expand(time), self._equations
        normal, inertial, noise = np.zeros((3, _POWERS))
        normal[0] = equations.total * equations.scene["gravity"]
        noise[0] = _NOISE * normal[0]
        share = {"upper": (1.0, 0.0), "inclined": (equations.cosine, equations.sine)}
        for i, guide in enumerate(equations.guides):
            inertia = guide.mass * _derivative(series[2 * i + 1])[:_POWERS]
            normal += share[guide.side][0] * inertia * (equations.rule != "weight")
            inertial += share[guide.side][1] * inertia
            noise += guide.mass * _derivative(_derivative(self._floor))
        return normal, inertial, noise


def _derivative(series: np.ndarray) -> np.ndarray:
    return series[1:] * np.arange(1, len(series))


def leading(series: np.ndarray, noise: np.ndarray) -> int:
    """Sign of the first coefficient above the noise, 0 if there is none."""
    first = np.flatnonzero(np.abs(series) > noise)
    return int(np.sign(series[first[0]])) if len(first) else 0
