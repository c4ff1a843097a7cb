"""The files of a study of basins: a row a start, with where it led."""

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa

from vibro_ros.orbits.recurrence import LONGEST_PERIOD
from vibro_ros.orbits.turn_map import coordinates
from vibro_ros.study.basins.design import Design
from vibro_ros.study.basins.rows import KEPT_STATES, Rows
from vibro_ros.study.running.parquet_blocks import Column, ParquetBlocks, has_columns

FOLDER = "blocks"
#: A list of numbers. Parquet calls its items so; by another name a file is not written again to the same bytes.
NUMBERS = pa.list_(pa.field("element", pa.float64()))


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
        super().__init__(folder, "basins", design.document(), design.blocks)
        self._design = design

    def is_own(self, block: int, table: pa.Table) -> bool:
        """Whether a block holds these starts, and of each as many states as its motion has."""
        own = self.columns(block, [Rows([], [], [], [], [])])
        starts = own[:len(self._design.starts.over)]
        if not has_columns(table, own) or any(
                not table[one.name].combine_chunks().equals(one.values) for one in starts):
            return False
        dimension = len(coordinates(self._design.scene))
        kept = {None: 0, 0: KEPT_STATES * dimension} | dict.fromkeys(range(1, LONGEST_PERIOD + 1), dimension)
        return all(kept.get(turns) == len(states) and None not in states and (turns is None or error is None)
                   for turns, states, error in zip(*(table[name].to_pylist() for name in ("turns", "states", "error")),
                                                   strict=True))

    def columns(self, block: int, found: Sequence[Rows]) -> list[Column]:
        """The columns of a block."""
        starts = [self._design.starts.start(number) for number in self._design.rows_of_block(block)]

        def gathered(name: str, kind: pa.DataType) -> pa.Array:
            return pa.array([value for rows in found for value in getattr(rows, name)], kind)

        states = [state.ravel() for rows in found for state in rows.states]
        return [
            *(Column(one.name, pa.array([start[one.name] for start in starts], pa.float64()), one.unit,
                     "of the start; what is no column is as the scene starts") for one in self._design.starts.over),
            Column("turns", gathered("turns", pa.int64()), "1", "turns of the crank after which the settled motion "
                   "repeats itself; 0 where it does not, null where nothing has settled"),
            Column("after", gathered("after", pa.int64()), "1", "turns of the crank that the start was watched for"),
            Column("mean_speed", gathered("mean_speed", pa.float64()), "m/s", "mean speed of the settled body, forward "
                   "positive; NaN where nothing has settled"),
            Column("states", pa.array(states, NUMBERS), "1", "states of the settled motion at the cut, "
                   "one after the other, in crank radii and crank radii times motor speed"),
            Column("error", gathered("errors", pa.string()), "1", "why the start leads nowhere; else null"),
        ]
