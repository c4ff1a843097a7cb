"""Write an MCAP file: messages in chunks with their indexes, and the summary that seals the file.

The head of a message and the index of a channel are one call of struct each: a message costs a third of what it costs
in `mcap.writer.Writer`, whose time the robot would miss at 1 kHz. The records of `mcap.records` write all that comes
once in a file.
"""

import struct
from collections.abc import Callable, Mapping, Sequence
from zlib import crc32

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC as MAGIC

CHUNK_SIZE = 2**20  # bytes; the largest chunk, unless one message is larger
_MESSAGE = int(Opcode.MESSAGE)
_HEAD = struct.Struct("<BQHIQQ")  # of a message: opcode, length, channel, sequence, stamp, publish time
_FIELDS = _HEAD.size - 9  # without opcode and length, which the length of a record does not count
_FOOTER_HEAD = struct.Struct("<BQQQ")  # of a footer: opcode, length, begin of the summary, begin of its offsets


class McapWriter:
    """Writes an MCAP file of ROS 2 through `write`, which takes bytes; each `schema_id` of a channel is in `schemas`.

    Schemas and channels stand before the first chunk, so that no damaged chunk costs them. `first` and `last` are the
    least and the greatest stamp [ns] of the messages, and `counts` has the number of messages in finished chunks by
    channel.
    """

    def __init__(self, write: Callable[[bytes], object], schemas: Sequence[Schema], channels: Sequence[Channel],
                 compression: str, chunk_size: int = CHUNK_SIZE):
        self.first, self.last = 2**64 - 1, -1
        self.counts = {channel.id: 0 for channel in channels}
        self._write_bytes, self._schemas, self._channels = write, schemas, channels
        self._compression, self._chunk_size = compression, chunk_size
        self._parts, self._pending = list[bytes](), 0  # head and data of each message of the next chunk; their size
        self._entries = {channel.id: list[int]() for channel in channels}  # stamp and offset of each of them
        self._offset = 0
        self._chunk_indexes, self._metadata_indexes = list[bytes](), list[bytes]()
        self._write(MAGIC + record_bytes(Header("ros2", "vibro_ros"), *schemas, *channels))

    def add_message(self, channel: int, stamp: int, data: bytes, published: int, sequence: int = 0) -> bool:
        """Add a message with its recorded stamp and its publish time [ns]; return whether this has ended a chunk."""
        self._parts += (_HEAD.pack(_MESSAGE, _FIELDS + len(data), channel, sequence, stamp, published), data)
        self._entries[channel] += (stamp, self._pending)
        self._pending += _HEAD.size + len(data)
        if stamp < self.first:
            self.first = stamp
        if stamp > self.last:
            self.last = stamp
        if self._pending <= self._chunk_size:
            return False
        self.end_chunk()
        return True

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write metadata, before the messages of the next chunk."""
        data = record_bytes(Metadata(name=name, metadata=dict(metadata)))
        self._metadata_indexes.append(record_bytes(MetadataIndex(offset=self._offset, length=len(data), name=name)))
        self._write(data)

    def end_chunk(self) -> None:
        """Write the messages since the last chunk as a chunk, if there are any."""
        if not self._parts:
            return
        raw, indexes = b"".join(self._parts), {channel: index for channel, index in self._entries.items() if index}
        self._parts, self._pending, self._entries = [], 0, {channel: [] for channel in self._entries}
        stamps = [stamp for index in indexes.values() for stamp in index[::2]]
        times, begin, name = (min(stamps), max(stamps)), self._offset, self._compression.encode()
        data = zstandard.compress(raw) if name else raw
        self._write(struct.pack(f"<B4QII{len(name)}sQ", Opcode.CHUNK, 40 + len(name) + len(data), *times, len(raw),
                                crc32(raw), len(name), name, len(data)))
        self._write(data)
        end, places = self._offset, list[int]()  # channel and offset of each message index
        for channel, index in sorted(indexes.items()):
            self.counts[channel] += len(index) // 2
            places += (channel, self._offset)
            size = 8 * len(index)
            self._write(struct.pack(f"<BQHI{len(index)}Q", Opcode.MESSAGE_INDEX, 6 + size, channel, size, *index))
        self._chunk_indexes.append(struct.pack(
            f"<B5QI{len(places) // 2 * 'HQ'}QI{len(name)}s2Q", Opcode.CHUNK_INDEX, 64 + 5 * len(places) + len(name),
            *times, begin, end - begin, 5 * len(places), *places, self._offset - end, len(name), name, len(data),
            len(raw)))

    def finish(self) -> None:
        """Write the last chunk and the summary."""
        self.end_chunk()
        self._write(record_bytes(DataEnd(0)))
        count = sum(self.counts.values())
        statistics = Statistics(
            attachment_count=0, channel_count=len(self._channels), channel_message_counts=self.counts,
            chunk_count=len(self._chunk_indexes), message_count=count, metadata_count=len(self._metadata_indexes),
            message_start_time=self.first if count else 0, message_end_time=max(0, self.last),
            schema_count=len(self._schemas))
        groups = {Opcode.SCHEMA: record_bytes(*self._schemas), Opcode.CHANNEL: record_bytes(*self._channels),
                  Opcode.STATISTICS: record_bytes(statistics), Opcode.CHUNK_INDEX: b"".join(self._chunk_indexes),
                  Opcode.METADATA_INDEX: b"".join(self._metadata_indexes)}
        begin = end = self._offset
        offsets = list[SummaryOffset]()
        for opcode, data in groups.items():
            offsets.append(SummaryOffset(group_opcode=opcode, group_start=end, group_length=len(data)))
            end += len(data)
        summary = b"".join(groups.values()) + record_bytes(*offsets)
        footer = _FOOTER_HEAD.pack(Opcode.FOOTER, 20, begin, end)
        self._write(summary + record_bytes(Footer(begin, end, crc32(summary + footer))) + MAGIC)

    def _write(self, data: bytes) -> None:
        self._write_bytes(data)
        self._offset += len(data)


def record_bytes(*records: McapRecord) -> bytes:
    """Return the bytes of records, one after the other."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()
