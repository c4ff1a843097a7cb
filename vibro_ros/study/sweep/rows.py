"""The runs of a sweep: pieces of a few rows, each simulated by whoever gets it, and kept in Parquet files."""

import itertools
import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.measures import MEASURES, measure
from vibro_ros.study.running.blocks import BlockRun, Column, ParquetBlocks
from vibro_ros.study.running.runner import PIECE, Piece, Results, Runner
from vibro_ros.study.sweep.design import Design

FOLDER = "blocks"
#: How the error of a row begins whose point is no legal scene.
NO_SCENE = "no such scene: "
_TYPES = {float: pa.float64(), bool: pa.bool_(), str: pa.string()}


@dataclass(frozen=True)
class Rows:
    """The results of a piece.

    Attributes
    ----------
    values : ndarray, shape (rows, measures)
        The measures, in their units; NaN where the run could not go on.
    errors, warnings : tuple of (str or None)
        Why a row has no values; what is to be known about its values.
    """

    values: np.ndarray
    errors: tuple[str | None, ...]
    warnings: tuple[str | None, ...]

    def __len__(self) -> int:
        return len(self.errors)


def run_sweep(design: Design, folder: Path, runner: Runner) -> BlockRun[Rows]:
    """All blocks of a design, in a folder that nobody else writes into; those that are missing are computed.

    Raises
    ------
    ValueError, OSError, RuntimeError
        As `BlockRun.do`.
    """
    rows = [len(design.rows_of_block(block)) for block in range(design.blocks)]
    run = BlockRun("sweep", Blocks(folder, design), rows)

    def compute(missing: list[int]) -> Results[Rows]:
        items = itertools.chain.from_iterable(pieces(design, block) for block in missing)
        varied = next((axis.values for axis in design.axes if axis.name == "solver.method"), None)
        return runner(work_of(design), design.settling + design.duration,
                      varied or (design.scene["solver.method"],), items)

    run.do(compute)
    return run


def work_of(design: Design) -> partial[Rows]:
    """What is done with every piece of a design."""
    return partial(rows_of, design.scene, design.measures, design.settling, design.duration)


def rows_of(scene: Scene, measures: tuple[str, ...], settling: float, duration: float, piece: Piece) -> Rows:
    """Run a piece; times [s] as `measure` takes them."""
    count = len(piece.starts)
    try:
        scene = scene.with_parameters(piece.changes)
    except ValueError as error:
        return Rows(np.full((count, len(measures)), math.nan), (f"{NO_SCENE}{error}",) * count, (None,) * count)
    values = np.full((count, len(measures)), math.nan)
    errors: list[str | None] = [None] * count
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ToleranceWarning)  # it stands in the row
        for row, start in enumerate(piece.starts):
            try:
                values[row] = list(measure(scene, measures, settling, duration, start).values())
            except SimulationError as error:
                errors[row] = str(error)
    return Rows(values, tuple(errors), (scene.broken_promise or None,) * count)


def pieces(design: Design, block: int) -> Iterator[Piece]:
    """The pieces of a block, in the order of its rows."""
    rows = design.rows_of_block(block)
    first = rows.start
    while first < rows.stop:
        point = design.point_of(first)
        end = min(rows.stop, first + PIECE, (point + 1) * max(design.starts, 1))
        yield Piece(design.changes(point), tuple(map(design.start_of, range(first, end))))
        first = end


class Blocks(ParquetBlocks[Rows]):
    """The files of a design: a row a run, with the parameters that vary and what was measured."""

    def __init__(self, folder: Path, design: Design):
        super().__init__(folder, design.document(), design.blocks)
        self._design = design

    def columns(self, block: int, found: Sequence[Rows]) -> list[Column]:
        """The columns of a block."""
        design, rows = self._design, self._design.rows_of_block(block)
        points = [design.changes(design.point_of(row)) for row in rows]
        values = np.concatenate([one.values for one in found])
        errors, warnings = ([text for one in found for text in texts(one)]
                            for texts in (lambda one: one.errors, lambda one: one.warnings))
        return [
            Column("point", pa.array([design.point_of(row) for row in rows], pa.int64()), "1",
                   "number of the combination of parameters"),
            Column("start", pa.array([design.start_of(row) for row in rows], pa.int64()), "1",
                   "number of the drawn start; null for the scene's own"),
            *(Column(name, pa.array([point[name] for point in points], _TYPES[type(BY_NAME[name].default)]),
                     BY_NAME[name].unit or "1", BY_NAME[name].description) for name in design.names),
            *(Column(name, pa.array(values[:, k], pa.float64()), MEASURES[name].unit, MEASURES[name].meaning)
              for k, name in enumerate(design.measures)),
            Column("error", pa.array(errors, pa.string()), "1", "why the row has no values; else null"),
            Column("warning", pa.array(warnings, pa.string()), "1", "what is to be known about the values; else null"),
        ]
