"""How a study is stored and resumed: one Parquet file a block, whose bytes depend on the study's design alone.

Every file says in its schema's metadata, under the key `vibro_ros`, the version, the whole design, and which block it
is, and under `digest`, by which damage is seen, a digest of this and of its values; every column says its unit and
meaning. A file is whole or absent: it is written beside its place, brought to the disk and renamed. A study that is
started again reads the blocks that are whole and computes the others. Anybody can write a file with a digest that fits,
so a file also counts only if it has the columns of the study and the rows of its block.
"""

import contextlib
import errno
import functools
import hashlib
import io
import json
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from vibro_ros.process.entry_point import say
from vibro_ros.process.files import content, is_temporary, replace_file
from vibro_ros.simulation.provenance import software
from vibro_ros.study.progress import Progress
from vibro_ros.study.running.runner import Results

KEY, _DIGEST = b"vibro_ros", b"digest"
NUMBERS = pa.list_(pa.field("element", pa.float64(), nullable=False))
"""A list of numbers, by the name of its items that a file has which is read again."""
_LARGEST, _MOST_ROWS = 2**28, 2**20  # bytes of a block's file, and its rows: few bytes can stand for many rows


# What comes of reading values that are not those of a study.
_UNSOUND = (pa.ArrowException, ArithmeticError, LookupError, TypeError, ValueError)


class ForeignBlockError(ValueError):
    """A file that belongs to another study."""


class Field(NamedTuple):
    """One column of a table; `optional`: whether a row may have no value there."""

    name: str
    type: pa.DataType
    unit: str
    meaning: str
    optional: bool = False


Sound = Callable[[int, list[dict]], bool]
"""Whether rows, whose columns have the right types, are those of the block of a number; may raise instead of False."""


class ParquetBlocks:
    """The files of a study in a folder.

    Parameters
    ----------
    folder : Path
        Where they are; it exists.
    design : dict
        All that decides what the files hold, as JSON has it.
    count : int
        Blocks.
    fields : sequence of Field
        The columns.
    sound : callable
        Tells the rows of a block from others.
    """

    def __init__(self, folder: Path, design: dict, count: int, fields: Sequence[Field], sound: Sound):
        self._folder, self._count, self._fields, self._sound = folder, count, fields, sound
        self._study = {**fingerprint(), "design": design, "blocks": count}

    def path(self, block: int) -> Path:
        """The file of a block."""
        return self._folder / f"block_{block:06d}.parquet"

    def check_folder(self) -> None:
        """Delete what an interrupted write has left (ForeignBlockError for files of another study)."""
        for name in sorted(os.listdir(self._folder)):
            found = re.fullmatch(r"\.?(block_(\d{6})\.parquet)(\.\w+)?", name)
            own = found[1] if found and int(found[2]) < self._count else ""
            if own and is_temporary(name):
                (self._folder / name).unlink()
            elif name != own:
                raise ForeignBlockError(f"{self._folder / name}: is no block of this study; give another --output, or "
                                        "delete that folder")

    def write(self, block: int, rows: Sequence[dict]) -> pa.Table:
        """Put a block on the disk, in the place of an older file (RuntimeError with the remedy); returns its table."""
        table = table_of(rows, self._fields)
        document = self._document(block)
        table = table.replace_schema_metadata({KEY: document, _DIGEST: _digest(document, table)})
        try:
            replace_file(self.path(block), file_of(table))
            folder = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
        except OSError as error:
            remedy = "free some room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "let it be written"
            raise RuntimeError(f"{self.path(block)}: {error.strerror}; {remedy}. The blocks before it are kept; the "
                               "same command goes on from there") from error
        return table

    def read(self, block: int) -> pa.Table | None:
        """The table of a block; None where there is no file, or one that is damaged or has the rows of something else,
        which is then computed again.

        Raises
        ------
        ForeignBlockError
            For a file of another design or version; the message names the first difference.
        OSError
            For one that cannot be read.
        """
        path = self.path(block)
        if not path.exists():
            return None
        data = content(path, _LARGEST, follow=False)
        try:
            file = pq.ParquetFile(io.BytesIO(data), page_checksum_verification=True)
            if file.metadata.num_rows > _MOST_ROWS:
                raise ValueError
            table = file.read()
            document, digest = table.schema.metadata[KEY], table.schema.metadata[_DIGEST]
            if _digest(document, table) != digest:
                raise ValueError
            theirs = json.loads(document)
        except (*_UNSOUND, OSError, RecursionError):
            return self._damaged(path)
        if document != self._document(block):
            raise ForeignBlockError(f"{path}: is of another study ({_difference(theirs, self._study)}); give another "
                                    "--output, or delete that folder")
        try:
            sound = table.schema.equals(schema_of(self._fields)) and self._sound(block, table.to_pylist())
        except _UNSOUND:
            sound = False
        return table if sound else self._damaged(path)

    @staticmethod
    def _damaged(path: Path) -> None:
        say("study", f"{path}: is damaged; it is computed again")

    def _document(self, block: int) -> bytes:
        return json.dumps({**self._study, "block": block}, ensure_ascii=False).encode()


def _digest(document: bytes, table: pa.Table) -> bytes:
    """Digest of what a file says of its study, of its columns, and of all its values to the last bit."""
    columns = [(one.name, str(one.type), sorted((one.metadata or {}).items())) for one in table.schema]
    return hashlib.sha256(document + repr((columns, table.to_pylist())).encode()).hexdigest().encode()


def completed(what: str, blocks: ParquetBlocks, sizes: Sequence[int], compute: Callable[[list[int]], Results],
              rows_of: Callable[[Any], Sequence[dict]] = lambda row: [row]) -> pa.Table:
    """All blocks of a study as one table: those that are there are read, the others are computed.

    Parameters
    ----------
    what : str
        What is done, for the lines that say how far it is.
    blocks : ParquetBlocks
        The files, in a folder that nobody else writes into.
    sizes : sequence of int
        Results of each block.
    compute : callable
        Gives, for the numbers of blocks, lists of their results, in order.
    rows_of : callable, optional
        The rows of a result; without it, a result is a row.

    Raises
    ------
    ForeignBlockError
        For files of another study.
    OSError
        For files that cannot be read.
    RuntimeError
        When the disk is full or refuses, or the runs cannot go on; finished blocks are kept.
    """
    blocks.check_folder()
    tables: dict[int, pa.Table] = {}
    with Progress("blocks checked", "block", len(sizes)) as progress:
        for block in range(len(sizes)):
            table = blocks.read(block)
            if table is not None:
                tables[block] = table
            progress.add(1)
    missing = [block for block in range(len(sizes)) if block not in tables]
    done = sum(sizes[block] for block in tables)
    with contextlib.closing(compute(missing)) as results, Progress(what, "run", sum(sizes), done) as progress:
        for block in missing:
            found: list = []
            while len(found) < sizes[block]:
                some = next(results)
                found += some
                progress.add(len(some))
            tables[block] = blocks.write(block, [row for one in found for row in rows_of(one)])
    return pa.concat_tables([tables[block].replace_schema_metadata() for block in range(len(sizes))])


def cut(rows: int, size: int) -> list[range]:
    """Numbers of the rows of each block, `size` of them; the last block may have fewer."""
    return [range(first, min(first + size, rows)) for first in range(0, rows, size)]


def table_of(rows: Sequence[dict], fields: Sequence[Field]) -> pa.Table:
    """A table whose schema says units and meanings."""
    return pa.Table.from_pylist(list(rows), schema_of(fields))


def schema_of(fields: Sequence[Field]) -> pa.Schema:
    """The schema that says units and meanings."""
    return pa.schema([pa.field(one.name, one.type, one.optional, {"unit": one.unit, "meaning": one.meaning})
                      for one in fields])


def are(rows: Sequence[dict], expected: Sequence[dict]) -> bool:
    """Whether there are as many rows as `expected`, and each has what is expected of it."""
    return len(rows) == len(expected) and all(
        row[name] == value for row, own in zip(rows, expected, strict=True) for name, value in own.items())


def file_of(table: pa.Table) -> bytes:
    """A table as a Parquet file, with a checksum of every page."""
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
    return sink.getvalue()


@functools.cache
def fingerprint() -> dict[str, str]:
    """Version of the package, and a digest of all that may decide the numbers of a study; equal where it may go on.

    Every module of the rooms `orbits` and `study` counts, and the drawn starts, beside those of the robot.
    """
    package, digest = Path(__file__).parents[2], hashlib.sha256(software()["sources"].encode())
    for path in sorted([*package.glob("orbits/**/*.py"), *package.glob("study/**/*.py"),
                        package / "accuracy" / "starts.py"]):
        digest.update(b"\n".join((str(path.relative_to(package)).encode(), *path.read_bytes().splitlines())))
    return {"version": software()["version"], "sources": digest.hexdigest()[:16]}


@functools.cache
def computes_with() -> dict[str, str]:
    """All that the bits of a study's run depend on besides its scene: where it is equal, numbers are equal to the last
    bit."""
    return {**software(), **fingerprint()}


def _difference(theirs: object, ours: object, where: str = "") -> str:
    """The first difference between two documents, in words."""
    if not (isinstance(theirs, dict) and isinstance(ours, dict)):
        shown = [text if len(text) <= 60 else f"{text[:60]}…" for text in map(str, (theirs, ours))]
        return f"{where} is {shown[0]} there, {shown[1]} here"
    for key in dict.fromkeys((*ours, *theirs)):
        if key in ours and theirs.get(key) != ours[key]:
            return _difference(theirs.get(key), ours[key], f"{where}.{key}" if where else str(key))
        if key not in ours and key != "block":
            return f"{where}.{key} is only there"
    return "its number is of another block"
