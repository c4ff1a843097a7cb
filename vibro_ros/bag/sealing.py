"""Seal one file of a bag in place: nothing is cut before it is kept beside, and nothing stays cut that fails.

A file that has another name somewhere (a hard link) is copied first, because what is done to it would be done there.
"""

import contextlib
import filecmp
import os
import sqlite3
import struct
from collections.abc import Iterator
from pathlib import Path

from mcap.records import Metadata, MetadataIndex

from vibro_ros.bag.mcap_gathering import Scan
from vibro_ros.bag.mcap_records import packed
from vibro_ros.bag.mcap_scan import scan
from vibro_ros.bag.mcap_segment import METADATA_KEY, METADATA_NAME
from vibro_ros.bag.sqlite_part import JOURNALS, DatabaseError, SqlitePart, is_hot
from vibro_ros.bag.torn import copy_bytes, keep_tail, put_back, torn_name
from vibro_ros.process.untrusted import is_temporary, opened, temporary_name, write_all

_SUPER_JOURNAL = bytes.fromhex("d9d505f920a163d7")
"""At the end of a journal that names another file, which SQLite would look into and delete."""
_JOURNAL_HEAD = struct.Struct(">8sIIIII")
"""Magic, records, nonce, pages of the database before the transaction, sector size, page size."""
_SLACK = 2**20  # bytes by which a database may have been longer before its transaction


class SealingError(OSError):
    """A file cannot be sealed; it is as it was. `strerror` says why."""

    def __init__(self, reason: str):
        super().__init__(0, reason)


def seal_mcap(path: Path, found: Scan, metadata: str, keep: bool) -> Path | None:
    """Cut the scanned file after its last readable record, and write index, metadata and footer.

    Parameters
    ----------
    path : Path
        The file.
    found : Scan
        What it holds.
    metadata : str
        What the bag says of itself, for the file's inside.
    keep : bool
        Whether what is cut is kept beside.

    Returns
    -------
    Path or None
        Where the cut bytes are; None when there are none.

    Raises
    ------
    OSError
        When it cannot be done; the file is as it was, without what was to be cut if that is not kept.
    """
    with _to_write(path) as (descriptor, size):
        if size != found.size:
            raise SealingError("the file changed while it was read")
        kept = keep_tail(path, descriptor, found.end, size) if keep else None
        try:
            _write_ending(descriptor, found, metadata)
            _check(descriptor, found)
        except BaseException:
            with contextlib.suppress(OSError):
                put_back(kept, descriptor, found.end)
            raise
    return kept


def settle_sqlite(path: Path, keep: bool) -> tuple[int, list[Path]]:
    """Roll a database's unfinished transaction back, as SQLite does when it opens it, on a copy that is checked first.

    Returns
    -------
    int, list of Path
        Bytes that are gone from the database, and where the journal and, if it changed, the database are kept.

    Raises
    ------
    DatabaseError
        When it is unreadable either way.
    OSError
        When it cannot be done; the files are as they were.
    """
    journals = [path.with_name(path.name + ending) for ending in JOURNALS if is_hot(path, ending)]
    size = path.stat().st_size
    kept: list[Path] = []
    with _copies(path, journals) as copy:
        if _rolled_back(copy, path) and not filecmp.cmp(copy, path, shallow=False):
            if keep:
                kept.append(torn_name(path))
                os.link(path, kept[-1])
            copy.replace(path)
    for journal in journals:
        kept += set_aside(journal, keep)
    return max(0, size - path.stat().st_size), kept


def set_aside(path: Path, keep: bool) -> list[Path]:
    """Give up whatever is at `path`, or keep it under another name (OSError); where it is now."""
    if not keep:
        path.unlink()
        return []
    kept = torn_name(path)
    path.rename(kept)
    return [kept]


def remove_leftovers(folder: Path) -> None:
    """Remove the copies that a killed recovery has left in a bag folder; their originals are there."""
    for path in folder.iterdir():
        if is_temporary(path.name):
            with contextlib.suppress(OSError):
                _remove_copy(path)


def _remove_copy(path: Path) -> None:
    """Remove a file or link, or a folder of files."""
    if path.is_symlink() or not path.is_dir():
        path.unlink()
        return
    for inside in path.iterdir():
        inside.unlink()
    path.rmdir()


@contextlib.contextmanager
def _to_write(path: Path) -> Iterator[tuple[int, int]]:
    """The file to write to, and its size [bytes]; one with several names is replaced by its copy when all went well."""
    descriptor = opened(path, os.O_RDWR, follow=False)
    try:
        status = os.fstat(descriptor)
        if status.st_nlink == 1:
            yield descriptor, status.st_size
            return
        fresh = temporary_name(path)
        copy = os.open(fresh, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, status.st_mode & 0o777)
        try:
            copy_bytes(descriptor, copy, 0, status.st_size)
            yield copy, status.st_size
            fresh.replace(path)
        except BaseException:
            fresh.unlink(missing_ok=True)
            raise
        finally:
            os.close(copy)
    finally:
        os.close(descriptor)


def _write_ending(descriptor: int, found: Scan, metadata: str) -> None:
    record = packed(Metadata(METADATA_NAME, {METADATA_KEY: metadata}))
    at = found.end + len(found.tail)
    found.contents.metadata.append(MetadataIndex(at, len(record), METADATA_NAME))
    ending = found.tail + record + found.contents.ending(at + len(record))
    try:
        os.posix_fallocate(descriptor, found.end, len(ending))  # before anything is overwritten: is there room?
    except OSError:
        os.ftruncate(descriptor, found.size)
        raise
    os.lseek(descriptor, found.end, os.SEEK_SET)
    write_all(descriptor, ending)
    os.ftruncate(descriptor, found.end + len(ending))
    os.fsync(descriptor)


def _check(descriptor: int, found: Scan) -> None:
    """Read back what was sealed (SealingError when it is not what was there)."""
    with os.fdopen(os.dup(descriptor), "rb") as file:
        now = scan(file, os.fstat(descriptor).st_size)
    if not now.sealed or now.contents.counts != found.contents.counts:
        raise SealingError("what was written cannot be read back")


@contextlib.contextmanager
def _copies(path: Path, journals: list[Path]) -> Iterator[Path]:
    """A copy of a database with its journals, in a folder of its own beside it."""
    folder = temporary_name(path)
    folder.mkdir(mode=0o700)
    try:
        for source in (path, *journals):
            _copy(source, folder / source.name)
        yield folder / path.name
    finally:
        _remove_copy(folder)


def _copy(source: Path, target: Path) -> None:
    descriptor = opened(source, follow=False)
    copy = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
    try:
        copy_bytes(descriptor, copy, 0, os.fstat(descriptor).st_size)
        os.fsync(copy)
    finally:
        os.close(copy)
        os.close(descriptor)


def _rolled_back(copy: Path, path: Path) -> bool:
    """Whether the copy's transaction was rolled back, and the copy is to be preferred to the database as it is.

    A journal may be anything. One that takes readable messages away is not believed.
    """
    as_it_is = _messages(path)
    try:
        if doubt := _doubt(copy.with_name(copy.name + "-journal"), path.stat().st_size):
            raise sqlite3.DatabaseError(doubt)
        database = sqlite3.connect(f"{copy.absolute().as_uri()}?mode=rw", uri=True, isolation_level=None)
        try:
            database.execute("PRAGMA journal_mode = DELETE")  # writes a -wal file back
            database.execute("BEGIN IMMEDIATE")  # rolls a -journal file back
            database.execute("ROLLBACK")
        finally:
            database.close()
        messages = SqlitePart(copy, path.name).contents.information.messages
    except (sqlite3.Error, DatabaseError) as error:
        if as_it_is is None:
            raise DatabaseError(str(error)) from error
        return False
    return as_it_is is None or messages >= as_it_is


def _messages(path: Path) -> int | None:
    """Messages of a database without its journal; None when it is not sound then."""
    try:
        database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
        try:
            sound = database.execute("PRAGMA quick_check(1)").fetchone() == ("ok",)
        finally:
            database.close()
        messages = SqlitePart(path, path.name, alone=True).contents.information.messages
    except (sqlite3.Error, DatabaseError):
        return None
    return messages if sound else None


def _doubt(journal: Path, size: int) -> str:
    """Why a rollback journal of a database of `size` bytes is not to be believed; empty for a good one."""
    if not journal.exists():
        return ""
    with journal.open("rb") as file:
        head = file.read(_JOURNAL_HEAD.size)
        file.seek(max(0, journal.stat().st_size - len(_SUPER_JOURNAL)))
        if file.read() == _SUPER_JOURNAL:
            return "its journal names another file"
    if len(head) == _JOURNAL_HEAD.size:
        _, _, _, pages, _, page_size = _JOURNAL_HEAD.unpack(head)
        if pages * page_size > size + _SLACK:
            return "its journal is of a larger database"
    return ""
