"""What a diagram has found: a row a visit, ranges of one kind of motion, and regions of hysteresis."""

import io
import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vibro_ros.study.diagram.chain import Visit
from vibro_ros.study.diagram.design import DOWN, UP, Design
from vibro_ros.study.running.origin import sources
from vibro_ros.study.running.parquet_blocks import KEY


class Range(NamedTuple):
    """Neighbouring values of one direction with one period, all within a region of hysteresis or all outside.

    Attributes
    ----------
    direction : str
        `UP` or `DOWN`.
    low, high : float
        The first and the last of the values, in the parameter's unit.
    visits : tuple of int
        Numbers of their visits, by value.
    """

    direction: str
    low: float
    high: float
    visits: tuple[int, ...]


class Region(NamedTuple):
    """Neighbouring values at which the motion found upwards is another one than that found downwards.

    Attributes
    ----------
    low, high : float
        The first and the last of the values, in the parameter's unit.
    places : tuple of int
        Places of the values.
    """

    low: float
    high: float
    places: tuple[int, ...]


@dataclass(frozen=True)
class Diagram:
    """A diagram that is done.

    Attributes
    ----------
    design : Design
        What was asked.
    visits : tuple of Visit
        By their numbers.
    natures : Table or None
        What was measured of each; None where nothing was.
    """

    design: Design
    visits: tuple[Visit, ...]
    natures: pa.Table | None

    def of(self, direction: str) -> tuple[Visit, ...]:
        """The visits of a direction, by value."""
        count = len(self.design.axis.values)
        return self.visits[:count] if direction == UP else self.visits[:count - 1:-1]

    def nature(self, column: str, visit: int) -> float:
        """What was measured of a visit, a column of its table; NaN where nothing was."""
        return float(self.natures[column][visit].as_py()) if self.natures is not None else float("nan")

    def differ(self) -> list[bool]:
        """For each value, whether the motions found upwards and downwards are settled, and two."""
        return [up.settled and down.settled and not up.motion.is_same(down.motion)
                for up, down in zip(self.of(UP), self.of(DOWN), strict=True)]

    def hysteresis(self) -> list[Region]:
        """Regions of two motions, by value."""
        values, regions = self.design.axis.values, []
        for is_two, places in _runs(range(len(values)), self.differ().__getitem__):
            if is_two:
                regions.append(Region(float(values[places[0]]), float(values[places[-1]]), tuple(places)))
        return regions

    def ranges(self) -> list[Range]:
        """Ranges of one period, of both directions, by value."""
        values, two = self.design.axis.values, self.differ()
        found = []
        for direction in (UP, DOWN):
            of_direction = self.of(direction)
            keys = [(kind(one), is_two) for one, is_two in zip(of_direction, two, strict=True)]
            for _, places in _runs(range(len(values)), keys.__getitem__):
                found.append(Range(direction, float(values[places[0]]), float(values[places[-1]]),
                                   tuple(of_direction[place].number for place in places)))
        return found


def kind(visit: Visit) -> str:
    """How a motion repeats itself, in words."""
    if not visit.settled:
        return "not settled"
    turns = visit.motion.turns
    return "not periodic" if not turns else "every turn" if turns == 1 else f"every {turns} turns"


def states_table(design: Design, blocks: Sequence[pa.Table]) -> bytes:
    """All states, as one Parquet file."""
    return _file(pa.concat_tables([block.replace_schema_metadata() for block in blocks]), design)


def values_table(found: Diagram) -> bytes:
    """A row a visit, as one Parquet file."""
    design, two = found.design, found.differ()
    first = {
        "visit": pa.array([one.number for one in found.visits], pa.int64()),
        "direction": pa.array([design.direction(one.number) for one in found.visits], pa.string()),
        design.axis.name: pa.array([design.value(one.number) for one in found.visits], pa.float64()),
        "period": pa.array([one.motion.turns for one in found.visits], pa.int64()),
        "settled": pa.array([one.settled for one in found.visits], pa.bool_()),
        "after": pa.array([one.motion.after for one in found.visits], pa.int64()),
        "mean_speed": pa.array([one.motion.mean_speed for one in found.visits], pa.float64()),
        "two_motions": pa.array([two[design.place(one.number)] for one in found.visits], pa.bool_()),
    }
    natures = found.natures.drop_columns(["visit"]) if found.natures is not None else None
    rest = dict(zip(natures.column_names, natures.columns, strict=True)) if natures is not None else {}
    return _file(pa.table({**first, **rest}), design)


def _file(table: pa.Table, design: Design) -> bytes:
    about = json.dumps({**sources("diagram"), "design": design.document()}, ensure_ascii=False).encode()
    sink = io.BytesIO()
    pq.write_table(table.replace_schema_metadata({KEY: about}), sink, compression="zstd", write_page_checksum=True)
    return sink.getvalue()


def _runs(places: Sequence[int], key: Callable[[int], object]) -> Iterator[tuple[object, list[int]]]:
    """Neighbouring places with one key."""
    for value, run in itertools.groupby(places, key):
        yield value, list(run)


def extent(values: Sequence[float]) -> tuple[float, float]:
    """Least and largest of some values, of which none need be finite: NaN then."""
    finite = [value for value in values if np.isfinite(value)]
    return (min(finite), max(finite)) if finite else (float("nan"), float("nan"))
