"""All rows of one scene: its Lyapunov exponent, the check of its reference, trajectories, requirements, mean speeds.

Because of chaos, trajectories can be compared for five Lyapunov times. Beyond, mean speeds over drawn starts are
compared. A motor that stands in the scene gets its command at t = 0 of a long run, which leads `device` to its usual
motion; in shorter runs it turns from the start, so that the masses meet their plates.
"""

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from vibro_lab.accuracy.harness import (
    AVERAGE,
    CANNOT,
    DIVERGES,
    EXPONENT,
    INSTANTS,
    REFERENCE,
    REQUIRED,
    TRAJECTORY,
    Effort,
    Row,
    SceneProblem,
    errors,
    machine,
    off_every_grid,
    row_of,
    rows,
)
from vibro_lab.accuracy.programs import DEVICE, PLAIN, Program, Setting, UnableError
from vibro_lab.orbits.attractors import group_starts
from vibro_lab.orbits.chaos import exponent_of_pairs, half_interval
from vibro_lab.orbits.recurrence import SettledMotion
from vibro_lab.orbits.starts import SETTLING, STARTING, motor_command, running, started_at_share
from vibro_lab.study.execution import Execution
from vibro_lab.study.measures import drift_in, measure_with_motion
from vibro_ros import Scene, SimulationError, core_count

#: Horizons [s] of requirements: a short one, which chaos allows in all scenes, and a long one.
SHORT, LONG = 0.2, 10.0
#: Longest horizon [s] of trajectories, in seconds and in Lyapunov times, after which an initial error has grown
#: e^5 = 150 times.
LONGEST_HORIZON, LYAPUNOV_TIMES = 1.0, 5.0
#: The device's methods of fixed step whose mean speeds are measured, and the steps [s].
AVERAGED, AVERAGE_STEPS = ("rk4", "rk4_located"), (1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5, 5e-6, 2e-6, 1e-6)
_PAIR_DURATION, _PAIRS = 15.0, 24  # duration [s] and number of the pairs of nearby motions
# Factor on the starts of `exact`, because its mean is cheap and the other methods are compared with it.
_MORE_STARTS = 4
# m/s, about the speed of sound: the method of a faster body has diverged.
_DIVERGED = 300.0
#: Default check of the reference: another integrator with another location of events. It uses the same tables of the
#: model.
OWN_CHECK = (DEVICE["rk4_located"], Setting(1e-6, "step 1e-06 s", is_step=True))


@dataclass(frozen=True)
class LyapunovTime:
    """Rate of separation of nearby motions."""

    rate: float  # largest Lyapunov exponent [1/s], the mean over pairs
    spread: float  # half its 95 % interval [1/s]
    chaotic: bool  # most pairs have separated, and the exponent is positive beyond its interval
    duration: float  # longest time for which a pair was observed [s]

    @property
    def time(self) -> float:
        """Lyapunov time [s]; infinite if the scene is not chaotic."""
        return 1.0 / self.rate if self.chaotic else math.inf

    @property
    def comparable(self) -> float:
        """Time [s] for which trajectories can be compared; without chaos the time of observation."""
        return min(self.duration, LYAPUNOV_TIMES * self.time)

    def __str__(self):
        if self.chaotic:
            return f"Lyapunov time {self.time:.2g} s (exponent {self.rate:.2g} ± {self.spread:.1g} 1/s): chaotic"
        return f"no chaos seen: motions that start close stay close for {self.duration:g} s"

    def row(self, scene: str) -> Row:
        """Return it as a row, whose `starts_forwards` is 1 for a chaotic scene, else 0."""
        return Row(scene, EXPONENT, "exact", PLAIN, "as it comes", math.nan, self.duration, _PAIRS, mean=self.rate,
                   low=self.rate - self.spread, high=self.rate + self.spread, starts_forwards=int(self.chaotic),
                   measured_on=machine())


def lyapunov_time_in(rows_of_scene: Sequence[Row]) -> LyapunovTime:
    """Return the Lyapunov time of a scene from its rows."""
    row = next(row for row in rows_of_scene if row.compared == EXPONENT)
    return LyapunovTime(row.mean, row.high - row.mean, bool(row.starts_forwards), row.horizon)


def lyapunov_time(scene: Scene, duration: float = _PAIR_DURATION, starts: int = _PAIRS) -> LyapunovTime:
    """Estimate the largest Lyapunov exponent of the masses' motion from pairs of exact runs; the motor turns."""
    scene = scene.with_parameters({"solver.method": "exact", "solver.accounts": False})
    rates = np.array([
        exponent_of_pairs(started_at_share(scene, k / starts, motor_command(scene)[1]), STARTING, duration)[0]
        for k in range(starts)])
    mean, spread = float(rates.mean()), float(half_interval(rates))
    chaotic = bool(2 * np.count_nonzero(rates) > starts and mean > spread)
    return LyapunovTime(mean, spread, chaotic, duration)


def rows_of_scene(scene: Scene, programs: Mapping[str, Program], effort: Effort,
                  checks: Sequence[tuple[Program, Setting]] = (OWN_CHECK,)) -> Iterator[Row]:
    """Measure a scene row by row; the reference is checked by the first of `checks` that can simulate the scene."""
    chaos = lyapunov_time(running(scene))
    yield chaos.row(scene.name)
    horizon = effort.horizon or math.floor(min(LONGEST_HORIZON, chaos.comparable) * 20.0) / 20.0 or 0.05
    for compared, length in ((TRAJECTORY, horizon), (REQUIRED, SHORT), (REQUIRED, LONG)):
        if compared == REQUIRED and length > chaos.comparable:
            continue
        # A short run with a motor that stands would be its ramp alone; a long one leads as users begin it.
        problem = SceneProblem.within(scene if length == LONG else running(scene), length)
        yield check_reference(problem, checks)
        for program in programs.values():
            yield from rows(problem, program, effort, compared)
    yield from averages_of_scene(running(scene), effort)


def check_reference(problem: SceneProblem, checks: Sequence[tuple[Program, Setting]]) -> Row:
    """Return the row of the reference's errors against the first of `checks` that can simulate the problem."""
    horizon, reasons = float(problem.times[-1]), list[str]()
    instants = off_every_grid(horizon, INSTANTS)
    for program, setting in checks:
        row = replace(row_of(problem, program, setting, REFERENCE), repeats=1)
        try:
            answer = program.prepare(problem.at(instants), setting)()
        except UnableError as error:
            reasons.append(str(error))
            continue
        return row.with_errors(errors(answer, problem.reference(instants), horizon))
    return Row(problem.name, REFERENCE, "none", PLAIN, "", math.nan, horizon, note="; ".join(reasons))


def averages_of_scene(scene: Scene, effort: Effort) -> Iterator[Row]:
    """Yield the mean speeds by `exact`, then by each method of fixed step until a step would exhaust the patience."""
    yield from averages(scene, "exact", math.nan, effort)
    for name in AVERAGED:
        last_step, duration = math.inf, 0.0
        for step in AVERAGE_STEPS:
            if math.isfinite(last_step) and duration * last_step / step > effort.patience_for_averages:
                break
            began = time.perf_counter()
            measured = averages(scene, name, step, effort)
            yield from measured
            if math.isfinite(measured[0].mean):
                last_step, duration = step, time.perf_counter() - began


def averages(scene: Scene, method: str, step: float, effort: Effort) -> list[Row]:
    """Measure the mean speed of each motion that drawn starts lead to with a method, that of most starts first."""
    exact = method == "exact"
    starts = effort.starts * (_MORE_STARTS if exact else 1)
    row = Row(scene.name, AVERAGE, method, PLAIN, "as it comes" if exact else f"step {step:g} s", step, effort.duration,
              starts, measured_on=machine())
    steps = {} if exact else {"solver.step": step}
    scene = scene.with_parameters({"solver.method": method, "solver.accounts": False, **steps})
    runs = Execution(core_count()).rows(partial(_settled, scene, effort.duration), range(starts),
                                        SETTLING + effort.duration)
    try:
        with closing(runs):
            measured, motions, drifts = zip(*runs, strict=True)
    except SimulationError as error:
        return [replace(row, repeats=0, outcome=CANNOT, note=str(error))]
    speeds = np.array(measured)
    if not np.abs(speeds).max() < _DIVERGED:
        return [replace(row, outcome=DIVERGES, note=f"diverged: faster than {_DIVERGED:g} m/s")]
    motions_found, indices = group_starts(motions, measured)
    averaged = []
    for index, attractor in enumerate(motions_found):
        chosen, drift = speeds[indices == index], 0.0
        if not attractor.turns:
            drift = drift_in(np.array(drifts)[indices == index], float(chosen.mean()))
        low, high = np.quantile(chosen, (0.05, 0.95))
        averaged.append(replace(
            row, repeats=len(chosen), mean=float(chosen.mean()), low=float(low), high=float(high),
            motions=len(motions_found), starts_forwards=int(np.sum(chosen > 0.0)),
            note=f"drifts by {1e3 * drift:.2g} mm/s" if drift else ""))
    return averaged


def _settled(scene: Scene, duration: float, number: int) -> tuple[float, SettledMotion | None, float]:
    """Mean speed [m/s] of start `number` over `duration` [s] after `SETTLING`, its motion or None, and its drift."""
    values, motion, drift = measure_with_motion(scene, ("mean_speed",), SETTLING, duration, number)
    return values["mean_speed"], motion, drift
