"""Runs of the study: displacements of every robot under every reading, from several starts, and the verdicts.

A *batch* is one robot under one reading, from all its starts. Batches are computed on all cores.
"""

import csv
import functools
import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import vibro_ros
from research.paper import worksheet
from research.paper.claims import (
    ANY_PHASE,
    CLAIMS,
    ON_SLIDERS,
    STEPS,
    UNITS,
    FigurePoint,
    Mean,
    Reading,
    Span,
    Verdict,
    exact_readings,
    instants,
    points,
    score,
    single_scores,
    slider_readings,
    verdicts,
    worksheet_readings,
)
from research.starts import computed

#: Speed at which the crank is turned to its starting angle [rad/s]; a mass moves by 1e-4 m meanwhile.
TURNING_SPEED = 1e4
#: Largest advance of the crank in a start near `zero` or `rest` [rad]: 0.9 mm of the slider's stroke of 40 mm.
NEAR = 0.1


class SimulationEffort(NamedTuple):
    """Amount of simulation."""

    readings: tuple[Reading, ...]
    exact_starts: int  # number of starts of each robot under readings with `exact`
    worksheet_starts: int  # the same under the other readings

    def starts(self, reading: Reading) -> int:
        """Number of starts under a reading."""
        return self.exact_starts if reading.solver == "exact" else self.worksheet_starts


class Batch(NamedTuple):
    """One robot under one reading, from `starts` starts, until an instant [s]."""

    reading: Reading
    point: FigurePoint
    starts: int
    until: float = math.inf


def full_effort() -> SimulationEffort:
    """Return the full effort: every reading; a quarter of an hour on two cores."""
    return SimulationEffort((*exact_readings(), *worksheet_readings(), *slider_readings()), 32, 6)


def quick_effort() -> SimulationEffort:
    """Return a small effort: readings with `exact`, and Runge-Kutta with one step, from few starts; two minutes."""
    worksheets = (reading for reading in worksheet_readings()
                  if reading.step == STEPS[1] and reading.friction == "eq5")
    return SimulationEffort((*exact_readings(), *worksheets, *slider_readings()), 6, 4)


def batches(effort: SimulationEffort) -> list[Batch]:
    """Return all batches of a study, reading by reading."""
    return [Batch(reading, point, effort.starts(reading)) for reading in effort.readings for point in points()]


def advance(start: str, number: int) -> float:
    """Advance of the crank at the begin of start `number` [rad].

    Start 0 near `zero` or `rest` is that state itself. Starts of `any phase` lie anywhere in the half turn in which the
    upper slider moves. In the other half the slider of a crank as long as its rod stands still, and starts there would
    only be delayed copies of one another.
    """
    draw = np.random.default_rng((20, number))
    if start == ANY_PHASE:
        return float(draw.uniform(-0.5 * math.pi, 0.5 * math.pi) % (2.0 * math.pi))
    return float(draw.uniform(0.0, NEAR)) if number else 0.0


def displacements(batch: Batch) -> np.ndarray:
    """Compute the displacements of the body [m], shape (starts, instants); not finite where a worksheet diverges."""
    times = np.array([instant for instant in instants(batch.reading) if instant <= batch.until])
    displacement = functools.partial(_displacement, batch.reading, batch.point, times)
    return np.array([displacement(number) for number in range(batch.starts)])


def _displacement(reading: Reading, point: FigurePoint, times: np.ndarray, number: int) -> np.ndarray:
    scene, ahead = reading.scene(point), advance(reading.start, number)
    if reading.solver == "rkfixed":
        return worksheet.rkfixed(scene, reading.friction, ahead, reading.step, times)
    if reading.solver == "Rkadapt":
        return worksheet.rkadapt(scene, reading.friction, ahead, times)
    device = vibro_ros.Simulator(scene)
    if ahead:
        device.command(motor_speed=TURNING_SPEED)
        device.advance_to(ahead / TURNING_SPEED)
        device.command(motor_speed=scene["motor.speed"])
        if reading.start == ON_SLIDERS:
            device.set_state(**masses_on_sliders(device))
    return device.sample(times).body_position


def masses_on_sliders(device: vibro_ros.Simulator) -> dict[str, float]:
    """State of the masses of the paper's robot, which has no dampers, at rest on their sliders or plates [m, m/s]."""
    scene, now, state = device.scene, device.state, dict[str, float]()
    for side in scene.guides:
        stretch = getattr(now, f"{side}_drive_force") / scene[f"{side}.spring.stiffness"]
        plate = scene[f"crank.{side}_rod"] + scene[f"{side}.gap"]
        state |= {f"{side}_position": min(getattr(now, f"{side}_position") + stretch, plate), f"{side}_velocity": 0.0}
    return state


def judged(effort: SimulationEffort) -> list[Verdict]:
    """Run the study, and judge every claim under every reading of `effort`."""
    every = batches(effort)
    for reading in {batch.reading.solver: batch.reading for batch in every}.values():
        displacements(Batch(reading, FigurePoint("angle", 40.0), 1))  # compiles the method once for all processes
    moved = iter(computed(displacements, every, "paper: robots"))
    return [verdict for reading in effort.readings
            for verdict in verdicts(reading, {point: next(moved) for point in points()})]


class Single(NamedTuple):
    """A reading and a span for which all claims hold in the first start alone, and how often they do in other starts.
    """

    equations: str
    normal_force: str
    start: str
    begin: float
    end: float
    runs: int
    full: int


def single_runs(judgements: Iterable[Verdict], runs: int = 300) -> list[Single]:
    """Simulate `runs` starts of each reading of the corrected equations whose first start alone gives all claims."""
    singles = []
    for verdict in judgements:
        reading = verdict.reading
        if (reading.solver, reading.equations) == ("exact", "corrected") and reading.start != ON_SLIDERS \
                and score(verdict.one_run) == len(CLAIMS):
            robots = list(points())
            moved = computed(displacements, [Batch(reading, point, runs, verdict.span.end) for point in robots],
                             f"paper: {reading.normal_force} {reading.start}")
            scores = single_scores(dict(zip(robots, moved, strict=True)), verdict.span)
            singles.append(Single(reading.equations, reading.normal_force, reading.start, *verdict.span, runs,
                                  int(np.sum(scores == len(CLAIMS)))))
    return singles


_OUTCOMES = ("one_run", "along_ox", "size")
_POINTS = tuple(points())
_VERDICT_COLUMNS = (
    *Reading._fields, "begin_s", "end_s", *(f"{kind}: {claim.name}" for kind in _OUTCOMES for claim in CLAIMS),
    *(f"{part}: {point.series} {point.value:g} {UNITS[point.series]}" for point in _POINTS
      for part in ("mean m/s", "spread m/s")))


def write_verdicts(path: Path, judgements: Iterable[Verdict]) -> None:
    """Write verdicts to a file, speeds with six digits."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_VERDICT_COLUMNS)
        for verdict in judgements:
            speeds = (f"{number:.6g}" for point in _POINTS for number in verdict.means[point])
            writer.writerow([*verdict.reading, *verdict.span, *verdict.one_run, *verdict.along_ox, *verdict.size,
                             *speeds])


def read_verdicts(path: Path) -> list[Verdict]:
    """Read the verdicts from a file of `write_verdicts` (ValueError if it has other columns)."""
    with path.open(encoding="utf-8", newline="") as file:
        columns, *rows = csv.reader(file)
    if tuple(columns) != _VERDICT_COLUMNS:
        raise ValueError(f"{path}: columns of another version; run the study again")
    return [_verdict(row) for row in rows]


def _verdict(row: list[str]) -> Verdict:
    solver, step, *words = row[:6]
    first, count = 8, len(CLAIMS)
    one_run, along_ox, size = (tuple(row[first + k * count:first + (k + 1) * count]) for k in range(len(_OUTCOMES)))
    numbers = [float(cell) for cell in row[first + len(_OUTCOMES) * count:]]
    means = {point: Mean(*numbers[2 * k:2 * k + 2]) for k, point in enumerate(_POINTS)}
    reading, span = Reading(solver, float(step), *words), Span(float(row[6]), float(row[7]))
    return Verdict(reading, span, one_run, along_ox, size, means)
