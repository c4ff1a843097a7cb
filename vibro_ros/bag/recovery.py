"""Seal a bag whose recorder was killed: cut what is torn, write index and metadata.

A readable bag is never changed. An MCAP file is only cut after its last whole record and written to from there on; when
that fails (the disk is full), it is cut again, and can be recovered later. metadata.yaml appears whole, at last.
"""

import os
import re
import sqlite3
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Metadata, MetadataIndex

from vibro_ros.bag import reserve
from vibro_ros.bag.lock import locked, writers
from vibro_ros.bag.mcap_records import packed
from vibro_ros.bag.mcap_scan import ForeignFileError, Scan, is_sealed, scan
from vibro_ros.bag.mcap_segment import METADATA_KEY, METADATA_NAME
from vibro_ros.bag.metadata import (
    FILE_NAME,
    FileInformation,
    TopicInformation,
    as_text,
    bag_information,
    custom_data,
    qos_profiles,
    read_metadata,
    write_metadata,
)
from vibro_ros.bag.sqlite_scan import scan_sqlite

_STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}


class RecoveryError(Exception):
    """A bag cannot be recovered; the message is one line for the user."""


@dataclass(frozen=True)
class Recovery:
    """What was done to a bag.

    Attributes
    ----------
    folder : Path
        The bag folder.
    messages : int
        Number of messages in the bag now.
    cut : int
        Bytes that were torn or damaged, and are lost.
    last : int
        Time of the last message [ns]; 0 without messages.
    was_sealed : bool
        True when there was nothing to do, and nothing was done.
    """

    folder: Path
    messages: int
    cut: int
    last: int
    was_sealed: bool = False


def recover(path: str | Path) -> Recovery:
    """Seal the bag in the folder `path`, or that of the file `path`.

    Raises
    ------
    RecoveryError
        When it is no bag, holds nothing, is being recorded, or cannot be written.
    """
    folder = _folder_of(Path(path))
    try:
        if is_bag_sealed(folder):
            return _nothing_to_do(folder)
        with locked(folder):
            _check_unused(folder)
            return _sealed(folder)
    except BlockingIOError:
        raise RecoveryError(f"{folder}: the bag is in use, its recorder still runs; end the recorder") from None
    except ForeignFileError as error:
        raise RecoveryError(f"{error}; give the folder of a recording") from error
    except OSError as error:
        raise RecoveryError(f"{folder}: cannot be sealed: {error.strerror or error}; nothing was lost, "
                            "make room or give write permission and try again") from error


def is_bag_sealed(folder: Path) -> bool:
    """Whether metadata.yaml is there, and every file that it names, sealed."""
    information = read_metadata(folder)
    if information is None:
        return False
    names = information.get("relative_file_paths")
    if not isinstance(names, list) or not names:
        return False
    files = [folder / str(name) for name in names]
    return all(file.is_file() and (file.suffix != ".mcap" or is_sealed(file)) for file in files)


def unsealed_bags(directory: Path, pattern: str = "*") -> list[Path]:
    """Bag folders in `directory` that are not sealed, hold something, and are not being recorded.

    Parameters
    ----------
    directory : Path
        Where recordings go; it may be missing.
    pattern : str
        Of the folders' names.
    """
    if not directory.is_dir():
        return []
    return [folder for folder in sorted(directory.glob(pattern))
            if folder.is_dir() and not (folder / FILE_NAME).exists()
            and any(file.stat().st_size for file in _bag_files(folder)) and not _is_in_use(folder)]


def _folder_of(path: Path) -> Path:
    if not path.exists():
        raise RecoveryError(f"{path}: no such folder; give the folder of a recording")
    if path.is_dir():
        return path
    if path.suffix not in _STORAGES:
        raise RecoveryError(f"{path}: a file, not a bag; give the folder of a recording")
    return path.absolute().parent


def _is_in_use(folder: Path) -> bool:
    try:
        with locked(folder):
            return bool(writers(folder))
    except OSError:
        return True


def _check_unused(folder: Path) -> None:
    found = [str(process) for process in writers(folder)]
    if found:
        raise RecoveryError(f"{folder}: the bag is in use, process {', '.join(found)} writes to it; end the recorder")


def _bag_files(folder: Path) -> list[Path]:
    """The bag's files in the order of their numbers."""
    files = [file for file in folder.iterdir() if file.suffix in _STORAGES and file.is_file()]
    return sorted(files, key=lambda file: (_number(file), file.name))


def _number(file: Path) -> int:
    found = re.search(r"_(\d+)$", file.stem)
    return int(found[1]) if found else 0


def _nothing_to_do(folder: Path) -> Recovery:
    information = read_metadata(folder)
    try:
        messages = int(information["message_count"])
        last = information["starting_time"]["nanoseconds_since_epoch"] + information["duration"]["nanoseconds"]
    except (KeyError, TypeError, ValueError):
        messages = last = 0
    return Recovery(folder, messages, 0, last if messages else 0, was_sealed=True)


def _sealed(folder: Path) -> Recovery:
    """Seal every file that is not, then the folder."""
    files = _bag_files(folder)
    if not files:
        raise RecoveryError(f"{folder}: not a bag, it holds no .mcap and no .db3 file; give the folder of a recording")
    filled = [file for file in files if file.stat().st_size]  # a killed recorder may have just made the last one
    if not filled:
        raise RecoveryError(f"{folder}: {files[0].name} is empty (0 bytes), nothing was recorded; delete the folder")
    kinds = {_STORAGES[file.suffix] for file in filled}
    if len(kinds) > 1:
        raise RecoveryError(f"{folder}: holds both .mcap and .db3 files; give the folder of one recording")
    reserve.remove(folder)
    (kind,) = kinds
    seen = [_SEALERS[kind](file) for file in filled]
    return _finish(folder, kind, seen)


@dataclass(frozen=True)
class _Sealed:
    """A file that is sealed now."""

    information: FileInformation
    topics: list[TopicInformation]
    custom: Mapping[str, str]
    cut: int


def _finish(folder: Path, kind: str, seen: list[_Sealed]) -> Recovery:
    topics = {topic.name: topic for one in seen for topic in one.topics}
    cut = sum(one.cut for one in seen)
    custom = {key: value for one in seen for key, value in one.custom.items()}
    files = [one.information for one in seen]
    messages = sum(file.messages for file in files)
    custom |= {"written": str(messages), "recovered": "true", "cut_bytes": str(cut)}
    write_metadata(folder, bag_information(kind, files, topics.values(), custom))
    return Recovery(folder, messages, cut, max(file.last for file in files))


def _seal_mcap(file: Path) -> _Sealed:
    try:
        found = scan(file)
    except ForeignFileError as error:
        raise ForeignFileError(f"{file}: {error}") from error
    topics = _mcap_topics(found)
    custom = custom_data(found.metadata)
    information = _mcap_information(file.name, found)
    cut = found.damaged
    if not found.sealed:
        cut += found.size - found.end
        _append_ending(file, found, as_text(bag_information("mcap", [information], topics, custom)))
    return _Sealed(information, topics, custom, cut)


def _mcap_topics(found: Scan) -> list[TopicInformation]:
    schemas = found.contents.schemas
    return [TopicInformation(channel.topic, schemas[channel.schema_id].name,
                             qos_profiles(channel.metadata.get("offered_qos_profiles", "")),
                             channel.metadata.get("topic_type_hash", ""), channel.message_encoding)
            for channel in found.contents.channels.values() if channel.schema_id in schemas]


def _mcap_information(name: str, found: Scan) -> FileInformation:
    contents = found.contents
    counts: dict[str, int] = {}
    for channel, count in contents.counts.items():
        topic = contents.channels[channel].topic
        counts[topic] = counts.get(topic, 0) + count
    return FileInformation(name, contents.first if contents.messages else 0, contents.last, counts)


def _append_ending(file: Path, found: Scan, metadata: str) -> None:
    """Cut the file after its last whole record and close it; on an error, only cut it."""
    record = packed(Metadata(METADATA_NAME, {METADATA_KEY: metadata}))
    end = found.end + len(found.tail)
    found.contents.metadata.append(MetadataIndex(end, len(record), METADATA_NAME))
    ending = found.tail + record + found.contents.ending(end + len(record))
    with file.open("r+b", buffering=0) as target:
        target.truncate(found.end)
        target.seek(found.end)
        try:
            _write(target.write, ending)
            os.fsync(target.fileno())
        except OSError:
            target.truncate(found.end)
            raise


def _write(write: Callable[[memoryview], int], data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[write(rest):]


def _seal_sqlite(file: Path) -> _Sealed:
    size = file.stat().st_size
    try:
        information, topics, custom = scan_sqlite(file)
    except sqlite3.Error as error:
        raise ForeignFileError(f"{file}: not a readable database of rosbag2: {error}") from error
    return _Sealed(information, topics, custom, max(0, size - file.stat().st_size))


_SEALERS: dict[str, Callable[[Path], _Sealed]] = {"mcap": _seal_mcap, "sqlite3": _seal_sqlite}


def described(recovery: Recovery, stamp: Callable[[int], str]) -> Iterable[str]:
    """What was done, for people; `stamp` writes a time [ns]."""
    if recovery.was_sealed:
        yield f"{recovery.folder}: sealed already, {recovery.messages} messages; nothing to do"
        return
    lost = f"{recovery.cut} torn bytes cut" if recovery.cut else "no bytes lost"
    last = f", the last of {stamp(recovery.last)}" if recovery.messages else ""
    yield f"{recovery.folder}: sealed, {recovery.messages} messages{last}; {lost}"
