"""The files of a study: one Parquet file a block, whose bytes depend on the study's design and on nothing else.

Every file says in its schema's metadata, under the key `vibro_ros`, the version, the whole design, and which block it
is; every column says its unit and meaning. A file is whole or absent: it is written beside its place, brought to the
disk and renamed.
"""

import io
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Generic, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from vibro_ros.process.untrusted import content, is_temporary, replace_file
from vibro_ros.study.running.origin import sources
from vibro_ros.study.running.pieces import Result

KEY = b"vibro_ros"
_LARGEST = 2**28  # bytes of a block's file


class ForeignBlockError(ValueError):
    """A file that is whole and belongs to another study."""


class Column(NamedTuple):
    """One column of a block."""

    name: str
    values: pa.Array
    unit: str
    meaning: str


class ParquetBlocks(ABC, Generic[Result]):
    """The files of a study in a folder.

    Parameters
    ----------
    folder : Path
        Where they are; it exists.
    study : str
        Of `origin.MODULES`.
    design : dict
        All that decides what the files hold, as JSON has it.
    count : int
        Blocks.
    """

    def __init__(self, folder: Path, study: str, design: dict, count: int):
        self._folder, self._count = folder, count
        self._study = {**sources(study), "design": design, "blocks": count}

    @abstractmethod
    def columns(self, block: int, found: Sequence[Result]) -> list[Column]:
        """The columns of a block, from what was found for all of its pieces."""

    def path(self, block: int) -> Path:
        """The file of a block."""
        return self._folder / f"block_{block:06d}.parquet"

    def check_folder(self) -> None:
        """Delete what an interrupted write has left (ForeignBlockError for files of another study)."""
        own = {self.path(block).name for block in range(self._count)}
        for name in sorted(os.listdir(self._folder)):
            if is_temporary(name) and name[1:].partition(".parquet")[0] + ".parquet" in own:
                (self._folder / name).unlink()
            elif name not in own:
                raise ForeignBlockError(f"{self._folder / name}: is no block of this study; give another --output, or "
                                        "delete that folder")

    def table(self, block: int, found: Sequence[Result]) -> pa.Table:
        """The table of a block, from what was found for all of its pieces."""
        columns = self.columns(block, found)
        schema = pa.schema([field(column) for column in columns], metadata={KEY: self._metadata(block)})
        return pa.Table.from_arrays([column.values for column in columns], schema=schema)

    def write(self, block: int, found: Sequence[Result]) -> pa.Table:
        """Put a block on the disk (OSError), in the place of what there was; returns its table."""
        table = self.table(block, found)
        replace_file(self.path(block), self._bytes(table))
        folder = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
        return table

    def read(self, block: int) -> pa.Table | None:
        """The table of a block; None where there is no file, or a damaged one.

        A file is whole if its pages have their checksums, and writing its table again gives the same bytes.

        Raises
        ------
        ForeignBlockError
            For a whole file of another design or version, of which the message names the first difference, or with
        contents that are not this study's.
        OSError
            For one that cannot be read.
        """
        path = self.path(block)
        if not path.exists():
            return None
        data = content(path, _LARGEST, follow=False)
        try:
            table = pq.ParquetFile(io.BytesIO(data), page_checksum_verification=True).read()
            metadata = json.loads(table.schema.metadata[KEY])
            whole = self._bytes(table) == data
        except (pa.ArrowException, OSError, KeyError, TypeError, ValueError):
            return None
        if not whole:
            return None
        if metadata != json.loads(self._metadata(block)):
            raise ForeignBlockError(f"{path}: is of another study ({_difference(metadata, self._study)}); give another "
                                    "--output, or delete that folder")
        if not self.is_own(block, table):
            raise ForeignBlockError(f"{path}: holds what this study does not write; delete it")
        return table

    def is_own(self, block: int, table: pa.Table) -> bool:  # noqa: ARG002
        """Whether the contents of a whole file can be this study's: somebody may have written them after its words."""
        return True

    def is_of(self, block: int, table: pa.Table, found: Sequence[Result]) -> bool:
        """Whether a table holds what `found` is written as, to the last bit; NaN is then the same as NaN."""
        return self._bytes(table) == self._bytes(self.table(block, found))

    def _metadata(self, block: int) -> bytes:
        return json.dumps({**self._study, "block": block}, ensure_ascii=False).encode()

    @staticmethod
    def _bytes(table: pa.Table) -> bytes:
        sink = io.BytesIO()
        pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
        return sink.getvalue()


def has_columns(table: pa.Table, columns: Sequence[Column]) -> bool:
    """Whether a table has these columns, by names and types."""
    return [(one.name, one.type) for one in table.schema] == [(one.name, one.values.type) for one in columns]


def field(column: Column) -> pa.Field:
    """The field of a schema that says unit and meaning."""
    return pa.field(column.name, column.values.type, metadata={"unit": column.unit, "meaning": column.meaning})


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
