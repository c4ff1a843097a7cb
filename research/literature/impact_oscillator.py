"""The impact oscillator of Budd and Dux: x'' + x = cos ωt below a rigid stop at σ, from which x' rebounds as -r x'.

A mass on its guide is this oscillator: lengths in units of the crank radius, times of sqrt(m/k). Its (1, n) orbits, one
impact in n turns, have closed forms, and so have their folds and period doublings.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from research.literature.guard import Guard
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.simulator import Simulator

_MASS, _STIFFNESS, _RADIUS, _ROD = 0.1, 1e3, 1e-5, 100.0
_RATE = math.sqrt(_STIFFNESS / _MASS)
# Turns until a motion counts as settled, turns that are then looked at, relative difference of equal impacts, and the
# speed of the plate in units of the crank radius a turn.
_SETTLING, _SEEN, _EQUAL, _PLATE = 1500, 60, 1e-6, 0.002
_SAMPLES = 400


@dataclass(frozen=True)
class Oscillator:
    """An impact oscillator.

    Attributes
    ----------
    omega : float
        Frequency of the force over the oscillator's own, dimensionless.
    sigma : float
        Place of the stop in units of the force over the stiffness, dimensionless.
    restitution : float
        Speed after an impact over the speed before it, dimensionless.
    """

    omega: float
    sigma: float
    restitution: float

    @property
    def reach(self) -> float:
        """Amplitude of the motion without a stop, dimensionless."""
        return 1.0 / abs(1.0 - self.omega**2)

    def shape(self, turns: int) -> tuple[float, float]:
        """a and b of the ellipse (σ + a V)² + (b V)² = reach² of the speeds V of impact of the (1, `turns`) orbits."""
        half = math.pi * turns / self.omega
        return (1.0 + self.restitution) / (2.0 * math.tan(half)), (1.0 - self.restitution) / (2.0 * self.omega)

    def speeds(self, turns: int) -> tuple[float, float]:
        """Speeds of impact on the upper and the lower branch, dimensionless; NaN where there is none."""
        a, b = self.shape(turns)
        square = a**2 + b**2
        root = (a * self.sigma) ** 2 - square * (self.sigma**2 - self.reach**2)
        if root < 0.0:
            return math.nan, math.nan
        upper, lower = ((-a * self.sigma + sign * math.sqrt(root)) / square for sign in (1.0, -1.0))
        return (upper if upper > 0.0 else math.nan), (lower if lower > 0.0 else math.nan)

    def fold(self, turns: int) -> float:
        """Place of the stop at which both branches meet, dimensionless."""
        a, b = self.shape(turns)
        return -math.copysign(self.reach * math.hypot(a, b) / b, a)

    def multipliers(self, turns: int, speed: float) -> np.ndarray:
        """Multipliers of the (1, `turns`) orbit with the `speed` of impact, shape (2,), complex."""
        a, _ = self.shape(turns)
        own = self.restitution
        sine, cosine = math.sin(2.0 * math.pi * turns / self.omega), math.cos(2.0 * math.pi * turns / self.omega)
        push = (1.0 - self.omega**2) * (self.sigma + a * speed) - self.sigma  # acceleration at the impact
        impact = np.array([[-own, 0.0], [(1.0 + own) * push / speed, -own]])
        return np.linalg.eigvals(np.array([[cosine, sine], [-sine, cosine]]) @ impact)

    def doubling_defect(self, turns: int) -> float:
        """1 + trace + determinant of the upper branch's orbit: 0 where a multiplier is -1."""
        product = self.multipliers(turns, self.speeds(turns)[0])
        return float(np.real(1.0 + product.sum() + product.prod()))


def oscillator_scene(oscillator: Oscillator) -> Scene:
    """The scene that is the oscillator: the upper mass alone, its plate rigid, no damper."""
    return Scene("impact_oscillator", {
        "mass.upper": _MASS, "upper.spring.stiffness": _STIFFNESS, "upper.plate.restitution": oscillator.restitution,
        "upper.gap": oscillator.sigma * _RADIUS, "crank.radius": _RADIUS, "crank.upper_rod": _ROD,
        "crank.inclined_rod": _ROD, "motor.speed": oscillator.omega * _RATE, "motor.max_speed": 1e4,
        "gap_actuator.speed": _PLATE * _RADIUS * oscillator.omega * _RATE / (2.0 * math.pi),
        "effects.inclined_mass": False, "effects.upper_contact": "restitution", "effects.normal_force": "weight"})


@dataclass(frozen=True)
class Motion:
    """A settled motion: impacts and turns that it takes to repeat itself, 0 for none found, and speeds of impact."""

    impacts: int
    turns: int
    speeds: tuple[float, ...]


def started(oscillator: Oscillator, spin: float) -> Simulator:
    """A device whose motor ran at `spin` times its speed for the first 20 turns."""
    device, speed = Simulator(oscillator_scene(oscillator)), oscillator.omega * _RATE
    device.command(motor_speed=spin * speed)
    device.advance_to(20.0 * 2.0 * math.pi / speed)
    device.command(motor_speed=speed)
    return device


def settled(device: Simulator, oscillator: Oscillator, turns: int = _SETTLING) -> Motion:
    """The motion of a device once it has settled for so many turns."""
    turn = 2.0 * math.pi / (oscillator.omega * _RATE)
    device.advance_to(device.time + turns * turn)
    device.take_events()
    begin = device.time
    device.advance_to(begin + _SEEN * turn)
    events = device.take_events()
    blows = events["speed"][events["kind"] == "upper_contact"] / (_RADIUS * _RATE)
    for count in range(1, len(blows) // 3 + 1):
        if np.allclose(blows[count:], blows[:-count], rtol=_EQUAL, atol=0.0):
            took = round(_SEEN * count / len(blows))
            return Motion(count, took, tuple(float(speed) for speed in blows[:count]))
    return Motion(0, 0, tuple(float(speed) for speed in blows))


def followed(oscillator: Oscillator, start: float) -> Motion:
    """The motion that is reached when the stop is moved slowly from `start` to its place."""
    device = started(replace(oscillator, sigma=start), 1.0)
    settled(device, oscillator)
    device.command(upper_gap=oscillator.sigma * _RADIUS)
    return settled(device, oscillator, _SETTLING + math.ceil(abs(oscillator.sigma - start) / _PLATE))


def doubling(oscillator: Oscillator, turns: int, low: float, high: float) -> float:
    """Place of the stop between `low` and `high` at which the upper branch's orbit doubles its period."""
    return brentq(lambda sigma: replace(oscillator, sigma=sigma).doubling_defect(turns), low, high)


def difference(oscillator: Oscillator, turns: int) -> float:
    """Largest difference of the position from scipy's, in crank radii, within so many turns from rest at x = 1.

    `oscillator` has its stop beyond 1, where the mass stands on its slider at first.
    """
    times = np.linspace(0.0, turns * 2.0 * math.pi / oscillator.omega, _SAMPLES + 1)
    own = (Simulator(oscillator_scene(oscillator)).sample(times / _RATE).upper_position - _ROD) / _RADIUS
    return float(np.max(np.abs(own - _by_scipy(oscillator, times))))


def _by_scipy(oscillator: Oscillator, times: np.ndarray) -> np.ndarray:
    def right(time: float, state: np.ndarray) -> list[float]:
        return [state[1], math.cos(oscillator.omega * time) - state[0]]

    stop = Guard(lambda _time, state: state[0] - oscillator.sigma, 1.0)
    found, done, time, state = np.empty(len(times)), 0, 0.0, np.array([1.0, 0.0])
    while done < len(times):
        piece = solve_ivp(right, (time, times[-1]), state, method="DOP853", rtol=1e-12, atol=1e-13, max_step=0.1,
                          events=stop, dense_output=True)
        upto = len(times) if piece.status == 0 else int(np.searchsorted(times, piece.t[-1]))
        if upto > done:
            found[done:upto] = piece.sol(times[done:upto])[0]
        done, time = upto, piece.t[-1]
        state = np.array([oscillator.sigma, -oscillator.restitution * piece.y[1, -1]])
    return found
