"""Verdicts as a CSV file: a row for each reading and span, with the outcomes of the claims and every mean speed."""

import csv
import io
from collections.abc import Iterable
from pathlib import Path

from research.paper.claims import CLAIMS, Mean, Verdict
from research.paper.readings import UNITS, Reading, Span, points
from vibro_ros.process.untrusted import replace_file

_OUTCOMES = ("one_run", "along_ox", "size")
_POINTS = tuple(points())
_COLUMNS = (*Reading._fields, "begin_s", "end_s", *(f"{kind}: {claim.name}" for kind in _OUTCOMES for claim in CLAIMS),
            *(f"{part}: {point.series} {point.value:g} {UNITS[point.series]}" for point in _POINTS
              for part in ("mean m/s", "spread m/s")))


def write_verdicts(path: Path, told: Iterable[Verdict]) -> None:
    """Write `told` to a file, whole or not at all; six digits of each speed."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for one in told:
        speeds = (f"{number:.6g}" for point in _POINTS for number in one.means[point])
        writer.writerow([*one.reading, *one.span, *one.one_run, *one.along_ox, *one.size, *speeds])
    replace_file(path, text.getvalue().encode())


def read_verdicts(path: Path) -> list[Verdict]:
    """The verdicts in a file of `write_verdicts`.

    Raises
    ------
    ValueError
        If the file has other columns.
    """
    with path.open(encoding="utf-8", newline="") as file:
        columns, *rows = csv.reader(file)
    if tuple(columns) != _COLUMNS:
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
