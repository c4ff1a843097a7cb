"""One MCAP file of a bag, read record by record, over damaged parts, up to its end or to where it is torn.

Nothing that a file says of itself is believed: each length is compared with the file's own, each chunk is unfolded and
compared with its checksum, and the summary with the data. A damaged chunk costs that chunk: reading goes on with the
next record or, where the records' own lengths are lost, with the next chunk. The library `mcap` parses each record; its
readers stop at the first damage, and believe every length.
"""

import os
import re
from array import array
from collections.abc import Callable, Iterator
from io import BytesIO
from itertools import chain
from pathlib import Path
from struct import Struct
from typing import BinaryIO, TypeVar
from zlib import crc32

import lz4.frame
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from vibro_ros.bag.mcap_segment import HEAD, MAGIC, METADATA_KEY, METADATA_NAME, Summary, message_indexes, packed, zstd
from vibro_ros.bag.metadata import LAST_STAMP, FileInformation, TopicInformation, custom_data, qos_profiles
from vibro_ros.process.files import open_to_read

LARGEST_RECORD = 128 * 2**20
"""Bytes of a record's content, and of a chunk's when it is decompressed; a longer one is not read."""
UNFOLDING = 100
"""How many times as long as the file its chunks may be when they are unfolded, beyond `FREE_UNFOLDING`."""
FREE_UNFOLDING = 32 * 2**20
"""Bytes that chunks may unfold to in any case."""

Message = tuple[str, int, bytes]
"""Topic, recorded stamp [ns], serialised message."""

_Record = TypeVar("_Record", bound=McapRecord)
_MESSAGE_HEAD = Struct("<HIQQ")  # channel, sequence number, log time, publish time; the data follow
_ENDING_SIZE = len(packed(Footer(summary_start=0, summary_offset_start=0, summary_crc=0))) + len(MAGIC)
_DATA_END_SIZE = HEAD.size + 4
_LONGEST_HEADER = 2**20  # bytes
_BLOCK = 2**20  # bytes that are searched at a time
_OF_DATA = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX,
                      Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END})
_OF_SUMMARY = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.STATISTICS,
                         Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET})
_CHUNK_HEAD = re.compile(rb"\x06.{36}(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)", re.DOTALL)
"""A chunk's head to its compression; the length of its data follows."""
_CHUNK_HEAD_SIZE = 64  # bytes, more than it takes


class ForeignFileError(ValueError):
    """A file that is no ROS 2 recording; the message says why."""


class MalformedError(ValueError):
    """Bytes that are not the record they should be."""


class McapFile:
    """An MCAP file, a regular one, looked through when it is made; it is open only while it is read.

    ForeignFileError when the file is empty, no MCAP, or not of ROS 2; OSError when it cannot be read.

    Attributes
    ----------
    information : FileInformation
        Its name, times, and readable messages by topic.
    topics : list of TopicInformation
        Each topic of `information`, once.
    custom : dict of str to str
        Custom data that the file keeps inside.
    ordered : bool
        Whether every message is at least as late as the one before.
    flaws : list of str
        Sentences on the parts that are not read.
    size, end : int
        Bytes of the file, and those up to the end of its readable data.
    damaged : int
        Bytes before `end` that cannot be read.
    ended, sealed : bool
        Whether the file has its footer, and whether a summary before it agrees with the data.
    summary : Summary
        What such a summary says.
    tail : bytes
        Message indexes of the last chunk, to be written at `end`, when the file lacks some of them.
    """

    def __init__(self, path: Path):
        self.path = path
        self.summary = Summary()
        self.ordered, self.ended, self.sealed = True, False, False
        self.end = self.damaged = 0
        self.tail = b""
        self.custom: dict[str, str] = {}
        self._blocks = array("Q")  # offsets of the readable chunks, and of the readable messages outside of chunks
        self._damage = ""  # the first
        self._unannounced = 0  # messages
        self._last_stamp = self._unfolded_bytes = 0
        self._chunk: ChunkIndex | None = None  # the last one; its message indexes follow it
        self._entries: dict[int, array] = {}
        self._seen: dict[int, int] = {}  # offsets of its message indexes, by channel
        self._seen_end = self._chunk_ahead = 0
        with open_to_read(path, follow=False) as self._file:
            self.size = os.fstat(self._file.fileno()).st_size
            self._scan()
        del self._file
        self.topics, self._read_channels, self.flaws = self._described()
        counts = dict.fromkeys((topic.name for topic in self.topics), 0)
        for number, topic_name in self._read_channels.items():
            counts[topic_name] += self.summary.counts[number]
        self.information = FileInformation(path.name, *self.summary.span, counts)

    def messages(self, topics: frozenset[str]) -> Iterator[Message]:
        """The messages of some topics, as they lie in the file (OSError when it cannot be opened any more)."""
        chosen = {channel: topic for channel, topic in self._read_channels.items() if topic in topics}
        try:
            with open_to_read(self.path, follow=False) as file:
                for offset in self._blocks if chosen else ():
                    yield from _block(file, offset, chosen)
        except MalformedError as error:  # it could be read a moment ago
            self.flaws.append(f"{self.path.name}: changed while it was read: {error}")

    def _scan(self) -> None:
        at = self.end = self._header()
        skipped, reason = 0, ""  # bytes since the last readable record, and why the first of them cannot be read
        while at + HEAD.size <= self.size and not self.ended:
            opcode, length = HEAD.unpack(self._read(at, HEAD.size))
            following = at + HEAD.size + length
            try:
                if opcode not in _OF_DATA or following > self.size:
                    raise MalformedError("not a record")
                self._take(opcode, at, length)
            except MalformedError as error:
                following = self._next(at, opcode, following)
                if not following:
                    break
                self._finish_chunk(last=False)
                reason = reason or f"{error} at byte {at}"
                skipped += following - at
            else:
                if opcode != Opcode.MESSAGE_INDEX:  # a message index counts once all of its chunk are there
                    self.end = at if self.ended else following
                    self.damaged += skipped
                    self._damage = self._damage or reason
                    skipped, reason = 0, ""
            at = following
        self._finish_chunk(last=not self.ended)
        said = self._summary_said() if self.ended else None
        for channel in self.summary.counts.keys() - self.summary.channels.keys():
            self._unannounced += self.summary.counts.pop(channel)
        if said is not None:  # do readers that trust the summary find every readable message?
            start, messages, chunks = said
            complete = messages in (None, self.summary.messages)
            self.sealed = (complete and (not chunks or sorted(chunks) == list(self._blocks))
                           if start else not self.damaged)

    def _header(self) -> int:
        """Offset of the first record after the header."""
        if self.size == 0:
            raise ForeignFileError("the file is empty, nothing was recorded")
        if self._read(0, len(MAGIC)) != MAGIC[:self.size]:
            raise ForeignFileError("not an MCAP file")
        begin = len(MAGIC) + HEAD.size
        opcode, length = HEAD.unpack(self._read(len(MAGIC), HEAD.size)) if self.size >= begin else (0, 0)
        if opcode != Opcode.HEADER or begin + length > self.size or length > _LONGEST_HEADER:
            raise ForeignFileError("the file ends within its header, nothing was recorded")
        try:
            profile = parsed(Header, self._read(begin, length)).profile
        except MalformedError as error:
            raise ForeignFileError(f"its header cannot be read: {error}") from error
        if profile != "ros2":
            raise ForeignFileError(f"an MCAP file, but not of ROS 2: its profile is {profile!r}")
        return begin + length

    def _next(self, at: int, opcode: int, following: int) -> int:
        """Where to go on behind an unreadable record at an offset; 0 when nothing follows."""
        if self._chunk_ahead <= at:
            self._chunk_ahead = _next_chunk(self._file, at + 1, self.size)
        if opcode in _OF_DATA and opcode != Opcode.DATA_END and following + HEAD.size <= self._chunk_ahead:
            kind, length = HEAD.unpack(self._read(following, HEAD.size))
            if kind in _OF_DATA and following + HEAD.size + length <= self.size:
                return following
        return self._chunk_ahead if self._chunk_ahead < self.size else 0

    def _take(self, opcode: int, at: int, length: int) -> None:
        if opcode == Opcode.DATA_END:
            self._check_ending(at)
            return
        if opcode == Opcode.ATTACHMENT:
            self._finish_chunk(last=False)
            return
        if length > LARGEST_RECORD:
            raise MalformedError(f"a record of {length} bytes, more than {LARGEST_RECORD}")
        content = self._read(at + HEAD.size, length)
        if opcode == Opcode.MESSAGE_INDEX:
            if length < 6 or int.from_bytes(content[2:6], "little") != length - 6:
                raise MalformedError("not a MessageIndex")
            self._seen[int.from_bytes(content[:2], "little")] = at
            self._seen_end = at + HEAD.size + length
            return
        self._finish_chunk(last=False)
        if opcode == Opcode.CHUNK:
            self._begin_chunk(at, content)
        elif opcode == Opcode.METADATA:
            found = parsed(Metadata, content)
            self.summary.metadata.append(MetadataIndex(at, HEAD.size + length, found.name))
            if found.name == METADATA_NAME:
                self.custom = custom_data(found.metadata.get(METADATA_KEY, ""))
        elif opcode == Opcode.MESSAGE:
            entries: dict[int, array] = {}
            self._enter(entries, content, 0, length, at)
            for channel, (stamp, _) in entries.items():
                self.summary.add_messages(channel, 1, stamp, stamp)
            self.summary.indexed = False
            self._blocks.append(at)
        else:
            self._take_definition(opcode, content)

    def _take_definition(self, opcode: int, content: bytes) -> None:
        found: Schema | Channel
        known: dict
        if opcode == Opcode.SCHEMA:
            found, known = parsed(Schema, content), self.summary.schemas
        elif opcode == Opcode.CHANNEL:
            found, known = parsed(Channel, content), self.summary.channels
            self.summary.counts.setdefault(found.id, 0)
        else:
            return
        if known.setdefault(found.id, found) != found:
            raise MalformedError(f"{type(found).__name__.lower()} {found.id} is announced twice, and differs")

    def _begin_chunk(self, at: int, content: bytes) -> None:
        chunk = parsed(Chunk, content)
        if self._unfolded_bytes + chunk.uncompressed_size > FREE_UNFOLDING + UNFOLDING * self.size:
            raise MalformedError(f"its chunks unfold to more than {UNFOLDING} times the file's size")
        raw = chunk_content(chunk)
        self._unfolded_bytes += len(raw)
        entries: dict[int, array] = {}  # by channel, stamp [ns] and offset of each message in turn
        for opcode, offset, begin, end in _records(raw):
            if opcode == Opcode.MESSAGE:
                self._enter(entries, raw, begin, end, offset)
            else:
                self._take_definition(opcode, raw[begin:end])
        stamps = [*chain.from_iterable((min(found[::2]), max(found[::2])) for found in entries.values())]
        self._chunk = ChunkIndex(
            chunk_start_offset=at, chunk_length=HEAD.size + len(content), compression=chunk.compression,
            compressed_size=len(chunk.data), uncompressed_size=chunk.uncompressed_size,
            message_start_time=min(stamps, default=0), message_end_time=max(stamps, default=0),
            message_index_offsets={}, message_index_length=0)
        self._entries, self._seen, self._seen_end = entries, {}, 0
        self._blocks.append(at)

    def _enter(self, entries: dict[int, array], content: bytes, begin: int, end: int, offset: int) -> None:
        channel, stamp = _message_head(content, begin, end)
        self.ordered &= stamp >= self._last_stamp
        self._last_stamp = stamp
        entries.setdefault(channel, array("Q")).extend((stamp, offset))

    def _finish_chunk(self, last: bool) -> None:
        """Take the chunk before into the summary; the `last` one gets the message indexes that were torn off."""
        chunk, self._chunk = self._chunk, None
        if chunk is None:
            return
        begin = chunk.chunk_start_offset + chunk.chunk_length
        if self._seen.keys() >= self._entries.keys():
            chunk.message_index_offsets = {channel: self._seen[channel] for channel in self._entries}
            chunk.message_index_length = self._seen_end - begin if self._seen else 0
            self.end = max(self.end, self._seen_end)
        elif last:
            self.tail, chunk.message_index_offsets = message_indexes(self._entries, begin)
            chunk.message_index_length = len(self.tail)
        else:
            self.summary.indexed = False
        self.summary.add_chunk(chunk, {channel: len(found) // 2 for channel, found in self._entries.items()})

    def _check_ending(self, at: int) -> None:
        """Return when only a summary, a footer and the magic follow the end of data at an offset."""
        position = at + _DATA_END_SIZE
        while position < self.size - _ENDING_SIZE:
            opcode, length = HEAD.unpack(self._read(position, HEAD.size))
            if opcode not in _OF_SUMMARY:
                break
            position += HEAD.size + length
        self.ended = (position == self.size - _ENDING_SIZE and self._read(position, 1)[0] == Opcode.FOOTER
                      and self._read(self.size - len(MAGIC), len(MAGIC)) == MAGIC)
        if not self.ended:
            raise MalformedError("an end of data that does not end the file")

    def _summary_said(self) -> tuple[int, int | None, list[int]] | None:
        """Offset of the summary (0 without one), its number of messages and its chunks' offsets; None if malformed.

        Its topics are taken in, because the announcement of one in the data may be damaged.
        """
        position = start = self.end + _DATA_END_SIZE
        messages, chunks = None, []
        try:
            while position < self.size - _ENDING_SIZE:
                opcode, length = HEAD.unpack(self._read(position, HEAD.size))
                if length > LARGEST_RECORD:
                    return None
                content = self._read(position + HEAD.size, length)
                if opcode == Opcode.CHUNK_INDEX:
                    chunks.append(parsed(ChunkIndex, content).chunk_start_offset)
                elif opcode == Opcode.STATISTICS:
                    messages = parsed(Statistics, content).message_count
                else:
                    self._take_definition(opcode, content)
                position += HEAD.size + length
            footer = parsed(Footer, self._read(position + HEAD.size, _ENDING_SIZE - HEAD.size))
        except MalformedError:
            return None
        return (footer.summary_start, messages, chunks) if footer.summary_start == start * (position > start) else None

    def _read(self, at: int, size: int) -> bytes:
        self._file.seek(at)
        data = self._file.read(size)
        if len(data) < min(size, self.size - at):
            raise MalformedError("the file was cut while it was read")
        return data

    def _described(self) -> tuple[list[TopicInformation], dict[int, str], list[str]]:
        """Each topic once, the topic of each channel that is read, and sentences on the parts that are not."""
        name, flaws = self.path.name, []
        if self.damaged:
            flaws.append(f"{name}: {self.damaged} damaged bytes are not read: {self._damage}")
        if self._unannounced:
            flaws.append(f"{name}: {self._unannounced} messages of topics that are not announced are not read")
        if not self.ended:
            flaws.append(f"{name}: it is not sealed, and its last {self.size - self.end} bytes are not read; "
                         "`recover` seals it")
        elif not self.sealed:
            flaws.append(f"{name}: its index does not agree with its data; `recover` writes it again")
        topics: dict[str, TopicInformation] = {}
        read: dict[int, str] = {}
        for number, channel in self.summary.channels.items():
            schema = self.summary.schemas.get(channel.schema_id)
            topic = schema and TopicInformation(
                channel.topic, schema.name, qos_profiles(channel.metadata.get("offered_qos_profiles", "")),
                channel.metadata.get("topic_type_hash", ""), channel.message_encoding)
            if topic and topic.encoding == "cdr" and topics.setdefault(topic.name, topic).type_name == topic.type_name:
                read[number] = channel.topic
            else:
                flaws.append(f"{name}: {self.summary.counts[number]} messages on {channel.topic} are not read: their "
                             "channel has no type, another type than the topic, or is not encoded as CDR")
        return list(topics.values()), read, flaws


def parsed(kind: type[_Record], content: bytes) -> _Record:
    """The record of this kind with this content (MalformedError where it ends too early, or is no text).

    Of a chunk, which is long, one that ends too late is refused, too: its length would swallow the records behind.
    """
    stream = _Whole(content)
    try:
        record = kind.read(ReadDataStream(stream))
    except (EndOfFile, UnicodeDecodeError, OverflowError) as error:
        raise MalformedError(f"not a {kind.__name__}: {error}") from error
    if kind is Chunk and stream.tell() != len(content):
        raise MalformedError("a chunk has another length than it says")
    return record


class _Whole(BytesIO):
    """Bytes of which a part is never less than was asked for."""

    def read(self, size: int = -1) -> bytes:  # type: ignore[override]  # mcap never asks with None
        piece = super().read(size)
        if len(piece) < size:
            raise MalformedError("a record ends too early")
        return piece


def chunk_content(chunk: Chunk) -> bytes:
    """The records in a chunk (MalformedError when it cannot be decompressed, or has another checksum or size).

    Never makes more bytes than the chunk says, nor more than `LARGEST_RECORD`.
    """
    if chunk.uncompressed_size > LARGEST_RECORD:
        raise MalformedError(f"a chunk says that it unfolds to {chunk.uncompressed_size} bytes, more than "
                             f"{LARGEST_RECORD}")
    if chunk.compression not in _DECOMPRESSORS:
        raise MalformedError(f"a chunk has the unknown compression {chunk.compression!r}")
    try:
        raw = _DECOMPRESSORS[chunk.compression](chunk.data, chunk.uncompressed_size + 1)
    except (zstd.ZstdError, RuntimeError, EOFError) as error:  # RuntimeError: of lz4
        raise MalformedError(f"a chunk cannot be decompressed: {error}") from error
    if len(raw) != chunk.uncompressed_size:
        raise MalformedError(f"a chunk does not unfold to the {chunk.uncompressed_size} bytes that it says")
    if chunk.uncompressed_crc and crc32(raw) != chunk.uncompressed_crc:
        raise MalformedError("a chunk has another checksum than it says")
    return raw


_DECOMPRESSORS: dict[str, Callable[[bytes, int], bytes]] = {
    "": lambda data, most: data,
    "lz4": lambda data, most: lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most),
    "zstd": lambda data, most: zstd.ZstdDecompressor().decompress(data, max_length=most),
}


def _records(content: bytes) -> Iterator[tuple[int, int, int, int]]:
    """Opcode, offset, and begin and end of the content, of each record in `content` (MalformedError when torn)."""
    at = 0
    while at < len(content):
        if at + HEAD.size > len(content):
            raise MalformedError("a record ends too early")
        opcode, length = HEAD.unpack_from(content, at)
        begin, end = at + HEAD.size, at + HEAD.size + length
        if not 0 < opcode <= Opcode.DATA_END or end > len(content):
            raise MalformedError("a record ends too early")
        yield opcode, at, begin, end
        at = end


def _message_head(content: bytes, begin: int, end: int) -> tuple[int, int]:
    """Channel and log time [ns] of the message between two offsets (MalformedError when it is none)."""
    if end - begin < _MESSAGE_HEAD.size:
        raise MalformedError("a message ends too early")
    channel, _, stamp, _ = _MESSAGE_HEAD.unpack_from(content, begin)
    if stamp > LAST_STAMP:
        raise MalformedError(f"a message at {stamp} ns, later than bags can say")
    return channel, stamp


def _block(file: BinaryIO, offset: int, chosen: dict[int, str]) -> Iterator[Message]:
    """The messages of the chunk, or the one message, at an offset; of the chosen channels, with their topics."""
    file.seek(offset)
    head = file.read(HEAD.size)
    if len(head) < HEAD.size:
        raise MalformedError("it ends too early")
    opcode, length = HEAD.unpack(head)
    content = file.read(min(length, LARGEST_RECORD))
    raw = chunk_content(parsed(Chunk, content)) if opcode == Opcode.CHUNK else head + content
    for kind, _, begin, end in _records(raw):
        if kind == Opcode.MESSAGE:
            channel, stamp = _message_head(raw, begin, end)
            if channel in chosen:
                yield chosen[channel], stamp, raw[begin + _MESSAGE_HEAD.size:end]


def _next_chunk(file: BinaryIO, at: int, size: int) -> int:
    """Offset of the next chunk whose two lengths agree, from the offset `at` on; `size` when there is none."""
    while at < size:
        file.seek(at)
        block = file.read(min(_BLOCK + _CHUNK_HEAD_SIZE, size - at))
        for match in _CHUNK_HEAD.finditer(block):
            _, length = HEAD.unpack_from(block, match.start())
            data = int.from_bytes(block[match.end():match.end() + 8], "little")
            content = match.end() + 8 - match.start() - HEAD.size + data
            if content == length and at + match.start() + HEAD.size + length <= size:
                return at + match.start()
        at += _BLOCK
    return size
