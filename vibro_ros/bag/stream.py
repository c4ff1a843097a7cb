"""A bag's messages one after the other, as bytes, whatever its size and storage, and whatever is damaged in it."""

import heapq
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from rosbags.rosbag2.storage_mcap import zstd

from vibro_ros.bag.mcap_records import LARGEST_RECORD
from vibro_ros.bag.metadata import FILE_NAME, depth_of, is_lasting
from vibro_ros.bag.part import Message, Part
from vibro_ros.bag.parts import bag_files, chosen_files, opened_parts, told
from vibro_ros.bag.unreadable import Unreadable
from vibro_ros.process.untrusted import one_line

QOS_DEPTH = 10
"""Of a topic of which the bag does not say it."""

MOST_HELD = 100_000
"""Messages of a file that wait to be put in the order of time, where they lie out of it."""
MOST_HELD_BYTES = 64 * 2**20
"""Bytes of them."""


class BagError(Exception):
    """A recording cannot be read; the message is one line for the user."""

    def __init__(self, message: str):
        super().__init__(one_line(message))


@dataclass(frozen=True)
class RecordedTopic:
    """What a recording holds of one topic.

    Attributes
    ----------
    type_name : str
        ROS type, such as ``nav_msgs/msg/Odometry``.
    messages : int
        Number of messages.
    qos_depth : int
        History depth that the publisher offered.
    lasting : bool
        Whether late subscribers got what was published before (transient local).
    """

    type_name: str
    messages: int
    qos_depth: int = QOS_DEPTH
    lasting: bool = False


class BagStream:
    """A bag folder, opened for reading; a context manager.

    Every file is looked through once before its messages are read, so that what the bag says of itself is what is
    there. What cannot be read is left out and named; nothing is ever written into the folder, and no link in it
    followed.

    Parameters
    ----------
    path : str or Path
        The bag folder, of this recorder or of ``ros2 bag record``.

    Attributes
    ----------
    folder : Path
        The bag folder.
    start, end : int
        Least and greatest recorded stamp [ns] of a message; 0 in an empty bag.
    metadata : dict of str to str
        The bag's custom data.
    topics : dict of str to RecordedTopic
        Every topic, by full name.
    unreadable : Unreadable
        Where those who read the messages count the ones that are not of their topic's type.

    Raises
    ------
    BagError
        When the folder is missing, no bag, or not sealed, or when nothing in it can be read; the message names path,
        reason and remedy.
    """

    def __init__(self, path: str | Path):
        self.folder = Path(path)
        self.unreadable = Unreadable()
        with ExitStack() as stack:
            try:
                _check_folder(self.folder)
                self._open(stack)
            except OSError as error:
                raise BagError(f"{self.folder}: cannot be read: {error.strerror or error}") from error
            self._stack = stack.pop_all()

    def _open(self, stack: ExitStack) -> None:
        known = told(self.folder)
        files, wrong = chosen_files(self.folder, known.names)
        self._parts, unopened = opened_parts(files, stack)
        self._flaws = [*known.flaws, *wrong, *unopened]
        self._compressed = known.compressed_messages
        self.topics = self._merged_topics()
        filled = [part.contents.information for part in self._parts if part.contents.information.messages]
        self.start = min((one.first for one in filled), default=0)
        self.end = max((one.last for one in filled), default=0)
        self.metadata = known.custom or {
            key: value for part in self._parts for key, value in part.contents.custom.items()}
        if not filled and (flaws := self.flaws):
            raise BagError(f"{self.folder}: damaged bag: nothing in it can be read: {flaws[0]}")

    def __enter__(self) -> "BagStream":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def flaws(self) -> list[str]:
        """What of the bag is not read, one line each: what is damaged, and what was counted as unreadable so far."""
        found = [*self._flaws, *(flaw for part in self._parts for flaw in part.contents.flaws)]
        return [one_line(flaw) for flaw in (*found, *self.unreadable.lines())]

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[tuple[str, int, bytes]]:
        """Topic, recorded stamp [ns] and serialised message of each message, in the order of recording.

        Messages of a file that lie out of the order of time are put in it as far as they lie within `MOST_HELD` of
        their place.

        Parameters
        ----------
        topics : frozenset of str
            Which; None for all.

        Raises
        ------
        BagError
            When the disk fails.
        """
        chosen = frozenset(self.topics) if topics is None else topics & self.topics.keys()
        try:
            for part in self._parts if chosen else ():
                found = self._unfolded(part.messages(self._agreed(part, chosen)))
                yield from found if part.contents.ordered else _in_time(found)
        except OSError as error:
            raise BagError(f"{self.folder}: cannot be read: {error.strerror or error}") from error

    def _agreed(self, part: Part, chosen: frozenset[str]) -> frozenset[str]:
        """Those topics that have the same type in a file as in the bag."""
        return frozenset(topic.name for topic in part.contents.topics
                         if topic.name in chosen and topic.type_name == self.topics[topic.name].type_name)

    def _unfolded(self, messages: Iterator[Message]) -> Iterator[Message]:
        if not self._compressed:
            yield from messages
            return
        for index, (topic, stamp, data) in enumerate(messages):
            try:
                yield topic, stamp, zstd.ZstdDecompressor().decompress(data, max_length=LARGEST_RECORD)
            except (zstd.ZstdError, EOFError):
                self.unreadable.add(topic, index, stamp, "it cannot be unfolded")

    def _merged_topics(self) -> dict[str, RecordedTopic]:
        found: dict[str, RecordedTopic] = {}
        for part in self._parts:
            for topic in part.contents.topics:
                before = found.get(topic.name)
                number = part.contents.information.counts[topic.name]
                if before is None:
                    found[topic.name] = RecordedTopic(topic.type_name, number, depth_of(topic.qos, QOS_DEPTH),
                                                      is_lasting(topic.qos))
                elif before.type_name == topic.type_name:
                    found[topic.name] = replace(before, messages=before.messages + number)
                else:
                    self._flaws.append(f"{part.contents.information.name}: {number} messages on {topic.name} are not "
                                       f"read: there it is {topic.type_name}, before it was {before.type_name}")
        return found


def _in_time(messages: Iterator[Message]) -> Iterator[Message]:
    """The messages in the order of their stamps, equal ones as they came, as far as they can be held."""
    held: list[tuple[int, int, Message]] = []
    numbers, size = count(), 0
    for message in messages:
        heapq.heappush(held, (message[1], next(numbers), message))
        size += len(message[2])
        while len(held) > MOST_HELD or size > MOST_HELD_BYTES:
            _, _, first = heapq.heappop(held)
            size -= len(first[2])
            yield first
    while held:
        yield heapq.heappop(held)[2]


def _check_folder(folder: Path) -> None:
    if not folder.exists():
        raise BagError(f"{folder}: no such folder; give the folder of a recording")
    if not folder.is_dir():
        raise BagError(f"{folder}: a file, not a bag; give the folder that holds metadata.yaml")
    if (folder / FILE_NAME).exists() or (folder / FILE_NAME).is_symlink():
        return
    files, _ = bag_files(folder)
    if files:
        raise BagError(f"{folder}: the bag is not sealed: its recorder still runs, or was killed; "
                       f"end the recorder, or seal it with `recover {folder}`")
    raise BagError(f"{folder}: not a bag, it holds no metadata.yaml; give the folder of a recording")
