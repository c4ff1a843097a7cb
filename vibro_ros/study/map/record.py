"""The record of a map, from which the same command goes on: one Parquet file a line, and one a row of ends."""

import hashlib
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pyarrow as pa

from vibro_ros.orbits.turn_map import coordinates
from vibro_ros.study.map.design import MapDesign
from vibro_ros.study.map.motions import End, Point, end_point
from vibro_ros.study.map.visits import PHASE, Visit, visits
from vibro_ros.study.running.blocks import BlockRun, Column, ParquetBlocks
from vibro_ros.study.running.runner import Piece, Runner

#: Folders of the two records.
LINES, ENDS = "lines", "ends"
_STATE = "state."  # begins the names of coordinates
_RUN_TIME = 20.0  # robot time [s] of a visit, and of an end, about
_VISIT = {
    "speed_index": (pa.int64(), "1", "index of the motor speed in the grid"),
    "gap_index": (pa.int64(), "1", "index of the gap in the grid"),
    "turns": (pa.int64(), "1", "turns after which the motion repeats itself; 0: it does not; -1: it did not settle"),
    "landings": (pa.int64(), "1", "landings of the body within these turns"),
    "mean_speed": (pa.float64(), "m/s", "of the body, forwards positive"),
    "cost_of_transport": (pa.float64(), "1", "mean power / (weight x speed)"),
    "stick_share": (pa.float64(), "1", "share of the time in which the body stands on the ground"),
    "air_share": (pa.float64(), "1", "share of the time in which the body is in the air"),
}
_POINT = {
    "kind": (pa.string(), "1", "what becomes of the motion; null where its branch goes on or is lost"),
    "turns": (pa.int64(), "1", "turns after which the motion repeats itself"),
    "motion": (pa.int64(), "1", "number of the motion"),
    "direction": (pa.int64(), "1", "1 towards larger motor speeds, -1 towards smaller"),
    "gap_index": (pa.int64(), "1", "index of the gap in the grid"),
    "motor_speed": (pa.float64(), "rad/s", "where that is"),
}


def visits_of(design: MapDesign, lines: Path, runner: Runner) -> list[Visit]:
    """All visits of a map; lines that are missing in the folder `lines` are swept (see `BlockRun.do`)."""
    every = design.lines()
    run = BlockRun("cells visited", _LineBlocks(lines, design), [len(list(design.cells(line))) for line in every])
    run.do(lambda missing: runner(
        partial(visits_of_piece, design), _RUN_TIME, ("exact",),
        (Piece({"line": number}, (None,) * len(list(design.cells(every[number])))) for number in missing)))
    return [_visit(row) for row in run.whole.to_pylist()]


def visits_of_piece(design: MapDesign, piece: Piece) -> list[Visit]:
    """Sweep the line of a piece."""
    return visits(design, design.lines()[piece.changes["line"]])  # type: ignore[index]


def points_of(design: MapDesign, ends: tuple[End, ...], folder: Path, runner: Runner) -> list[Point]:
    """The special point of each end that has one; points that are missing in the folder are looked for."""
    if not ends:
        return []
    document = {**design.document(), "ends": hashlib.sha256(repr(list(ends)).encode()).hexdigest()}
    run = BlockRun("ends of motions followed", _EndBlocks(folder, document, len(ends)), [1] * len(ends))
    run.do(lambda missing: runner(
        partial(_points_of_piece, design, ends), 20.0 * _RUN_TIME, ("exact",),
        (Piece({"end": number}, (None,)) for number in missing)))
    points = [Point(**row) for row in run.whole.to_pylist()]
    return [point for point in points if point.kind is not None]


def _points_of_piece(design: MapDesign, ends: tuple[End, ...], piece: Piece) -> list[Point]:
    return [end_point(design, ends[piece.changes["end"]])]  # type: ignore[index]


class _LineBlocks(ParquetBlocks[list]):
    """A row a visit, with a column for each coordinate of its state."""

    def __init__(self, folder: Path, design: MapDesign):
        super().__init__(folder, design.document(), len(design.lines()))
        self._design, self._coordinates = design, coordinates(design.scene)

    def columns(self, block: int, found: Sequence[list]) -> list[Column]:
        rows = [row for piece in found for row in piece]
        states = zip(*[row.state or (None,) * len(self._coordinates) for row in rows], strict=True)
        return _columns(rows, _VISIT) + [
            Column(f"{_STATE}{name}", pa.array(values, pa.float64()), f"crank.radius{' x motor.speed' * is_speed}",
                   f"{name} at the cut, crank angle {PHASE:.6g} rad")
            for name, values in zip(self._coordinates, states, strict=True)
            for is_speed in (name.endswith("velocity"),)]


class _EndBlocks(ParquetBlocks[list]):
    """A row an end."""

    def columns(self, block: int, found: Sequence[list]) -> list[Column]:
        return _columns([row for piece in found for row in piece], _POINT)


def _columns(rows: list, kinds: dict[str, tuple[pa.DataType, str, str]]) -> list[Column]:
    return [Column(name, pa.array([getattr(row, name) for row in rows], kind), unit, meaning)
            for name, (kind, unit, meaning) in kinds.items()]


def _visit(row: dict) -> Visit:
    state = tuple(value for name, value in row.items() if name.startswith(_STATE) and value is not None)
    return Visit(**{name: row[name] for name in _VISIT}, state=state)
