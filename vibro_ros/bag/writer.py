"""A bag folder while it is written: one file, or several that follow each other in time."""

import os
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vibro_ros.bag.definitions import Definition
from vibro_ros.bag.identity import Identity, is_in_place
from vibro_ros.bag.lock import lock
from vibro_ros.bag.mcap_segment import McapSegment
from vibro_ros.bag.metadata import FILE_NAME, FileInformation, as_text, bag_information, write_metadata
from vibro_ros.bag.reserve import Reserve
from vibro_ros.bag.sqlite_segment import SqliteSegment

SMALLEST_SEGMENT = 100_000  # bytes; topics, index and metadata of a file take about a third of it
SHORTEST_SEGMENT = 0.1  # s, that between two flushes
FEWEST_SEGMENTS = 2  # of a bag that is limited: the one that is written, and one before it

_SEGMENTS: dict[str, type[McapSegment] | type[SqliteSegment]] = {"mcap": McapSegment, "sqlite3": SqliteSegment}
_PARTS = 10  # in how many segments a bag is cut when only its whole size is limited


@dataclass(frozen=True)
class Storage:
    """How a bag lies on the disk.

    Attributes
    ----------
    kind : str
        ``mcap`` or ``sqlite3``.
    compression : str
        ``none`` or ``zstd``, of MCAP chunks.
    max_size : int
        Largest file [bytes]; 0 is no limit. A file exceeds it only when one instant's messages do not fit.
    max_duration : float
        Longest file [s]; 0 is no limit.
    max_bytes : int
        Largest bag [bytes]: the oldest file is deleted before it would be exceeded; 0 is no limit.

    Raises
    ------
    ValueError
        For values that are too small or do not go together; the message names the parameter of the node.
    """

    kind: str = "mcap"
    compression: str = "none"
    max_size: int = 0
    max_duration: float = 0.0
    max_bytes: int = 0

    def __post_init__(self) -> None:
        if self.kind != "mcap" and self.compression != "none":
            raise ValueError(f"record.compression: {self.compression} goes with record.storage mcap only; give none")
        for name, value, least, unit in (("max_size", self.max_size, SMALLEST_SEGMENT, "bytes"),
                                         ("max_duration", self.max_duration, SHORTEST_SEGMENT, "s"),
                                         ("max_bytes", self.max_bytes, _PARTS * SMALLEST_SEGMENT, "bytes")):
            if 0 < value < least:
                raise ValueError(f"record.{name}: {value:g} is too small; give 0 for no limit, "
                                 f"or at least {least:g} {unit}")
        if self.max_bytes and self.max_size * FEWEST_SEGMENTS > self.max_bytes:
            raise ValueError(f"record.max_size: {self.max_size} does not fit twice into record.max_bytes "
                             f"{self.max_bytes}; give at most half of it")

    @property
    def segment_size(self) -> int:
        """Largest file [bytes]; 0 is no limit."""
        return self.max_size or self.max_bytes // _PARTS


@dataclass(frozen=True)
class _Finished:
    """A sealed file of the bag."""

    information: FileInformation
    size: int
    identity: Identity


class BagWriter:
    """Writes a bag folder; holds its lock, so that nobody takes it for abandoned.

    Parameters
    ----------
    folder : Path
        Folder to make; it must not exist, its parents may be missing.
    definitions : sequence of Definition
        The topics; a message names its topic by the position in this sequence, counted from 1.
    custom : mapping of str to str
        The bag's custom data, from its beginning on.
    storage : Storage
        How the bag lies on the disk.

    Attributes
    ----------
    added : int
        Messages that the writer itself has put at the beginning of files.
    missing : list of FileInformation
        Files that somebody else removed or replaced while the bag was written, as far as that was noticed: at every
        flush for the file that is written, when a file is finished for all.

    Raises
    ------
    FileExistsError
        When the folder exists.
    OSError
        When it cannot be made or written; nothing is left behind.
    """

    def __init__(self, folder: Path, definitions: Sequence[Definition], custom: Mapping[str, str], storage: Storage):
        self.folder = folder
        self._definitions, self._custom, self._storage = definitions, dict(custom), storage
        self.missing: list[FileInformation] = []
        self.added = 0
        self._lasting: tuple[tuple[int, bytes], ...] = ()
        self._finished: deque[_Finished] = deque()
        self._number = 0
        self._discarded_files = self._discarded_messages = 0
        self._segment: Any = None  # a McapSegment or SqliteSegment while one is written
        self._limited = bool(storage.segment_size or storage.max_duration)
        self._first: int  # stamp in the file that is written, if files are limited
        self._last: int
        folder.mkdir(parents=True)
        self._lock = lock(folder)
        try:
            self._reserve = Reserve(folder)
            self._segment = self._next_segment()
        except OSError:
            self.abandon()
            self._clear()
            raise
        self._begin_segment()

    @property
    def stored(self) -> int:
        """Messages that the operating system has, those of files too that were deleted to make room."""
        finished = sum(one.information.messages for one in list(self._finished))  # other threads ask, too
        return finished + self._discarded_messages + (self._segment.stored if self._segment else 0)

    def begin_files_with(self, messages: Sequence[tuple[int, bytes]]) -> None:
        """Let each file begin with these, topic and message, under its first message's stamp; before that is written.

        So whoever has one file, or plays the bag from there on, has what was published once and for all.
        """
        self._lasting = self._waiting = tuple(messages)

    def write(self, topic: int, stamp: int, data: bytes) -> None:
        """Take a message (OSError when the disk fails); a new file begins only where time goes on."""
        if self._limited:
            if stamp > self._last and self._is_full(stamp, len(data)):
                self._split()
            self._first, self._last = min(self._first, stamp), max(self._last, stamp)
        if self._waiting:
            self._write_waiting(stamp)
        self._segment.write(topic, stamp, data)

    def flush(self) -> None:
        """Make everything written so far survive the end of this process (OSError when the disk fails)."""
        self._segment.flush()
        self._reserve.hold(self._segment.ending_size)

    def describe(self, custom: Mapping[str, str]) -> None:
        """Add to the bag's custom data, also for a reader of a bag that was killed (OSError when the disk fails)."""
        self._custom |= custom
        self._segment.describe(as_text(self._information([self._segment.information])))

    def close(self, custom: Mapping[str, str]) -> None:
        """Seal what is stored, with `custom` added to the bag's custom data (OSError when the disk fails)."""
        if self._discarded_files:
            custom = {**custom, "discarded_files": str(self._discarded_files),
                      "discarded_messages": str(self._discarded_messages)}
        self._custom |= custom
        self._reserve.release()
        try:
            if self._segment and not is_in_place(self._segment.path, self._segment.identity):
                self._lose_segment()
            if self._segment:
                self._finish_segment()
            self._look_for_missing()
            if self.missing and not self._finished:
                raise OSError(0, "no file of the bag is left")
            write_metadata(self.folder / FILE_NAME, self._information([one.information for one in self._finished]))
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close all files without sealing; calling it again does nothing."""
        if self._segment:
            self._segment.abandon()
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def _begin_segment(self) -> None:
        self._first, self._last = 2**63 - 1, -1
        self._waiting = self._lasting

    def _write_waiting(self, stamp: int) -> None:
        waiting, self._waiting = self._waiting, ()
        for topic, data in waiting:
            self.added += 1
            self._segment.write(topic, stamp, data)

    def _is_full(self, stamp: int, size: int) -> bool:
        if self._last < 0:
            return False
        limit, longest = self._storage.segment_size, self._storage.max_duration
        return bool((longest and stamp - self._first >= longest * 1e9)
                    or (limit and self._segment.size + size > limit))

    def _split(self) -> None:
        self._segment.flush()
        self._finish_segment()
        self._look_for_missing()
        self._make_room()
        self._segment = self._next_segment()
        self._begin_segment()

    def _finish_segment(self) -> None:
        """Seal the file that is written."""
        segment = self._segment
        file = segment.information
        segment.seal(as_text(self._information([file])))
        self._finished.append(_Finished(file, segment.path.stat().st_size, segment.identity))
        self._segment = None

    def _lose_segment(self) -> None:
        """Give up the file that is written: it is no longer in the folder."""
        self.missing.append(self._segment.information)
        self._segment.abandon()
        self._segment = None

    def _look_for_missing(self) -> None:
        """Find the finished files that are no longer in the folder."""
        for one in [one for one in self._finished if not is_in_place(self.folder / one.information.name, one.identity)]:
            self._finished.remove(one)
            self.missing.append(one.information)

    def _make_room(self) -> None:
        """Delete the oldest files until another one fits."""
        room = self._storage.max_bytes - self._storage.segment_size - self._reserve.size
        while self._storage.max_bytes and self._finished and sum(one.size for one in self._finished) > room:
            file = self._finished.popleft().information
            (self.folder / file.name).unlink()
            self._discarded_files += 1
            self._discarded_messages += file.messages

    def _next_segment(self) -> McapSegment | SqliteSegment:
        kind = _SEGMENTS[self._storage.kind]
        path = self.folder / f"{self.folder.name}_{self._number}{kind.SUFFIX}"
        self._number += 1
        return kind(path, self._definitions, as_text(self._information([FileInformation(path.name, 0, 0)])),
                    self._storage.compression)

    def _information(self, files: Sequence[FileInformation]) -> dict:
        return bag_information(self._storage.kind, files, [one.information for one in self._definitions], self._custom)

    def _clear(self) -> None:
        """Remove a folder that this made and in which nothing could be recorded."""
        for path in self.folder.iterdir():
            path.unlink()
        self.folder.rmdir()
