"""Mean speeds over drawn starts, `vibro_ros.orbits.starts`, with their intervals."""

from contextlib import closing
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.stats import sem
from scipy.stats import t as student

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.starts import SETTLING, drawn_start
from vibro_ros.simulation.preparation import provide_kernels
from vibro_ros.simulation.processes import core_count, in_processes

#: Relative difference below which two starts have the same motion: they still settle.
SAME = 1e-5
# Part of the variance that a cut into two groups takes away, of starts that have two motions, and starts that it takes
# to see that: a cut takes 64 % of many normal values, and so much of eight in 4 draws of 1000.
_TWO_MOTIONS, _LEAST_STARTS = 0.95, 8


@dataclass(frozen=True)
class Average:
    """A mean over starts, half the width of its 95 % confidence interval, and how many of the starts are positive."""

    mean: float
    spread: float
    positive: int

    @property
    def is_one_motion(self) -> bool:
        """Whether all starts agree to `SAME`: one motion repeated, of which an interval would describe the draw."""
        return self.spread <= SAME * abs(self.mean)


def average(values: np.ndarray) -> Average:
    """Mean of independent values, and its interval by Student's distribution."""
    spread = student.ppf(0.975, len(values) - 1) * sem(values)  # ttest_1samp warns where all values are equal
    return Average(float(np.mean(values)), float(spread), int(np.sum(values > 0.0)))


def motions_of(values: np.ndarray) -> list[np.ndarray]:
    """Values of starts, shape (starts,), in groups that lie far apart, each of another motion; the largest first.

    One interval over starts with several motions would describe how often the draw meets each of them.
    """
    groups, left = [], [np.sort(values)]
    while left:
        group = left.pop()
        whole = float(np.sum((group - group.mean()) ** 2))
        if len(group) >= _LEAST_STARTS and np.ptp(group) > SAME * np.abs(group).max():
            within, place = min((sum(float(np.sum((part - part.mean()) ** 2)) for part in np.split(group, [cut])), cut)
                                for cut in range(1, len(group)))
            if within <= (1.0 - _TWO_MOTIONS) * whole:
                left += np.split(group, [place])
                continue
        groups.append(group)
    return sorted(groups, key=len, reverse=True)


def speeds_of_starts(scene: Scene, duration: float, starts: int, batch: int = 0) -> np.ndarray:
    """Mean speed of the body [m/s] of each start, shape (starts,), shared among all cores; another `batch`, others.

    Raises
    ------
    SimulationError
        If a run cannot go on.
    """
    provide_kernels(scene["solver.method"])  # once for all that are forked
    found = in_processes(partial(speed_of_start, scene, duration, batch), range(starts), core_count())
    with closing(found) as jobs:  # else a raised error would keep the workers until it is collected
        return np.array([future.result() for _, future in jobs])


def speed_of_start(scene: Scene, duration: float, batch: int, number: int) -> float:
    """Mean speed of the body [m/s] of one start over `duration` [s]; `SETTLING` seconds do not count."""
    device = drawn_start(scene, number, batch)
    device.advance_to(SETTLING)
    begin = device.state.body_position
    device.advance_to(SETTLING + duration)
    return (device.state.body_position - begin) / duration
