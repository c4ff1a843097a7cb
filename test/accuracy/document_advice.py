"""What docs/accuracy.md advises, read back from its text, and held against the rows of docs/accuracy/accuracy.csv."""

import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from vibro_ros.accuracy.findings import NEEDS, Need
from vibro_ros.accuracy.measurement import NEED, Measurement
from vibro_ros.accuracy.precision import COMPILED

_USE = re.compile(r"(\w+)(?: ([\d.e-]+)(?: s)?)? \(([\d.]+)\)")


@dataclass(frozen=True)
class Advised:
    """A use that a cell of the table names: in a scene, for a need, a method, its setting and its cost."""

    scene: str
    need: Need
    method: str
    value: float
    cost: float


def rows_of(file: Path) -> list[Measurement]:
    """The rows of a table."""
    kinds = {field.name: field.type for field in fields(Measurement)}
    read = {"str": str, "float": float, "int": int, str: str, float: float, int: int}
    with file.open(encoding="utf-8") as lines:
        return [Measurement(**{name: read[kinds[name]](cell) for name, cell in line.items()})
                for line in csv.DictReader(lines)]


def advised(text: str) -> Iterator[Advised]:
    """Every use that the table under "Which method for what" names."""
    table = text.partition("## Which method for what")[2].partition("\n## ")[0]
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:1] == "|"]
    heads = lines[0]
    for cells in lines[2:]:
        for need in NEEDS:
            for method, value, cost in _USE.findall(cells[heads.index(need.words)]):
                yield Advised(cells[0].strip("`"), need, method, float(value or "nan"), float(cost))


def complaints(text: str, rows: Sequence[Measurement]) -> list[str]:
    """Uses that their rows deny: too inaccurate there or at a finer setting, not the coarsest, or of another cost."""
    found = []
    for use in advised(text):
        own = sorted((row for row in rows if (row.scene, row.compared, row.method, row.horizon) == (
            use.scene, NEED, use.method, use.need.horizon)), key=lambda row: row.value)
        here = [row for row in own if not abs(row.value / use.value - 1.0) > 0.02]  # exact has no value
        finer = [row for row in own if here and row.value <= here[0].value]
        coarser = [row for row in own if here and row.value > here[0].value]
        if not here or any(not error_of(row, use.need) < use.need.limit for row in finer):
            found.append(f"{use}: missed")
        elif coarser and error_of(coarser[0], use.need) < use.need.limit:
            found.append(f"{use}: a coarser one does, too")
        elif not math.isclose(here[0].cost, use.cost, rel_tol=0.06):
            found.append(f"{use}: costs {here[0].cost:g}")
    return found


def error_of(row: Measurement, need: Need) -> float:
    """A row's error for a need, by the words of the need and the columns of the table."""
    if "contact" in need.words:
        return row.event_error
    parts = [row.body_error, row.height_error] + [row.mass_error] * ("every position" in need.words)
    return math.nan if any(map(math.isnan, parts)) else max(parts)


def left_out(text: str, rows: Sequence[Measurement]) -> list[str]:
    """Needs that a method meets at its finest setting and that the table does not name any method for."""
    named = {(use.scene, use.need.words) for use in advised(text)}
    missing = []
    for need in NEEDS:
        for row in rows:
            finest = row.compared == NEED and row.horizon == need.horizon and row.method in COMPILED and not any(
                other.value < row.value for other in rows if (other.scene, other.compared, other.method, other.horizon)
                == (row.scene, row.compared, row.method, row.horizon))
            if finest and error_of(row, need) < need.limit and (row.scene, need.words) not in named:
                missing.append(f"{row.scene}: {need.words}: {row.method}")
    return missing
