"""A function of many items on several processes: their results in order, and no process left behind.

Processes, not threads: compiling a scene to its tables is Python, and takes as long as seconds of robot time.

Each worker is a fork with a pipe of its own, whose other end closes with it: so each side notices when the other is
killed. The workers of `concurrent.futures.ProcessPoolExecutor` share one pipe for results. One that is killed while it
sends leaves half a result in that pipe, and the pool waits for ever; and all of them outlive a parent that is killed.
"""

import multiprocessing
import os
import pickle
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from vibro_ros.process.entry_point import interrupt_again, interrupted_afterwards

#: Items a process that may be ahead of the result that is due.
AHEAD = 4
#: Results [B] that may wait for an earlier one that is still under way, beyond `AHEAD`: where one item takes as long as
#: many others, the other processes go on.
WAITING = 2**25
#: Items at a time that a worker has: it works on one while the other waits, so that it is never idle.
MOST_GIVEN = 2
# A result counts at least so many bytes [B]: a scene and its place in the queue.
_LEAST_SIZE = 10_000

_FORK = multiprocessing.get_context("fork")  # starts in milliseconds, with the kernels that the parent has compiled


class WorkerError(RuntimeError):
    """A process that ended before its work, or a result that cannot be sent."""


@dataclass(eq=False)
class Job:
    """The application of a function to one item.

    Attributes
    ----------
    item : object
        What the function is applied to.
    result : object
        What the function has returned.
    error : Exception or None
        What the function has raised instead.
    size : int
        Bytes of the result as another process has sent it; 0 while the job is under way.
    """

    item: Any
    result: Any = None
    error: Exception | None = None
    size: int = 0

    def outcome(self) -> Any:
        """Return the result, or raise the error."""
        if self.error is not None:
            raise self.error
        return self.result


def core_count() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def in_processes(function: Callable, items: Iterable, workers: int) -> Generator[Job, None, None]:
    """Apply `function` to each of `items` in processes that are forked from this one.

    Parameters
    ----------
    function : callable
        Of one item; it may be a closure, because forks inherit it. What the forks need should be compiled before.
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

    Raises
    ------
    KeyboardInterrupt
        Before the next result, if a stop signal came, even if its own KeyboardInterrupt was swallowed elsewhere.
    """
    if workers == 1:
        for item in items:
            interrupt_again()
            yield Job(item, *_applied(function, item))
        return
    pool = _Pool(function, items, workers)
    try:
        while job := pool.next_job():
            yield job
    finally:
        pool.end()


def _applied(function: Callable, item: Any) -> tuple[Any, Exception | None]:
    """The function's result and None, or None and its error."""
    try:
        return function(item), None
    except Exception as error:
        return None, error


class _Pool:
    """Workers, the jobs under way or waiting to be yielded, and the items still to come."""

    def __init__(self, function: Callable, items: Iterable, size: int):
        self._function, self._items, self._size = function, iter(items), size
        self._workers: list[_Worker] = []
        self._jobs: deque[Job] = deque()  # in the order of the items
        self._waiting = 0  # bytes of the jobs that are done
        self._error: Exception | None = None  # of the iterable

    def next_job(self) -> Job | None:
        """Return the job that is due, done; None when there are no more items."""
        interrupt_again()
        self._give()
        if not self._jobs and self._error:
            raise self._error
        while self._jobs and not self._jobs[0].size:
            self._collect(None)
            self._give()
        if not self._jobs:
            return None
        self._collect(0.0)
        job = self._jobs.popleft()
        self._waiting -= job.size
        self._give()
        return job

    def end(self) -> None:
        """Kill every worker: a kernel would not notice a gentler signal before its run is over."""
        for worker in self._workers:  # all at once, and then wait
            worker.process.kill()
        for worker in self._workers:
            worker.process.join()
            worker.process.close()
            worker.pipe.close()

    def _give(self) -> None:
        """Give items until every worker has `MOST_GIVEN`, or enough are ahead."""
        while len(self._jobs) < AHEAD * self._size or (not self._jobs[0].size and self._waiting < WAITING):
            worker = min(self._workers, key=lambda one: len(one.given), default=None)
            if len(self._workers) < self._size and (worker is None or worker.given):
                worker = None
            elif worker and len(worker.given) == MOST_GIVEN:
                return
            try:
                job = Job(next(self._items))
            except StopIteration:
                return
            except Exception as error:
                self._items, self._error = iter(()), error
                return
            if worker is None:
                worker = _Worker(self._function, [other.pipe for other in self._workers])
                self._workers.append(worker)
            self._jobs.append(job)
            worker.give(job)

    def _collect(self, patience: float | None) -> None:
        """Take what workers have done; wait `patience` [s] for the first, without end if None."""
        busy = {worker.pipe: worker for worker in self._workers if worker.given}
        for pipe in wait(list(busy), patience):
            self._waiting += busy[pipe].take().size  # type: ignore[index]


class _Worker:
    """A process, the pipe to it and from it, and the jobs that it has not answered, in order.

    Parameters
    ----------
    function : callable
        Of one item.
    others : list of Connection
        Pipes to other workers, which the process closes: else it would keep them alive if the parent were killed.
    """

    def __init__(self, function: Callable, others: list[Connection]):
        self.given: deque[Job] = deque()
        self.pipe, far = _FORK.Pipe()
        self.process = _FORK.Process(target=_work, args=(far, [*others, self.pipe], function), daemon=True,
                                     name="vibro_ros worker")
        with interrupted_afterwards():
            self.process.start()
        far.close()

    def give(self, job: Job) -> None:
        self.given.append(job)
        with suppress(OSError):  # the process has ended, which `take` says
            self.pipe.send(job.item)

    def take(self) -> Job:
        """Wait for the oldest job's answer; return the job, done."""
        job = self.given.popleft()
        try:
            answer, sizes = self.pipe.recv()
            arrays = [bytearray(size) for size in sizes]
            for array in arrays:
                self.pipe.recv_bytes_into(array)
        except (EOFError, OSError):
            self.process.join()
            job.error, job.size = WorkerError(f"its process ended with exit code {self.process.exitcode}"), _LEAST_SIZE
            return job
        job.size = max(len(answer) + sum(sizes), _LEAST_SIZE)
        job.result, job.error = pickle.loads(answer, buffers=arrays)
        return job


def _work(pipe: Connection, others: list[Connection], function: Callable) -> None:
    """Answer every item that comes, until the parent closes the pipe or ends."""
    for number in (signal.SIGINT, signal.SIGHUP):  # they reach the parent as well, which ends this process
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for other in others:
        other.close()
    with suppress(EOFError, OSError):
        while True:
            outcome = _applied(function, pipe.recv())
            arrays: list[pickle.PickleBuffer] = []  # sent as they are: a pickled array is copied six times
            try:
                answer = pickle.dumps(outcome, pickle.HIGHEST_PROTOCOL, buffer_callback=arrays.append)
            except Exception as error:
                words = f"its result cannot be handed over: {type(error).__name__}: {error}"
                arrays, answer = [], pickle.dumps((None, WorkerError(words)))
            parts = [array.raw() for array in arrays]
            pipe.send((answer, [part.nbytes for part in parts]))
            for part in parts:
                pipe.send_bytes(part)
            del outcome, arrays, answer, parts  # while this process waits, they would keep their memory
