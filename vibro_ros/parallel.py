"""Many scenes at once: worker processes, results in the order of the scenes.

Processes, not threads: compiling a scene to its tables is Python, and takes as long as seconds of robot time.
They are forked, so that they start in milliseconds with the kernels that their parent has compiled, and hand their
results over in memory that they share with it. The parent simulates as well, part by part, while it has no result to
give: what it simulates need not be handed over.
"""

import functools
import os
from collections.abc import Iterable, Iterator
from multiprocessing.connection import wait

import numpy as np

from vibro_ros.model.parameters import SCENE_PARAMETERS, checked_parameters
from vibro_ros.model.scene import Scene
from vibro_ros.samples import Run
from vibro_ros.simulation import overriding, sample_times, simulate_in_parts
from vibro_ros.simulator import SimulationError, compile_kernels
from vibro_ros.worker import MOST_GIVEN, Simulation, Worker, outcome_in_parts

# Scenes a process that may be ahead of the result that is due: a slow scene does not stop the others at once.
_AHEAD = 4


def simulate_many(scenes: Iterable[Scene], duration: float | None = None, rate: float | None = None,
                  times: np.ndarray | None = None, tolerance: float | None = None, method: str | None = None,
                  workers: int | None = None) -> Iterator[Run]:
    """Simulate many scenes on all cores, each as `simulate` does, to the last bit.

    Parameters
    ----------
    scenes : iterable of Scene
        What to simulate. Taken as it is needed, at most four scenes a process ahead of the result that is due, so
        that it may be a generator without end.
    duration, rate, times, tolerance, method
        As for `simulate`, the same for every scene.
    workers : int
        Processes, as many as cores that this process may use unless given. The calling process is one of them: it
        simulates while it waits for a result, and with 1 it does it all.

    Yields
    ------
    Run
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
    """
    times = sample_times(duration, rate, times)
    checked_parameters(overriding(tolerance, method), SCENE_PARAMETERS)
    workers = len(os.sched_getaffinity(0)) if workers is None else workers
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise ValueError(f"workers: {workers!r} is no number of processes; give 1 or more")
    run = functools.partial(simulate_in_parts, times=times, tolerance=tolerance, method=method)
    return _results(_outcomes(_Team(_checked(scenes), run, workers, method)))


def _results(outcomes: Iterator[tuple[Scene, Run | str]]) -> Iterator[Run]:
    """The runs; an error where the outcome is the text of one."""
    first = None
    try:
        for index, (scene, outcome) in enumerate(outcomes):
            first = scene if first is None else first
            if isinstance(outcome, str):
                raise SimulationError(f"scene {index} ({_distinction(scene, first)}): {outcome}")
            yield outcome
    finally:
        outcomes.close()


def _distinction(scene: Scene, first: Scene) -> str:
    """A scene's name and the parameters in which it differs from the first."""
    different = {name: value for name, value in scene.parameters.items() if value != first[name]}
    return ", ".join([scene.name, *(f"{name} = {value!r}" for name, value in different.items())])


def _checked(scenes: Iterable[Scene]) -> Iterator[Scene]:
    for index, scene in enumerate(scenes):
        if not isinstance(scene, Scene):
            raise TypeError(f"scene {index}: {scene!r} is not a Scene; vibro_ros.load_scene makes one of a name")
        yield scene


def _outcomes(team: "_Team") -> Iterator[tuple[Scene, Run | str]]:
    try:
        while team.due():
            yield team.take()
    finally:
        team.stop()


class _Team:
    """Workers and this process, the scenes that they have been given, and the outcomes that wait to be taken.

    A scene's number is its place among all scenes; outcomes are taken in its order.
    """

    def __init__(self, scenes: Iterator[Scene], run: Simulation, size: int, method: str | None):
        self._source, self._run, self._size, self._method = scenes, run, size, method
        self._workers: list[Worker] = []
        self._own: tuple[int, Iterator[Run | str | None]] | None = None  # what this process simulates
        self._scenes: dict[int, Scene] = {}  # pulled and not yet taken
        self._outcomes: dict[int, Run | str] = {}
        self._pulled = self._taken = 0
        self._exhausted = False
        self._error: Exception | None = None

    def due(self) -> bool:
        """Whether there is an outcome to take; work begins, if need be.

        An error of the iterable of scenes is raised when all that came before it has been taken.
        """
        self._give(1)
        if self._scenes or self._begin():
            return True
        if self._error is not None:
            raise self._error
        return False

    def take(self) -> tuple[Scene, Run | str]:
        """The next scene and its outcome."""
        self._serve()
        while self._taken not in self._outcomes:
            if self._own is None:
                self._collect(None)
            else:
                self._do_a_part()
            self._serve()
        number, self._taken = self._taken, self._taken + 1
        return self._scenes.pop(number), self._outcomes.pop(number)

    def stop(self) -> None:
        """End every worker, whatever it does."""
        self._own = None
        for worker in self._workers:  # all at once, and then wait
            worker.kill()
        for worker in self._workers:
            worker.forget()

    def _serve(self) -> None:
        """See to it that everyone has something to do: this process as well, unless it has an outcome to give."""
        self._collect(0.0)
        self._give(1)
        if self._own is None and self._taken not in self._outcomes:
            self._begin()
        self._give(MOST_GIVEN)

    def _pull(self) -> int | None:
        """Number of one more scene; None when there is none, or enough are ahead."""
        if self._exhausted or len(self._scenes) >= _AHEAD * self._size:
            return None
        try:
            scene = next(self._source)
        except StopIteration:
            self._exhausted = True
            return None
        except Exception as error:
            self._exhausted, self._error = True, error
            return None
        number, self._pulled = self._pulled, self._pulled + 1
        self._scenes[number] = scene
        return number

    def _begin(self) -> bool:
        """Begin a scene in this process; whether there is one."""
        number = self._pull()
        if number is not None:
            self._own = number, outcome_in_parts(self._run, self._scenes[number])
        return number is not None

    def _do_a_part(self) -> None:
        number, parts = self._own
        outcome = next(parts)
        if outcome is not None:
            self._outcomes[number], self._own = outcome, None

    def _give(self, enough: int) -> None:
        """Give scenes until every worker has `enough`: first to a new one, then to those with the least to do."""
        while True:
            free = min(self._workers, key=lambda worker: len(worker.given), default=None)
            new = (free is None or len(free.given) > 0) and len(self._workers) < self._size - 1
            if not new and (free is None or len(free.given) >= enough):
                return
            number = self._pull()
            if number is None:
                return
            if not self._workers:  # once for all that are forked
                compile_kernels(self._method or self._scenes[number]["solver.method"])
            if new:
                free = Worker(self._run, [worker.pipe for worker in self._workers])
                self._workers.append(free)
            free.give(number, self._scenes[number])

    def _collect(self, patience: float | None) -> None:
        by_pipe = {worker.pipe: worker for worker in self._workers if worker.given}
        for pipe in wait(list(by_pipe), patience):
            number, outcome = by_pipe[pipe].answer()
            self._outcomes[number] = outcome
