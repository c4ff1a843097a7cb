"""A function applied to many items by processes: results in order, items taken as needed, no process left over.

`Forks` is a `concurrent.futures.Executor` in which each worker is a fork with a pipe of its own, served by a thread.
The workers of `concurrent.futures.ProcessPoolExecutor` share one pipe for results: one that is killed while it sends
40 MB leaves half a result there, and the pool waits for ever (one of five kills). So does the pool of loky (one of
ten), whose workers also take 2 s to start.
"""

import ctypes
import multiprocessing
import os
import queue
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import BrokenExecutor, Executor, Future, wait
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from vibro_ros.process.entry_point import interrupt_again, interrupted_afterwards

#: Items per process that may be submitted beyond the item whose result is due; this limits the results that wait.
AHEAD = 4
_FORK = multiprocessing.get_context("fork")  # starts in milliseconds, with all that the parent has imported
_DIE_WITH_PARENT = 1  # prctl's PR_SET_PDEATHSIG


class WorkerError(BrokenExecutor):
    """Error of a process that ended before its work was done, or of a result that cannot be sent."""


def core_count() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def in_order(executor: Executor, function: Callable, items: Iterable, ahead: int,
             when_done: Callable[[], None] = lambda: None) -> Generator[tuple[Any, Future], None, None]:
    """Apply `function` to each of `items`, at most `ahead` of them beyond the item whose result is due.

    `when_done` is called when all results are computed, before the last is yielded, because a caller that knows their
    number, as ``zip(names, runs)`` does, does not ask for one more.

    Yields each item and its future, in the items' order. An error of the iterable is raised after all items before it;
    a KeyboardInterrupt before the next item, if a stop signal came, even if its own was swallowed elsewhere.
    """
    due: deque[tuple[Any, Future]] = deque()
    source, error = iter(items), None
    try:
        while True:
            try:
                item = next(source)
            except StopIteration:
                break
            except Exception as failure:
                error = failure
                break
            interrupt_again()
            due.append((item, executor.submit(function, item)))
            if len(due) > ahead:
                yield due.popleft()
        while due:
            if len(due) == 1 and error is None:
                wait([due[0][1]])
                when_done()
            yield due.popleft()
            interrupt_again()
        if error is not None:
            raise error
    finally:
        for _, future in due:
            future.cancel()


def in_processes(function: Callable, items: Iterable, workers: int) -> Generator[tuple[Any, Future], None, None]:
    """Return `in_order` over so many worker processes, or over this process if `workers` is 1. Workers end before the
    last item is yielded, or when the iterator is closed or dropped."""
    with Forks(workers, function) if workers > 1 else InThisProcess() as executor:
        yield from in_order(executor, function, items, AHEAD * workers if workers > 1 else 0, executor.shutdown)


class InThisProcess(Executor):
    """Executor that computes each item in this process when the item is submitted."""

    def submit(self, function: Callable, /, *arguments: Any, **named: Any) -> Future:
        """Return the finished future of the function's result or error."""
        future: Future = Future()
        try:
            future.set_result(function(*arguments, **named))
        except Exception as error:
            future.set_exception(error)
        return future


class Forks(Executor):
    """Processes that are forked from this one, and end with the context, with this process, or when they are killed.

    `inherited` is a function that the forks inherit, so that it may be a closure; other functions are pickled by name.
    """

    def __init__(self, workers: int, inherited: Callable):
        self._inherited = inherited
        self._waiting: queue.SimpleQueue[tuple[Future, Callable | None, Any] | None] = queue.SimpleQueue()
        self._pipes, self._processes = list[Connection](), []
        for _ in range(workers):
            ours, theirs = _FORK.Pipe()
            process = _FORK.Process(target=_work, args=(theirs, ours, os.getpid(), inherited), daemon=True,
                                    name="vibro_ros worker")
            with interrupted_afterwards():
                process.start()
            theirs.close()
            self._pipes.append(ours)
            self._processes.append(process)
        self._threads = [threading.Thread(target=self._serve, args=pair, daemon=True)
                         for pair in zip(self._pipes, self._processes, strict=True)]
        for thread in self._threads:
            thread.start()

    def submit(self, function: Callable, /, *arguments: Any, **_: Any) -> Future:
        """Return the future of the function's result for one item; a WorkerError if its process ends before."""
        future: Future = Future()
        self._waiting.put((future, None if function is self._inherited else function, *arguments))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """Kill every worker, because a kernel would not notice a gentler signal before its run is over."""
        for process in self._processes:
            process.kill()
        for _ in self._threads:
            self._waiting.put(None)
        for thread in self._threads:
            thread.join()
        for process, pipe in zip(self._processes, self._pipes, strict=True):
            process.join()
            process.close()
            pipe.close()
        self._processes, self._pipes, self._threads = [], [], []

    def _serve(self, pipe: Connection, process: Any) -> None:
        """Send items to a worker and take its results, until there are no more items."""
        while (task := self._waiting.get()) is not None:
            future, *work = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                pipe.send(work)
                result, error = pipe.recv()
            except (EOFError, OSError):  # this worker fails whatever it is given, so that no future waits for ever
                process.join()
                result, error = None, WorkerError(f"its process ended with exit code {process.exitcode}")
            except Exception as failure:  # the item cannot be pickled
                result, error = None, failure
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)
            del future, task, work, result, error  # else their memory is kept while this thread waits


def _work(pipe: Connection, other_end: Connection, parent: int, inherited: Callable) -> None:
    """Compute and send the result of every item that arrives, until the parent ends."""
    for number in (signal.SIGINT, signal.SIGHUP):  # the parent gets them as well, and ends this process
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    other_end.close()
    if os.getppid() != parent:  # the parent ended before the call of prctl
        return
    with suppress(EOFError, OSError):
        while True:
            function, item = pipe.recv()
            outcome: tuple[Any, Exception | None]
            try:
                outcome = (function or inherited)(item), None
            except Exception as error:
                outcome = None, error
            try:
                pipe.send(outcome)
            except (EOFError, OSError):
                raise
            except Exception as error:
                words = f"its result cannot be handed over: {type(error).__name__}: {error}"
                pipe.send((None, WorkerError(words)))
            del outcome  # else its memory is kept while this process waits
