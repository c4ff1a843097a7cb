"""Seal a bag whose recorder was killed: cut what is torn, write index and metadata.

A readable bag is never changed. Everything is read before anything is written: an MCAP file is only cut behind its last
readable record, what is cut is kept beside it, and what was written is read back. metadata.yaml appears whole, at last.
When a step fails (the disk is full), its file is as it was, and recovery can be repeated. No link is followed.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from vibro_ros.bag import reserve
from vibro_ros.bag.lock import locked, writers
from vibro_ros.bag.mcap_part import McapPart
from vibro_ros.bag.mcap_scan import ForeignFileError
from vibro_ros.bag.metadata import FILE_NAME, TopicInformation, as_text, bag_information, is_beginning, write_metadata
from vibro_ros.bag.metadata_check import tells
from vibro_ros.bag.part import Part, PartContents
from vibro_ros.bag.parts import (
    COMPRESSED,
    STORAGES,
    bag_files,
    opened_part,
    suffix_of,
    told,
)
from vibro_ros.bag.sealing import remove_leftovers, seal_mcap, set_aside, settle_sqlite
from vibro_ros.bag.sqlite_part import JOURNALS, DatabaseError, is_hot
from vibro_ros.bag.stream import BagError, BagStream
from vibro_ros.bag.unreadable import not_read
from vibro_ros.process.untrusted import one_line


class RecoveryError(Exception):
    """A bag cannot be recovered; the message is one line for the user."""

    def __init__(self, message: str):
        super().__init__(one_line(message))


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
        Bytes that were torn or damaged, and are not read.
    last : int
        Time of the last message [ns]; 0 without messages.
    was_sealed : bool
        True when there was nothing to do, and nothing was done.
    kept : tuple of Path
        Where the bytes are that were cut.
    flaws : tuple of str
        What of the bag still cannot be read, one line each.
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

    Parameters
    ----------
    path : str or Path
        The bag folder, or one of its files.
    keep_torn : bool
        Whether what is cut is kept beside, as ``<file>.torn``, ``<file>.torn.2``, …

    Raises
    ------
    RecoveryError
        When it is no bag, holds nothing that can be read, is being recorded, or cannot be written.
    """
    try:
        folder = _folder_of(Path(path))
        with locked(folder):
            _check_unused(folder)
            return _Recovering(folder, keep_torn).result()
    except BlockingIOError:
        raise RecoveryError(f"{path}: the bag is in use, its recorder still runs; end the recorder") from None
    except OSError as error:
        raise RecoveryError(f"{path}: cannot be sealed: {error.strerror or error}; nothing readable was lost, "
                            "make room or give write permission and try again") from error
    except MemoryError:
        raise RecoveryError(f"{path}: cannot be sealed: not enough memory; nothing readable was lost") from None


def is_bag_sealed(folder: Path) -> bool:
    """Whether metadata.yaml tells what the bag's files hold, and each of them has its ending (OSError)."""
    with ExitStack() as stack:
        return _Looked(folder, stack).is_sealed()


def _folder_of(path: Path) -> Path:
    if not path.exists():
        raise RecoveryError(f"{path}: no such folder; give the folder of a recording")
    if path.is_dir():
        return path
    if suffix_of(path.name) not in STORAGES:
        raise RecoveryError(f"{path}: a file, not a bag; give the folder of a recording")
    return path.absolute().parent


def _check_unused(folder: Path) -> None:
    if found := writers([folder]):
        processes = ", ".join(map(str, found[folder]))
        raise RecoveryError(f"{folder}: the bag is in use, process {processes} writes to it; end the recorder")


class _Looked:
    """A bag folder that was looked through: its files, open, and what is wrong with them.

    Parameters
    ----------
    folder : Path
        The bag folder.
    stack : ExitStack
        Closes the files.
    """

    def __init__(self, folder: Path, stack: ExitStack):
        self.folder = folder
        self.told = told(folder)
        self.files, self.flaws = bag_files(folder)
        self.files = [file for file in self.files if file.stat().st_size]  # a recorder may just have made the last one
        self.parts: dict[Path, Part] = {}
        self.hot: list[Path] = []  # databases with an unfinished transaction
        self.reasons: list[str] = []  # why files cannot be read
        for file in self.files:
            self._open(file, stack)

    def is_sealed(self) -> bool:
        """Whether readers find all of it that can be read."""
        return (bool(self.parts) and not self.hot and not self.told.flaws
                and all(part.is_sealed for part in self.parts.values())
                and tells(self.told.information, self.contents()))

    def contents(self) -> list[PartContents]:
        """What the files hold, in the order of time."""
        found = [part.contents for part in self.parts.values()]
        return sorted(found, key=lambda one: one.information.first if one.information.messages else 0)

    def _open(self, file: Path, stack: ExitStack) -> None:
        if any(is_hot(file, ending) for ending in JOURNALS):
            self.hot.append(file)
            return
        try:
            self.parts[file] = opened_part(file, stack)
        except (ForeignFileError, DatabaseError) as error:
            self.reasons.append(f"{file.name}: {error}")


class _Recovering:
    """Goes through the steps of a recovery."""

    def __init__(self, folder: Path, keep: bool):
        self._folder, self._keep = folder, keep
        self._cut = 0
        self._kept: list[Path] = []

    def result(self) -> Recovery:
        with ExitStack() as stack:
            looked = _Looked(self._folder, stack)
            if looked.is_sealed():
                return self._read_back(was_sealed=True)
            self._check(looked)
            reserve.remove(self._folder)
            remove_leftovers(self._folder)
            for file in looked.hot:
                self._settle(file, looked, stack)
            if not looked.parts:
                raise RecoveryError(f"{self._folder}: {looked.reasons[0]}; give the folder of a recording")
            self._check_readable(looked)
            self._seal(looked)
        return self._read_back()

    def _check(self, looked: _Looked) -> None:
        files, _ = bag_files(self._folder)
        if not files:
            reason = f"{looked.flaws[0]}" if looked.flaws else "not a bag, it holds no .mcap and no .db3 file"
            raise RecoveryError(f"{self._folder}: {reason}; give the folder of a recording")
        if not looked.files:
            raise RecoveryError(f"{self._folder}: {files[0].name} is empty (0 bytes), nothing was recorded; "
                                "delete the folder")
        if len({STORAGES[suffix_of(file.name)] for file in looked.files}) > 1:
            raise RecoveryError(f"{self._folder}: holds both .mcap and .db3 files; give the folder of one recording")
        if not looked.parts and not looked.hot:
            raise RecoveryError(f"{self._folder / looked.reasons[0]}; give the folder of a recording")

    def _check_readable(self, looked: _Looked) -> None:
        """Refuse a bag of which nothing is left to be read, as it is."""
        contents = looked.contents()
        damaged = [part.contents.flaws[0] for part in looked.parts.values()
                   if part.damaged or (part.is_sealed and part.contents.flaws)]
        if damaged and not any(one.information.messages for one in contents):
            raise RecoveryError(f"{self._folder}: nothing in it can be read: {damaged[0]}")

    def _settle(self, file: Path, looked: _Looked, stack: ExitStack) -> None:
        try:
            cut, kept = settle_sqlite(file, self._keep)
            self._cut += cut
            self._kept += kept
            looked.parts[file] = opened_part(file, stack)
        except DatabaseError as error:
            looked.reasons.append(f"{file.name}: {error}")

    def _seal(self, looked: _Looked) -> None:
        contents = looked.contents()
        custom = looked.told.custom or {key: value for one in contents for key, value in one.custom.items()}
        for file, part in looked.parts.items():
            self._cut += part.damaged
            if isinstance(part, McapPart) and not part.is_sealed:
                self._seal_file(file, part, custom)
        storage = STORAGES[suffix_of(next(iter(looked.parts)).name)]
        messages = sum(one.information.messages for one in contents)
        custom = {**custom, "written": str(messages), "recovered": "true", "cut_bytes": str(self._cut)}
        files = [one.information for one in contents]
        self._write(bag_information(storage, files, _topics(contents), custom) | _compression(looked))

    def _seal_file(self, file: Path, part: McapPart, custom: Mapping[str, str]) -> None:
        if file.name.endswith(COMPRESSED):
            raise RecoveryError(f"{file}: is torn and compressed; unfold it with `zstd -d`, and try again")
        own = part.contents
        text = as_text(bag_information("mcap", [own.information], own.topics, own.custom or custom))
        kept = seal_mcap(file, part.scan, text, self._keep)
        self._cut += 0 if part.scan.ended else part.scan.size - part.scan.end
        self._kept += [kept] if kept else []

    def _write(self, information: dict) -> None:
        file = self._folder / FILE_NAME
        if os.path.lexists(file) and not is_beginning(file, information):
            self._kept += set_aside(file, self._keep)
        write_metadata(file, information)

    def _read_back(self, was_sealed: bool = False) -> Recovery:
        """What a reader finds now."""
        try:
            with BagStream(self._folder) as stream:
                messages = sum(topic.messages for topic in stream.topics.values())
                return Recovery(self._folder, messages, self._cut, stream.end, was_sealed, tuple(self._kept),
                                tuple(stream.flaws))
        except BagError as error:
            raise RecoveryError(f"{error}; it cannot be sealed") from error


def _topics(contents: list[PartContents]) -> list[TopicInformation]:
    """Each topic of the files once."""
    return list({topic.name: topic for one in reversed(contents) for topic in one.topics}.values())


def _compression(looked: _Looked) -> dict[str, str]:
    """What metadata.yaml says of the compression of whole files, or of single messages."""
    if any(file.name.endswith(COMPRESSED) for file in looked.parts):
        return {"compression_format": "zstd", "compression_mode": "FILE"}
    return {"compression_format": "zstd", "compression_mode": "MESSAGE"} if looked.told.compressed_messages else {}


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
