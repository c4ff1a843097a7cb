"""A sweep at work: its blocks, computed by whoever runs it."""

import itertools
from collections.abc import Iterator
from pathlib import Path

from vibro_ros.study.running.block_run import BlockRun
from vibro_ros.study.running.runner import Runner
from vibro_ros.study.sweep.blocks import Blocks
from vibro_ros.study.sweep.design import Design
from vibro_ros.study.sweep.rows import Rows, pieces, work_of


class SweepRun(BlockRun[Rows]):
    """The blocks of a design in a folder that nobody else writes into.

    Parameters
    ----------
    design : Design
        What is run.
    folder : Path
        Of the blocks.
    """

    def __init__(self, design: Design, folder: Path):
        rows = [len(design.rows_of_block(block)) for block in range(design.blocks)]
        super().__init__("sweep", Blocks(folder, design), rows)
        self._design = design

    def do_by(self, runner: Runner) -> None:
        """Have a runner do the blocks that are missing (RuntimeError: see `do_missing`)."""
        design = self._design

        def compute(missing: list[int]) -> Iterator[Rows]:
            items = itertools.chain.from_iterable(pieces(design, block) for block in missing)
            return runner(work_of(design), methods_of(design), items)

        self.do_missing(compute)


def methods_of(design: Design) -> tuple[str, ...]:
    """Each `solver.method` of a design."""
    varied = next((axis.values for axis in design.axes if axis.name == "solver.method"), None)
    return varied or (design.scene["solver.method"],)
