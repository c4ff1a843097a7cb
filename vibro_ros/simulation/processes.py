"""Work for several processes: a function of many items, their results in order, and no process left behind.

Processes, not threads: compiling a scene to its tables is Python, and takes as long as seconds of robot time.
"""

import os
import select
from collections import deque
from collections.abc import Callable, Generator, Iterable

from vibro_ros.simulation.job import Job
from vibro_ros.simulation.worker import MOST_GIVEN, Worker

#: Items a process that may be ahead of the result that is due, whatever becomes of them.
AHEAD = 4
#: Results [B] that may wait for an earlier one that is still under way, beyond `AHEAD`: where one item takes as long as
#: many others, the other processes go on.
WAITING = 2**25
# A job counts at least so many bytes [B]: a scene and its place in the queue.
_LEAST_SIZE = 10_000


def core_count() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def in_processes(function: Callable, items: Iterable, workers: int) -> Generator[Job, None, None]:
    """Apply `function` to each of `items` in processes that are forked from this one.

    Parameters
    ----------
    function : callable
        Of one item. What the forks need should be compiled and loaded before.
    items : iterable
        Taken as they are needed, at most `AHEAD` a process ahead of the result that is due, and more only while that
        result is under way and the results that wait for it have less than `WAITING` bytes.
    workers : int
        Processes; with 1, this one does it all.

    Yields
    ------
    Job
        Each item with its result or error, in their order. An error of the iterable comes after all before it. Every
        process ends with the last result, with an error, or when the iterator is closed or dropped.
    """
    if workers == 1:
        for own in map(Job, items):
            own.do(function)
            yield own
        return
    dispatcher = _Dispatcher(function, items, workers)
    try:
        while job := dispatcher.next_job():
            yield job
    finally:
        dispatcher.stop()


class _Dispatcher:
    """Workers, the jobs under way or waiting to be yielded, and the items still to come."""

    def __init__(self, function: Callable, items: Iterable, size: int):
        self._function, self._items, self._size = function, iter(items), size
        self._workers: list[Worker] = []
        self._jobs: deque[Job] = deque()  # in the order of the items
        self._waiting = 0  # bytes of the jobs that are done
        self._error: Exception | None = None

    def next_job(self) -> Job | None:
        """Return the job that is due, done; None when there are no more items."""
        self._give()
        if not self._jobs and self._error:
            raise self._error
        while self._jobs and not self._jobs[0].done:
            self._take(None)
            self._give()
        if not self._jobs:
            return None
        self._take(0)
        job = self._jobs.popleft()
        self._waiting -= _size(job)
        self._give()
        return job

    def stop(self) -> None:
        """End every worker, whatever it does."""
        for worker in self._workers:  # all at once, and then wait
            worker.kill()
        for worker in self._workers:
            worker.close()

    def _give(self) -> None:
        """Give jobs until every worker has `MOST_GIVEN`, or enough are ahead."""
        while self._needs_more():
            worker = min(self._workers, key=lambda one: len(one.given), default=None)
            is_new = len(self._workers) < self._size and (worker is None or len(worker.given) > 0)
            if worker and not is_new and len(worker.given) >= MOST_GIVEN:
                return
            job = self._pull()
            if job is None:
                return
            if worker is None or is_new:
                worker = Worker(self._function, [other.pipe for other in self._workers])
                self._workers.append(worker)
            self._jobs.append(job)
            worker.give(job)

    def _needs_more(self) -> bool:
        under_way = bool(self._jobs) and not self._jobs[0].done
        return len(self._jobs) < AHEAD * self._size or (under_way and self._waiting < WAITING)

    def _pull(self) -> Job | None:
        """Return a job of the next item; None when there is none."""
        if self._error:
            return None
        try:
            return Job(next(self._items))
        except StopIteration:
            self._items = iter(())
        except Exception as error:
            self._error = error
        return None

    def _take(self, patience: int | None) -> None:
        """Take what workers have done; wait `patience` [ms] for the first, without end if None."""
        by_pipe = {worker.pipe.fileno(): worker for worker in self._workers if worker.given}
        poll = select.poll()  # multiprocessing's own `wait` takes ten times as long
        for pipe in by_pipe:
            poll.register(pipe, select.POLLIN)
        for pipe, _ in poll.poll(patience):
            self._waiting += _size(by_pipe[pipe].take())


def _size(job: Job) -> int:
    return max(job.size, _LEAST_SIZE)
