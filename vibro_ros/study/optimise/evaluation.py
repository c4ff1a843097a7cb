"""The values of candidates: every candidate from the same starts, shared among processes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import cast

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.preparation import provide_kernels
from vibro_ros.simulation.processes import in_processes
from vibro_ros.study.measures import measure
from vibro_ros.study.optimise.objective import MEASURED

#: First of the starts that choose among the best candidates, and of those that verify: no search has seen them.
CHOOSING, VERIFYING = 10_000, 20_000


@dataclass(frozen=True)
class Trials:
    """The runs of a robot.

    Attributes
    ----------
    starts : int
        Number of drawn starts.
    settling, duration : float
        Time of a run that does not count, and time that does [s].
    first : int
        Number of the first start; those of a search begin at 0.
    """

    starts: int = 4
    settling: float = 2.0
    duration: float = 4.0
    first: int = 0


def values_of(scene: Scene | None, trials: Trials) -> np.ndarray:
    """Measures of a robot from each start, shape (starts, measures), columns `MEASURED`.

    NaN if a run cannot go on, and for a robot that cannot be built (None).
    """
    nothing = np.full((trials.starts, len(MEASURED)), np.nan)
    if scene is None:
        return nothing
    try:
        rows = [measure(scene, MEASURED, trials.settling, trials.duration, trials.first + number)
                for number in range(trials.starts)]
    except SimulationError:
        return nothing
    return np.array([[row[name] for name in MEASURED] for row in rows])


def values_of_many(scenes: Sequence[Scene | None], trials: Trials, workers: int) -> Iterator[np.ndarray]:
    """Yield `values_of` of each of `scenes`, in their order, from so many processes."""
    for method in {scene["solver.method"] for scene in scenes if scene is not None}:
        provide_kernels(method)  # once for all that are forked
    jobs = in_processes(partial(values_of, trials=trials), scenes, min(workers, max(len(scenes), 1)))
    try:
        for job in jobs:
            yield cast(np.ndarray, job.outcome())
    finally:
        jobs.close()
