"""Record messages to a bag in a thread of its own, so that no caller ever waits for the disk.

`Recorder.write` only puts the message on a bounded queue. The first message after a flush is due wakes the writer
thread, so that the recorder works when a tick has just ended, not when the next one begins. If no message comes, the
thread wakes by itself a little later. It does not wake more often, because waking costs more than writing the messages
of a tick. A program with deadlines, such as the robot, lets its threads change more often (`sys.setswitchinterval`),
because the thread would else hold the interpreter lock for up to 5 ms.

Files are written by `McapWriter`. Each flush ends a chunk: a killed process loses the messages of the last
`FLUSH_PERIOD`. Chunk indexes stay in memory, 12 MB an hour, so the robot begins another file after an hour
(`record.max_duration`).
"""

import contextlib
import math
import os
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Lock, Thread

from mcap.records import Channel, Schema

from vibro_ros.bag.folders import SUFFIX, lock
from vibro_ros.bag.mcap_writer import CHUNK_SIZE, McapWriter
from vibro_ros.bag.metadata import (
    FILE_NAME,
    LAST_STAMP,
    METADATA_KEY,
    METADATA_NAME,
    FileInformation,
    Topic,
    TopicInformation,
    as_text,
    bag_information,
    channel_metadata,
    defined,
    definition_text,
    write_metadata,
)

FLUSH_PERIOD = 0.05  # s, between two flushes; a message is promised to be safe after 0.1 s, for a busy machine
WAKE_DELAY = 0.01  # s, from the time when a flush is due until the thread wakes by itself
EARLY_WAKE = 1000  # waiting messages that wake the thread early, so that a robot faster than real time fills no queue
BACKLOG = 20_000  # most messages waiting for the disk; about 4 s of a robot that publishes at 1 kHz
SMALLEST_FILE = 100_000  # bytes; topics, index and metadata of a file take about a third of it
SHORTEST_FILE = 0.1  # s, smallest limit of a file's duration; longer than a period between flushes
FEWEST_FILES = 2  # in a bag of limited size: the one that is written, and the previous one
_PARTS = 10  # number of files of a bag when only its total size is limited
_METADATA_SIZE = 64 * 1024  # bytes reserved for metadata.yaml and a file's end in a bag of limited size
_COMPRESSIONS = {"none": "", "zstd": "zstd"}


@dataclass(frozen=True)
class Storage:
    """How a bag is stored on the disk: compression and limits."""

    compression: str = "none"  # compression of chunks, ``none`` or ``zstd``
    max_size: int = 0  # largest file [bytes]; 0 is no limit. A file exceeds it by up to one flush, and by its index
    max_duration: float = 0.0  # longest file [s]; 0 is no limit
    max_bytes: int = 0  # largest bag [bytes]: the oldest file is deleted before the bag would exceed it; 0 is no limit

    def __post_init__(self) -> None:
        for name, value, least, unit in (("max_size", self.max_size, SMALLEST_FILE, "bytes"),
                                         ("max_duration", self.max_duration, SHORTEST_FILE, "s"),
                                         ("max_bytes", self.max_bytes, _PARTS * SMALLEST_FILE, "bytes")):
            if 0 < value < least:
                raise ValueError(f"record.{name}: {value:g} is too small; give 0 for no limit, "
                                 f"or at least {least:g} {unit}")
        if self.max_bytes and self.max_size * FEWEST_FILES > self.max_bytes:
            raise ValueError(f"record.max_size: {self.max_size} does not fit twice into record.max_bytes "
                             f"{self.max_bytes}; give at most half of it")

    @property
    def file_size(self) -> int:
        """Largest file [bytes]; 0 is no limit."""
        return self.max_size or self.max_bytes // _PARTS


_PLAIN = Storage()


class Recorder:
    """Writes messages to a new bag folder; a context manager.

    Once it is open, an error of the disk never reaches the caller: the recording stops, `fault` says why, the messages
    already written stay for `recover` to seal, and further messages are dropped and counted. After `close`, `written` +
    `dropped` + `lost` is the number of `write` calls plus that of latched messages in all files; the bag's custom data
    have these three numbers, too.

    `folder` is made and must not exist, its parents may be missing. `metadata` are the bag's custom data, which survive
    a killed process. Beyond `backlog` messages that wait for the disk, messages are dropped; inputs only beyond twice
    this number, because a replay computes all other messages again. FileExistsError when the folder exists, because a
    recording never overwrites; OSError when it cannot be made or written, and then nothing is left behind; ValueError
    for an unknown message type or a topic given twice.
    """

    def __init__(self, folder: Path, topics: Sequence[Topic], metadata: Mapping[str, str],
                 backlog: int = BACKLOG, storage: Storage = _PLAIN) -> None:
        self.folder = Path(folder)
        self.fault: str | None = None
        self._backlog = backlog
        self.dropped = 0  # messages that `write` refused
        self._refusing = Lock()
        self._taken = 0
        self._due = time.monotonic() + FLUSH_PERIOD
        self.accepting = True  # whether `write` takes messages; false a little before `fault` says why
        self._has_ended = False  # no more messages are written
        self._closing = False
        self._new_custom: Mapping[str, str] = {}
        self._wake_from = self._due  # time from which a message wakes the thread; infinite while it is awake
        self._wake_up: SimpleQueue[None] = SimpleQueue()
        self._capacities = {topic.name: 2 * backlog if topic.is_input else backlog for topic in topics}
        self._queue: deque[tuple[str, int, bytes]] = deque()
        try:
            self._writer = BagWriter(self.folder, defined(topics), metadata, storage)
        except FileExistsError as error:
            raise FileExistsError(f"{folder} exists already; a recording never overwrites: "
                                  "give a new folder") from error
        except OSError as error:
            raise OSError(f"cannot record to {folder}: {error.strerror}; "
                          "give a folder that can be written") from error
        self._thread = Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def write(self, topic_name: str, stamp_ns: int, data: bytes) -> bool:
        """Queue a serialised message (CDR) with its stamp, ROS time [ns], 0 to `LAST_STAMP`; never blocks or raises.

        Returns False when the message was dropped (and counted): unknown topic, stamp out of range, data that is not
        bytes, queue full, recording stopped.
        """
        if (len(self._queue) < self._capacities.get(topic_name, 0) and type(stamp_ns) is int
                and 0 <= stamp_ns <= LAST_STAMP and type(data) is bytes and self.accepting):
            self._queue.append((topic_name, stamp_ns, data))
            if time.monotonic() >= self._wake_from or len(self._queue) == EARLY_WAKE:
                self._wake_from = math.inf
                self._wake_up.put(None)
            return True
        with self._refusing:
            self.dropped += 1
        return False

    def announce(self, custom: Mapping[str, str], latched: Sequence[tuple[str, bytes]]) -> None:
        """Add to the bag's custom data, and begin each file as `BagWriter.latch`; to be called before any `write`."""
        self._writer.latch(latched)
        self._new_custom = custom
        self._wake_up.put(None)

    @property
    def written(self) -> int:
        """Number of messages in the bag that a killed process would not lose."""
        return self._writer.stored

    @property
    def lost(self) -> int:
        """Number of messages that `write` took and that did not reach the bag, because the recording stopped."""
        return self._taken + self._writer.added - self.written if self._has_ended else 0

    @property
    def backlog(self) -> int:
        """Number of messages that wait for the writer thread."""
        return len(self._queue)

    @property
    def is_backlogged(self) -> bool:
        """Whether more than half of the backlog is taken, so that a caller who can wait should."""
        return self.accepting and 2 * len(self._queue) > self._backlog

    @property
    def ended(self) -> bool:
        """Whether the thread has ended: after a fault, or when the bag is sealed."""
        return not self._thread.is_alive()

    def close(self, patience: float | None = None) -> bool:
        """Stop accepting, write the queue, seal the bag and end the thread; calling it again does nothing.

        Returns False if this took longer than `patience` [s]; the thread then finishes on its own. With None it waits
        for ever.
        """
        self.accepting = False
        self._closing = True
        self._wake_up.put(None)
        self._thread.join(patience)
        if self.ended:
            self._discard_queue()
        return self.ended

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        try:
            self._write_queue()
            self._writer.flush()
            self._has_ended = True
            self._writer.close({"written": str(self.written), "dropped": str(self.dropped), "lost": str(self.lost)})
        except Exception as error:  # whatever the disk does, the robot goes on
            self._stop(error)

    def _write_queue(self) -> None:
        """Write queued messages until `close` asks to end, and flush every `FLUSH_PERIOD`."""
        closing = False
        while not closing:
            self._wake_from = self._due
            with contextlib.suppress(Empty):
                self._wake_up.get(timeout=max(0.0, self._due + WAKE_DELAY - time.monotonic()))
            self._wake_from = math.inf
            closing = self._closing  # read before the queue is emptied for the last time
            if self._new_custom:
                custom, self._new_custom = self._new_custom, {}
                self._writer.describe(custom)
            while waiting := len(self._queue):
                for _ in range(waiting):
                    topic, stamp, data = self._queue.popleft()
                    self._taken += 1
                    self._writer.write(topic, stamp, data)
                self._flush_if_due()
            self._flush_if_due()

    def _flush_if_due(self) -> None:
        if time.monotonic() >= self._due:
            self._writer.flush()
            self._due = time.monotonic() + FLUSH_PERIOD

    def _stop(self, error: Exception) -> None:
        """End the recording; stored messages stay as they are, for the readers of this package and for `recover`."""
        self.accepting = False
        self._has_ended = True
        reason = " ".join((getattr(error, "strerror", None) or str(error) or type(error).__name__).split())
        self._discard_queue()
        self._writer.abandon()
        remains = (f"its {self.written} messages are there; `recover {self.folder}` seals the bag for other programs"
                   if self.folder.exists() else "the folder is gone")
        self.fault = f"recording to {self.folder} stopped: {reason}; {remains}"

    def _discard_queue(self) -> None:
        with contextlib.suppress(IndexError):
            while True:
                self._queue.popleft()
                self._taken += 1


class BagWriter:
    """Writes a bag folder: one MCAP file, or several that follow each other in time.

    It holds the folder's lock, so that the bag does not count as abandoned. `folder` must not exist, its parents may be
    missing. `custom` is the bag's custom data, from its beginning on; `added` counts the latched messages at the
    beginning of files, `stored` the messages handed to the operating system, even if their file was deleted later to
    make room. After an OSError the bag ends with its last flush, and `recover` can seal it.
    FileExistsError when the folder exists; OSError when it cannot be made or written, and then nothing is left behind.
    """

    def __init__(self, folder: Path, topics: Sequence[TopicInformation], custom: Mapping[str, str], storage: Storage):
        self.folder = folder
        self.added = self.stored = 0
        self._topics, self._custom, self._storage = topics, dict(custom), storage
        types = list(dict.fromkeys(topic.type_name for topic in topics))
        self._schemas = [Schema(id=number, data=definition_text(name).encode(), encoding="ros2msg", name=name)
                         for number, name in enumerate(types, start=1)]
        self._channels = [Channel(id=number, topic=topic.name, message_encoding=topic.encoding,
                                  metadata=channel_metadata(topic), schema_id=1 + types.index(topic.type_name))
                          for number, topic in enumerate(topics, start=1)]
        self._numbers = {channel.topic: channel.id for channel in self._channels}
        self._latched: tuple[tuple[str, bytes], ...] = ()
        self._finished: deque[tuple[FileInformation, int]] = deque()  # sealed files, and their bytes
        self._number = 0
        self._sink: _Sink  # the file that is written, or was written last
        self._is_open = False
        self._flushed = 0  # messages of that file handed to the operating system
        self._discarded_files = self._discarded_messages = 0
        folder.mkdir(parents=True)
        self._lock = lock(folder)
        try:
            self._begin_file()
        except OSError:
            os.close(self._lock)
            folder.rmdir()  # a file that could not be begun has left nothing
            raise

    def latch(self, latched: Sequence[tuple[str, bytes]]) -> None:
        """Begin each file with these messages, pairs of topic and bytes, with the stamp of its first message.

        So each file alone, or a bag played from there on, has the messages that are published only once.
        """
        self._latched = self._waiting = tuple(latched)

    def write(self, topic: str, stamp: int, data: bytes) -> None:
        """Write a message (OSError when the disk fails); a new file begins only before a message with a later stamp."""
        if (self._is_full or stamp - self._file.first >= self._longest) and 0 <= self._file.last < stamp:
            self.flush()
            self._finish_file()
            self._begin_file()
        if self._waiting:
            waiting, self._waiting = self._waiting, ()
            self.added += len(waiting)
            for name, message in waiting:
                self._file.add_message(self._numbers[name], stamp, message, stamp)
        if self._file.add_message(self._numbers[topic], stamp, data, stamp):  # a chunk is full
            self.flush()

    def flush(self) -> None:
        """Make everything written so far survive the end of this process.

        OSError when the disk is full, or the file was removed or replaced.
        """
        self._file.end_chunk()
        try:
            self._sink.flush()
        except OSError:
            if not self._sink.is_in_place:
                self.stored -= self._flushed
            raise
        written = sum(self._file.counts.values())
        self.stored += written - self._flushed
        self._flushed = written
        self._is_full = 0 < self._storage.file_size < self._sink.size
        self._make_room()

    def describe(self, custom: Mapping[str, str]) -> None:
        """Add to the bag's custom data; after the next flush they survive a killed process."""
        self._custom |= custom
        self._file.add_metadata(METADATA_NAME, self._description(self._file_information()))

    def close(self, custom: Mapping[str, str]) -> None:
        """Seal the bag, with `custom` added to its custom data (OSError when the disk fails)."""
        if self._discarded_files:
            custom = {**custom, "discarded_files": str(self._discarded_files),
                      "discarded_messages": str(self._discarded_messages)}
        self._custom |= custom
        try:
            if self._is_open:
                self._finish_file()
            files = [file for file, _ in self._finished if (self.folder / file.name).exists()]
            write_metadata(self.folder / FILE_NAME, bag_information(files, self._topics, self._custom))
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close all files without sealing; calling it again does nothing."""
        if self._is_open:
            self._sink.close()
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def _begin_file(self) -> None:
        path = self.folder / f"{self.folder.name}_{self._number}{SUFFIX}"
        # The description takes long, so it is made first: a process killed meanwhile leaves no empty file.
        about = self._description(FileInformation(path.name, 0, 0))
        self._sink = _Sink(path)
        chunk = min(CHUNK_SIZE, self._storage.file_size // 8 or CHUNK_SIZE)
        self._file = McapWriter(self._sink.write, self._schemas, self._channels,
                                _COMPRESSIONS[self._storage.compression], chunk)
        self._file.add_metadata(METADATA_NAME, about)
        try:
            self._sink.flush()
        except OSError:
            self._sink.close()
            path.unlink(missing_ok=True)
            raise
        self._is_open = True
        self._number += 1
        self._longest = self._storage.max_duration * 1e9 or math.inf
        self._flushed = 0
        self._is_full = False
        self._waiting = self._latched

    def _finish_file(self) -> None:
        """Seal the file; after an OSError it ends with its last flush."""
        information = self._file_information()
        self._file.add_metadata(METADATA_NAME, self._description(information))
        self._file.finish()
        self._sink.flush()
        self._sink.close()
        self._finished.append((information, self._sink.size))
        self._is_open = False

    def _make_room(self) -> None:
        """Delete the oldest files before a bag of limited size would exceed its limit."""
        room = self._storage.max_bytes - self._storage.file_size // 10 - _METADATA_SIZE - self._sink.size
        while self._storage.max_bytes and self._finished and sum(size for _, size in self._finished) > room:
            file, _ = self._finished.popleft()
            (self.folder / file.name).unlink(missing_ok=True)
            self._discarded_files += 1
            self._discarded_messages += file.messages

    def _file_information(self) -> FileInformation:
        counts = {topic: self._file.counts[number] for topic, number in self._numbers.items()}
        first, last = (self._file.first, self._file.last) if self._file.last >= 0 else (0, 0)
        return FileInformation(self._sink.path.name, first, last, counts)

    def _description(self, file: FileInformation) -> dict[str, str]:
        """Return the bag's metadata for a record in the file, as if it were the only file."""
        return {METADATA_KEY: as_text(bag_information([file], self._topics, self._custom))}


class _Sink:
    """A new file; each `flush` writes all that was written since the previous one, or nothing.

    `size` is the number of bytes on the disk.
    """

    def __init__(self, path: Path):
        self.path = path
        self.size = 0
        self._parts: list[bytes] = []
        self._file = path.open("xb", buffering=0)

    def write(self, data: bytes) -> None:
        """Keep bytes for the next flush."""
        self._parts.append(data)

    def flush(self) -> None:
        """Hand the bytes that were kept to the operating system (OSError when that fails, or the file is gone)."""
        rest = memoryview(b"".join(self._parts))
        whole = self.size + len(rest)
        self._parts.clear()
        try:
            while rest:
                rest = rest[self._file.write(rest):]
        except OSError:
            os.ftruncate(self._file.fileno(), self.size)
            self._file.seek(self.size)
            raise
        if not self.is_in_place:  # bytes written to such a file are lost
            raise OSError(0, f"{self.path.name} was removed, or replaced by another file", str(self.path))
        self.size = whole

    @property
    def is_in_place(self) -> bool:
        """Whether the path still names this file."""
        try:
            return os.path.samestat(os.fstat(self._file.fileno()), os.stat(self.path, follow_symlinks=False))
        except OSError:
            return False

    def close(self) -> None:
        """Close the file."""
        self._file.close()
