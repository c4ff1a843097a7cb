"""Whole runs: one scene from its start to its end, and many scenes on all cores.

Processes are used, not threads, because a scene is compiled to its tables in Python, which takes as long as simulating
seconds of robot time. `in_processes` applies any function to many items so: results in order, items taken as needed, no
process left over. `Forks` is its `concurrent.futures.Executor`, in which each worker is a fork with a pipe of its own,
served by a thread. The workers of `concurrent.futures.ProcessPoolExecutor` share one pipe for results: one that is
killed while it sends 40 MB leaves half a result there, and the pool waits for ever (one of five kills). So does the
pool of loky (one of ten), whose workers also take 2 s to start.
"""

import ctypes
import functools
import inspect
import itertools
import math
import multiprocessing
import os
import queue
import signal
import threading
import time as wall_clock
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, wait
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, TypeVar

import numpy as np

from vibro_ros.model.parameters import SCENE_PARAMETERS, checked_parameters
from vibro_ros.model.scene import Scene, check_scene
from vibro_ros.process.entry_point import interrupt_again, interrupted_afterwards
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.samples import Run, Samples, sample_times
from vibro_ros.simulation.simulator import Simulator

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
    for number, scene in enumerate(scenes):
        if not isinstance(scene, Scene):
            raise TypeError(f"scene {number}: {scene!r} is not a Scene; vibro_ros.load_scene makes one of a name")
        yield scene


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
