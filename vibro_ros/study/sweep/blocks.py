"""The files of a sweep: a row a run, with the parameters that vary and what was measured."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.study.measures import MEASURES
from vibro_ros.study.running.parquet_blocks import Column, ParquetBlocks
from vibro_ros.study.sweep.design import Design
from vibro_ros.study.sweep.rows import Rows

FOLDER = "blocks"
_TYPES = {float: pa.float64(), bool: pa.bool_(), str: pa.string()}


class Blocks(ParquetBlocks[Rows]):
    """The files of a design in a folder.

    Parameters
    ----------
    folder : Path
        Where they are; it exists.
    design : Design
        What they hold.
    """

    def __init__(self, folder: Path, design: Design):
        super().__init__(folder, "sweep", design.document(), design.blocks)
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
