"""An MCAP file of a bag, opened for reading."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk

from vibro_ros.bag.mcap_gathering import Scan, message_head
from vibro_ros.bag.mcap_records import (
    HEAD,
    LARGEST_RECORD,
    MESSAGE_HEAD,
    MalformedError,
    chunk_content,
    parsed,
    records,
)
from vibro_ros.bag.mcap_scan import scan
from vibro_ros.bag.metadata import FileInformation, TopicInformation, custom_data, qos_profiles
from vibro_ros.bag.part import CDR, Message, PartContents
from vibro_ros.process.untrusted import open_to_read


class McapPart:
    """Looks through the file when it is made; see `Part`, and `scan` for what was found.

    Parameters
    ----------
    path : Path
        A regular file.
    name : str
        What messages call it.

    Raises
    ------
    ForeignFileError
        When the file is empty, no MCAP, or not of ROS 2.
    OSError
        When it cannot be read.
    """

    def __init__(self, path: Path, name: str):
        self._path = path
        with open_to_read(path, follow=False) as file:
            self.scan = scan(file, os.fstat(file.fileno()).st_size)
        self.is_sealed, self.damaged = self.scan.sealed, self.scan.damaged
        self.contents, self._topics = described(name, self.scan)

    def messages(self, topics: frozenset[str]) -> Iterator[Message]:
        """Those of some topics, as they lie in the file."""
        chosen = {channel: topic for channel, topic in self._topics.items() if topic in topics}
        try:
            with open_to_read(self._path, follow=False) as file:
                for offset in self.scan.blocks if chosen else ():
                    yield from _block(file, offset, chosen)
        except MalformedError as error:  # it could be read a moment ago
            self.contents.flaws.append(f"{self.contents.information.name}: changed while it was read: {error}")


def _block(file: BinaryIO, offset: int, chosen: dict[int, str]) -> Iterator[Message]:
    """The messages of the chunk, or the one message, at an offset; of the chosen channels, with their topics."""
    file.seek(offset)
    head = file.read(HEAD.size)
    if len(head) < HEAD.size:
        raise MalformedError("it ends too early")
    opcode, length = HEAD.unpack(head)
    content = file.read(min(length, LARGEST_RECORD))
    raw = chunk_content(parsed(Chunk, content)) if opcode == Opcode.CHUNK else head + content
    for kind, _, begin, end in records(raw):
        if kind == Opcode.MESSAGE:
            with contextlib.suppress(MalformedError):  # counted when the file was scanned
                channel, stamp = message_head(raw, begin, end)
                if channel in chosen:
                    yield chosen[channel], stamp, raw[begin + MESSAGE_HEAD.size:end]


def described(name: str, found: Scan) -> tuple[PartContents, dict[int, str]]:
    """What a scanned file holds, and the topic of each channel that is read."""
    flaws = list(_damage(name, found))
    topics: dict[str, TopicInformation] = {}
    read: dict[int, str] = {}
    for number, channel in found.contents.channels.items():
        topic = _topic(channel, found)
        if topic is None or topic.encoding != CDR or topics.setdefault(topic.name, topic).type_name != topic.type_name:
            flaws.append(f"{name}: {found.contents.counts[number]} messages on {channel.topic} are not read: their "
                         "channel has no type, another type than the topic, or is not encoded as CDR")
        else:
            read[number] = channel.topic
    counts = dict.fromkeys(topics, 0)
    for number, topic_name in read.items():
        counts[topic_name] += found.contents.counts[number]
    contents = found.contents
    information = FileInformation(name, contents.first if contents.messages else 0, contents.last, counts)
    return PartContents(information, list(topics.values()), custom_data(found.metadata), found.ordered, flaws), read


def _topic(channel: Channel, found: Scan) -> TopicInformation | None:
    schema = found.contents.schemas.get(channel.schema_id)
    return schema and TopicInformation(
        channel.topic, schema.name, qos_profiles(channel.metadata.get("offered_qos_profiles", "")),
        channel.metadata.get("topic_type_hash", ""), channel.message_encoding)


def _damage(name: str, found: Scan) -> Iterator[str]:
    if found.damaged:
        yield f"{name}: {found.damaged} damaged bytes are not read: {found.damage}"
    if found.lost:
        yield f"{name}: {found.lost} records within chunks are not read: {found.damage}"
    if not found.ended:
        yield f"{name}: it is not sealed, and its last {found.size - found.end} bytes are not read; `recover` seals it"
    elif not found.sealed:
        yield f"{name}: its index tells something else than its data; `recover` writes it again"
