"""One scene from its start to its end: samples, events and statistics."""

import math
import time as wall_clock
from collections.abc import Iterator

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.samples import Run
from vibro_ros.simulator import LATEST, Simulator, checked_times

#: Most samples of one run: their fields take 20 GB.
MOST_SAMPLES = 1e8


def simulate(scene: Scene, duration: float | None = None, rate: float | None = None,
             times: np.ndarray | None = None, tolerance: float | None = None, method: str | None = None) -> Run:
    """Simulate `scene` from its start.

    Parameters
    ----------
    scene : Scene
        What to simulate.
    duration : float
        Length of the run [s]; with `rate`.
    rate : float
        Samples per second, the first at t = 0.
    times : ndarray, shape (n,)
        Instants to sample [s], ascending, not negative; instead of `duration` and `rate`.
    tolerance, method : float [m], str
        Override the scene's `solver.tolerance` and `solver.method`.

    Returns
    -------
    Run
        The samples, the events up to the last one, and statistics.

    Raises
    ------
    ValueError
        For times that are not finite, negative or not ascending, and an unknown method or tolerance.
    SimulationError
        If the run cannot go on.
    """
    *_, run = simulate_in_parts(scene, sample_times(duration, rate, times), tolerance, method)
    return run


def simulate_in_parts(scene: Scene, times: np.ndarray, tolerance: float | None = None,
                      method: str | None = None) -> Iterator[Run | None]:
    """`simulate`, pausing as `Simulator.sample_in_parts` does: yields None after each part, and at last the run."""
    if overrides := overriding(tolerance, method):
        scene = scene.with_parameters(overrides)
    began, paused = wall_clock.perf_counter(), 0.0
    device = Simulator(scene)
    for samples in device.sample_in_parts(times):
        if samples is None:
            stopped = wall_clock.perf_counter()
            yield None
            paused += wall_clock.perf_counter() - stopped
    wall_time = wall_clock.perf_counter() - began - paused
    events = device.take_events()
    events = events.take(np.argsort(events["time"], kind="stable"))
    yield Run(**vars(samples), events=events, statistics={**device.statistics, "wall_time": wall_time})


def overriding(tolerance: float | None, method: str | None) -> dict[str, object]:
    """Parameters of the scene that the arguments of `simulate` override."""
    overrides = {"solver.tolerance": tolerance, "solver.method": method}
    return {name: value for name, value in overrides.items() if value is not None}


def sample_times(duration: float | None, rate: float | None, times: np.ndarray | None) -> np.ndarray:
    """Instants to sample [s], shape (n,), from the arguments of `simulate`; a ValueError for any that make no sense."""
    if times is None:
        if duration is None or rate is None:
            raise ValueError("give duration and rate, or times")
        if not (math.isfinite(duration) and duration >= 0.0 and math.isfinite(rate) and rate > 0.0):
            raise ValueError(f"duration {duration:g} s and rate {rate:g} Hz: give a duration of at least 0 and a "
                             "rate above 0")
        if duration > LATEST or duration * rate > MOST_SAMPLES:
            raise ValueError(f"duration {duration:g} s and rate {rate:g} Hz: give a duration of at most {LATEST:g} s "
                             f"and at most {MOST_SAMPLES:g} samples")
        return np.arange(int(math.floor(duration * rate * (1.0 + 1e-12))) + 1) / rate
    return checked_times(times, 0.0)
