"""Measured rows of a work–precision study: what each method and setting costs, and how far off it is."""

import math
import statistics
import time as wall_clock
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from vibro_ros.accuracy.measurement import AVERAGE, NEED, REFERENCE, TRAJECTORY, Errors, Measurement, errors
from vibro_ros.accuracy.methods import (
    BASELINE,
    METHODS,
    Answer,
    ComparedMethod,
    UnableError,
)
from vibro_ros.accuracy.starts import average, speeds_of_starts
from vibro_ros.model.scene import Scene
from vibro_ros.model.support import unsupported
from vibro_ros.orbits.chaos import exponent_of_pairs
from vibro_ros.orbits.starts import STARTING, motor_command, started_at_share
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.solver.methods import SCHEMES

#: Samples per second of robot time in the runs whose cost is measured.
RATE = 1000.0
#: Time [s] that the median cost of a round is taken over, at least.
LEAST_TIME = 0.1
#: Instants at which errors are looked for, in each horizon; they lie off all grids of samples and steps.
INSTANTS = 50_000
#: Motor speed [rad/s] of a study of a scene whose motor stands still, if it may turn so fast.
RUNNING_SPEED = 100.0
#: Steps [s] at which mean speeds are measured.
AVERAGE_STEPS = (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5, 5e-6, 2e-6, 1e-6)
#: Horizons [s] of what is asked for: a short one, which chaos allows everywhere, and a long one.
SHORT, LONG = 0.2, 10.0
# The golden ratio's part beyond one: multiples of it lie in all parts of an interval alike.
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_OF_BASELINE = 1001  # samples that the baseline is run for at most
_FINEST_EXACT, _FINEST_LOCATED = 1e-12, 1e-13  # tolerances
_MOST_EVALUATIONS = 3e5  # a second, of DOP853 as a check: the shipped scenes need up to 7e4
# Starts for the exact mean, times those of the others: it is what they are measured against, and cheap.
_MORE_STARTS = 4
# m/s, about that of sound: a body that is faster has no mean speed, its method has diverged.
_DIVERGED = 300.0


class Check(NamedTuple):
    """An independent method that checks the reference: its name, an `Answer` of it, and its finest tolerance."""

    name: str
    run: Callable[[Scene, np.ndarray, float], Answer]
    tolerance: float


#: scipy's DOP853 with located events, on the tables that the exact method integrates.
BY_DOP853 = Check("DOP853", partial(METHODS["DOP853"].run, most_evaluations=_MOST_EVALUATIONS), _FINEST_LOCATED)


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes
    ----------
    repeats : int
        Rounds of each row, each of runs for `LEAST_TIME`; costs are medians.
    horizon : float or None
        Time over which trajectories are compared [s]; by the Lyapunov time if None.
    patience : float
        Time [s] of one run after which its method's ladder goes no further; steps that are expected to take longer are
        not tried. Nothing is repeated after a quarter of it: a long run's time has less scatter.
    patience_for_averages : float
        The same time [s] for all starts of a mean speed.
    thorough : tuple of str
        Methods whose mean speeds are measured at every step, however long it takes.
    starts : int
        Starts of a mean speed, at least 2; the spread between them does not shrink with their duration.
    duration : float
        Time of each start that counts [s].
    checks : tuple of Check
        Independent methods, the most accurate first; the first that has the scene checks the reference.
    baseline : ComparedMethod
        What costs are ratios to, with the step of its ladder, each of whose steps costs the same.
    """

    repeats: int = 5
    horizon: float | None = None
    patience: float = 2.0
    patience_for_averages: float = 8.0
    thorough: tuple[str, ...] = ()
    starts: int = 32
    duration: float = 5.0
    checks: tuple[Check, ...] = (BY_DOP853,)
    baseline: ComparedMethod = BASELINE


def running(scene: Scene) -> Scene:
    """`scene`, its motor turning from the start at `RUNNING_SPEED` if it stands still there."""
    if scene["motor.speed"]:
        return scene
    return scene.with_parameters({"motor.speed": min(RUNNING_SPEED, scene["motor.max_speed"])})


def off_every_grid(horizon: float, count: int) -> np.ndarray:
    """Instants [s], shape (count + 1,), from 0 to `horizon`, ascending: one in each part of it, nowhere the same part.

    On a grid an error between its instants would go unseen, and one between a method's steps as well.
    """
    k = np.arange(count)
    instants = (k + np.mod(_GOLDEN * k, 1.0)) * (horizon / count)
    return np.append(instants, horizon)


class Comparison:
    """Trajectories of a scene within one horizon.

    Attributes
    ----------
    scene : Scene
        What is simulated.
    times : ndarray, shape (n,)
        Instants [s] at which runs are sampled whose cost is measured.
    instants : ndarray, shape (m,)
        Instants [s] at which trajectories are compared, in runs of their own; see `off_every_grid`.
    reference : Answer
        By the exact method, at `instants`.
    uncertainty : Measurement
        Errors of the reference against the first of `Effort.checks` that has the scene, named there.
    """

    def __init__(self, scene: Scene, horizon: float, effort: Effort, kind: str = TRAJECTORY):
        self.scene, self._effort, self._kind = scene, effort, kind
        self.times = np.arange(max(1, round(horizon * RATE)) + 1) / RATE
        self.horizon = float(self.times[-1])
        self.instants = off_every_grid(self.horizon, INSTANTS)
        self.reference = METHODS["exact"](scene, self.instants, _FINEST_EXACT)
        self.uncertainty = self._uncertainty()

    def rows(self, methods: Mapping[str, ComparedMethod]) -> Iterator[Measurement]:
        """The reference's uncertainty, then each method's ladder."""
        self._baseline()  # what is compiled at first use is not its cost
        yield self.uncertainty
        for name, method in methods.items():
            yield from self._ladder(name, method)

    def _row(self, compared: str, name: str, setting: str, value: float, **numbers) -> Measurement:
        return Measurement(self.scene.name, compared, name, setting, value, self.horizon, **{"repeats": 1} | numbers)

    def _uncertainty(self) -> Measurement:
        reasons = []
        for check in self._effort.checks:
            try:
                found = check.run(self.scene, self.instants, check.tolerance)
            except UnableError as error:
                reasons.append(str(error))
                continue
            return self._row(REFERENCE, check.name, "tolerance", check.tolerance,
                             **_named(errors(self.reference, found)))
        return self._row(REFERENCE, "none", "tolerance", math.nan, note="; ".join(reasons))

    def _ladder(self, name: str, method: ComparedMethod) -> Iterator[Measurement]:
        try:  # what is compiled at first use is not the method's cost
            method(self.scene, self.times[:2], method.ladder[0])
        except UnableError:
            pass
        before, seconds = math.inf, 0.0
        for value in method.ladder:
            if _expected(method.setting, before, seconds, value) > self._effort.patience:
                return
            began = wall_clock.perf_counter()
            row = self._measured(name, method, value)
            yield row
            seconds = row.wall_time if math.isfinite(row.wall_time) else wall_clock.perf_counter() - began
            before = value if math.isfinite(row.wall_time) else math.inf
            if seconds > self._effort.patience:
                return

    def _measured(self, name: str, method: ComparedMethod, value: float) -> Measurement:
        walls: list[float] = []
        ratios: list[float] = []
        try:
            while len(walls) < self._effort.repeats and sum(walls) <= self._effort.patience / 4.0:
                walls.append(typical(lambda: method(self.scene, self.times, value).wall_time))
                ratios.append(walls[-1] / (walls[-1] if name == "baseline" else self._baseline()))
            off = self._errors(name, method, value)
        except UnableError as error:
            return self._row(self._kind, name, method.setting, value, repeats=0, note=str(error))
        if not off.finite:
            return self._row(self._kind, name, method.setting, value, repeats=len(walls), note="positions not finite")
        return self._row(self._kind, name, method.setting, value, repeats=len(walls), cost=statistics.median(ratios),
                         wall_time=statistics.median(walls), **_named(off))

    def _errors(self, name: str, method: ComparedMethod, value: float) -> Errors:
        if name != "baseline":
            return errors(method(self.scene, self.instants, value), self.reference)
        ends = np.arange(round(self.horizon / (2.0 * value)) + 1) * (2.0 * value)  # it knows nothing between its steps
        return errors(method(self.scene, ends, value), METHODS["exact"](self.scene, ends, _FINEST_EXACT))

    def _baseline(self) -> float:
        """Wall time of the baseline now [s]; NaN where it lacks an effect."""
        times = self.times[:_OF_BASELINE]
        try:
            wall_time = self._effort.baseline(self.scene, times, self._effort.baseline.ladder[0]).wall_time
            return wall_time * self.horizon / float(times[-1])
        except UnableError:
            return math.nan


class SceneStudy:
    """The study of one scene; `rows` measures, everything before it is the reference.

    Attributes
    ----------
    scene : Scene
        As loaded, but running.
    growth : Growth
        Its chaos.
    comparison : Comparison
        Within the horizon that chaos allows, or that was asked for.
    """

    def __init__(self, scene: Scene, effort: Effort):
        self.scene = scene = running(scene)
        self._effort = effort
        self.growth: Growth = growth(scene)
        horizon = effort.horizon or math.floor(self.growth.horizon * 20.0) / 20.0 or 0.05
        self.comparison = Comparison(scene, horizon, effort)

    @property
    def needs(self) -> tuple[float, ...]:
        """Horizons [s] of needs that chaos allows."""
        return tuple(horizon for horizon in (SHORT, LONG) if horizon <= self.growth.comparable)

    def count(self, methods: Mapping[str, ComparedMethod]) -> int:
        """Number of rows that are tried at most."""
        rungs = {name: len(method.ladder) for name, method in methods.items()}
        averages = [1 if name == "exact" else len(AVERAGE_STEPS) for name in _devices(self.scene, methods)]
        needs = sum(1 + sum(len(method.ladder) for method in self._asked(horizon, methods).values())
                    for horizon in self.needs)
        return 1 + sum(rungs.values()) + needs + sum(averages)

    def rows(self, methods: Mapping[str, ComparedMethod]) -> Iterator[Measurement]:
        """Measure row by row: trajectories within the horizon, within those of needs, then mean speeds."""
        yield from self.comparison.rows(methods)
        for horizon in self.needs:
            asked = self._asked(horizon, methods)
            if asked:
                yield from Comparison(self.scene, horizon, self._effort, NEED).rows(asked)
        for name in _devices(self.scene, methods):
            yield from self._averages(name)

    def _asked(self, horizon: float, methods: Mapping[str, ComparedMethod]) -> dict[str, ComparedMethod]:
        """The methods that are compared within the horizon of a need, and the baseline, whose error is reported."""
        asked = {name: method for name, method in methods.items() if method.compiled}
        return asked | ({"baseline": self._effort.baseline} if asked and horizon == SHORT else {})

    def _averages(self, name: str) -> Iterator[Measurement]:
        if name == "exact":
            yield self._average(name, "tolerance", METHODS["exact"].ladder[-1], {}, _MORE_STARTS)
            return
        before, seconds = math.inf, 0.0
        patience = math.inf if name in self._effort.thorough else self._effort.patience_for_averages
        for step in AVERAGE_STEPS:
            if _expected("step", before, seconds, step) > patience:
                return
            row = self._average(name, "step", step, {"solver.step": step})
            yield row
            before, seconds = (step, row.wall_time) if math.isfinite(row.wall_time) else (before, seconds)

    def _average(self, name: str, kind: str, value: float, parameters: dict, more: int = 1) -> Measurement:
        duration, starts = self._effort.duration, more * self._effort.starts
        row = Measurement(self.scene.name, AVERAGE, name, kind, value, duration, repeats=starts)
        scene = self.scene.with_parameters(parameters | {"solver.method": name, "solver.audit": False})
        began = wall_clock.perf_counter()
        try:
            found = average(speeds_of_starts(scene, duration, starts))
        except SimulationError as error:
            return replace(row, repeats=0, note=str(error))
        row = replace(row, wall_time=wall_clock.perf_counter() - began)
        if not abs(found.mean) + found.spread < _DIVERGED:
            return replace(row, note=f"diverged: faster than {_DIVERGED:g} m/s")
        return replace(row, mean_speed=found.mean, mean_speed_spread=found.spread, starts_forwards=found.positive)


def typical(timed: Callable[[], float]) -> float:
    """Median of the wall times [s] that `timed` returns, one a run, of as many runs as fit into `LEAST_TIME`.

    A single run of milliseconds would be measured with caches that the run before it left cold, or with what else the
    machine did just then.
    """
    began, times = wall_clock.perf_counter(), []
    while wall_clock.perf_counter() - began < LEAST_TIME:
        times.append(timed())
    return statistics.median(times)


def _devices(scene: Scene, methods: Mapping[str, ComparedMethod]) -> list[str]:
    """The device's own methods that have `scene`, whose mean speeds are measured."""
    return [name for name in methods if name == "exact" or name in SCHEMES and not (
        name == "moreau" and unsupported(scene, name))]


def _expected(setting: str, before: float, seconds: float, value: float) -> float:
    """Time [s] that a setting will take after one that took `seconds`: steps cost by their number."""
    return seconds * before / value if setting == "step" and math.isfinite(before) else 0.0


def _named(off: Errors) -> dict[str, float]:
    return {"body_error": off.body, "height_error": off.height, "mass_error": off.masses, "event_error": off.events,
            "speed_error": off.speed}


#: Longest horizon [s] of a comparison by every method, and how many Lyapunov times it may have: an error of the first
#: instant has grown e^5 = 150 times by then.
LONGEST_HORIZON, LYAPUNOV_TIMES = 1.0, 5.0


@dataclass(frozen=True)
class Growth:
    """How fast nearby motions part.

    Attributes
    ----------
    rate, spread : float
        Largest Lyapunov exponent [1/s] and its 95 % confidence interval's half width, over starts.
    chaotic : bool
        Whether most pairs have parted and the exponent is positive beyond its interval.
    duration : float
        Time that each pair was watched for at most [s].
    """

    rate: float
    spread: float
    chaotic: bool
    duration: float

    @property
    def lyapunov_time(self) -> float:
        """[s]; infinite if no growth was seen."""
        return 1.0 / self.rate if self.chaotic else math.inf

    @property
    def comparable(self) -> float:
        """Time [s] within which trajectories can be compared; as far as was watched where there is no chaos."""
        return min(self.duration, LYAPUNOV_TIMES * self.lyapunov_time)

    @property
    def horizon(self) -> float:
        """Time [s] within which they are."""
        return min(LONGEST_HORIZON, self.comparable)

    def __str__(self):
        if self.chaotic:
            return (f"Lyapunov time {self.lyapunov_time:.2g} s (exponent {self.rate:.2g} ± {self.spread:.1g} 1/s): "
                    f"chaotic")
        return f"no chaos seen: motions that start close stay close for {self.duration:g} s"


def growth(scene: Scene, duration: float = 15.0, starts: int = 24) -> Growth:
    """Estimate the largest Lyapunov exponent of the masses' motion from pairs of exact runs; the motor turns."""
    scene = scene.with_parameters({"solver.method": "exact", "solver.audit": False})
    rates = np.array([
        exponent_of_pairs(started_at_share(scene, k / starts, motor_command(scene)[1]), STARTING, duration)[0]
        for k in range(starts)])
    rate = average(rates)
    chaotic = bool(2 * np.count_nonzero(rates) > starts and rate.mean > rate.spread)
    return Growth(rate.mean, rate.spread, chaotic, duration)
