"""Starts that are independent of each other, and mean speeds over them with their intervals.

A loss-free scene is not ergodic: what its body does for ever depends on how it began, and starts along one line, such
as equidistant speeds, may miss part of it. A start is therefore drawn: three stretches within the first second, each of
random length and with a random motor speed and random gaps, all from a generator of its own number.
"""

from contextlib import closing
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.stats import sem
from scipy.stats import t as student

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.preparation import provide_kernels
from vibro_ros.simulation.processes import core_count, in_processes
from vibro_ros.simulation.simulator import Simulator

#: Time [s] that a start is given before its mean speed counts, and of that, the time at other motor speeds.
SETTLING, STARTING = 4.0, 1.0
#: Relative difference below which two starts have the same motion: they still settle.
SAME = 1e-5
# Part of the variance that a cut into two groups takes away, of starts that have two motions, and starts that it takes
# to see that: a cut takes 64 % of many normal values, and so much of eight in 4 draws of 1000.
_TWO_MOTIONS, _LEAST_STARTS = 0.95, 8
# Stretches of a start; the first instant at which one may end [s]; least speed or voltage in parts of the scene's;
# largest change of a gap in parts of the crank's radius.
_STRETCHES, _FIRST_END, _SLOWEST, _GAPS = 3, 0.1, 0.5, 0.1


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
        return np.array([job.outcome() for job in jobs])


def speed_of_start(scene: Scene, duration: float, batch: int, number: int) -> float:
    """Mean speed of the body [m/s] of one start over `duration` [s]; `SETTLING` seconds do not count."""
    device = started(scene, np.random.default_rng((batch, number)))
    device.advance_to(SETTLING)
    begin = device.state.body_position
    device.advance_to(SETTLING + duration)
    return (device.state.body_position - begin) / duration


def started(scene: Scene, draw: np.random.Generator) -> Simulator:
    """A device after its start, at the motor speed or voltage of `scene`, its plates on their way to its gaps."""
    device, reach = Simulator(scene), _GAPS * scene["crank.radius"]
    name, command = motor_command(scene)
    gaps = {f"{side}_gap": scene[f"{side}.gap"] for side in scene.guides}
    for end in (*np.sort(draw.uniform(_FIRST_END, STARTING, _STRETCHES - 1)), STARTING):
        aside = {}
        for side, gap in gaps.items():
            rod = scene[f"crank.{side.removesuffix('_gap')}_rod"]
            aside[side] = min(max(gap + draw.uniform(-reach, reach), -rod), rod)
        device.command(**{name: command * draw.uniform(_SLOWEST, 1.0)}, **aside)
        device.advance_to(end)
    device.command(**{name: command}, **gaps)
    return device


def started_at_share(scene: Scene, share: float, command: float) -> Simulator:
    """A device at the motor speed [rad/s] or voltage [V] of `command`, after a first second at (1 + `share`) / 2 of it.
    """
    device = Simulator(scene)
    device.command(**{scene.motor_command: command * (1.0 + share) / 2.0})
    device.advance_to(STARTING)
    device.command(**{scene.motor_command: command})
    return device


def motor_command(scene: Scene) -> tuple[str, float]:
    """What commands the motor of `scene`, and its value there: a speed [rad/s], or a voltage [V]."""
    return scene.motor_command, scene[scene.motor_command.replace("_", ".")]
