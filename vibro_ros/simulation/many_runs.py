"""Many scenes at once: the runs in the order of the scenes, or numbers of them."""

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator
from typing import Generic, TypeVar

import numpy as np

from vibro_ros.model.parameters import SCENE_PARAMETERS, checked_parameters
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.one_run import Commands, checked_commands, overriding, simulate
from vibro_ros.simulation.preparation import provide_kernels
from vibro_ros.simulation.processes import core_count, in_processes
from vibro_ros.simulation.sample_times import sample_times
from vibro_ros.simulation.samples import Run
from vibro_ros.simulation.worker import WorkerError

Result = TypeVar("Result")


def simulate_many(scenes: Iterable[Scene], duration: float | None = None, rate: float | None = None,
                  times: np.ndarray | None = None, tolerance: float | None = None, method: str | None = None,
                  workers: int | None = None, commands: Commands = (),
                  reduce: Callable[[Run], Result] | None = None) -> Iterator[Run | Result]:
    """Simulate many scenes on all cores, each as `simulate` does, to the last bit.

    Parameters
    ----------
    scenes : iterable of Scene
        What to simulate; it may be a generator without end. Taken as it is needed, at most four scenes a process
        ahead of the result that is due; more only while that result is being computed, so that the other processes
        need not wait for a long run, until the results that wait have 32 MiB.
    duration, rate, times, tolerance, method, commands
        As for `simulate`, the same for every scene.
    workers : int
        Processes that simulate, as many as cores that this process may use unless given; with 1, this process does.
    reduce : callable
        Called with each run where it was simulated; what it returns is yielded in place of the run.

    Yields
    ------
    Run, or what `reduce` returns
        The result of each scene, in the order of `scenes`. Only results that wait for an earlier one are kept:
        ``list(simulate_many(...))`` keeps all. The other processes end with the last result, with an error, or when
        the iterator is closed or dropped.

    Raises
    ------
    ValueError
        At the call: as `simulate`, and for less than one worker.
    SimulationError
        In the place of the first result that cannot be had, after all before it; the message names the scene by
        its number, from 0, and by what distinguishes it from the first.

    Notes
    -----
    Workers are forks of the calling process. Like every fork they are unwise while another thread compiles kernels,
    and a worker of another pool may have none: give ``workers=1`` there.

    Examples
    --------
    >>> scene = vibro_ros.load_scene("damped")
    >>> scenes = (scene.with_parameters({"guide.angle": angle}) for angle in (0.8, 1.0, 1.2))
    >>> for run in vibro_ros.simulate_many(scenes, duration=1.0, rate=100.0, workers=2):
    ...     print(f"{run.body_position[-1]:.6f} m")
    -0.057607 m
    -0.056602 m
    -0.054009 m
    >>> speeds = ({"motor.speed": speed} for speed in (60.0, 120.0))
    >>> list(vibro_ros.simulate_many(map(scene.with_parameters, speeds), duration=1.0, rate=100.0, workers=2,
    ...                              reduce=lambda run: round(float(run.normal_force.max()), 1)))
    [50.9, 57.8]
    """
    times = sample_times(duration, rate, times)
    checked_parameters(overriding(tolerance, method), SCENE_PARAMETERS)
    workers = core_count() if workers is None else workers
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise ValueError(f"workers: {workers!r} is no number of processes; give 1 or more")
    run = functools.partial(simulate, times=times, tolerance=tolerance, method=method,
                            commands=checked_commands(commands))
    return _results(_checked(scenes), _Reduced(run, reduce) if reduce else run, workers, method)


class _Reduced(Generic[Result]):
    """A simulation of which a function of the run is handed over."""

    def __init__(self, simulation: Callable[[Scene], Run], reduce: Callable[[Run], Result]):
        self._simulation, self._reduce = simulation, reduce

    def __call__(self, scene: Scene) -> Result:
        return self._reduce(self._simulation(scene))


def _results(scenes: Iterator[Scene], simulation: Callable, workers: int, method: str | None) -> Iterator:
    """Yield what `simulation` returns of each scene; raise a SimulationError in place of the first that it cannot."""
    first = next(scenes, None)
    if first is None:
        return
    if workers > 1:  # once for all that are forked
        provide_kernels(method or first["solver.method"])
    jobs = in_processes(simulation, itertools.chain([first], scenes), workers)
    try:
        for number, job in enumerate(jobs):
            if job.error is not None:
                raise SimulationError(f"scene {number} ({_distinction(job.item, first)}): {_in_words(job.error)}")
            yield job.result
    finally:
        jobs.close()


def _in_words(error: Exception) -> str:
    return str(error) if isinstance(error, SimulationError | WorkerError) else f"{type(error).__name__}: {error}"


def _distinction(scene: Scene, first: Scene) -> str:
    """Return a scene's name and the parameters in which it differs from the first."""
    different = {name: value for name, value in scene.parameters.items() if value != first[name]}
    return ", ".join([scene.name, *(f"{name} = {value!r}" for name, value in different.items())])


def _checked(scenes: Iterable[Scene]) -> Iterator[Scene]:
    """Yield each of `scenes`; a TypeError for what is none."""
    for number, scene in enumerate(scenes):
        if not isinstance(scene, Scene):
            raise TypeError(f"scene {number}: {scene!r} is not a Scene; vibro_ros.load_scene makes one of a name")
        yield scene
