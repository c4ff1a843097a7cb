"""The runs of the study `paper`: the displacement of every robot under every reading, from several starts.

A *batch* is one robot under one reading, from all its starts. Batches are computed on all cores, and each is appended
to a file as soon as all before it are there, so that an interrupted study goes on where it stopped and leaves the
same bytes as one that was not interrupted.
"""

import csv
import functools
import hashlib
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from research.paper import readings, worksheet
from research.paper.readings import INSTANTS, STEPS, Point, Reading, instants, points
from vibro_ros.process.untrusted import content, opened, replace_file, write_all
from vibro_ros.simulation.processes import core_count, in_processes
from vibro_ros.simulation.provenance import software
from vibro_ros.simulation.simulator import Simulator

#: Speed at which the crank is turned to where it starts [rad/s]; a mass moves by 1e-4 m meanwhile.
TURNING_SPEED = 1e4
#: Most by which the crank is ahead in a start beside `zero` or `rest` [rad]: 0.9 mm of the slider's stroke of 40 mm.
NEAR = 0.1
#: Largest file of rows that is read [B]: twenty times a full study's.
LARGEST = 2**26
_COLUMNS = (*Reading._fields, *Point._fields, "start_number", *(f"x_{instant:g}_s" for instant in INSTANTS))


class Effort(NamedTuple):
    """How much is run.

    Attributes
    ----------
    readings : tuple of Reading
        The readings.
    exact_starts, worksheet_starts : int
        Starts of each robot under readings with `exact`, and under the others.
    """

    readings: tuple[Reading, ...]
    exact_starts: int
    worksheet_starts: int

    def starts(self, reading: Reading) -> int:
        """Number of starts under a reading."""
        return self.exact_starts if reading.solver == "exact" else self.worksheet_starts


class Batch(NamedTuple):
    """One robot under one reading, from `starts` starts."""

    reading: Reading
    point: Point
    starts: int


def full_effort() -> Effort:
    """Every reading; a quarter of an hour on two cores."""
    return Effort((*readings.exact_readings(), *readings.worksheet_readings()), 32, 6)


def quick_effort() -> Effort:
    """Every reading by `exact`, and Runge-Kutta of one step, from few starts; two minutes."""
    worksheets = (reading for reading in readings.worksheet_readings()
                  if reading.step == STEPS[1] and reading.friction == "eq5")
    return Effort((*readings.exact_readings(), *worksheets), 6, 4)


def batches(effort: Effort) -> list[Batch]:
    """All batches of a study, in the order of the file."""
    return [Batch(reading, point, effort.starts(reading)) for reading in effort.readings for point in points()]


def advance(start: str, number: int) -> float:
    """How far the crank is ahead when start `number` begins [rad].

    Start 0 of `zero` and of `rest` is the one that the name says; the others are near it. Those of `phase` are anywhere
    in the half turn in which the upper slider moves. In the other half the slider of a crank as long as its rod stands
    still, and starts there would be copies of one another, only later.
    """
    draw = np.random.default_rng((20, number))
    if start == "phase":
        return float(draw.uniform(-0.5 * math.pi, 0.5 * math.pi) % (2.0 * math.pi))
    return float(draw.uniform(0.0, NEAR)) if number else 0.0


def displacements(batch: Batch) -> np.ndarray:
    """Displacement of the body [m], shape (starts, instants); not finite where a worksheet diverges.

    Raises
    ------
    SimulationError
        If `exact` cannot go on.
    RuntimeError
        If the step of `Rkadapt` becomes too small.
    """
    one = functools.partial(_displacement, batch.reading, batch.point)
    return np.array([one(number) for number in range(batch.starts)])


def _displacement(reading: Reading, point: Point, number: int) -> np.ndarray:
    scene, ahead, times = reading.scene(point), advance(reading.start, number), np.array(instants(reading))
    if reading.solver == "rkfixed":
        return worksheet.rkfixed(scene, reading.friction, ahead, reading.step, times)
    if reading.solver == "Rkadapt":
        return worksheet.rkadapt(scene, reading.friction, ahead, times)
    device = Simulator(scene)
    if ahead:
        device.command(motor_speed=TURNING_SPEED)
        device.advance_to(ahead / TURNING_SPEED)
        device.command(motor_speed=scene["motor.speed"])
    return device.sample(times).body_position


def run_batches(wanted: Sequence[Batch]) -> Iterator[np.ndarray]:
    """Displacements of each batch in turn, computed on all cores; the kernels of `exact` are compiled before."""
    for reading in {batch.reading.solver: batch.reading for batch in wanted}.values():
        displacements(Batch(reading, Point("angle", 40.0), 1))  # compiles it once for all that are forked
    jobs = in_processes(displacements, wanted, core_count())
    try:
        for job in jobs:
            yield np.asarray(job.outcome())
    finally:
        jobs.close()


class RowFile:
    """A CSV file of displacements: a line that says what they are of, the columns' names, and a row for each start.

    Parameters
    ----------
    path : Path
        The file, which need not exist.
    effort : Effort
        The study that the rows belong to.

    Raises
    ------
    ValueError
        If the file holds rows of another study, or of other sources.
    OSError
        If the file cannot be read, or is no regular file.
    """

    def __init__(self, path: Path, effort: Effort):
        self._path, self._batches = path, batches(effort)
        self._head = f"# study paper, {len(self._batches)} batches, {_digest(effort)}\n{','.join(_COLUMNS)}\n"
        data = content(path, LARGEST) if os.path.lexists(path) else b""
        self._text = data.decode("ascii", errors="replace")
        if self._text and not (self._text.startswith(self._head) or self._head.startswith(self._text)):
            raise ValueError(f"{path}: rows of another study, or of another version; remove the file, or give another "
                             "--output")

    def done(self) -> list[np.ndarray]:
        """Displacements of the batches that the file holds whole; the rest of the file is dropped."""
        rows, found = self._text[len(self._head):].splitlines(keepends=True), list[np.ndarray]()
        kept, first = len(self._head), 0
        for batch in self._batches:
            lines = rows[first:first + batch.starts]
            values = _read(batch, lines)
            if values is None:
                break
            found.append(values)
            kept, first = kept + sum(map(len, lines)), first + batch.starts
        if self._text.startswith(self._head):
            os.truncate(self._path, kept)
        else:
            replace_file(self._path, self._head.encode())
        return found

    def append(self, results: Iterable[np.ndarray], first: int) -> Iterator[np.ndarray]:
        """Write each of `results`, from batch `first` on, to disk and yield it."""
        descriptor = opened(self._path, os.O_WRONLY | os.O_APPEND)
        try:
            for batch, values in zip(self._batches[first:], results, strict=True):
                write_all(descriptor, "".join(_lines(batch, values)).encode())
                yield values
        finally:
            os.close(descriptor)


def _digest(effort: Effort) -> str:
    """What the numbers depend on."""
    own = b"".join(Path(str(module.__file__)).read_bytes() for module in (readings, worksheet))
    parts = (repr(effort), software()["sources"], Path(__file__).read_text(encoding="utf-8"), own.hex())
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def _lines(batch: Batch, values: np.ndarray) -> Iterator[str]:
    for number, found in enumerate(values):
        cells = [*map(str, batch.reading), *map(str, batch.point), str(number), *(repr(float(x)) for x in found)]
        yield ",".join([*cells, *[""] * (len(_COLUMNS) - len(cells))]) + "\n"


def _read(batch: Batch, lines: Sequence[str]) -> np.ndarray | None:
    """The displacements of a batch in its lines; None where these are not whole, or another batch's."""
    count = len(instants(batch.reading))
    try:
        values = np.array([[float(cell) for cell in row[9:9 + count]] for row in csv.reader(lines)])
    except ValueError:
        return None
    if values.shape != (batch.starts, count) or "".join(_lines(batch, values)) != "".join(lines):
        return None
    return values
