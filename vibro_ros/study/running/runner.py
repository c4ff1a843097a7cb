"""Who computes the pieces of a study, with the same numbers everywhere: processes of this machine, or a cluster."""

import itertools
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import cast

from vibro_ros.model.parameters import Value
from vibro_ros.simulation.preparation import prepare_kernels
from vibro_ros.simulation.processes import WorkerError, in_processes

#: Most rows of a piece: all of the same machine, whose equations are compiled once.
PIECE = 16
#: How often in a row a process may end before its work, such as by the system that lacks memory.
MOST_DEATHS = 3
# Robot time [s] of the runs that a process gets at a time, some hundredths of a second of work, and most of them.
_TASK_TIME, _TASK_ROWS = 64.0, 64

Results = Generator[list, None, None]


@dataclass(frozen=True)
class Piece:
    """Rows of one machine.

    Attributes
    ----------
    number : int
        By which the study knows the piece.
    changes : dict
        Values of the parameters that vary.
    starts : tuple of (int or None)
        Numbers of the starts.
    """

    number: int
    changes: dict[str, Value]
    starts: tuple[int | None, ...]


Work = Callable[[Piece], list]
"""Runs a piece, and returns as many results as it has starts; other processes get it pickled."""


Runner = Callable[[Work, float, tuple[str, ...], Iterator[Piece]], Results]
"""Yields the results of all pieces, in order. Its arguments are the work, the robot time of a run [s], about, each
`solver.method` whose kernels are needed, and the pieces, which are taken as they are needed."""


def tasks(items: Iterator[Piece], run_time: float, time: float, most: int) -> Iterator[tuple[Piece, ...]]:
    """Pieces in groups: as many as have at most `most` runs, of `run_time` [s] each and `time` [s] together."""
    rows_of_task = max(1, min(most, int(time / run_time)))
    task: list[Piece] = []
    rows = 0
    for item in items:
        if task and rows + len(item.starts) > rows_of_task:
            yield tuple(task)
            task, rows = [], 0
        task.append(item)
        rows += len(item.starts)
    if task:
        yield tuple(task)


def run_on_this_machine(workers: int, work: Work, run_time: float, methods: Sequence[str],
                        items: Iterator[Piece]) -> Results:
    """A `Runner` once `workers` are given; a process that is killed is replaced, and its work done again.

    Raises
    ------
    RuntimeError
        If `MOST_DEATHS` processes in a row end before the same task is done.
    """
    for method in methods:
        prepare_kernels("study", method)
    given = tasks(items, run_time, _TASK_TIME, _TASK_ROWS)
    under_way: deque[tuple[Piece, ...]] = deque()
    deaths = 0

    def taken(source: Iterator[tuple[Piece, ...]]) -> Iterator[tuple[Piece, ...]]:
        for task in source:
            under_way.append(task)  # before it is given away: whatever happens then, it is done or in here
            yield task

    while deaths < MOST_DEATHS:
        given = itertools.chain(tuple(under_way), given)
        under_way.clear()
        jobs = in_processes(lambda task: [work(piece) for piece in task], taken(given), workers)
        try:
            for job in jobs:
                if isinstance(job.error, WorkerError):
                    deaths += 1
                    break
                found = cast(list[list], job.outcome())
                under_way.popleft()
                deaths = 0
                yield from found
            else:
                return
        finally:
            jobs.close()
    last = under_way[0][0]
    where = ", ".join(f"{name} = {value}" for name, value in last.changes.items()) or f"piece {last.number}"
    raise RuntimeError(f"{MOST_DEATHS} processes ended at or after {where}, perhaps for want of memory; finished "
                       "work is kept. Give fewer --workers and the same command again")
