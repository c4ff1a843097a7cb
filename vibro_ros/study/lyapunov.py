"""The largest Lyapunov exponent over a measuring time: how fast two runs part that began close to each other.

The second run takes over the first one's state, turns for a moment by 1e-10 slower, and is watched until the masses are
`_SATURATED` apart; then it takes over the first one's state again. The exponent is the growth of the logarithm of all
these stretches by their time. The moment shifts the crank's angle, and so the distance of two runs that stay together
does not fall to zero.
"""

import math
from collections.abc import Iterator

import numpy as np

from vibro_ros.simulation.simulator import Simulator
from vibro_ros.study.window import Window

_APART = 1e-10  # relative difference of the motor speeds in the moment
# The distance counts by its maximum in a stretch of so many turns, or, where the motor stands, seconds.
_TURNS, _STANDING, _SAMPLES = 2.0, 0.1, 64
_SATURATED = 1e-4  # m, where the distance begins to feel the size of the motion
_ROUNDING = 1e-13  # m, below which a distance says nothing
_GROWN = 1e3  # times: what a distance grows by linearly, while phases drift apart, is less


def lyapunov_exponent(device: Simulator, measured: Window) -> float:
    """Exponent [1/s] of the motion of a device's masses over a measuring time, from its first instant on.

    Returns
    -------
    float
        [1/s]; 0 if no two runs have parted; NaN for a time of less than three stretches.

    Raises
    ------
    SimulationError
        If a run cannot go on.
    """
    stretch = _TURNS * measured.turn if measured.turns else _STANDING
    count = math.floor(measured.duration / stretch)
    if count < 3:
        return math.nan
    device.advance_to(measured.begin)
    twin, ends = Simulator(device.scene), iter([measured.begin + stretch * k for k in range(1, count + 1)])
    growth, watched, parted = 0.0, 0, False
    for begun in ends:
        distances = _distances(device, twin, begun, ends)
        if len(distances) > 1:
            growth, watched = growth + math.log(distances[-1] / distances[0]), watched + len(distances) - 1
            parted = parted or distances[-1] > _GROWN * distances[0]
    return growth / (watched * stretch) if parted else 0.0


def _distances(device: Simulator, twin: Simulator, begun: float, ends: Iterator[float]) -> list[float]:
    """Distances [m] of a pair that has parted a little by the instant `begun`, up to each of `ends`, until it is far
    apart; what it takes of `ends` is gone."""
    speed = device.scene["motor.speed"]
    twin.restore(device.checkpoint())
    twin.command(motor_speed=(1.0 - _APART) * speed)
    for one in (device, twin):
        one.advance_to(begun)
    twin.command(motor_speed=speed)
    distances: list[float] = []
    for end in ends:
        times = np.linspace(device.time, end, _SAMPLES)
        distances.append(max(_ROUNDING, float(np.abs(_masses(device, times) - _masses(twin, times)).max())))
        if distances[-1] > _SATURATED:
            break
    for one in (device, twin):
        one.take_events()  # or they would be kept
    return distances


def _masses(device: Simulator, times: np.ndarray) -> np.ndarray:
    """Positions of both masses [m] at `times`, shape (2, n)."""
    samples = device.sample(times)
    return np.stack([samples.upper_position, samples.inclined_position])
