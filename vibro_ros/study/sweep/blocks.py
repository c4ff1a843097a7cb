"""The files of a sweep: one Parquet file a block, whose bytes depend on the design and on nothing else.

Every file says in its schema's metadata, under the key `vibro_ros`, the version, the whole design with every parameter
of the scene, and which block it is; every column says its unit and meaning. A file is whole or absent: it is written
beside its place, brought to the disk and renamed.
"""

import io
import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.process.regular_file import content, is_temporary, replace_file
from vibro_ros.study.measures import MEASURES
from vibro_ros.study.sweep.design import Design
from vibro_ros.study.sweep.origin import sources
from vibro_ros.study.sweep.rows import Rows

FOLDER, KEY = "blocks", b"vibro_ros"
_LARGEST = 2**28  # bytes of a block's file
_TYPES = {float: pa.float64(), bool: pa.bool_(), str: pa.string()}


class ForeignBlockError(ValueError):
    """A file that is whole and belongs to another study."""


class Blocks:
    """The files of a design in a folder.

    Parameters
    ----------
    folder : Path
        Where they are; it exists.
    design : Design
        What they hold.
    """

    def __init__(self, folder: Path, design: Design):
        self._folder, self._design = folder, design
        self._study = {**sources(), "design": design.document(), "blocks": design.blocks}

    def path(self, block: int) -> Path:
        """The file of a block."""
        return self._folder / f"block_{block:06d}.parquet"

    def check_folder(self) -> None:
        """Delete what an interrupted write has left (ForeignBlockError for files of another study)."""
        own = {self.path(block).name for block in range(self._design.blocks)}
        for name in sorted(os.listdir(self._folder)):
            if is_temporary(name) and name[1:].partition(".parquet")[0] + ".parquet" in own:
                (self._folder / name).unlink()
            elif name not in own:
                raise ForeignBlockError(f"{self._folder / name}: is no block of this study; give another --output, or "
                                        "delete that folder")

    def write(self, block: int, found: Sequence[Rows]) -> pa.Table:
        """Put a block on the disk (OSError), in the place of what there was; returns its table."""
        table = self._table(block, found)
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
            For a whole file of another design or version; the message names the first difference.
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
        return table

    def _table(self, block: int, found: Sequence[Rows]) -> pa.Table:
        design, rows = self._design, self._design.rows_of_block(block)
        points = [design.changes(design.point_of(row)) for row in rows]
        values = np.concatenate([one.values for one in found])
        columns: list[pa.Array] = [pa.array([design.point_of(row) for row in rows], pa.int64()),
                                   pa.array([design.start_of(row) for row in rows], pa.int64())]
        columns += [pa.array([point[name] for point in points], _TYPES[type(BY_NAME[name].default)])
                    for name in design.names]
        columns += [pa.array(values[:, k], pa.float64()) for k in range(len(design.measures))]
        columns += [pa.array([text for one in found for text in texts(one)], pa.string())
                    for texts in (lambda one: one.errors, lambda one: one.warnings)]
        return pa.Table.from_arrays(columns, schema=self._schema(block))

    def _schema(self, block: int) -> pa.Schema:
        design = self._design
        fields = [_field("point", pa.int64(), "1", "number of the combination of parameters"),
                  _field("start", pa.int64(), "1", "number of the drawn start; null for the scene's own")]
        fields += [_field(name, _TYPES[type(BY_NAME[name].default)], BY_NAME[name].unit or "1",
                          BY_NAME[name].description) for name in design.names]
        fields += [_field(name, pa.float64(), MEASURES[name].unit, MEASURES[name].meaning) for name in design.measures]
        fields += [_field("error", pa.string(), "1", "why the row has no values; else null"),
                   _field("warning", pa.string(), "1", "what is to be known about the values; else null")]
        return pa.schema(fields, metadata={KEY: self._metadata(block)})

    def _metadata(self, block: int) -> bytes:
        return json.dumps({**self._study, "block": block}, ensure_ascii=False).encode()

    @staticmethod
    def _bytes(table: pa.Table) -> bytes:
        sink = io.BytesIO()
        pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
        return sink.getvalue()


def _field(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})


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
