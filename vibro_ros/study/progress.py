"""Many jobs on all cores, with a bar that says how far they are."""

from collections.abc import Callable, Sequence
from typing import TypeVar

from tqdm import tqdm

from vibro_ros.simulation.preparation import provide_kernels
from vibro_ros.simulation.processes import core_count, in_processes

Item = TypeVar("Item")
Result = TypeVar("Result")


def computed(function: Callable[[Item], Result], items: Sequence[Item], what: str) -> list[Result]:
    """Results of `function` for `items`, in their order; `what` names the bar on stderr.

    Raises
    ------
    Exception
        The first error of `function`; no process is left behind.
    """
    provide_kernels("exact")  # once for all that are forked
    jobs = in_processes(function, items, min(core_count(), len(items)) or 1)
    return [job.outcome() for job in tqdm(jobs, desc=what, total=len(items), disable=None)]
