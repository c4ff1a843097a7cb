"""A study at work: finds the blocks that are done, computes the others, and writes each as soon as it is whole."""

import errno
from collections.abc import Callable, Iterator, Sequence
from typing import Generic

import pyarrow as pa

from vibro_ros.process.front_door import say
from vibro_ros.study.progress import Progress
from vibro_ros.study.running.parquet_blocks import ParquetBlocks
from vibro_ros.study.running.pieces import Result


class BlockRun(Generic[Result]):
    """The blocks of a study in a folder that nobody else writes into.

    Parameters
    ----------
    what : str
        What is done, for the lines that say how far it is.
    blocks : ParquetBlocks
        The files.
    rows : sequence of int
        Rows of each block.

    Attributes
    ----------
    tables : dict of int to Table
        The blocks that are done.
    """

    def __init__(self, what: str, blocks: ParquetBlocks[Result], rows: Sequence[int]):
        self._what, self._blocks, self._rows = what, blocks, rows
        self.tables: dict[int, pa.Table] = {}

    @property
    def in_words(self) -> str:
        """How much is done."""
        return f"{len(self.tables)} of {len(self._rows)} blocks are kept; the same command goes on from there"

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
        with Progress("blocks checked", "block", len(self._rows)) as progress:
            for block in range(len(self._rows)):
                table = self._blocks.read(block)
                if table is not None:
                    self.tables[block] = table
                elif self._blocks.path(block).exists():
                    say("study", f"{self._blocks.path(block)}: is damaged, or of another pyarrow; it is run again")
                progress.add(1)

    def do_missing(self, compute: Callable[[list[int]], Iterator[Result]]) -> None:
        """Compute the blocks that are missing.

        Parameters
        ----------
        compute : callable
            Gives, for the numbers of blocks, what comes of their pieces, in order.

        Raises
        ------
        RuntimeError
            When the disk is full or refuses, or the runs cannot go on; what is done is kept.
        """
        missing = [block for block in range(len(self._rows)) if block not in self.tables]
        found, done = compute(missing), sum(self._rows[block] for block in self.tables)
        with Progress(self._what, "run", sum(self._rows), done) as progress:
            try:
                for block in missing:
                    self._do(block, found, progress)
            finally:
                found.close()  # type: ignore[attr-defined]

    def _do(self, block: int, found: Iterator[Result], progress: Progress) -> None:
        gathered: list[Result] = []
        left = self._rows[block]
        while left:
            gathered.append(next(found))
            left -= len(gathered[-1])
            progress.add(len(gathered[-1]))
        try:
            self.tables[block] = self._blocks.write(block, gathered)
        except OSError as error:
            remedy = "free some room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "let it be written"
            raise RuntimeError(f"{self._blocks.path(block)}: {error.strerror}; {remedy}. {self.in_words}") from error
