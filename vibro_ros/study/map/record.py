"""The record of a map, from which the same command goes on: one Parquet file a line, and one a row of ends."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from vibro_ros.configuration.command_map import CURVES as CURVE_KINDS
from vibro_ros.orbits.turn_map import coordinates
from vibro_ros.study.map.curves import End, Point, end_point
from vibro_ros.study.map.design import MapDesign
from vibro_ros.study.map.visit import PHASE, Visit, visits
from vibro_ros.study.running.block_run import BlockRun
from vibro_ros.study.running.parquet_blocks import Column, ParquetBlocks
from vibro_ros.study.running.pieces import Piece
from vibro_ros.study.running.runner import Runner

STUDY, CURVES = "map", "map_curves"
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


@dataclass(frozen=True)
class LineWork:
    """Sweeps lines of a design; for processes and clusters."""

    design: MapDesign
    study: str = STUDY
    run_time: float = _RUN_TIME

    def __call__(self, piece: Piece) -> list[Visit]:
        """Sweep the line of a piece."""
        return visits(self.design, self.design.lines()[piece.changes["line"]])


@dataclass(frozen=True)
class EndWork:
    """Follows motions to their ends; for processes and clusters."""

    design: MapDesign
    ends: tuple[End, ...]
    study: str = CURVES
    run_time: float = 20.0 * _RUN_TIME

    def __call__(self, piece: Piece) -> list[Point]:
        """Follow the motion of a piece."""
        return [end_point(self.design, self.ends[piece.changes["end"]])]


class _LineBlocks(ParquetBlocks[list]):
    """A row a visit, with a column for each coordinate of its state."""

    def __init__(self, folder: Path, design: MapDesign):
        super().__init__(folder, STUDY, design.document(), len(design.lines()))
        self._design, self._coordinates = design, coordinates(design.scene)

    def is_own(self, block: int, table: pa.Table) -> bool:
        """Whether the rows can be the visits of this line."""
        try:
            rows = [_visit(row) for row in table.to_pylist()]
            cells = list(self._design.cells(self._design.lines()[block]))
            return [(row.speed_index, row.gap_index) for row in rows] == cells and self.is_of(block, table, [rows])
        except (LookupError, TypeError, ValueError, OverflowError):
            return False

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

    def is_own(self, block: int, table: pa.Table) -> bool:
        """Whether the row can be an end."""
        try:
            rows = [Point(**row) for row in table.to_pylist()]
            return len(rows) == 1 and rows[0].kind in (None, *CURVE_KINDS) and self.is_of(block, table, [rows])
        except (LookupError, TypeError, ValueError, OverflowError):
            return False

    def columns(self, block: int, found: Sequence[list]) -> list[Column]:
        return _columns([row for piece in found for row in piece], _POINT)


def _columns(rows: list, kinds: dict[str, tuple[pa.DataType, str, str]]) -> list[Column]:
    return [Column(name, pa.array([getattr(row, name) for row in rows], kind), unit, meaning)
            for name, (kind, unit, meaning) in kinds.items()]


def _visit(row: dict) -> Visit:
    state = tuple(value for name, value in row.items() if name.startswith(_STATE) and value is not None)
    return Visit(**{name: row[name] for name in _VISIT}, state=state)


def line_run(design: MapDesign, folder: Path) -> BlockRun[list]:
    """The lines of a map, a block each, in a folder that nobody else writes into."""
    lengths = [len(list(design.cells(line))) for line in design.lines()]
    return BlockRun("cells visited", _LineBlocks(folder, design), lengths)


def sweep_lines(run: BlockRun[list], design: MapDesign, runner: Runner) -> list[Visit]:
    """All visits of a map; those of the lines that are missing are made (RuntimeError as `BlockRun.do_missing`)."""
    lines = design.lines()

    def compute(missing: list[int]) -> Iterator[list[Visit]]:
        items = (Piece({"line": number}, (None,) * len(list(design.cells(lines[number])))) for number in missing)
        return runner(LineWork(design), ("exact",), items)

    run.do_missing(compute)
    return [_visit(row) for number in range(len(lines)) for row in run.tables[number].to_pylist()]


def end_run(design: MapDesign, ends: Sequence[End], folder: Path) -> BlockRun[list]:
    """The ends of motions, a block each, in a folder that nobody else writes into."""
    digest = hashlib.sha256(repr(list(ends)).encode()).hexdigest()
    document = {**design.document(), "ends": digest}
    return BlockRun("ends of motions followed", _EndBlocks(folder, CURVES, document, len(ends)), [1] * len(ends))


def follow_ends(run: BlockRun[list], design: MapDesign, ends: Sequence[End], runner: Runner) -> list[Point]:
    """The special point of each end that has one; missing ones are looked for (RuntimeError as `do_missing`)."""
    def compute(missing: list[int]) -> Iterator[list[Point]]:
        return runner(EndWork(design, tuple(ends)), ("exact",), (Piece({"end": number}, (None,)) for number in missing))

    run.do_missing(compute)
    points = [Point(**row) for number in range(len(ends)) for row in run.tables[number].to_pylist()]
    return [point for point in points if point.kind is not None]
