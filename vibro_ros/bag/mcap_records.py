"""MCAP records as bytes, packed and unpacked: pure functions after https://mcap.dev/spec.

All integers are little-endian, texts are UTF-8 behind their length in 4 bytes, times are ROS time [ns]. A record
is its opcode (1 byte), the length of its content (8 bytes) and its content.
"""

import struct
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from typing import NamedTuple

MAGIC = b"\x89MCAP0\r\n"

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(0x0B, 0x10)
LAST_OPCODE = DATA_END

HEAD = struct.Struct("<BQ")
"""Opcode and length of content."""
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence number, log time, publish time; the message's bytes follow."""
MESSAGE_OVERHEAD = MESSAGE_HEAD.size - HEAD.size
FOOTER_SIZE = HEAD.size + 20 + len(MAGIC)

_U16, _U32, _U64 = struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<Q")
_CHUNK_HEAD = struct.Struct("<QQQI")
_CHUNK_INDEX_HEAD = struct.Struct("<QQQQ")
_STATISTICS_HEAD = struct.Struct("<QHIIIIQQ")


class MalformedError(ValueError):
    """Bytes that are not the record they should be."""


class Schema(NamedTuple):
    """A message definition."""

    id: int
    name: str
    encoding: str
    data: bytes


class Channel(NamedTuple):
    """A topic; `labels` holds `offered_qos_profiles` (YAML) and `topic_type_hash`, as rosbag2 writes them."""

    id: int
    schema: int
    topic: str
    encoding: str
    labels: dict[str, str]


class Chunk(NamedTuple):
    """Where a chunk lies and what is in it; `indexes` are the offsets of its message indexes by channel."""

    first: int
    last: int
    offset: int
    length: int
    indexes: dict[int, int]
    index_length: int
    compression: str
    compressed_size: int
    size: int


class ChunkContent(NamedTuple):
    """A chunk as it lies in the file: times [ns], uncompressed size, CRC-32 of that (0: none), compressed records."""

    first: int
    last: int
    size: int
    crc: int
    compression: str
    records: bytes


class Parser:
    """Takes values one after the other from a record's content (MalformedError where it ends too early)."""

    def __init__(self, content: bytes):
        self._content = content
        self._at = 0

    @property
    def ended(self) -> bool:
        """Whether everything is taken."""
        return self._at >= len(self._content)

    def take(self, size: int) -> bytes:
        """The next `size` bytes."""
        piece = self._content[self._at:self._at + size]
        if len(piece) < size:
            raise MalformedError("a record ends too early")
        self._at += size
        return piece

    def unpack(self, layout: struct.Struct) -> tuple:
        """The next values of `layout`."""
        return layout.unpack(self.take(layout.size))

    def u16(self) -> int:
        """An unsigned integer of 2 bytes."""
        return self.unpack(_U16)[0]

    def u64(self) -> int:
        """An unsigned integer of 8 bytes."""
        return self.unpack(_U64)[0]

    def blob(self) -> bytes:
        """Bytes behind their length."""
        return self.take(self.unpack(_U32)[0])

    def text(self) -> str:
        """Text behind its length."""
        try:
            return self.blob().decode()
        except UnicodeDecodeError as error:
            raise MalformedError("a text is not UTF-8") from error

    def labels(self) -> dict[str, str]:
        """A map of texts."""
        pairs, found = Parser(self.blob()), {}
        while not pairs.ended:
            key = pairs.text()
            found[key] = pairs.text()
        return found


def record(opcode: int, content: bytes) -> bytes:
    """A whole record."""
    return HEAD.pack(opcode, len(content)) + content


def header(library: str) -> bytes:
    """Magic and header of a ROS 2 file."""
    return MAGIC + record(HEADER, _text("ros2") + _text(library))


def schema(one: Schema) -> bytes:
    """A schema record."""
    return record(SCHEMA, _U16.pack(one.id) + _text(one.name) + _text(one.encoding) + _blob(one.data))


def channel(one: Channel) -> bytes:
    """A channel record."""
    return record(CHANNEL, _U16.pack(one.id) + _U16.pack(one.schema) + _text(one.topic) + _text(one.encoding)
                  + _labels(one.labels))


def chunk(content: ChunkContent) -> bytes:
    """A chunk record."""
    return record(CHUNK, _CHUNK_HEAD.pack(*content[:4]) + _text(content.compression)
                  + _U64.pack(len(content.records)) + content.records)


def message_index(channel_id: int, entries: list[tuple[int, int]]) -> bytes:
    """Where the messages of one channel lie in the chunk before it: (time, offset in the uncompressed chunk)."""
    numbers = struct.pack(f"<{2 * len(entries)}Q", *chain.from_iterable(entries))
    return record(MESSAGE_INDEX, _U16.pack(channel_id) + _blob(numbers))


def metadata(name: str, labels: Mapping[str, str]) -> bytes:
    """A metadata record."""
    return record(METADATA, _text(name) + _labels(labels))


def chunk_index(one: Chunk) -> bytes:
    """A chunk index record."""
    offsets = b"".join(_U16.pack(key) + _U64.pack(offset) for key, offset in one.indexes.items())
    return record(CHUNK_INDEX, _CHUNK_INDEX_HEAD.pack(*one[:4]) + _blob(offsets) + _U64.pack(one.index_length)
                  + _text(one.compression) + _U64.pack(one.compressed_size) + _U64.pack(one.size))


def metadata_index(offset: int, length: int, name: str) -> bytes:
    """A metadata index record."""
    return record(METADATA_INDEX, _U64.pack(offset) + _U64.pack(length) + _text(name))


def statistics(schemas: int, metadata_records: int, chunks: int, first: int, last: int,
               counts: Mapping[int, int]) -> bytes:
    """A statistics record; `counts` are the messages by channel."""
    each = b"".join(_U16.pack(key) + _U64.pack(count) for key, count in sorted(counts.items()))
    return record(STATISTICS, _STATISTICS_HEAD.pack(sum(counts.values()), schemas, len(counts), 0, metadata_records,
                                                    chunks, first, last) + _blob(each))


def summary_offset(opcode: int, start: int, length: int) -> bytes:
    """A summary offset record."""
    return record(SUMMARY_OFFSET, bytes([opcode]) + _U64.pack(start) + _U64.pack(length))


def data_end() -> bytes:
    """The record that ends the data; without a checksum of them."""
    return record(DATA_END, _U32.pack(0))


def footer(summary: int, offsets: int) -> bytes:
    """Footer, without a checksum, and the closing magic."""
    return record(FOOTER, _U64.pack(summary) + _U64.pack(offsets) + _U32.pack(0)) + MAGIC


def parsed_schema(content: bytes) -> Schema:
    """The schema of a record's content."""
    parser = Parser(content)
    return Schema(parser.u16(), parser.text(), parser.text(), parser.blob())


def parsed_channel(content: bytes) -> Channel:
    """The channel of a record's content."""
    parser = Parser(content)
    return Channel(parser.u16(), parser.u16(), parser.text(), parser.text(), parser.labels())


def parsed_chunk(content: bytes) -> ChunkContent:
    """The chunk of a record's content."""
    parser = Parser(content)
    head = parser.unpack(_CHUNK_HEAD)
    compression = parser.text()
    return ChunkContent(*head, compression, parser.take(parser.u64()))


def records(content: bytes) -> Iterator[tuple[int, int, int, int]]:
    """Opcode, offset, and begin and end of the content, of each record in `content` (MalformedError when torn)."""
    at = 0
    while at < len(content):
        if at + HEAD.size > len(content):
            raise MalformedError("a record ends too early")
        opcode, length = HEAD.unpack_from(content, at)
        begin, end = at + HEAD.size, at + HEAD.size + length
        if not 0 < opcode <= LAST_OPCODE or end > len(content):
            raise MalformedError("a record ends too early")
        yield opcode, at, begin, end
        at = end


def _blob(data: bytes) -> bytes:
    return _U32.pack(len(data)) + data


def _text(text: str) -> bytes:
    return _blob(text.encode())


def _labels(labels: Mapping[str, str]) -> bytes:
    return _blob(b"".join(_concatenated(labels.items())))


def _concatenated(pairs: Iterable[tuple[str, str]]) -> Iterator[bytes]:
    for key, value in pairs:
        yield _text(key) + _text(value)
