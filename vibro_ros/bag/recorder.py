"""Record messages to a bag from a thread of its own, so that no caller ever waits for the disk.

`Recorder.write` only puts the message on a bounded queue, and wakes the writer thread by the first message that comes
when a flush is due: then the recorder works when a tick has just ended, not when the next one begins. Where no message
comes, the thread wakes by itself a little later. It wakes no more often, because to wake costs more than to write what
a tick has published. The thread takes a few messages at a time: many would hold the interpreter lock and delay the
robot's clock, and after each single one it would wait so long for the lock to come back that it would fall behind a
robot that publishes at 1 kHz.
What a killed process loses is what came in the last `FLUSH_PERIOD`.
"""

import contextlib
import math
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Lock, Thread

from vibro_ros.bag.metadata import LAST_STAMP, Topic, defined
from vibro_ros.bag.writer import BagWriter, Storage

FLUSH_PERIOD = 0.05  # s, that a message stays in memory only; 0.1 is promised, and a busy machine is late
PATIENCE = 0.01  # s, after a flush was due, until the thread wakes by itself
WAKING = 1000  # messages that wait and wake the thread before: a robot faster than real time must not fill the queue
BATCH = 50  # messages between two offers of the interpreter lock; about 60 us
BACKLOG = 20_000  # messages waiting for the disk; about 4 s of a robot that publishes at 1 kHz

_PLAIN = Storage()


class Recorder:
    """Writes messages to a new bag folder; a context manager.

    Once open, nothing that happens to the disk reaches the caller: the recording stops, `fault`
    says why, what was written is sealed where the disk allows it, and further messages are dropped and
    counted. After `close`, the number of `write` calls, and of `lasting` messages in each file, is `written` +
    `dropped` + `lost`; the bag's custom data say these three as well.

    Parameters
    ----------
    folder : Path
        Folder to make; it must not exist, its parents may be missing.
    topics : sequence of Topic
        Every topic that will be written.
    metadata : mapping of str to str
        Kept as the bag's custom data (scene, parameters, version, start time), also when the process is killed.
    backlog : int
        Largest number of messages waiting for the disk; beyond it, messages are dropped.
    storage : Storage
        How the bag lies on the disk.
    lasting : sequence of (str, bytes)
        Topics and messages with which each file of the bag begins, under the stamp of its first message.

    Raises
    ------
    FileExistsError
        When the folder exists: a recording never overwrites.
    OSError
        When the folder cannot be made or written; nothing is left behind.
    ValueError
        For an unknown message type or a topic given twice.
    """

    def __init__(self, folder: Path, topics: Sequence[Topic], metadata: Mapping[str, str],
                 backlog: int = BACKLOG, storage: Storage = _PLAIN,
                 lasting: Sequence[tuple[str, bytes]] = ()) -> None:
        self.folder = Path(folder)
        self.fault: str | None = None
        self.sealed = False
        self._backlog = backlog
        self._refused = 0
        self._refusing = Lock()
        self._taken = 0
        self._due = time.monotonic() + FLUSH_PERIOD
        self._accepting = True
        self._over = self._gone = False  # no message is written any more; the folder is gone
        self._closing = False
        self._known: Mapping[str, str] = {}
        self._waking = self._due  # when a message wakes the thread; never while it is awake
        self._bell: SimpleQueue[None] = SimpleQueue()
        definitions = defined(topics)
        self._topics = {one.information.name: number for number, one in enumerate(definitions, start=1)}
        self._queue: deque[tuple[int, int, bytes]] = deque()  # a message names its topic by a number
        try:
            self._writer = BagWriter(self.folder, definitions, metadata, storage)
        except FileExistsError as error:
            raise FileExistsError(f"{folder} exists already; a recording never overwrites: "
                                  "give a new folder") from error
        except OSError as error:
            raise OSError(f"cannot record to {folder}: {error.strerror}; "
                          "give a folder that can be written") from error
        self.begin_files_with(lasting)
        self._thread = Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def write(self, topic_name: str, stamp_ns: int, data: bytes) -> bool:
        """Queue a serialised message (CDR) with its stamp, ROS time [ns], 0 to `LAST_STAMP`; never blocks or raises.

        False when the message was dropped (and counted): unknown topic, stamp that would spoil the bag, data that is
        not bytes, queue full, recording stopped.
        """
        topic = self._topics.get(topic_name)
        if (topic is not None and type(stamp_ns) is int and 0 <= stamp_ns <= LAST_STAMP
                and type(data) is bytes and self._accepting and len(self._queue) < self._backlog):
            self._append(topic, stamp_ns, data)
            return True
        with self._refusing:
            self._refused += 1
        return False

    def begin_files_with(self, lasting: Sequence[tuple[str, bytes]]) -> None:
        """Say what `lasting` is, before the first `write`."""
        self._writer.begin_files_with([(self._topics[topic], data) for topic, data in lasting])

    def describe(self, custom: Mapping[str, str]) -> None:
        """Add to the bag's custom data what is known now, before the messages that are written from now on."""
        self._known = custom
        self._bell.put(None)

    @property
    def accepting(self) -> bool:
        """Whether `write` takes messages; no longer from the moment when the disk fails, before `fault` says so."""
        return self._accepting

    @property
    def written(self) -> int:
        """Messages in the bag that a killed process would not lose; none when the folder was removed."""
        return 0 if self._gone else self._writer.stored

    @property
    def dropped(self) -> int:
        """Messages that `write` refused."""
        return self._refused

    @property
    def lost(self) -> int:
        """Messages that `write` took and that did not reach the bag, because the recording stopped."""
        return self._taken + self._writer.added - self.written if self._over else 0

    @property
    def backlog(self) -> int:
        """Messages that wait for the writer thread."""
        return len(self._queue)

    @property
    def crowded(self) -> bool:
        """Whether half of the room for waiting messages is taken, so that a caller who can wait should."""
        return self._accepting and 2 * len(self._queue) > self._backlog

    @property
    def ended(self) -> bool:
        """Whether the thread has ended: after a fault, or when the bag is sealed."""
        return not self._thread.is_alive()

    def close(self, patience: float | None = None) -> bool:
        """Accept no more, write what is queued, seal the bag and end the thread; calling it again does nothing.

        False when the disk was slower than `patience` [s]: the thread goes on by itself. None waits until it is done.
        """
        self._accepting = False
        self._closing = True
        self._bell.put(None)
        self._thread.join(patience)
        if self.ended:
            self._discard_queue()
        return self.ended

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _append(self, topic: int, stamp: int, data: bytes) -> None:
        self._queue.append((topic, stamp, data))
        if time.monotonic() >= self._waking or len(self._queue) == WAKING:
            self._waking = math.inf
            self._bell.put(None)

    def _run(self) -> None:
        try:
            self._write_queue()
            self._writer.flush()
            self._over = True
            self._seal()
        except Exception as error:  # whatever the disk does, the robot goes on
            self._stop(error)

    def _write_queue(self) -> None:
        """Write what is queued until `close` asks to end, flushing every `FLUSH_PERIOD`."""
        closing = False
        while not closing:
            self._waking = self._due
            with contextlib.suppress(Empty):
                self._bell.get(timeout=max(0.0, self._due + PATIENCE - time.monotonic()))
            self._waking = math.inf
            closing = self._closing  # asked before the queue is emptied for the last time
            self._write_batch()
            while self._queue:
                self._write_batch()

    def _write_batch(self) -> None:
        """Describe what has become known, write up to `BATCH` messages, and flush when that is due."""
        if self._known:
            known, self._known = self._known, {}
            self._writer.describe(known)
        until = self._taken + BATCH
        while self._queue and self._taken < until:
            topic, stamp, data = self._queue.popleft()
            self._taken += 1
            self._writer.write(topic, stamp, data)
        time.sleep(0)  # offer the interpreter lock
        if time.monotonic() >= self._due:
            self._writer.flush()
            self._due = time.monotonic() + FLUSH_PERIOD

    def _seal(self) -> None:
        self._writer.close({"written": str(self.written), "dropped": str(self.dropped), "lost": str(self.lost)})
        self.sealed = True

    def _stop(self, error: Exception) -> None:
        """End the recording; what is stored is sealed, or stays as it is for `recover`."""
        self._accepting = False
        self._over = True
        reason = " ".join((getattr(error, "strerror", None) or str(error) or type(error).__name__).split())
        self._discard_queue()
        with contextlib.suppress(Exception):  # it would write to the disk that failed
            self._seal()
        if not self.sealed:
            self._writer.abandon()
        self._gone = not self.folder.exists()
        remains = (f"the bag is sealed with its {self.written} messages" if self.sealed
                   else "the folder is gone" if self._gone
                   else f"the bag is not sealed; `recover {self.folder}` seals it once it can be written")
        self.fault = f"recording to {self.folder} stopped: {reason}; {remains}"

    def _discard_queue(self) -> None:
        with contextlib.suppress(IndexError):
            while True:
                self._queue.popleft()
                self._taken += 1
