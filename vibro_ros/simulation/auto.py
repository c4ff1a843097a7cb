"""`solver.method: auto`: the method and step of least counted work that keep a scene within `solver.accuracy`.

What is promised: during the first 0.2 s from the scene's start, without commands and, if its motor stands still, also
with `motor.max_speed` commanded at the start, body, height and both masses stay within `solver.accuracy` of where the
method exact has them.

Nothing is timed: errors are those of the very runs that are promised, on a grid finer than their steps, and costs are
counted (`work`). Every process picks the same.
"""

import contextlib
import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.counted_work import counted_work
from vibro_ros.simulation.kernels import compile_kernels
from vibro_ros.simulation.motion import Motion, SimulationError
from vibro_ros.simulation.stability import is_stable
from vibro_ros.solver.methods import SCHEMES

#: Length of the motions that are promised [s].
HORIZON = 0.2
#: What `solver.accuracy` is divided by: between two instants of the grid an error may be larger than at them.
SAFETY = 2.0
#: `exact` is left only for what costs less than this part of it: the weights of counted work are no better.
CLEARLY_LESS = 0.8
# Steps that are tried [s], the finest longer than the distance of two instants at which errors are looked at.
_COARSEST, _FINEST, _STEPS_A_DECADE = 1e-2, 1e-5, 4
_INSTANTS = 40_001
# Every so many of these instants are looked at first: what is off there need not be looked at closely.
_STRIDE = 200
_POSITIONS = ("body_position", "body_height", "upper_position", "inclined_position")


class Measured(NamedTuple):
    """A run: positions [m], shape (coordinates, n), not finite if it cannot go on; its steps and its events."""

    positions: np.ndarray
    steps: int
    events: int


#: Runs a scene, with a motor speed commanded at its start if one is given, through instants [s] from 0.
Measure = Callable[[Scene, float | None, np.ndarray], Measured]


class Candidate(NamedTuple):
    """A method of fixed step [s], its largest error of a position [m], and its counted work [s per simulated s]."""

    method: str
    step: float
    error: float
    cost: float


@dataclass(frozen=True)
class Choice:
    """What `auto` has picked.

    Attributes
    ----------
    method : str
        A `solver.method`.
    step : float
        Its `solver.step` [s]; infinite for `exact`, which has none.
    error : float
        Largest error of a position in the motions that are promised [m], measured against `exact`.
    cost, exact_cost : float
        Counted work by it and by `exact` [s per simulated s].
    cheaper : Candidate or None
        What costs next less: of all steps tried that cost less, the one with the smallest error.
    """

    method: str
    step: float
    error: float
    cost: float
    exact_cost: float
    cheaper: Candidate | None = None

    def __str__(self):
        if self.method == "exact":
            return (f"exact: no step of fixed length keeps the accuracy for less than {CLEARLY_LESS:g} of its counted "
                    "work")
        return (f"{self.method} with a step of {self.step:.3g} s: off by {self.error:.2g} m within {HORIZON:g} s, for "
                f"{self.cost / self.exact_cost:.2g} of exact's counted work")


@functools.lru_cache(maxsize=64)
def choose_method(scene: Scene) -> Choice:
    """What `solver.method` auto picks for `scene`; the same in every process."""
    compile_kernels("auto")
    return choose(scene, measured)


def measured(scene: Scene, speed: float | None, times: np.ndarray) -> Measured:
    """Run `scene` by its own method; a `Measure`."""
    motion = Motion(scene)
    try:
        if speed is not None:
            motion.command(scene.checked_motor_speed(speed), {})
        found = motion.sampled(np.ascontiguousarray(times))  # kernels are compiled for such arrays alone
    except SimulationError:
        return Measured(np.full((len(_POSITIONS), len(times)), math.nan), 0, 0)
    return Measured(np.array([found[name] for name in _POSITIONS]), motion.steps, len(motion.events.take()))


def choose(scene: Scene, measure: Measure) -> Choice:
    """Pick for `scene`; the same in every process."""
    trial = Trial(scene, measure)
    tried = [candidate for name in SCHEMES for candidate in _allowed(trial.down_to_accurate(name))]
    kept = [candidate for candidate in tried if candidate.error <= trial.limit]
    exact = Candidate("exact", math.inf, 0.0, trial.exact_cost)
    picked = min([exact, *kept], key=lambda candidate: candidate.cost)
    cheaper = next_cheaper(picked.cost, tried)
    return Choice(*picked, trial.exact_cost, cheaper and trial.looked_at_closely(cheaper))


def next_cheaper(cost: float, tried: list[Candidate]) -> Candidate | None:
    """Of the candidates that cost less than `cost` and do not diverge, the one with the smallest error."""
    less = [candidate for candidate in tried if candidate.cost < cost and math.isfinite(candidate.error)]
    return min(less, key=lambda candidate: candidate.error, default=None)


def chosen(scene: Scene, choice: Choice) -> Scene:
    """`scene` with the method and step of `choice`."""
    step = {} if choice.method == "exact" else {"solver.step": choice.step}
    return scene.with_parameters({"solver.method": choice.method, **step})


def promised_commands(scene: Scene) -> tuple[float | None, ...]:
    """Motor speeds [rad/s] commanded at the start of the motions that are promised; None for no command."""
    return (None, scene["motor.max_speed"]) if scene["motor.speed"] == 0.0 else (None,)


class Trial:
    """Methods of fixed step in the promised motions of one scene.

    Attributes
    ----------
    limit : float
        The error that is kept to [m].
    exact_cost : float
        Counted work of the method exact [s per simulated s].
    """

    def __init__(self, scene: Scene, measure: Measure):
        self._scene, self._measure = scene, measure
        self._commands = promised_commands(scene)
        self._times = np.linspace(0.0, HORIZON, _INSTANTS)
        self.limit = scene["solver.accuracy"] / SAFETY
        exact = scene.with_parameters({"solver.method": "exact"})
        runs = [measure(exact, command, self._times) for command in self._commands]
        self._references = [run.positions for run in runs]
        self.exact_cost = self._cost(exact, runs)

    def down_to_accurate(self, method: str) -> Iterator[Candidate]:
        """Steps of `method` that cost clearly less than exact, from the coarsest to the first that is accurate."""
        for step in _ladder():
            candidate = self._tried(method, step)
            if candidate.cost > CLEARLY_LESS * self.exact_cost:
                return
            if math.isfinite(candidate.error):
                yield candidate
            if candidate.error <= self.limit:
                return

    def looked_at_closely(self, candidate: Candidate) -> Candidate:
        """`candidate` with its error at every instant of the grid."""
        return candidate._replace(error=self._error(self._by(candidate.method, candidate.step)))

    def _by(self, method: str, step: float) -> Scene:
        return self._scene.with_parameters({"solver.method": method, "solver.step": step})

    def _tried(self, method: str, step: float) -> Candidate:
        scene = self._by(method, step)
        cost = counted_work(scene, round(HORIZON / step)) / HORIZON
        if cost > CLEARLY_LESS * self.exact_cost or not is_stable(scene, method, step):
            return Candidate(method, step, math.inf, cost)
        error = self._error(scene, _STRIDE)
        return Candidate(method, step, self._error(scene) if error <= self.limit else error, cost)

    def _error(self, scene: Scene, stride: int = 1) -> float:
        """Largest error [m] in the promised motions, at every instant of the grid or at each of `stride`."""
        times = self._times[::stride]
        found = (self._measure(scene, command, times).positions for command in self._commands)
        return max(_off(positions, reference[:, ::stride])
                   for positions, reference in zip(found, self._references, strict=True))

    def _cost(self, scene: Scene, runs: list[Measured]) -> float:
        works = [counted_work(scene, run.steps, run.events, command is not None)
                 for run, command in zip(runs, self._commands, strict=True)]
        return sum(works) / len(works) / HORIZON


def _allowed(candidates: Iterator[Candidate]) -> Iterator[Candidate]:
    """`candidates` up to the first whose method the scene refuses."""
    with contextlib.suppress(ValueError):
        yield from candidates


def _ladder() -> list[float]:
    """Steps [s] from coarse to fine."""
    count = round(_STEPS_A_DECADE * math.log10(_COARSEST / _FINEST))
    return [_COARSEST * 10.0 ** (-k / _STEPS_A_DECADE) for k in range(count + 1)]


def _off(positions: np.ndarray, reference: np.ndarray) -> float:
    error = float(np.abs(positions - reference).max())
    return error if math.isfinite(error) else math.inf
