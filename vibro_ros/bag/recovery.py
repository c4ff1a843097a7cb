"""Seal a bag whose recorder was killed: cut what is torn, write index and metadata.

A readable bag is never changed. Everything is read before anything is written. A file is only cut behind its last
readable record, and its torn end is kept beside it before. metadata.yaml appears whole, at last. When a step fails (the
disk is full), nothing readable is lost, and recovery can be repeated. No link is followed.

Files are sealed in place: a copy of a long recording would take as much room again.
"""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path

from vibro_ros.bag.folders import SUFFIX, bag_files, locked, writers
from vibro_ros.bag.mcap_scan import McapFile
from vibro_ros.bag.mcap_segment import metadata_record
from vibro_ros.bag.metadata import FILE_NAME, agrees, as_text, bag_information, write_metadata
from vibro_ros.bag.stream import BagContents, BagError, BagStream, not_read
from vibro_ros.process.files import one_line, opened, write_all

_BLOCK = 2**20  # bytes that are copied at a time


class RecoveryError(Exception):
    """A bag cannot be recovered; the message is one line for the user."""

    def __init__(self, message: str):
        super().__init__(one_line(message))


@dataclass(frozen=True)
class Recovery:
    """What was done to a bag, which has so many messages now, the last one at the time `last` [ns]; 0 without messages.

    `cut` bytes were torn or damaged, and are not read; they are `kept` there. `was_sealed` says that there was nothing
    to do, and nothing was done; `flaws` are sentences on the parts of the bag that still cannot be read.
    """

    folder: Path
    messages: int
    cut: int
    last: int
    was_sealed: bool = False
    kept: tuple[Path, ...] = ()
    flaws: tuple[str, ...] = ()


def recover(path: str | Path, keep_torn: bool = True) -> Recovery:
    """Seal the bag in the folder `path`, or that of the file `path`.

    `keep_torn` keeps what is cut beside it, as ``<file>.torn``, ``<file>.torn.2``, … RecoveryError when it is no bag,
    holds nothing that can be read, is being recorded, or cannot be written.
    """
    path = Path(path)
    if not path.exists():
        raise RecoveryError(f"{path}: no such folder; give the folder of a recording")
    if not path.is_dir() and path.suffix != SUFFIX:
        raise RecoveryError(f"{path}: a file, not a bag; give the folder of a recording")
    folder = path if path.is_dir() else path.absolute().parent
    try:
        paths, flaws = bag_files(folder)
        if not paths:
            reason = flaws[0] if flaws else "not a bag, it holds no .mcap file"
            raise RecoveryError(f"{folder}: {reason}; give the folder of a recording")
        with locked(folder):
            if found := writers([folder]):
                processes = ", ".join(map(str, found[folder]))
                raise RecoveryError(f"{folder}: the bag is in use, process {processes} writes to it; end the recorder")
            return _recovered(folder, paths, keep_torn)
    except BlockingIOError:
        raise RecoveryError(f"{path}: the bag is in use, its recorder still runs; end the recorder") from None
    except OSError as error:
        raise RecoveryError(f"{path}: cannot be sealed: {error.strerror or error}; nothing readable was lost, "
                            "make room or give write permission and try again") from error
    except MemoryError:
        raise RecoveryError(f"{path}: cannot be sealed: not enough memory; nothing readable was lost") from None


def described(recovery: Recovery, stamp: Callable[[int], str]) -> Iterable[str]:
    """What was done, for people; `stamp` writes a time [ns]."""
    if recovery.was_sealed:
        yield one_line(f"{recovery.folder}: sealed already, {recovery.messages} messages; nothing to do")
    else:
        lost = f"{recovery.cut} torn bytes cut" if recovery.cut else "no bytes lost"
        kept = f", kept in {', '.join(path.name for path in recovery.kept)}" if recovery.kept else ""
        last = f", the last of {stamp(recovery.last)}" if recovery.messages else ""
        yield one_line(f"{recovery.folder}: sealed, {recovery.messages} messages{last}; {lost}{kept}")
    yield from not_read(recovery.flaws)


def _recovered(folder: Path, paths: list[Path], keep_torn: bool) -> Recovery:
    if not any(path.stat().st_size for path in paths):
        raise RecoveryError(f"{folder}: {paths[0].name} is empty (0 bytes), nothing was recorded; delete the folder")
    bag = BagContents(folder, all_files=True)
    if not bag.files:
        raise RecoveryError(f"{folder / bag.flaws[-1]}; give the folder of a recording")
    damaged = [file.flaws[0] for file in bag.files if file.damaged or (file.sealed and file.flaws)]
    if damaged and not any(file.information.messages for file in bag.files):
        raise RecoveryError(f"{folder}: nothing in it can be read: {damaged[0]}")
    files = [file.information for file in bag.files]
    topics = list({topic.name: topic for file in reversed(bag.files) for topic in file.topics}.values())
    if (bag.information and all(file.sealed for file in bag.files)
            and agrees(bag.information, bag_information(files, topics, {}))):
        return _read_back(folder, was_sealed=True)
    cut, kept = 0, []
    for file in bag.files:
        cut += file.damaged + (0 if file.ended else file.size - file.end)
        if not file.sealed:
            text = as_text(bag_information([file.information], file.topics, file.custom or bag.custom))
            kept += _seal(file, text, keep_torn)
    written = str(sum(file.messages for file in files))
    custom = {**bag.custom, "written": written, "recovered": "true", "cut_bytes": str(cut)}
    metadata = folder / FILE_NAME
    if os.path.lexists(metadata) and (os.path.islink(metadata) or metadata.is_dir() or metadata.stat().st_size):
        if keep_torn:
            kept.append(metadata.rename(_torn_name(metadata)))
        else:
            metadata.unlink()
    write_metadata(metadata, bag_information(files, topics, custom))
    return _read_back(folder, cut, tuple(kept))


def _seal(file: McapFile, metadata: str, keep_torn: bool) -> list[Path]:
    """Cut a file behind its last readable record, and write metadata, index and footer there (OSError).

    The torn end, or an index that is wrong, is on the disk under another name before it is overwritten; the names of
    such files are returned.
    """
    record, index = metadata_record(metadata, file.end + len(file.tail))
    file.summary.metadata.append(index)
    ending = file.tail + record + file.summary.ending(file.end + len(file.tail) + len(record))
    descriptor = opened(file.path, os.O_RDWR, follow=False)
    try:
        status = os.fstat(descriptor)
        if status.st_size != file.size:
            raise OSError(0, "the file changed while it was read")
        if status.st_nlink > 1:
            raise RecoveryError(f"{file.path}: has another name (a hard link) that would change, too; give a copy")
        torn = file.size - file.end
        kept = [_keep_tail(file, descriptor)] if keep_torn and torn else []
        try:
            os.posix_fallocate(descriptor, file.end, len(ending))  # before anything is overwritten: is there room?
        except OSError:
            os.ftruncate(descriptor, file.size)
            for copy in kept:
                copy.unlink()
            raise
        os.lseek(descriptor, file.end, os.SEEK_SET)
        write_all(descriptor, ending)
        os.ftruncate(descriptor, file.end + len(ending))
        os.fsync(descriptor)
        return kept
    finally:
        os.close(descriptor)


def _keep_tail(file: McapFile, descriptor: int) -> Path:
    """Copy the torn end of an open file to a new one beside it (OSError, and then nothing is left of the copy)."""
    path = _torn_name(file.path)
    copy = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    try:
        for at in range(file.end, file.size, _BLOCK):
            write_all(copy, os.pread(descriptor, min(_BLOCK, file.size - at), at))
        os.fsync(copy)
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    finally:
        os.close(copy)
    return path


def _torn_name(path: Path) -> Path:
    """A free name beside `path` for what is cut from it: ``<file>.torn``, ``<file>.torn.2``, …"""
    names = (path.with_name(f"{path.name}.torn{suffix}") for suffix in chain([""], (f".{i}" for i in count(2))))
    return next(name for name in names if not os.path.lexists(name))


def _read_back(folder: Path, cut: int = 0, kept: tuple[Path, ...] = (), was_sealed: bool = False) -> Recovery:
    """What a reader finds now."""
    try:
        with BagStream(folder) as stream:
            messages = sum(topic.messages for topic in stream.topics.values())
            return Recovery(folder, messages, cut, stream.end, was_sealed, kept, tuple(stream.flaws))
    except BagError as error:
        raise RecoveryError(f"{error}; it cannot be sealed") from error
