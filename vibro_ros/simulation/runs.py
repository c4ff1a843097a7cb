"""Whole runs: one scene from its start to its end, and many scenes on all cores.

Processes are used, not threads, because a scene is compiled to its tables in Python, which takes as long as simulating
seconds of robot time.
"""

import functools
import inspect
import itertools
import math
import time as wall_clock
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TypeVar

import numpy as np

from vibro_ros.model.parameters import SCENE_PARAMETERS, checked_parameters
from vibro_ros.model.scene import Scene, check_scene
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.samples import Run, Samples, sample_times
from vibro_ros.simulation.simulator import Simulator
from vibro_ros.simulation.workers import WorkerError, core_count, in_processes

Result = TypeVar("Result")
#: Instants [s], ascending, each with its commands by the names of the arguments of `Simulator.command`.
CommandPairs = Iterable[tuple[float, Mapping[str, float]]]
Commands = Mapping[float, Mapping[str, float]] | CommandPairs
_COMMAND_NAMES = tuple(inspect.signature(Simulator.command).parameters)[1:]


def simulate(scene: Scene, duration: float | None = None, rate: float | None = None,
             times: np.ndarray | None = None, tolerance: float | None = None, method: str | None = None,
             commands: Commands = ()) -> Run:
    """Simulate `scene` from its start.

    Parameters
    ----------
    scene : Scene
        The scene to simulate.
    duration : float
        Length of the run [s]; with `rate`.
    rate : float
        Samples per second, the first at t = 0.
    times : ndarray, shape (n,)
        Instants to sample [s], ascending, not negative; instead of `duration` and `rate`.
    tolerance, method : float [m], str
        Override the scene's `solver.tolerance` and `solver.method`.
    commands : mapping from float to mapping, or iterable of such pairs
        Instants [s], ascending, each with its commands: `motor_speed` [rad/s], `upper_gap`, `inclined_gap` [m], or
        `motor_voltage` [V].
        A sample at such an instant is taken after the command; commands after the last sample are not given.

    Returns
    -------
    Run
        The samples, the events up to the last one, and statistics.

    Raises
    ------
    ValueError
        For times that are not finite, negative or not ascending, an unknown method or tolerance, and a command beyond
        its limit.
    SimulationError
        If the run cannot go on.

    Examples
    --------
    >>> scene = vibro_ros.load_scene("damped")
    >>> run = vibro_ros.simulate(scene, duration=1.0, rate=1000.0, commands={0.5: {"motor_speed": 120.0}})
    >>> len(run.time), f"{run.body_position[-1]:.6f} m"
    (1001, '-0.042608 m')
    >>> blows = run.events[run.events["kind"] == "upper_contact"]
    >>> f"{len(blows)} blows, the hardest {blows['peak_force'].max():.0f} N"
    '18 blows, the hardest 3493 N'
    """
    times, commands = sample_times(duration, rate, times), _checked_commands(commands)
    check_scene(scene)
    if overrides := _overriding(tolerance, method):
        scene = scene.with_parameters(overrides)
    began = wall_clock.perf_counter()
    device = Simulator(scene)
    samples = commanded_samples(device, times, commands) if commands else device.sample(times)
    wall_time = wall_clock.perf_counter() - began
    events = device.take_events()
    events = events.take(np.argsort(events["time"], kind="stable"))
    return Run(**vars(samples), events=events, statistics={**device.statistics, "wall_time": wall_time})


def simulate_many(scenes: Iterable[Scene], duration: float | None = None, rate: float | None = None,
                  times: np.ndarray | None = None, tolerance: float | None = None, method: str | None = None,
                  workers: int | None = None, commands: Commands = (),
                  reduce: Callable[[Run], Result] | None = None) -> Iterator[Run | Result]:
    """Simulate many scenes on all cores, each as `simulate` does, to the last bit.

    Parameters
    ----------
    scenes : iterable of Scene
        The scenes to simulate; it may be a generator without end. Scenes are taken as needed, at most four per process
        ahead of the result that is due.
    duration, rate, times, tolerance, method, commands
        As for `simulate`, the same for every scene.
    workers : int
        Number of processes that simulate, by default the number of cores that this process may use; with 1, this
        process simulates.
    reduce : callable
        Called with each run in the process that simulated it; its result is yielded in place of the run.

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
        In the place of the first result that cannot be computed, after all results before it; the message names the
        scene by its number, from 0, and by the parameters in which it differs from the first.

    Notes
    -----
    Workers are forks of the calling process. As with every fork, do not start them while another thread computes
    kernels. A worker of another pool may not start processes: give ``workers=1`` there.

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
    checked_parameters(_overriding(tolerance, method), SCENE_PARAMETERS)
    workers = core_count() if workers is None else workers
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise ValueError(f"workers: {workers!r} is no number of processes; give 1 or more")
    run = functools.partial(simulate, times=times, tolerance=tolerance, method=method,
                            commands=_checked_commands(commands))
    simulation = (lambda scene: reduce(run(scene))) if reduce else run  # forks inherit it, so it needs no name
    return _results(_checked(scenes), simulation, workers, method)


def commanded_samples(device: Simulator, times: np.ndarray, commands: CommandPairs) -> Samples:
    """Sample `device` at ascending `times` [s]; each command is given before the samples at its instant."""
    parts, done = [], 0
    for instant, command in commands:
        upto = int(np.searchsorted(times, instant))
        if upto == len(times):
            break
        parts.append(device.sample(times[done:upto]))
        device.advance_to(instant)
        device.command(**command)
        done = upto
    parts.append(device.sample(times[done:]))
    return Samples(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def _checked_commands(commands: Commands) -> tuple[tuple[float, dict[str, float]], ...]:
    """Return instants and commands as pairs, or raise a ValueError."""
    try:
        pairs = commands.items() if isinstance(commands, Mapping) else commands
        copied = tuple((float(instant), dict(command)) for instant, command in pairs)
    except (TypeError, ValueError):
        raise ValueError('commands: give the commands by instants [s], such as {0.5: {"motor_speed": 120.0}}') from None
    instants = [0.0, *(instant for instant, _ in copied)]
    if not all(map(math.isfinite, instants)) or sorted(instants) != instants:
        raise ValueError("commands: give ascending, finite instants, none below 0 s")
    for name in (name for _, command in copied for name in command):
        if name not in _COMMAND_NAMES:
            raise ValueError(f"commands: {name!r} is no command; give {', '.join(_COMMAND_NAMES)}")
    return copied


def _overriding(tolerance: float | None, method: str | None) -> dict[str, object]:
    """Return the parameters of the scene that the arguments of `simulate` override."""
    overrides = {"solver.tolerance": tolerance, "solver.method": method}
    return {name: value for name, value in overrides.items() if value is not None}


def _results(scenes: Iterator[Scene], simulation: Callable, workers: int, method: str | None) -> Iterator:
    """Yield the result of `simulation` for each scene; raise a SimulationError in place of the first that fails."""
    first = next(scenes, None)
    if first is None:
        return
    jobs = in_processes(simulation, itertools.chain([first], scenes), workers)
    try:
        for number, (scene_of_run, future) in enumerate(jobs):
            if error := future.exception():
                different = {name: value for name, value in scene_of_run.parameters.items() if value != first[name]}
                scene = ", ".join([scene_of_run.name, *(f"{name} = {value!r}" for name, value in different.items())])
                kind = "" if isinstance(error, SimulationError | WorkerError) else f"{type(error).__name__}: "
                raise SimulationError(f"scene {number} ({scene}): {kind}{error}")
            yield future.result()
            del future
    finally:
        jobs.close()


def _checked(scenes: Iterable[Scene]) -> Iterator[Scene]:
    """Yield the scenes; raise a TypeError in place of the first that is none."""
    for number, scene in enumerate(scenes):
        if not isinstance(scene, Scene):
            raise TypeError(f"scene {number}: {scene!r} is not a Scene; vibro_ros.load_scene makes one of a name")
        yield scene
