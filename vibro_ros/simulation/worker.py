"""A process that does one job after another for the process that forked it.

`concurrent.futures` cannot be used: a process of its pool that is killed while it hands a result over leaves half of
that in the pipe that all share, and whoever waits for the pool waits for ever. Here each worker has a pipe of its own,
whose other end closes with it.
"""

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable
from multiprocessing.connection import Connection

from vibro_ros.simulation.handover import Handover
from vibro_ros.simulation.job import Job

#: Jobs at a time that a worker has: one is done while the other waits, so that the worker need not wait.
MOST_GIVEN = 2

_FORK = multiprocessing.get_context("fork")  # starts in milliseconds, with the kernels that the parent has compiled


class WorkerError(RuntimeError):
    """A process that ended before its work."""


class Worker:
    """A process that applies a function to one item after another.

    Parameters
    ----------
    function : callable
        Of one item; the process inherits it, so that it may be a closure.
    inherited : list of Connection
        Pipes to other workers, which the process closes.

    Attributes
    ----------
    pipe : Connection
        To it and from it.
    given : deque of Job
        What it has been given and has not answered, in order.
    """

    def __init__(self, function: Callable, inherited: list[Connection]):
        self.pipe, far = _FORK.Pipe()
        self.given: deque[Job] = deque()
        self._handover = Handover(MOST_GIVEN)
        self._process = _FORK.Process(target=_work, args=(far, [*inherited, self.pipe], self._handover, function),
                                      daemon=True, name="vibro_ros worker")
        self._process.start()
        far.close()

    def give(self, job: Job) -> None:
        """Add a job to its work, of which it has less than `MOST_GIVEN`."""
        self.given.append(job)
        try:
            self.pipe.send(job.item)
        except OSError:  # it has ended: `take` says so
            pass

    def take(self) -> Job:
        """Wait for the end of the oldest job that it was given; return the job."""
        job = self.given.popleft()
        try:
            (result, error), size = self._handover.unpack(self.pipe.recv_bytes())
            job.end(result, error, size)
        except (EOFError, OSError):
            self._process.join()
            job.end(None, WorkerError(f"its process ended with exit code {self._process.exitcode}"))
        return job

    def kill(self) -> None:
        """End it: a kernel would not notice a gentler signal before its run is over."""
        self._process.kill()

    def close(self) -> None:
        """Wait for its end and leave nothing of it behind."""
        self._process.join()
        self._process.close()
        self.pipe.close()
        self._handover.close()


def _work(pipe: Connection, inherited: list[Connection], handover: Handover, function: Callable) -> None:
    """Do every job that comes, until nobody is left to ask."""
    for number in (signal.SIGINT, signal.SIGHUP):  # they reach the parent as well, which ends us
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for other in inherited:  # or we would keep each other alive if the parent were killed
        other.close()
    try:
        while True:
            job = Job(pipe.recv())
            job.do(function)
            pipe.send_bytes(_packed(job, handover))
    except (EOFError, OSError):
        pass


def _packed(job: Job, handover: Handover) -> bytes:
    try:
        return handover.pack((job.result, job.error))
    except Exception as error:  # whatever pickle meets in a result
        return handover.pack(
            (None, WorkerError(f"its result cannot be handed over: {type(error).__name__}: {error}")))
