"""The runs of a study on the workers of a Dask cluster, with the numbers that this machine would find.

Every answer says what it was computed with. One that may differ in a bit is refused, because nobody could tell
afterwards which rows it made.
"""

import threading
from collections import deque
from collections.abc import Iterator, Sequence

from distributed import CancelledError, Client, Future, KilledWorker

from vibro_ros.process.entry_point import say
from vibro_ros.simulation.preparation import provide_kernels
from vibro_ros.study.running.blocks import computes_with
from vibro_ros.study.running.runner import Piece, Results, Work, tasks

# Robot time [s] of a task's runs, half a second of work, and most rows of a task: a scheduler hands out some thousand
# tasks a second.
_TASK_TIME, _TASK_ROWS = 512.0, 256
_AHEAD = 4  # tasks a worker's thread that are submitted beyond the one that is due
_PATIENCE = "10s"  # to find the scheduler
_one_at_a_time = threading.Lock()


def run_on_cluster(address: str, work: Work, run_time: float, methods: Sequence[str],
                   items: Iterator[Piece]) -> Results:
    """The results of all pieces, in order, as `Runner` has it, from the scheduler at ``tcp://host:8786`` or the like.

    Raises
    ------
    ValueError
        If there is no scheduler.
    RuntimeError
        If workers compute otherwise than this machine, die again and again at the same task, or the scheduler goes.
    """
    try:
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise ValueError(f"--scheduler {address}: no scheduler answers ({error}); start one with `dask scheduler`, and "
                         "`dask worker` for each core") from error
    with client:
        if not client.run(_prepare, tuple(methods)):
            say("study", f"{address} has no worker yet; waiting for `dask worker {address}`")
        futures: deque[Future] = deque()
        try:
            for task in tasks(items, run_time, _TASK_TIME, _TASK_ROWS):
                futures.append(client.submit(_run, work, task, pure=False))
                if len(futures) > _AHEAD * max(1, sum(client.nthreads().values())):
                    yield from _answer(futures.popleft())
            while futures:
                yield from _answer(futures.popleft())
        except KilledWorker as error:
            raise RuntimeError(f"workers of the cluster died again and again at the same task ({error}); finished work "
                               "is kept. Give them more memory and the same command again") from error
        except (CancelledError, OSError) as error:
            raise RuntimeError(f"{address}: the scheduler went away ({error}); finished work is kept. Start it and "
                               "give the same command again") from error
        finally:
            client.cancel(list(futures))


def _answer(future: Future) -> list:
    theirs, found = future.result()
    for key, ours in computes_with().items():
        if theirs.get(key) != ours:
            raise RuntimeError(f"a worker of the cluster has another {key} ({theirs.get(key)}) than this machine "
                               f"({ours}), so that bits may differ; start workers from the same environment on "
                               "machines of one kind")
    return found


def _prepare(methods: Sequence[str]) -> None:
    """Compile or load kernels where a worker is."""
    with _one_at_a_time:
        for method in methods:
            provide_kernels(method)


def _run(work: Work, task: Sequence[Piece]) -> tuple[dict[str, str], list[list]]:
    """Do a task; a worker's threads take turns, because a device is for one thread."""
    with _one_at_a_time:
        return computes_with(), [work(piece) for piece in task]
