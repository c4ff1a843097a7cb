"""The runs of a sweep: pieces of a few rows, with the same numbers on every machine, stored in Parquet files."""

import itertools
import math
import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pyarrow as pa

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.measures import MEASURES, measure
from vibro_ros.study.running.blocks import BlockRun, Field, ParquetBlocks
from vibro_ros.study.running.runner import PIECE, Piece, Results, Runner, Work
from vibro_ros.study.sweep.design import Design

FOLDER = "blocks"
#: How the error of a row begins whose point is no legal scene.
NO_SCENE = "no such scene: "
_TYPES = {float: pa.float64(), bool: pa.bool_(), str: pa.string()}


def run_sweep(design: Design, folder: Path, runner: Runner) -> BlockRun:
    """All blocks of a design, in a folder that nobody else writes into; those that are missing are computed.

    Raises
    ------
    ValueError, OSError, RuntimeError
        As `BlockRun.do`.
    """
    blocks = ParquetBlocks(folder, design.document(), design.blocks, fields_of(design))
    run = BlockRun("sweep", blocks, [len(design.rows_of_block(block)) for block in range(design.blocks)])

    def compute(missing: list[int]) -> Results:
        items = itertools.chain.from_iterable(pieces(design, block) for block in missing)
        varied = next((axis.values for axis in design.axes if axis.name == "solver.method"), None)
        return runner(work_of(design), design.settling + design.duration,
                      varied or (design.scene["solver.method"],), items)

    run.do(compute)
    return run


def work_of(design: Design) -> Work:
    """What is done with every piece of a design."""
    return partial(rows_of, design.scene, design.measures, design.settling, design.duration)


def rows_of(scene: Scene, measures: tuple[str, ...], settling: float, duration: float, piece: Piece) -> list[dict]:
    """Run a piece; a row a start, with NaN and the reason where it cannot go on. Times [s] as `measure` takes them."""
    rows = [{"point": piece.number, "start": start, **piece.changes, **dict.fromkeys(measures, math.nan),
             "error": None, "warning": None} for start in piece.starts]
    try:
        scene = scene.with_parameters(piece.changes)
    except ValueError as error:
        return [{**row, "error": f"{NO_SCENE}{error}"} for row in rows]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ToleranceWarning)  # it stands in the row
        for row, start in zip(rows, piece.starts, strict=True):
            row["warning"] = scene.broken_promise or None
            try:
                row.update(measure(scene, measures, settling, duration, start))
            except SimulationError as error:
                row["error"] = str(error)
    return rows


def pieces(design: Design, block: int) -> Iterator[Piece]:
    """The pieces of a block, in the order of its rows."""
    rows = design.rows_of_block(block)
    first = rows.start
    while first < rows.stop:
        point = design.point_of(first)
        end = min(rows.stop, first + PIECE, (point + 1) * max(design.starts, 1))
        yield Piece(point, design.changes(point), tuple(map(design.start_of, range(first, end))))
        first = end


def fields_of(design: Design) -> list[Field]:
    """The columns: what varies, and what was measured."""
    return [
        Field("point", pa.int64(), "1", "number of the combination of parameters"),
        Field("start", pa.int64(), "1", "number of the drawn start; null for the scene's own"),
        *(Field(name, _TYPES[type(BY_NAME[name].default)], BY_NAME[name].unit or "1", BY_NAME[name].description)
          for name in design.names),
        *(Field(name, pa.float64(), MEASURES[name].unit, MEASURES[name].meaning) for name in design.measures),
        Field("error", pa.string(), "1", "why the row has no values; else null"),
        Field("warning", pa.string(), "1", "what is to be known about the values; else null"),
    ]
