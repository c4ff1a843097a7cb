"""The runs of a sweep on this machine, in several processes."""

import itertools
from collections import deque
from collections.abc import Iterator
from typing import cast

from vibro_ros.simulation.processes import in_processes
from vibro_ros.simulation.worker import WorkerError
from vibro_ros.study.sweep.rows import Piece, Rows, Work

#: How often in a row a process may end before its work, such as by the system that lacks memory.
MOST_DEATHS = 3


def in_local_processes(work: Work, items: Iterator[Piece], workers: int) -> Iterator[Rows]:
    """What `work` makes of each item, in order; a process that is killed is replaced, and its work done again.

    Raises
    ------
    RuntimeError
        If `MOST_DEATHS` processes in a row end before the same item is done.
    """
    under_way: deque[Piece] = deque()
    deaths = 0

    def taken(source: Iterator[Piece]) -> Iterator[Piece]:
        for item in source:
            under_way.append(item)
            yield item

    while deaths < MOST_DEATHS:
        again = tuple(under_way)
        under_way.clear()
        jobs = in_processes(work, itertools.chain(taken(iter(again)), taken(items)), workers)
        try:
            for job in jobs:
                if isinstance(job.error, WorkerError):
                    deaths += 1
                    break
                rows = cast(Rows, job.outcome())
                under_way.popleft()
                deaths = 0
                yield rows
            else:
                return
        finally:
            jobs.close()
    changes = ", ".join(f"{name} = {value}" for name, value in under_way[0].changes.items())
    raise RuntimeError(f"{MOST_DEATHS} processes ended at {changes}, perhaps for want of memory; what is done is kept. "
                       "Give fewer --workers and the same command again")
