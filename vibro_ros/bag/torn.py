"""Bytes that are cut from a file, kept beside it."""

import os
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from vibro_ros.process.untrusted import write_all

ENDING = ".torn"
_BLOCK = 2**20  # bytes that are copied at a time


def torn_name(path: Path) -> Path:
    """A free name beside `path` for what is cut from it: ``<file>.torn``, ``<file>.torn.2``, …"""
    names = (path.with_name(f"{path.name}{ENDING}{suffix}") for suffix in _suffixes())
    return next(name for name in names if not os.path.lexists(name))


def keep_tail(path: Path, descriptor: int, begin: int, end: int) -> Path | None:
    """Copy the bytes between two offsets of an open file beside it; None when there are none.

    The copy is on the disk when this returns. When it fails (OSError), nothing is left of it.
    """
    if begin >= end:
        return None
    kept = torn_name(path)
    copy = os.open(kept, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    try:
        copy_bytes(descriptor, copy, begin, end)
        os.fsync(copy)
    except BaseException:
        kept.unlink(missing_ok=True)
        raise
    finally:
        os.close(copy)
    return kept


def put_back(kept: Path | None, descriptor: int, begin: int) -> None:
    """Undo a cut: the file ends with what was kept, which is given up then (OSError)."""
    if kept is None:
        os.ftruncate(descriptor, begin)
        return
    copy = os.open(kept, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        size = os.fstat(copy).st_size
        os.lseek(descriptor, begin, os.SEEK_SET)
        copy_bytes(copy, descriptor, 0, size)
        os.ftruncate(descriptor, begin + size)
        os.fsync(descriptor)
    finally:
        os.close(copy)
    kept.unlink()


def copy_bytes(source: int, target: int, begin: int, end: int) -> None:
    """Write the bytes of one descriptor between two offsets where the other stands (OSError)."""
    while begin < end:
        block = os.pread(source, min(_BLOCK, end - begin), begin)
        if not block:
            raise OSError(0, "the file was cut while it was read")
        write_all(target, block)
        begin += len(block)


def _suffixes() -> Iterator[str]:
    yield ""
    yield from (f".{number}" for number in count(2))
