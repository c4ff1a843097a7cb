"""A bag's messages one after the other, as bytes; works for bags of any size, and for damaged ones."""

import errno
import heapq
import json
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from vibro_ros.bag.folders import bag_files
from vibro_ros.bag.mcap_file import ForeignFileError, McapFile
from vibro_ros.bag.metadata import FILE_NAME, custom_of, read_metadata
from vibro_ros.messages.topics import ROBOT_TOPICS, TOPICS
from vibro_ros.process.files import one_line, user_path

MOST_FLAWS = 20  # most sentences on what cannot be read that are shown
MOST_HELD = 100_000  # most messages that are held to sort a file that is not in time order
MOST_HELD_BYTES = 64 * 2**20  # most bytes of such messages

_TYPES = {name: topic.type for name, topic in TOPICS.items()}


Message = tuple[str, int, bytes]  # topic, recorded stamp [ns], serialised message


class BagError(Exception):
    """The recording cannot be read; the message is one line for the user."""

    def __init__(self, message: str):
        super().__init__(one_line(message))


@contextmanager
def bag_errors(bag: Path) -> Iterator[None]:
    """Context that turns every error with a bag into a ValueError of one line, as executables expect."""
    try:
        yield
    except BagError as error:
        raise ValueError(str(error)) from error
    except OSError as error:
        raise ValueError(f"{error.filename or bag}: {error.strerror or error}") from error
    except MemoryError:
        raise ValueError(f"{bag}: not enough memory to read it; free some, or read some of its columns with "
                         "vibro_ros.read_bag") from None


def check_is_bag(folder: Path) -> None:
    """Raise a BagError unless a folder has MCAP files or a metadata.yaml (OSError when it cannot be read)."""
    reason = ""
    if not folder.exists():
        reason = "no such folder"
    elif not folder.is_dir():
        reason = "a file, not a bag"
    else:
        files, flaws = bag_files(folder)
        if not files and not os.path.lexists(folder / FILE_NAME):
            reason = f"nothing in it can be read: {flaws[0]}" if flaws else "not a bag, it holds no .mcap file"
    if reason:
        raise BagError(f"{folder}: {reason}; give the folder of a recording")


@dataclass(frozen=True)
class RecordedTopic:
    """One topic of a recording."""

    type_name: str  # ROS type, such as ``nav_msgs/msg/Odometry``
    messages: int


class BagStream:
    """A bag folder, of this recorder or of ``ros2 bag record``, opened for reading; a context manager.

    Every file is scanned once before its messages are read, so that topics and counts are those of the messages
    themselves. What cannot be read is left out and named; nothing is ever written into the folder, and no link in it is
    followed.

    `start` and `end` are the least and the greatest recorded stamp [ns] of a message, 0 in an empty bag; `metadata` is
    the bag's custom data. Readers of the messages count in `unreadable` those that are not of their topic's type. A bag
    that is not sealed, because its recorder was killed or still runs, is read as far as it was written. BagError when
    the folder is missing or no bag, or when nothing in it can be read; the message names path, reason and remedy.
    """

    def __init__(self, path: str | Path):
        self.folder = user_path(path)
        self.unreadable = Unreadable()
        try:
            check_is_bag(self.folder)
            contents = BagContents(self.folder)
        except OSError as error:
            raise BagError(f"{self.folder}: cannot be read: {error.strerror or error}") from error
        self._files, self._flaws = contents.files, contents.flaws
        self.topics = self._merged_topics()
        filled = [file.information for file in self._files if file.information.messages]
        self.start = min((information.first for information in filled), default=0)
        self.end = max((information.last for information in filled), default=0)
        self.metadata = contents.custom
        if not filled and (flaws := self.flaws):
            raise BagError(f"{self.folder}: nothing in it can be read: {flaws[0]}")

    def __enter__(self) -> "BagStream":
        return self

    def __exit__(self, *_: object) -> None:
        """Files are open only while messages are read."""

    @property
    def flaws(self) -> list[str]:
        """Sentences on the parts of the bag that are not read: damage, and the unreadable messages so far."""
        flaws = [*self._flaws, *(flaw for file in self._files for flaw in file.flaws)]
        return [one_line(flaw) for flaw in (*flaws, *self.unreadable.lines())]

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[Message]:
        """Yield topic, recorded stamp [ns] and bytes of each message of `topics`, None for all, in time order.

        A file that is not in time order is sorted, as far as no message is more than `MOST_HELD` out of place. BagError
        when the disk fails.
        """
        chosen = frozenset(self.topics) if topics is None else topics & self.topics.keys()
        try:
            for file in self._files:
                agreed = frozenset(topic.name for topic in file.topics  # of the same type in the file as in the bag
                                   if topic.name in chosen and topic.type_name == self.topics[topic.name].type_name)
                messages = file.messages(agreed)
                yield from messages if file.ordered else _in_time(messages)
        except OSError as error:
            raise BagError(f"{self.folder}: cannot be read: {error.strerror or error}") from error

    def _merged_topics(self) -> dict[str, RecordedTopic]:
        merged: dict[str, RecordedTopic] = {}
        for file in self._files:
            for topic in file.topics:
                earlier = merged.get(topic.name)
                number = file.information.counts[topic.name]
                if earlier is None:
                    merged[topic.name] = RecordedTopic(topic.type_name, number)
                elif earlier.type_name == topic.type_name:
                    merged[topic.name] = replace(earlier, messages=earlier.messages + number)
                else:
                    self._flaws.append(f"{file.information.name}: {number} messages on {topic.name} are not "
                                       f"read: there it is {topic.type_name}, before it was {earlier.type_name}")
        return merged


class BagContents:
    """Contents of a bag folder: its metadata.yaml and its files in time order, each scanned.

    With `all_files`, files that metadata.yaml does not name are read, too. `information` is the content of
    metadata.yaml, empty when it cannot be read, `custom` the bag's custom data; `flaws` are sentences on metadata.yaml
    and on files that cannot be read at all. OSError when the folder cannot be read, or too many files are open.
    """

    def __init__(self, folder: Path, all_files: bool = False):
        self.information: dict = {}
        self.files: list[McapFile] = []
        paths, self.flaws = bag_files(folder)
        is_missing = not os.path.lexists(folder / FILE_NAME)
        try:
            self.information = {} if is_missing else read_metadata(folder)
        except ValueError as error:
            reason = str(error).removeprefix(f"{folder}/").removesuffix("; give the path of a YAML file")
            self.flaws.insert(0, reason)
        for path in paths if all_files else self._named_files(paths):
            try:
                self.files.append(McapFile(path))
            except ForeignFileError as error:
                self.flaws.append(f"{path.name}: {error}")
            except OSError as error:
                if error.errno in (errno.EMFILE, errno.ENFILE):
                    raise
                self.flaws.append(f"{path.name}: {error.strerror or error}")
        self.files.sort(key=lambda file: file.information.first)
        if is_missing and self.files and all(file.sealed for file in self.files):
            self.flaws.insert(0, f"{FILE_NAME}: is missing; `recover` writes it")
        self.custom = custom_of(self.information) or {
            key: value for file in self.files for key, value in file.custom.items()}

    def _named_files(self, paths: list[Path]) -> list[Path]:
        """Return the folder's files that metadata.yaml names; all files if it names none of them."""
        if str(self.information.get("compression_mode", "")).lower() == "message":
            self.flaws.append(f"{FILE_NAME}: each message is compressed; `ros2 bag convert` unfolds them")
            return []
        names = self.information.get("relative_file_paths")
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            return paths
        present = {path.name for path in paths}
        flawed = {flaw.partition(": ")[0] for flaw in self.flaws}
        self.flaws += [f"{name}: {FILE_NAME} names this file, and it is not in the folder"
                       for name in dict.fromkeys(names) if name not in present | flawed]
        if present.isdisjoint(names):
            return paths
        self.flaws += [f"{path.name}: {FILE_NAME} does not name this file; it is not read" for path in paths
                       if path.name not in names and path.stat().st_size]
        return [path for path in paths if path.name in names]


class Unreadable:
    """Counts unreadable messages, and keeps the description of the first of each topic."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._firsts: dict[str, str] = {}

    def add(self, topic: str, index: int, stamp: int, reason: object) -> None:
        """Count a message; `index` is its number on the topic in the bag, from 0, `stamp` its recorded stamp [ns]."""
        self._counts[topic] += 1
        self._firsts.setdefault(topic, f"the first is number {index} at {stamp} ns: {reason}")

    def lines(self) -> list[str]:
        """Return a sentence for each topic with unreadable messages."""
        return [f"{topic}: {count} unreadable message{'s' if count > 1 else ''}, {self._firsts[topic]}"
                for topic, count in self._counts.items()]


def flaw_lines(flaws: Sequence[str]) -> list[str]:
    """Return lines for people: the first `MOST_FLAWS` of the flaws, and how many more there are."""
    more = [f"not read: {len(flaws) - MOST_FLAWS} more"] if len(flaws) > MOST_FLAWS else []
    return [*(f"not read: {one_line(flaw)}" for flaw in flaws[:MOST_FLAWS]), *more]


def robot_topics(stream: BagStream) -> dict[str, str]:
    """Return the full names of the robot's topics in a bag, by their keys in `TOPICS`.

    They are taken from the bag's custom data, or else found by the last part of the name and the type. BagError when a
    topic in the custom data has another type, or when a bag without custom data has two robots.
    """
    try:
        recorded_names = json.loads(stream.metadata.get("topics", "{}"))
        topics = {name: str(recorded_names[name]) for name in _TYPES if name in recorded_names}
    except (ValueError, TypeError, RecursionError) as error:
        raise BagError(f"{stream.folder}: its custom data `topics` cannot be read: {error}") from error
    for name, topic in topics.items():
        recorded = stream.topics.get(topic)
        if recorded and recorded.type_name != _TYPES[name]:
            raise BagError(f"{stream.folder}: {topic} is {recorded.type_name}, not the robot's {_TYPES[name]}")
    if topics:
        return topics
    for topic, recorded in stream.topics.items():
        name = topic.rpartition("/")[2]
        if ROBOT_TOPICS.get(name) == recorded.type_name:
            if name in topics:
                raise BagError(f"{stream.folder}: {name} is ambiguous: {topics[name]} and {topic}")
            topics[name] = topic
    return topics


def _in_time(messages: Iterator[Message]) -> Iterator[Message]:
    """Yield messages sorted by stamp, as far as the limits of held messages allow; equal stamps keep their order."""
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
