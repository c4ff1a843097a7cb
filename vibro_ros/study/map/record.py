"""The record of a map, from which the same command goes on: one Parquet file a line, and one a row of ends."""

import hashlib
from functools import partial
from pathlib import Path

import pyarrow as pa

from vibro_ros.orbits.turn_map import coordinates
from vibro_ros.study.map.design import MapDesign
from vibro_ros.study.map.motions import End, Point, end_point
from vibro_ros.study.map.visits import PHASE, Visit, visits
from vibro_ros.study.running.blocks import BlockRun, Field, ParquetBlocks
from vibro_ros.study.running.runner import Piece, Runner

#: Folders of the two records.
LINES, ENDS = "lines", "ends"
_STATE = "state."  # begins the names of coordinates
_RUN_TIME = 20.0  # robot time [s] of a visit, and of an end, about
_VISIT = [
    Field("speed_index", pa.int64(), "1", "index of the motor speed in the grid"),
    Field("gap_index", pa.int64(), "1", "index of the gap in the grid"),
    Field("turns", pa.int64(), "1", "turns after which the motion repeats itself; 0: it does not; -1: it did not "
          "settle"),
    Field("landings", pa.int64(), "1", "landings of the body within these turns"),
    Field("mean_speed", pa.float64(), "m/s", "of the body, forwards positive"),
    Field("cost_of_transport", pa.float64(), "1", "mean power / (weight x speed)"),
    Field("stick_share", pa.float64(), "1", "share of the time in which the body stands on the ground"),
    Field("air_share", pa.float64(), "1", "share of the time in which the body is in the air"),
]
_POINT = [
    Field("kind", pa.string(), "1", "what becomes of the motion; null where its branch goes on or is lost"),
    Field("turns", pa.int64(), "1", "turns after which the motion repeats itself"),
    Field("motion", pa.int64(), "1", "number of the motion"),
    Field("direction", pa.int64(), "1", "1 towards larger motor speeds, -1 towards smaller"),
    Field("gap_index", pa.int64(), "1", "index of the gap in the grid"),
    Field("motor_speed", pa.float64(), "rad/s", "where that is"),
]


def visits_of(design: MapDesign, lines: Path, runner: Runner) -> list[Visit]:
    """All visits of a map; lines that are missing in the folder `lines` are swept (see `BlockRun.do`)."""
    every = design.lines()
    fields = [*_VISIT, *(Field(f"{_STATE}{name}", pa.float64(), f"crank.radius{' x motor.speed' * is_speed}",
                               f"{name} at the cut, crank angle {PHASE:.6g} rad")
                         for name in coordinates(design.scene) for is_speed in (name.endswith("velocity"),))]
    sizes = [len(list(design.cells(line))) for line in every]
    run = BlockRun("cells visited", ParquetBlocks(lines, design.document(), len(every), fields), sizes)
    run.do(lambda missing: runner(partial(rows_of_line, design), _RUN_TIME, ("exact",), (
        Piece(number, {}, (None,) * sizes[number]) for number in missing)))
    return [_visit(row) for row in run.whole.to_pylist()]


def rows_of_line(design: MapDesign, piece: Piece) -> list[dict]:
    """Sweep the line that a piece has the number of; a row a visit."""
    names = [f"{_STATE}{name}" for name in coordinates(design.scene)]
    return [{**one._asdict(), **dict(zip(names, one.state, strict=False))}
            for one in visits(design, design.lines()[piece.number])]


def _visit(row: dict) -> Visit:
    state = tuple(value for name, value in row.items() if name.startswith(_STATE) and value is not None)
    return Visit(**{one.name: row[one.name] for one in _VISIT}, state=state)


def points_of(design: MapDesign, ends: tuple[End, ...], folder: Path, runner: Runner) -> list[Point]:
    """The special point of each end that has one; points that are missing in the folder are looked for."""
    if not ends:
        return []
    document = {**design.document(), "ends": hashlib.sha256(repr(list(ends)).encode()).hexdigest()}
    run = BlockRun("ends of motions followed", ParquetBlocks(folder, document, len(ends), _POINT), [1] * len(ends))
    run.do(lambda missing: runner(partial(_row_of_end, design, ends), 20.0 * _RUN_TIME, ("exact",), (
        Piece(number, {}, (None,)) for number in missing)))
    points = [Point(**row) for row in run.whole.to_pylist()]
    return [point for point in points if point.kind is not None]


def _row_of_end(design: MapDesign, ends: tuple[End, ...], piece: Piece) -> list[dict]:
    return [end_point(design, ends[piece.number])._asdict()]
