"""Many jobs on all cores, and how far they are."""

from collections.abc import Callable, Sequence
from typing import TypeVar, cast

from vibro_ros.simulation.preparation import provide_kernels
from vibro_ros.simulation.processes import core_count, in_processes
from vibro_ros.study.progress import Progress

Item = TypeVar("Item")
Result = TypeVar("Result")


def computed(function: Callable[[Item], Result], items: Sequence[Item], what: str) -> list[Result]:
    """Results of `function` for `items`, in their order; `what` names them on stderr.

    Raises
    ------
    Exception
        The first error of `function`; no process is left behind.
    """
    provide_kernels("exact")  # once for all that are forked
    jobs = in_processes(function, items, min(core_count(), len(items)) or 1)
    results: list[Result] = []
    with Progress(what, "job", len(items)) as progress:
        for job in jobs:
            results.append(cast(Result, job.outcome()))
            progress.add(1)
    return results
