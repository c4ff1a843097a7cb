"""For how long trajectories can be compared: the Lyapunov time.

Of two exact runs that start a 1e-10th apart, the distance grows as exp(t / Lyapunov time) in a chaotic scene. The
start differs in the motor's speed during the first second alone, hence only in state afterwards. A pair is not scaled
back when it has parted: others are begun from other starts, because the loss-free masses are not ergodic and the
exponent differs from start to start more than along one of them. Until a pair feels the size of the motion, it grows at
the same rate from 1e-9 to 1e-13 apart.
"""

import math
from dataclasses import dataclass

import numpy as np

from vibro_ros.accuracy.methods import drive_speed
from vibro_ros.accuracy.starts import STARTING, average, from_start
from vibro_ros.model.scene import Scene

#: Longest horizon [s] of a comparison by every method, and how many Lyapunov times it may have: an error of the first
#: instant has grown e^5 = 150 times by then.
LONGEST_HORIZON, LYAPUNOV_TIMES = 1.0, 5.0
_APART = 1e-10  # relative difference of the motor speeds in the first second
_WINDOW, _PER_WINDOW = 0.1, 50  # s; the distance counts by its maximum in a window, longer than a turn of the crank
_SATURATED = 1e-4  # m, where the distance begins to feel the size of the motion
_GROWN = 1e3  # times: what a distance grows by linearly, while phases drift apart, is less


@dataclass(frozen=True)
class Growth:
    """How fast nearby motions part.

    Attributes
    ----------
    rate, spread : float
        Largest Lyapunov exponent [1/s] and its 95 % confidence interval's half width, over starts.
    chaotic : bool
        Whether most pairs have parted and the exponent is positive beyond its interval.
    duration : float
        Time that each pair was watched for at most [s].
    """

    rate: float
    spread: float
    chaotic: bool
    duration: float

    @property
    def lyapunov_time(self) -> float:
        """[s]; infinite if no growth was seen."""
        return 1.0 / self.rate if self.chaotic else math.inf

    @property
    def comparable(self) -> float:
        """Time [s] within which trajectories can be compared; as far as was watched where there is no chaos."""
        return min(self.duration, LYAPUNOV_TIMES * self.lyapunov_time)

    @property
    def horizon(self) -> float:
        """Time [s] within which they are."""
        return min(LONGEST_HORIZON, self.comparable)

    def __str__(self):
        if self.chaotic:
            return (f"Lyapunov time {self.lyapunov_time:.2g} s (exponent {self.rate:.2g} ± {self.spread:.1g} 1/s): "
                    f"chaotic")
        return f"no chaos seen: motions that start close stay close for {self.duration:g} s"


def cruising_speed(scene: Scene) -> float:
    """Motor speed [rad/s] at which a scene is studied."""
    return drive_speed(scene) or scene["motor.speed"]


def growth(scene: Scene, duration: float = 15.0, starts: int = 24) -> Growth:
    """Estimate the largest Lyapunov exponent of the masses' motion from pairs of exact runs."""
    scene = scene.with_parameters({"solver.method": "exact", "solver.audit": False})
    pairs = [_growth_of_pair(scene, duration, k / starts) for k in range(starts)]
    rate = average(np.array([rate for rate, _ in pairs]))
    parted = sum(parted for _, parted in pairs)
    return Growth(rate.mean, rate.spread, 2 * parted > starts and rate.mean > rate.spread, duration)


def _growth_of_pair(scene: Scene, duration: float, share: float) -> tuple[float, bool]:
    """Exponent [1/s] that fits the distance of a pair best, and whether the pair has parted."""
    apart = np.abs(_masses(scene, duration, share, 0.0) - _masses(scene, duration, share, _APART)).max(axis=0)
    apart = np.maximum(apart.reshape(-1, _PER_WINDOW).max(axis=1), np.finfo(float).tiny)
    parted = bool(apart.max() > _GROWN * apart[0])
    until = int(np.argmax(apart > _SATURATED)) if (apart > _SATURATED).any() else len(apart)
    if until < 2:
        return 0.0, False
    times = _WINDOW * np.arange(until)
    return float(np.polyfit(times, np.log(apart[:until]), 1)[0]), parted


def _masses(scene: Scene, duration: float, share: float, change: float) -> np.ndarray:
    """Positions of both masses, shape (2, n), of one start."""
    windows = round(duration / _WINDOW)
    times = STARTING + _WINDOW / _PER_WINDOW * np.arange(1, windows * _PER_WINDOW + 1)
    run = from_start(scene, (1.0 + share) * (1.0 - change) - 1.0, cruising_speed(scene), times)
    return np.stack([run.upper_position, run.inclined_position])
