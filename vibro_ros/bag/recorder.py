"""Record messages to a bag from a thread of its own, so that no caller ever waits for the disk.

`Recorder.write` only puts the message on a bounded queue, which the writer thread looks at every
`POLL_PERIOD`: waking it for each message would cost the caller ten times as much. The thread takes
one message at a time, because many at once would hold the interpreter lock and delay the robot's clock.
What a killed process loses is what came in the last `FLUSH_PERIOD`.
"""

import contextlib
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import count
from pathlib import Path
from threading import Event, Lock, Thread

from rosbags.interfaces import Connection
from rosbags.rosbag2 import WriterError

from vibro_ros.bag.storage import FlushedWriter, jazzy_types, reliable_qos

FLUSH_PERIOD = 0.1  # s, longest time that a message stays in memory only; a flush costs about 0.3 ms
POLL_PERIOD = 0.005  # s, between two looks at an empty queue
BACKLOG = 20_000  # messages waiting for the disk; about 4 s of a robot that publishes at 1 kHz
LAST_STAMP = 2**63 - 2  # ns; rosbag2 keeps signed 64-bit stamps, and rosbags reserves the last one


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    Attributes
    ----------
    name : str
        Fully resolved name, such as ``/odom``.
    type_name : str
        ROS type, such as ``nav_msgs/msg/Odometry``; any type of ROS 2 Jazzy's common interfaces.
    qos_depth : int
        History depth that the publisher offers.
    """

    name: str
    type_name: str
    qos_depth: int


class Recorder:
    """Writes messages to a new bag folder; a context manager.

    Once open, nothing that happens to the disk reaches the caller: the recording stops, `fault`
    says why, and further messages are dropped and counted. After `close`, the number of `write`
    calls is `written` + `dropped`.

    Parameters
    ----------
    folder : Path
        Folder to make; it must not exist, its parents may be missing.
    topics : sequence of Topic
        Every topic that will be written.
    metadata : mapping of str to str
        Kept as the bag's custom data (scene, parameters, version, start time).
    backlog : int
        Largest number of messages waiting for the disk; beyond it, messages are dropped.

    Raises
    ------
    FileExistsError
        When the folder exists: a recording never overwrites.
    OSError
        When the folder cannot be made or written.
    ValueError
        For an unknown message type or a topic given twice.
    """

    def __init__(self, folder: Path, topics: Sequence[Topic], metadata: Mapping[str, str],
                 backlog: int = BACKLOG) -> None:
        self.folder = Path(folder)
        self.fault: str | None = None
        self.written = 0
        self._backlog = backlog
        self._refused = 0
        self._refusing = Lock()
        self._lost = 0
        self._unflushed = 0
        self._due = time.monotonic() + FLUSH_PERIOD
        self._accepting = True
        self._closing = Event()
        self._queue: deque[tuple[Connection, int, bytes]] = deque()
        self._writer, self._connections = _opened(self.folder, topics, metadata)
        self._thread = Thread(target=self._run, name="bag writer", daemon=True)
        self._thread.start()

    def write(self, topic_name: str, stamp_ns: int, data: bytes) -> bool:
        """Queue one message; never blocks, never raises.

        Parameters
        ----------
        topic_name : str
            One of the topics' names.
        stamp_ns : int
            Recorded stamp, ROS time [ns], a Python int from 0 to `LAST_STAMP`.
        data : bytes
            The serialised message (CDR), as published.

        Returns
        -------
        bool
            False when the message was dropped (and counted): unknown topic, stamp that would spoil
            the bag, data that is not bytes, queue full, recording stopped.
        """
        connection = self._connections.get(topic_name)
        if (connection is not None and type(stamp_ns) is int and 0 <= stamp_ns <= LAST_STAMP
                and type(data) is bytes and self._accepting and len(self._queue) < self._backlog):
            self._queue.append((connection, stamp_ns, data))
            return True
        with self._refusing:
            self._refused += 1
        return False

    @property
    def dropped(self) -> int:
        """Messages given to `write` that are not in the bag and never will be."""
        return self._refused + self._lost

    @property
    def backlog(self) -> int:
        """Messages that wait for the writer thread."""
        return len(self._queue)

    def close(self) -> None:
        """Write what is queued, seal the bag and end the thread; calling it again does nothing."""
        self._accepting = False
        self._closing.set()
        self._thread.join()
        self._drop_queue()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        try:
            self._write_queue()
            self._flush()
            self._writer.close()
        except Exception as error:  # whatever the disk or rosbags does, the robot goes on
            self._stop(error)

    def _write_queue(self) -> None:
        """Write what is queued until told to close, flushing every `FLUSH_PERIOD`."""
        closing = False
        while not closing:
            closing = self._closing.wait(POLL_PERIOD)  # asked before the queue is emptied for the last time
            while self._queue:
                self._unflushed += 1
                self._writer.write(*self._queue.popleft())
                time.sleep(0)  # give up the interpreter lock after each message
                self._flush_when_due()
            self._flush_when_due()

    def _flush_when_due(self) -> None:
        if time.monotonic() >= self._due:
            self._flush()

    def _flush(self) -> None:
        self._writer.flush()
        self.written += self._unflushed
        self._unflushed = 0
        self._due = time.monotonic() + FLUSH_PERIOD

    def _stop(self, error: Exception) -> None:
        """Give the recording up; what is flushed stays in the unsealed file."""
        self._accepting = False
        reason = " ".join((getattr(error, "strerror", None) or str(error) or type(error).__name__).split())
        self.fault = f"recording to {self.folder} stopped: {reason}; the bag is not sealed"
        self._lost += self._unflushed
        self._unflushed = 0
        self._drop_queue()
        _abandon(self._writer)

    def _drop_queue(self) -> None:
        with contextlib.suppress(IndexError):
            while True:
                self._queue.popleft()
                self._lost += 1


def new_bag_folder(directory: Path, now: datetime) -> Path:
    """Name of a bag folder that does not exist yet, as rosbag2 names them.

    Parameters
    ----------
    directory : Path
        Where recordings go; ``~`` is the home folder.
    now : datetime
        Start of the recording, local time.

    Returns
    -------
    Path
        ``vibro_robot_YYYY_MM_DD-HH_MM_SS`` in `directory`, with ``_2``, ``_3``, … where taken. The
        folder is not made: `Recorder` does that, and refuses one made meanwhile.
    """
    name = now.strftime("vibro_robot_%Y_%m_%d-%H_%M_%S")
    folder = Path(directory).expanduser() / name
    suffixes = count(2)
    while folder.exists() or folder.is_symlink():
        folder = folder.with_name(f"{name}_{next(suffixes)}")
    return folder


def _opened(folder: Path, topics: Sequence[Topic], metadata: Mapping[str, str],
            ) -> tuple[FlushedWriter, dict[str, Connection]]:
    """A bag with every topic announced and on the disk, and the connections by topic name."""
    _check_topics(topics)
    with contextlib.ExitStack() as on_failure:
        try:
            writer = FlushedWriter(folder)
            for key, value in metadata.items():
                writer.set_custom_data(key, value)
            on_failure.callback(_abandon, writer)
            writer.open()
            connections = {topic.name: _announced(writer, topic) for topic in topics}
            writer.flush()
        except OSError as error:
            raise OSError(f"cannot record to {folder}: {error.strerror}; give a folder that can be written") from error
        except WriterError as error:
            if folder.exists():
                raise FileExistsError(f"{folder} exists already; a recording never overwrites: "
                                      "give a new folder") from error
            raise ValueError(f"{folder}: {error}") from error
        on_failure.pop_all()
    return writer, connections


def _abandon(writer: FlushedWriter) -> None:
    with contextlib.suppress(Exception):  # closing flushes once more, onto the disk that failed
        writer.abort()


def _announced(writer: FlushedWriter, topic: Topic) -> Connection:
    return writer.add_connection(topic.name, topic.type_name, typestore=jazzy_types(),
                                 offered_qos_profiles=[reliable_qos(topic.qos_depth)])


def _check_topics(topics: Sequence[Topic]) -> None:
    names = [topic.name for topic in topics]
    for topic in topics:
        if topic.type_name not in jazzy_types().fielddefs:
            raise ValueError(f"{topic.name}: unknown message type {topic.type_name!r}; give one of ROS 2 Jazzy's")
        if names.count(topic.name) > 1:
            raise ValueError(f"{topic.name}: given twice; a topic is recorded once")
