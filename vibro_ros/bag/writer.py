"""A bag folder while it is written: one MCAP file, or several that follow each other in time."""

import os
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vibro_ros.bag.folders import SUFFIX, lock
from vibro_ros.bag.mcap_segment import McapSegment
from vibro_ros.bag.metadata import FILE_NAME, Definition, FileInformation, as_text, bag_information, write_metadata

SMALLEST_SEGMENT = 100_000  # bytes; topics, index and metadata of a file take about a third of it
SHORTEST_SEGMENT = 0.1  # s, that between two flushes
FEWEST_SEGMENTS = 2  # of a bag that is limited: the one that is written, and one before it

_PARTS = 10  # in how many segments a bag is cut when only its whole size is limited
_METADATA_SIZE = 64 * 1024  # bytes, room for metadata.yaml in a bag that is limited


@dataclass(frozen=True)
class Storage:
    """How a bag lies on the disk.

    Attributes
    ----------
    compression : str
        ``none`` or ``zstd``, of chunks.
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

    compression: str = "none"
    max_size: int = 0
    max_duration: float = 0.0
    max_bytes: int = 0

    def __post_init__(self) -> None:
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


class BagWriter:
    """Writes a bag folder; holds its lock, so that nobody takes it for abandoned.

    `folder` must not exist, its parents may be missing. A message names its topic by the position in `definitions`,
    counted from 1. `custom` is the bag's custom data, from its beginning on; `added` counts the messages that the
    writer itself has put at the beginning of files. FileExistsError when the folder exists; OSError when it cannot be
    made or written, and then nothing is left behind.
    """

    def __init__(self, folder: Path, definitions: Sequence[Definition], custom: Mapping[str, str], storage: Storage):
        self.folder = folder
        self._definitions, self._custom, self._storage = definitions, dict(custom), storage
        self.added = 0
        self._lasting: tuple[tuple[int, bytes], ...] = ()
        self._finished: deque[tuple[FileInformation, int]] = deque()  # sealed files, and their bytes
        self._number = 0
        self._segment: Any = None  # a McapSegment while one is written
        self._discarded_files = self._discarded_messages = 0
        self._limited = bool(storage.segment_size or storage.max_duration)
        self._first: int  # stamps in the file that is written, if files are limited
        self._last: int
        folder.mkdir(parents=True)
        self._lock = lock(folder)
        try:
            self._begin_segment()
        except OSError:
            os.close(self._lock)
            folder.rmdir()  # a segment that could not be begun has left nothing
            raise

    @property
    def stored(self) -> int:
        """Messages that the operating system has, those of files too that were deleted to make room."""
        finished = sum(file.messages for file, _ in list(self._finished))  # other threads ask, too
        return finished + self._discarded_messages + (self._segment.stored if self._segment else 0)

    def begin_files_with(self, messages: Sequence[tuple[int, bytes]]) -> None:
        """Let each file begin with these, topic and message, under its first message's stamp; before that is written.

        So whoever has one file, or plays the bag from there on, has what was published once and for all.
        """
        self._lasting = self._waiting = tuple(messages)

    def write(self, topic: int, stamp: int, data: bytes) -> None:
        """Take a message (OSError when the disk fails); a new file begins only where time goes on."""
        if self._limited:
            limit, longest = self._storage.segment_size, self._storage.max_duration
            if 0 <= self._last < stamp and ((longest and stamp - self._first >= longest * 1e9)
                                            or (limit and self._segment.size + len(data) > limit)):
                self._segment.flush()
                self._finish_segment()
                self._make_room()
                self._begin_segment()
            self._first, self._last = min(self._first, stamp), max(self._last, stamp)
        if self._waiting:
            waiting, self._waiting = self._waiting, ()
            for number, message in waiting:
                self.added += 1
                self._segment.write(number, stamp, message)
        self._segment.write(topic, stamp, data)

    def flush(self) -> None:
        """Make everything written so far survive the end of this process (OSError when the disk fails)."""
        self._segment.flush()

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
        try:
            if self._segment:
                self._finish_segment()
            files = [file for file, _ in self._finished if (self.folder / file.name).exists()]
            write_metadata(self.folder / FILE_NAME, self._information(files))
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
        path = self.folder / f"{self.folder.name}_{self._number}{SUFFIX}"
        metadata = as_text(self._information([FileInformation(path.name, 0, 0)]))
        self._segment = McapSegment(path, self._definitions, metadata, self._storage.compression)
        self._number += 1
        self._first, self._last = 2**63 - 1, -1
        self._waiting = self._lasting

    def _finish_segment(self) -> None:
        segment, file = self._segment, self._segment.information
        segment.seal(as_text(self._information([file])))
        self._finished.append((file, segment.path.stat().st_size))
        self._segment = None

    def _make_room(self) -> None:
        room = self._storage.max_bytes - self._storage.segment_size - _METADATA_SIZE
        while self._storage.max_bytes and self._finished and sum(size for _, size in self._finished) > room:
            file, _ = self._finished.popleft()
            (self.folder / file.name).unlink(missing_ok=True)
            self._discarded_files += 1
            self._discarded_messages += file.messages

    def _information(self, files: Sequence[FileInformation]) -> dict:
        return bag_information(files, [one.information for one in self._definitions], self._custom)
