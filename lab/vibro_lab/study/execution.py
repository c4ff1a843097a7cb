"""Distribution of a study's points over processes of this machine or a Dask cluster, with bitwise equal results.

Both are a `concurrent.futures.Executor`. A task is a group of points, so that its overhead is small. Every answer
includes the versions of the software that computed it, and an answer from other software is refused, because it may
differ in a bit and nobody could find its rows afterwards. If a process is killed, for example for lack of memory, its
task and the later ones are computed again.
"""

import functools
import hashlib
import itertools
import threading
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vibro_ros import Forks, InThisProcess, ToleranceWarning, in_order, say, software

MOST_DEATHS = 3
"""Number of times in a row that processes may end before the next task is done."""
AHEAD = 16
"""Tasks per process that may be submitted beyond the next one whose result is awaited."""
# Simulated time [s] of a task, and its largest number of points: some hundredths of a second of work on this machine,
# and half a second on a cluster, whose scheduler distributes some thousand tasks a second.
_LOCAL_GROUP, _CLUSTER_GROUP = (64.0, 64), (512.0, 256)
_PATIENCE = "10s"  # to connect to the scheduler
_one_at_a_time = threading.Lock()

Rows = Generator[Any, None, None]
"""Generator of the rows of each point, in the order of the points."""


@functools.cache
def fingerprint() -> dict[str, str]:
    """Version of the package, and a digest of all sources that may affect a study's numbers.

    A study resumes only if both are equal. Beside the sources of the simulation, the digest covers every module of
    `orbits` and `study`.
    """
    package, digest = Path(__file__).parents[1], hashlib.sha256(software()["sources"].encode())
    for path in sorted([*package.glob("orbits/**/*.py"), *package.glob("study/**/*.py")]):
        digest.update(b"\n".join((str(path.relative_to(package)).encode(), *path.read_bytes().splitlines())))
    return {"version": software()["version"], "sources": digest.hexdigest()[:16]}


@functools.cache
def computes_with() -> dict[str, str]:
    """Everything besides the scene that a run's bits depend on; if it is equal, numbers are equal to the last bit."""
    return {**software(), **fingerprint()}


@dataclass(frozen=True)
class Task:
    """Function that computes the rows of some points in a worker."""

    rows: Callable[[int], Any]  # returns the rows of a point by its number

    def __call__(self, numbers: tuple[int, ...]) -> tuple[dict[str, str], list]:
        """Return `computes_with` and the rows of each point.

        Threads of a worker take turns, because a device may be used by one thread only.
        """
        with _one_at_a_time, warnings.catch_warnings():
            warnings.simplefilter("ignore", ToleranceWarning)  # the command has printed it, or a row contains it
            return computes_with(), [self.rows(number) for number in numbers]


@dataclass(frozen=True)
class Execution:
    """Choice of the workers: processes of this machine, or a Dask cluster."""

    workers: int  # number of processes of this machine
    address: str | None = None  # address of a Dask cluster's scheduler; if given, the cluster computes instead

    def rows(self, rows: Callable[[int], Any], numbers: Iterable[int], run_time: float) -> Rows:
        """Yield the rows of each numbered point, in order; a point takes about `run_time` seconds of simulated time."""
        task, (time, most) = Task(rows), _CLUSTER_GROUP if self.address else _LOCAL_GROUP
        given = _groups(iter(numbers), max(1, min(most, int(time / run_time))))
        due: deque[tuple[int, ...]] = deque()
        deaths = 0
        while True:
            waiting = itertools.chain(tuple(due), given)
            due.clear()
            try:
                with self._executor(task) as (executor, ahead), closing(
                        in_order(executor, task, _note_due(waiting, due), ahead)) as answers:
                    for _, future in answers:
                        rows_of_group = _check_worker(*future.result())
                        due.popleft()
                        deaths = 0
                        yield from rows_of_group
                return
            except BrokenExecutor as error:
                deaths += 1
                if deaths == MOST_DEATHS:
                    raise RuntimeError(f"{MOST_DEATHS} processes ended at or after point {due[0][0]} ({error}), perhaps"
                                       " for want of memory; finished work is kept. Give fewer --workers and the same "
                                       "command again") from error

    def _executor(self, task: Task) -> "AbstractContextManager[tuple[Executor, int]]":
        return _cluster(self.address) if self.address else _local_pool(self.workers, task)


def _groups(numbers: Iterator[int], size: int) -> Iterator[tuple[int, ...]]:
    while group := tuple(itertools.islice(numbers, size)):
        yield group


def _note_due(groups: Iterable[tuple[int, ...]], due: deque[tuple[int, ...]]) -> Iterator[tuple[int, ...]]:
    for group in groups:
        due.append(group)  # before it is submitted, so that it is never lost: it is done or in `due`
        yield group


def _check_worker(theirs: dict[str, str], rows: list) -> list:
    for key, ours in computes_with().items():
        if theirs.get(key) != ours:
            raise RuntimeError(f"a worker of the cluster has another {key} ({theirs.get(key)}) than this machine "
                               f"({ours}), so that bits may differ; start workers from the same environment")
    return rows


@contextmanager
def _local_pool(workers: int, task: Task) -> Iterator[tuple[Executor, int]]:
    """Give an executor of processes of this machine, and the number of tasks ahead."""
    with Forks(workers, task) if workers > 1 else InThisProcess() as executor:
        yield executor, AHEAD * workers if workers > 1 else 0


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Executor, int]]:
    """Give an executor of a Dask cluster (``tcp://host:8786``), and the number of tasks ahead."""
    try:
        from distributed import CancelledError as Cancelled  # only clusters need it
        from distributed import Client, KilledWorker
    except ModuleNotFoundError as error:
        raise ValueError(f"{error.name}: not installed; `pip install \"./lab[cluster]\"` brings what --scheduler "
                         "needs") from error
    try:
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise ValueError(f"--scheduler {address}: no scheduler answers ({error}); start one with `dask scheduler`, "
                         "and `dask worker` for each core") from error
    with closing(client):
        threads = client.nthreads()
        if not threads:
            say("study", f"{address} has no worker yet; waiting for `dask worker {address}`")
        try:
            yield client.get_executor(pure=False), AHEAD * max(1, sum(threads.values()))
        except KilledWorker as error:
            raise RuntimeError(f"workers of the cluster died again and again at the same task ({error}); finished work "
                               "is kept. Give them more memory and the same command again") from error
        except (Cancelled, CancelledError, OSError) as error:
            raise RuntimeError(f"{address}: the scheduler went away ({error}); finished work is kept. Start it and "
                               "give the same command again") from error
