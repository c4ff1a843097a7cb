"""Wall times of runs: medians that the state of caches and the machine's other work do not decide."""

import statistics
import time
from collections.abc import Callable
from functools import partial

#: Time [s] that a median is taken over, at least.
LEAST_TIME = 0.1
#: Samples per second of robot time that a run is asked for.
RATE = 200.0


def seconds(function: Callable, *arguments: object) -> float:
    """Wall time [s] of one call."""
    began = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - began


def typical_seconds(function: Callable) -> float:
    """Wall time [s] of a call; `typical` of many."""
    return typical(partial(seconds, function))


def typical(timed: Callable[[], float]) -> float:
    """Median of as many runs as fit into `LEAST_TIME`, and of one at least.

    A single run of milliseconds would be measured with caches that the run before it left cold, or with what else the
    machine did just then.

    Parameters
    ----------
    timed : callable
        Does one run and returns its wall time [s].
    """
    began, times = time.perf_counter(), []
    while time.perf_counter() - began < LEAST_TIME:
        times.append(timed())
    return statistics.median(times)
