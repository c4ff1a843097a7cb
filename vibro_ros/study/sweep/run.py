"""A sweep at work: finds the blocks that are done, runs the others, and writes each as soon as it is whole."""

import errno
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import pyarrow as pa

from vibro_ros.process.front_door import say
from vibro_ros.simulation.preparation import prepare_kernels
from vibro_ros.study.progress import Progress
from vibro_ros.study.sweep.blocks import Blocks
from vibro_ros.study.sweep.design import Design
from vibro_ros.study.sweep.local import in_local_processes
from vibro_ros.study.sweep.rows import Piece, Rows, Work, pieces, work_of

#: Gives what a `Work` makes of each piece, in order; gets the methods whose kernels are needed.
Runner = Callable[[Work, tuple[str, ...], Iterator[Piece]], Iterator[Rows]]


class SweepRun:
    """The blocks of a design in a folder that nobody else writes into.

    Parameters
    ----------
    design : Design
        What is run.
    folder : Path
        Of the blocks.

    Attributes
    ----------
    tables : dict of int to Table
        The blocks that are done.
    """

    def __init__(self, design: Design, folder: Path):
        self._design, self._blocks = design, Blocks(folder, design)
        self.tables: dict[int, pa.Table] = {}

    @property
    def in_words(self) -> str:
        """How much is done."""
        return f"{len(self.tables)} of {self._design.blocks} blocks are kept; the same command goes on from there"

    def find_done(self) -> None:
        """Read the blocks that are there.

        Raises
        ------
        ForeignBlockError
            For files of another study.
        OSError
            For files that cannot be read.
        """
        self._blocks.check_folder()
        with Progress("blocks checked", "block", self._design.blocks) as progress:
            for block in range(self._design.blocks):
                table = self._blocks.read(block)
                if table is not None:
                    self.tables[block] = table
                elif self._blocks.path(block).exists():
                    say("study", f"{self._blocks.path(block)}: is damaged, or of another pyarrow; it is run again")
                progress.add(1)

    def do_missing(self, runner: Runner) -> None:
        """Run the blocks that are missing.

        Raises
        ------
        RuntimeError
            When the disk is full or refuses, or the runs cannot go on; what is done is kept.
        """
        design = self._design
        missing = [block for block in range(design.blocks) if block not in self.tables]
        found = runner(work_of(design), methods_of(design),
                       itertools.chain.from_iterable(pieces(design, block) for block in missing))
        done = sum(len(design.rows_of_block(block)) for block in self.tables)
        with Progress("sweep", "run", design.rows, done) as progress:
            try:
                for block in missing:
                    self._do(block, found, progress)
            finally:
                found.close()  # type: ignore[attr-defined]

    def _do(self, block: int, found: Iterator[Rows], progress: Progress) -> None:
        gathered: list[Rows] = []
        left = len(self._design.rows_of_block(block))
        while left:
            gathered.append(next(found))
            left -= len(gathered[-1].errors)
            progress.add(len(gathered[-1].errors))
        try:
            self.tables[block] = self._blocks.write(block, gathered)
        except OSError as error:
            remedy = "free some room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "let it be written"
            raise RuntimeError(f"{self._blocks.path(block)}: {error.strerror}; {remedy}. {self.in_words}") from error


def methods_of(design: Design) -> tuple[str, ...]:
    """Each `solver.method` of a design."""
    varied = next((axis.values for axis in design.axes if axis.name == "solver.method"), None)
    return varied or (design.scene["solver.method"],)


def on_this_machine(workers: int) -> Runner:
    """A runner with so many processes."""
    def run(work: Work, methods: tuple[str, ...], items: Iterator[Piece]) -> Iterator[Rows]:
        for method in methods:
            prepare_kernels("study", method)
        return in_local_processes(work, items, workers)

    return run


def on_cluster(address: str) -> Runner:
    """A runner on the Dask cluster at `address` (ValueError where `distributed` is not installed)."""
    def run(work: Work, methods: tuple[str, ...], items: Iterator[Piece]) -> Iterator[Rows]:
        return cluster.run_on_cluster(address, work, methods, items)

    try:
        from vibro_ros.study.sweep import cluster  # needs a package that only clusters need
    except ModuleNotFoundError as error:
        raise ValueError(f"{error.name}: not installed; `pip install vibro_ros[cluster]` brings what --scheduler "
                         "needs") from error
    return run
