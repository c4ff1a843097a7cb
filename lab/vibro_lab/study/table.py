"""The table of a study: rows of numbered points, computed in order, stored in files, and resumed.

`Study` defines the rows. `computed` returns its whole table: it reads the blocks that are complete, lets the others be
computed, and writes each block as soon as it is complete.

Beside a folder `blocks`, the file `blocks.json` has the version and the whole design, and the folder's blocks belong to
this design: a study with another one refuses the folder. So the folder has nothing but blocks, and other programs read
it as one table. A block is a Parquet file whose bytes depend only on the study; every column has
its unit and meaning, and every page a checksum, by which damage is detected. A file is complete or absent: it is
written under a temporary name, flushed to the disk and renamed.
"""

import contextlib
import errno
import io
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from vibro_lab.study.command import Progress
from vibro_lab.study.execution import Execution, Rows, fingerprint
from vibro_ros import PARAMETERS, is_temporary, read_file, replace_file, say

NUMBERS = pa.list_(pa.field("element", pa.float64(), nullable=False))
"""Type of a list of numbers; the items are named as in a file that is read back."""
_LARGEST, _MOST_ROWS = 2**28, 2**20  # largest file of a block [bytes], and its rows, because few bytes can encode many
# Errors that reading a damaged or foreign file may raise.
_DAMAGE_ERRORS = (pa.ArrowException, ArithmeticError, LookupError, TypeError, ValueError)


class ForeignBlockError(ValueError):
    """A file that belongs to another study."""


class Field(NamedTuple):
    """Column of a table; `optional` is true if a row may have no value (null)."""

    name: str
    type: pa.DataType
    unit: str
    meaning: str
    optional: bool = False


def parameter_field(name: str) -> Field:
    """Column of a numeric parameter of a scene."""
    return Field(name, pa.float64(), PARAMETERS[name].unit or "1", PARAMETERS[name].description)


@dataclass(frozen=True)
class Study:
    """Definition of a table: its design, columns, and the function that computes its rows."""

    what: str  # description of the work for the progress display
    design: dict  # everything that determines the rows, for JSON
    fields: Sequence[Field]  # the columns
    # Returns the rows of a point from its number, on which alone they depend. It must be picklable for other processes.
    rows: Callable[[int], list[dict]]
    run_time: float  # approximate simulated time of a point [s]
    count: int  # number of points, or an upper limit
    block: int = 1  # points of a block: the most that an interruption loses

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.count // self.block)

    def points(self, block: int) -> range:
        """Numbers of the points of a block."""
        return range(block * self.block, min((block + 1) * self.block, self.count))


def computed(study: Study, folder: Path, execution: Execution) -> pa.Table:
    """Return the whole table of a study, stored in a folder into which no other process writes."""
    blocks = {block: study.points(block) for block in range(study.blocks)}
    tables = stored(study, folder, blocks, lambda numbers: execution.rows(
        study.rows, numbers, study.run_time))
    return pa.concat_tables([tables[block] for block in blocks])


def stored(study: Study, folder: Path, blocks: Mapping[int, Sequence[int]],
           compute: Callable[[Iterable[int]], Rows]) -> dict[int, pa.Table]:
    """Return the tables of some blocks; `blocks` has the numbers of the points of each.

    Existing blocks are read. `compute` yields, in order, the rows of the other blocks' points, and each block is
    written when it is complete; a block without rows leaves no file. Errors are those of `computed`.
    """
    check_folder(study, folder)
    tables: dict[int, pa.Table] = {}
    with Progress("blocks checked", "block", len(blocks)) as progress:
        for block in blocks:
            if (table := read_block(study, folder, block)) is not None:
                tables[block] = table
            progress.add(1)
    missing = {block: numbers for block, numbers in blocks.items() if block not in tables}
    points = sum(map(len, blocks.values()))
    remaining = sum(map(len, missing.values()))
    with contextlib.closing(compute([number for numbers in missing.values() for number in numbers])) as results, \
            Progress(study.what, "point", points, points - remaining) as progress:
        for block, numbers in missing.items():
            rows: list[dict] = []
            for _ in numbers:
                rows += next(results)
                progress.add(1)
            tables[block] = _write(study, folder, block, rows)
    return tables


def path_of(folder: Path, block: int) -> Path:
    """Path of a block's file."""
    return folder / f"block_{block:06d}.parquet"


def design_of(folder: Path) -> Path:
    """Return the file beside a folder of blocks that has the version and the design of their study."""
    return folder.with_name(f"{folder.name}.json")


def read_block(study: Study, folder: Path, block: int) -> pa.Table | None:
    """Read the table of a block; None if there is no file, or if it is damaged (OSError if it cannot be read)."""
    path = path_of(folder, block)
    if not path.exists():
        return None
    data = read_file(path, _LARGEST, follow=False)
    try:
        file = pq.ParquetFile(io.BytesIO(data), page_checksum_verification=True)
        if file.metadata.num_rows <= _MOST_ROWS and file.schema_arrow.equals(
                schema_of(study.fields), check_metadata=True):
            return file.read()
    except (*_DAMAGE_ERRORS, OSError):
        pass
    say("study", f"{path}: is damaged; it is computed again")
    return None


def check_folder(study: Study, folder: Path) -> None:
    """Make the folder with its design, or delete files of an interrupted write in it."""
    folder.mkdir(exist_ok=True)
    identity, path = _identity(study), design_of(folder)
    remedy = f"give another --output, or delete {folder.name} and {path.name} there"
    has_design = path.exists()
    if has_design:
        text = read_file(path, _LARGEST, follow=False)
        try:
            theirs = json.loads(text)
        except (ValueError, RecursionError):
            raise ForeignBlockError(f"{path}: is damaged; {remedy}") from None
        if theirs != identity:
            raise ForeignBlockError(f"{path}: is of another study ({_difference(theirs, identity)}); {remedy}")
    for temporary in folder.parent.glob(f".{path.name}.*"):
        if is_temporary(temporary.name):
            temporary.unlink()
    for name in sorted(os.listdir(folder)):
        match = re.fullmatch(r"\.?(block_(\d{6})\.parquet)(\.\w+)?", name)
        if match and is_temporary(name):
            (folder / name).unlink()
        elif not match or name != match[1] or not has_design or int(match[2]) >= study.blocks:
            raise ForeignBlockError(f"{folder / name}: is no block of this study; {remedy}")
    if not has_design:
        _replace(path, (json.dumps(identity, indent=1, ensure_ascii=False) + "\n").encode())


def _write(study: Study, folder: Path, block: int, rows: Sequence[dict]) -> pa.Table:
    """Write a block to the disk, replacing an older file; returns its table."""
    table = table_of(rows, study.fields)
    if rows:
        _replace(path_of(folder, block), file_of(table))
    return table


def _replace(path: Path, data: bytes) -> None:
    """Write a file to the disk, replacing an older one (RuntimeError with the remedy)."""
    try:
        replace_file(path, data)
        descriptor = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        remedy = "free some room" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "let it be written"
        raise RuntimeError(f"{path}: {error.strerror}; {remedy}. The blocks before it are kept; the same command goes "
                           "on from there") from error


def table_of(rows: Sequence[dict], fields: Sequence[Field]) -> pa.Table:
    """Return a table of rows, whose schema contains units and meanings."""
    return pa.Table.from_pylist(list(rows), schema_of(fields))


def schema_of(fields: Sequence[Field]) -> pa.Schema:
    """Return the schema of columns, with units and meanings as metadata."""
    return pa.schema([pa.field(field.name, field.type, field.optional, {"unit": field.unit, "meaning": field.meaning})
                      for field in fields])


def file_of(table: pa.Table) -> bytes:
    """Return a table as the contents of a Parquet file, with a checksum of every page."""
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
    return sink.getvalue()


def _identity(study: Study) -> dict:
    """Version and design of a study, with lists in place of tuples, as JSON has them."""
    return json.loads(json.dumps({**fingerprint(), "design": study.design, "blocks": study.blocks}))


def _difference(theirs: object, ours: object, where: str = "") -> str:
    """Describe the first difference between two documents."""
    if not (isinstance(theirs, dict) and isinstance(ours, dict)):
        texts = [text if len(text) <= 60 else f"{text[:60]}…" for text in map(str, (theirs, ours))]
        return f"{where} is {texts[0]} there, {texts[1]} here"
    for key in dict.fromkeys((*ours, *theirs)):
        if key in ours and theirs.get(key) != ours[key]:
            return _difference(theirs.get(key), ours[key], f"{where}.{key}" if where else str(key))
        if key not in ours:
            return f"{where}.{key} is only there"
    return "its numbers differ"
