"""`solver.method: auto`: the method and step of least counted work that keep a scene within `solver.accuracy`.

What is promised: during the first 0.2 s from the scene's start, without commands and, if its motor stands still, also
with `motor.max_speed` commanded at the start, body, height and both masses stay within `solver.accuracy` of where the
method exact has them.

Nothing is timed, because a clock gives another answer in every process: errors are those of the very runs that are
promised, on a grid finer than their steps, and costs are counts of steps, segments and events by fixed weights. So
every process picks the same.
"""

import contextlib
import functools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.simulation.kernels import compile_kernels
from vibro_ros.simulation.motion import Motion, SimulationError

#: Length of the motions that are promised [s].
HORIZON = 0.2
#: What `solver.accuracy` is divided by: between two instants of the grid an error may be larger than at them.
SAFETY = 2.0
#: Weight of a step of fixed length, by scheme [µs a channel of the scene]. The weights are those of one machine, and
#: only their ratios matter: `python -m tools.work_weights` measures them, and how far counted work is from time.
#: `rk4_located` is left out: `exact` locates the same events for less.
STEP_WEIGHTS: Mapping[str, float] = {"rk4": 0.024, "semi_implicit_euler": 0.009, "moreau": 0.019}
#: Weights of the method exact: of a segment and of an event; and of a segment besides, if its energy is balanced, if a
#: friction that decays is followed, or if the motor's speed is on a ramp or lags [µs a channel].
EXACT_WEIGHTS: Mapping[str, float] = {"segment": 0.075, "event": 0.05, "audited": 0.04, "decaying": 0.02,
                                      "ramping": 0.08, "lagging": 0.04}
#: `exact` is left only for what costs less than this part of it: the weights of counted work are no better.
CLEARLY_LESS = 0.8
# Steps that are tried [s], the finest longer than the distance of two instants at which errors are looked at.
_COARSEST, _FINEST, _STEPS_A_DECADE = 1e-2, 1e-5, 4
_INSTANTS = 40_001
# Every so many of these instants are looked at first: what is off there need not be looked at closely.
_STRIDE = 200
# By how much a spectral radius of 1 may be exceeded, by rounding.
_ROUNDING = 1e-9
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
    if scene.has_rotor:  # steps of fixed length evaluate all that its series need, more often than the series do
        return Choice("exact", math.inf, 0.0, 1.0, 1.0)
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
    trial, tried = Trial(scene, measure), list[Candidate]()
    for name in STEP_WEIGHTS:
        with contextlib.suppress(ValueError):  # of a method that the scene refuses
            tried.extend(trial.down_to_accurate(name))
    accurate = [candidate for candidate in tried if candidate.error <= trial.limit]
    exact = Candidate("exact", math.inf, 0.0, trial.exact_cost)
    picked = min([exact, *accurate], key=lambda candidate: candidate.cost)
    cheaper = min((candidate for candidate in tried if candidate.cost < picked.cost),
                  key=lambda candidate: candidate.error, default=None)
    return Choice(*picked, trial.exact_cost, cheaper and trial.looked_at_closely(cheaper))


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
        works = [counted_work(exact, run.steps, run.events, command is not None)
                 for run, command in zip(runs, self._commands, strict=True)]
        self.exact_cost = sum(works) / len(works) / HORIZON

    def down_to_accurate(self, method: str) -> Iterator[Candidate]:
        """Steps of `method` that cost clearly less than exact, from the coarsest to the first that is accurate."""
        for step in _ladder():
            scene = self._by(method, step)
            cost = counted_work(scene, round(HORIZON / step)) / HORIZON
            if cost > CLEARLY_LESS * self.exact_cost:
                return
            error = self._error(scene, _STRIDE) if is_stable(scene, method, step) else math.inf
            if error <= self.limit:
                error = self._error(scene)
            if math.isfinite(error):
                yield Candidate(method, step, error, cost)
            if error <= self.limit:
                return

    def looked_at_closely(self, candidate: Candidate) -> Candidate:
        """`candidate` with its error at every instant of the grid."""
        return candidate._replace(error=self._error(self._by(candidate.method, candidate.step)))

    def _by(self, method: str, step: float) -> Scene:
        return self._scene.with_parameters({"solver.method": method, "solver.step": step})

    def _error(self, scene: Scene, stride: int = 1) -> float:
        times = self._times[::stride]
        errors = [float(np.abs(self._measure(scene, command, times).positions - reference[:, ::stride]).max())
                  for command, reference in zip(self._commands, self._references, strict=True)]
        return max(error if math.isfinite(error) else math.inf for error in errors)


def _ladder() -> list[float]:
    count = round(_STEPS_A_DECADE * math.log10(_COARSEST / _FINEST))
    return [_COARSEST * 10.0 ** (-k / _STEPS_A_DECADE) for k in range(count + 1)]


def counts_of_exact(scene: Scene, segments: int, events: int, speeding: bool) -> dict[str, float]:
    """What `EXACT_WEIGHTS` weigh in a run of `scene` by the method exact; `speeding` if its motor's speed changes."""
    channels = compile_scene(scene).forms.channels
    size, motor = channels.count, scene["effects.motor"] if speeding else "ideal"
    return {"segment": size * segments, "event": size * events,
            "audited": size * segments * scene["solver.audit"], "decaying": size * segments * channels.decays,
            "ramping": size * segments * (motor == "ramp"), "lagging": size * segments * (motor == "lag")}


def counted_work(scene: Scene, steps: int, events: int = 0, speeding: bool = False) -> float:
    """Counted work [s] of a run of `scene` by its own `solver.method`.

    Parameters
    ----------
    scene : Scene
        What was run.
    steps, events : int
        The run's `statistics["steps"]` and, of `exact`, its number of events.
    speeding : bool
        Whether the motor's speed changed during the run.
    """
    if scene["solver.method"] == "exact":
        counts = counts_of_exact(scene, steps, events, speeding)
        return 1e-6 * sum(EXACT_WEIGHTS[name] * count for name, count in counts.items())
    return 1e-6 * STEP_WEIGHTS[scene["solver.method"]] * compile_scene(scene).forms.channels.count * steps


def is_stable(scene: Scene, scheme: str, step: float) -> bool:
    """Whether no mode of `scene` lets steps of `step` [s] by `scheme` grow faster than its motion does.

    A step that a plate's stiffness makes unstable is accurate until the first contact, and overflows then.
    """
    if scheme == "moreau":  # springs, dampers and contacts are implicit
        return True
    model = compile_scene(scene)
    channels, rows = model.forms.channels, model.system.acceleration
    dynamic, first = channels.dynamic, channels.coordinates
    matrices = np.zeros((len(rows), 2 * dynamic, 2 * dynamic))  # A of y' = A y, coordinates and velocities, by mode
    matrices[:, :dynamic, dynamic:] = np.eye(dynamic)
    matrices[:, dynamic:, :dynamic] = rows[:, :dynamic, :dynamic]
    matrices[:, dynamic:, dynamic:] = rows[:, :dynamic, first:first + dynamic]
    for matrix in matrices:
        growth = float(np.exp(max(0.0, step * np.linalg.eigvals(matrix).real.max())))  # of the motion itself
        if _amplification(matrix, scheme, step) > growth * (1.0 + _ROUNDING):
            return False
    return True


def _amplification(matrix: np.ndarray, scheme: str, step: float) -> float:
    """Spectral radius of a step."""
    unit, part = np.eye(len(matrix)), step * matrix
    if scheme == "rk4":
        grown = unit + part @ (unit + part / 2.0 @ (unit + part / 3.0 @ (unit + part / 4.0)))
    else:
        half = len(matrix) // 2
        grown = unit
        grown[half:] += part[half:]
        grown[:half] += step * grown[half:]
    return float(np.abs(np.linalg.eigvals(grown)).max())
