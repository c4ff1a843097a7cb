"""The runs of a study on this machine, in several processes."""

import itertools
from collections import deque
from collections.abc import Iterator
from functools import partial
from typing import cast

from vibro_ros.simulation.processes import in_processes
from vibro_ros.simulation.worker import WorkerError
from vibro_ros.study.running.pieces import Piece, Result, Work, tasks

#: How often in a row a process may end before its work, such as by the system that lacks memory.
MOST_DEATHS = 3
# Robot time [s] of the runs that a process gets at a time, some hundredths of a second of work, and most of them.
_TASK_TIME, _TASK_ROWS = 64.0, 64


def in_local_processes(work: Work[Result], items: Iterator[Piece], workers: int) -> Iterator[Result]:
    """What `work` makes of each piece, in order; a process that is killed is replaced, and its work done again.

    Raises
    ------
    RuntimeError
        If `MOST_DEATHS` processes in a row end before the same task is done.
    """
    under_way: deque[tuple[Piece, ...]] = deque()
    given: Iterator[tuple[Piece, ...]] = tasks(items, work.run_time, _TASK_TIME, _TASK_ROWS)
    deaths = 0

    def taken(source: Iterator[tuple[Piece, ...]]) -> Iterator[tuple[Piece, ...]]:
        for task in source:
            under_way.append(task)  # before it is given away: whatever happens then, it is done or in here
            yield task

    while deaths < MOST_DEATHS:
        given = itertools.chain(tuple(under_way), given)
        under_way.clear()
        jobs = in_processes(partial(_all_of, work), taken(given), workers)
        try:
            for job in jobs:
                if isinstance(job.error, WorkerError):
                    deaths += 1
                    break
                found = cast(list[Result], job.outcome())
                under_way.popleft()
                deaths = 0
                yield from found
            else:
                return
        finally:
            jobs.close()
    changes = ", ".join(f"{name} = {value}" for name, value in under_way[0][0].changes.items())
    raise RuntimeError(f"{MOST_DEATHS} processes ended at or after {changes}, perhaps for want of memory; what is done "
                       "is kept. Give fewer --workers and the same command again")


def _all_of(work: Work[Result], task: tuple[Piece, ...]) -> list[Result]:
    return [work(piece) for piece in task]
