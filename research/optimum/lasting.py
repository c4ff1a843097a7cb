"""Whether speed and power of a robot are those of the long run: the same starts, watched for longer and longer.

By the paper's equations the body's acceleration does not act on the masses (`effects.reaction` false). Then nothing
that friction takes from the body is taken from the masses, and without dampers the masses lose nothing at all: the work
of the motor is only what their stored energy has changed by, which is bounded. Its mean over time tends to 0 while the
body goes on, so that V/P has no bound. That is a fault of the equations, not a merit of a robot.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibro_ros.accuracy.starts import Average, average
from vibro_ros.model.scene import Scene
from vibro_ros.study.optimise.plan import VERIFYING, Trials, values_of
from vibro_ros.study.progress import Progress

#: Times [s] over which means are taken.
DURATIONS = (4.0, 16.0, 64.0, 256.0)


@dataclass(frozen=True)
class Lasting:
    """Means over one duration.

    Attributes
    ----------
    duration : float
        Time of a run that counts [s].
    speed : Average
        Mean speed of the body [m/s], forward positive.
    power : float
        Largest magnitude of the mean power of a start [W].
    delivered : Average
        Mean delivered power [W].
    ratio : float
        Magnitude of the mean speed over `power` [m/J]: V/P is at least so large for every start's power.
    """

    duration: float
    speed: Average
    power: float
    delivered: Average
    ratio: float


def lasting(scene: Scene, trials: Trials, durations: Sequence[float], progress: Progress) -> list[Lasting]:
    """Means of a scene over each of `durations` [s], from the same starts; `trials` gives their number and settling."""
    rows = []
    for duration in durations:
        long = replace(trials, duration=duration, first=VERIFYING)
        rows.append(_lasting(duration, values_of(scene, long)))
        progress.add(1)
    return rows


def _lasting(duration: float, values: np.ndarray) -> Lasting:
    power = float(np.abs(values[:, 1]).max())
    return Lasting(duration, average(values[:, 0]), power, average(values[:, 2]),
                   float(abs(values[:, 0].mean()) / power))
