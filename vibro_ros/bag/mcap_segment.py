"""One MCAP file of a bag while it is written, and the summary that ends a file.

Messages gather in a chunk in memory. `McapSegment.flush` hands the chunk to the operating system in one piece, so a
killed process loses what came after the last flush, and leaves at most one torn record at the end.

Records are those of the library `mcap`. Its `Writer` is not used: a message costs it 4.7 us against 1.6 us here, which
is 15 us for a robot's five messages at 1 kHz, more than a tenth of a tick (both measured, `exact`, 137 us a tick);
it keeps 55 MB of chunk indexes an hour in memory; and when the disk is full it cannot end the file that it began.
"""

import os
import struct
import sys
import zlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
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

from vibro_ros.bag.metadata import Definition, FileInformation, as_text

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

METADATA_NAME = "rosbag2"
METADATA_KEY = "serialized_metadata"
CHUNK_SIZE = 2**20  # bytes; the largest chunk, unless one message is larger

HEAD = struct.Struct("<BQ")
"""Of a record: its opcode and the length of the content that follows."""

_COMPRESSORS = {"none": ("", bytes), "zstd": ("zstd", zstd.compress)}
_MESSAGE_HEAD = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_INDEX_SIZE = 25  # bytes, of a channel's index behind a chunk, without its entries, and of its place in the summary
_CHUNK_SIZE_BESIDE = 160  # bytes, at most, of a chunk's head and of its record in the summary
_NEVER = 2**63 - 1  # time of the first message [ns] where there is none yet


class McapSegment:
    """Writes one MCAP file; header, topics and metadata are on the disk once it is made.

    A message names its topic by the position in `definitions`, counted from 1. `metadata` is what the bag says of
    itself so far, as rosbag2 keeps it inside the file; `compression` of chunks is ``none`` or ``zstd``. OSError when
    the file exists, or cannot be made or written.
    """

    def __init__(self, path: Path, definitions: Sequence[Definition], metadata: str, compression: str):
        self.path = path
        self._summary = Summary()
        self._topics = [definition.information.name for definition in definitions]
        self._compression, self._compress = _COMPRESSORS[compression]
        self._file = path.open("xb", buffering=0)
        self._good = 0  # bytes of the file that are whole records
        self._first: int  # stamps in the chunk
        self._last: int
        self._begin_chunk()
        try:
            self._append(MAGIC + packed(Header("ros2", "vibro_ros")) + self._announce(definitions))
            self._append_metadata(metadata)
            self._fixed_size += len(metadata.encode())
        except OSError:
            self._file.close()
            path.unlink(missing_ok=True)
            raise

    def write(self, topic: int, stamp: int, data: bytes) -> None:
        """Take a message (OSError when its chunk was due and could not be written)."""
        size = _MESSAGE_HEAD.size + len(data)
        self._pieces += _MESSAGE_HEAD.pack(Opcode.MESSAGE, size - HEAD.size, topic, 0, stamp, stamp), data
        self._entries[topic] += (stamp, self._size)
        self._size += size
        if stamp < self._first:
            self._first = stamp
        if stamp > self._last:
            self._last = stamp
        if self._size > CHUNK_SIZE:
            self._write_chunk()

    def flush(self) -> None:
        """Hand every message to the operating system: a killed process no longer loses them.

        Raises
        ------
        OSError
            When the disk is full, or the file was removed or replaced.
        """
        if self._pieces:
            self._write_chunk()
        self._check_in_place()

    @property
    def stored(self) -> int:
        """Number of messages that the operating system has."""
        return self._summary.messages

    @property
    def size(self) -> int:
        """Bytes on the disk if the file were sealed now without compression of the pending chunk."""
        indexes = sum(_INDEX_SIZE + 8 * len(found) for found in self._entries.values())
        return (self._good + self._size + indexes + (_CHUNK_SIZE_BESIDE if indexes else 0)
                + self._summary.index_size + self._fixed_size)

    @property
    def information(self) -> FileInformation:
        """What is stored, for metadata.yaml."""
        counts = {self._topics[channel - 1]: count for channel, count in self._summary.counts.items()}
        return FileInformation(self.path.name, *self._summary.span, counts)

    def describe(self, metadata: str) -> None:
        """Say this of the bag from now on (OSError when the disk fails)."""
        self._append_metadata(metadata)

    def seal(self, metadata: str) -> None:
        """Write metadata, index and footer after what is stored, and close; a failed write leaves nothing behind.

        Messages that were not flushed are lost.
        """
        self._check_in_place()
        self._append_metadata(metadata)
        self._append(self._summary.ending(self._good))
        self._file.close()

    def abandon(self) -> None:
        """Close without sealing; `recover` can do that later."""
        self._file.close()

    def _announce(self, definitions: Sequence[Definition]) -> bytes:
        schemas: dict[str, Schema] = {}
        for number, definition in enumerate(definitions, start=1):
            topic = definition.information
            schema = schemas.setdefault(topic.type_name, Schema(
                id=len(schemas) + 1, data=definition.text.encode(), encoding="ros2msg", name=topic.type_name))
            self._summary.schemas[schema.id] = schema
            self._summary.channels[number] = Channel(
                id=number, topic=topic.name, message_encoding=topic.encoding, schema_id=schema.id, metadata={
                    "offered_qos_profiles": as_text(topic.qos).strip(), "topic_type_hash": topic.type_hash})
            self._summary.counts[number] = 0
        records = packed(*self._summary.schemas.values(), *self._summary.channels.values())
        # In the file twice, at its beginning and in the summary; so are the metadata, which grow a little.
        self._fixed_size = len(records) + 2048
        return records

    def _append_metadata(self, text: str) -> None:
        record, index = metadata_record(text, self._good)
        self._append(record)
        self._summary.metadata.append(index)

    def _begin_chunk(self) -> None:
        self._pieces: list[bytes] = []
        self._entries = defaultdict[int, list[int]](list)  # stamps and offsets in turn
        self._size = 0
        self._first, self._last = _NEVER, 0

    def _write_chunk(self) -> None:
        raw, entries, first, last = b"".join(self._pieces), self._entries, self._first, self._last
        self._begin_chunk()
        data = self._compress(raw)
        record = packed(Chunk(compression=self._compression, data=data, message_start_time=first, message_end_time=last,
                              uncompressed_crc=zlib.crc32(raw), uncompressed_size=len(raw)))
        indexes, offsets = message_indexes(entries, self._good + len(record))
        index = ChunkIndex(chunk_start_offset=self._good, chunk_length=len(record), message_start_time=first,
                           message_end_time=last, message_index_offsets=offsets, message_index_length=len(indexes),
                           compression=self._compression, compressed_size=len(data), uncompressed_size=len(raw))
        self._append(record + indexes)
        self._summary.add_chunk(index, {channel: len(found) // 2 for channel, found in entries.items()})

    def _append(self, data: bytes) -> None:
        """Write all of `data` after what is stored, or leave the file as it was."""
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest):]
        except OSError:
            os.ftruncate(self._file.fileno(), self._good)
            self._file.seek(self._good)
            raise
        self._good += len(data)

    def _check_in_place(self) -> None:
        """Notice a removed file: writing to it succeeds, and what is written is nowhere."""
        try:
            if os.path.samestat(os.fstat(self._file.fileno()), os.stat(self.path, follow_symlinks=False)):
                return
        except FileNotFoundError:
            self._summary.counts.clear()  # nothing is stored any more
            raise
        self._summary.counts.clear()
        raise OSError(0, f"{self.path.name} was replaced by another file", str(self.path))


class Summary:
    """What the end of an MCAP file says of its data: schemas and channels by id, messages by channel, chunks, metadata.

    `index_size` are the bytes of the chunks' index records. They are kept compressed, because a recording of a day has
    two million. `indexed` is False when some message lies where an index of chunks would not find it; then none is
    written, and readers go through the file from its beginning.
    """

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.counts: dict[int, int] = {}
        self.chunks = self.index_size = 0
        self.metadata: list[MetadataIndex] = []
        self.indexed = True
        self._first, self._last = _NEVER, 0
        self._compressor = zlib.compressobj(1)
        self._indexes = bytearray()

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())

    @property
    def span(self) -> tuple[int, int]:
        """Least and greatest log time [ns]; twice 0 without messages."""
        return (self._first, self._last) if self.messages else (0, 0)

    def add_chunk(self, chunk: ChunkIndex, counts: dict[int, int]) -> None:
        """Take a chunk in, with its number of messages by channel."""
        record = packed(chunk)
        self.chunks += 1
        self.index_size += len(record)
        self._indexes += self._compressor.compress(record)
        for channel, count in counts.items():
            self.add_messages(channel, count, chunk.message_start_time, chunk.message_end_time)

    def add_messages(self, channel: int, count: int, first: int, last: int) -> None:
        """Take messages of one channel in, which lie between two times [ns]."""
        self.counts[channel] = self.counts.get(channel, 0) + count
        self._first, self._last = min(self._first, first), max(self._last, last)

    def ending(self, at: int) -> bytes:
        """All that closes a file whose data end at the offset `at`: end of data, summary, footer; without checksums."""
        end, (first, last) = packed(DataEnd(data_section_crc=0)), self.span
        pieces, offsets, position = [end], [], at + len(end)
        summary = position
        indexes = zlib.decompress(bytes(self._indexes) + self._compressor.copy().flush()) if self.indexed else b""
        statistics = Statistics(
            attachment_count=0, channel_count=len(self.channels), channel_message_counts=self.counts,
            chunk_count=self.chunks, message_count=self.messages, message_start_time=first, message_end_time=last,
            metadata_count=len(self.metadata), schema_count=len(self.schemas))
        for opcode, group in ((Opcode.SCHEMA, packed(*self.schemas.values())),
                              (Opcode.CHANNEL, packed(*self.channels.values())), (Opcode.CHUNK_INDEX, indexes),
                              (Opcode.METADATA_INDEX, packed(*self.metadata)), (Opcode.STATISTICS, packed(statistics))):
            if group:
                offsets.append(SummaryOffset(group_opcode=opcode, group_start=position, group_length=len(group)))
                pieces.append(group)
                position += len(group)
        footer = Footer(summary_start=summary, summary_offset_start=position, summary_crc=0)
        return b"".join([*pieces, packed(*offsets, footer), MAGIC])


def packed(*records: McapRecord) -> bytes:
    """Records one after the other."""
    builder = RecordBuilder()
    for one in records:
        one.write(builder)
    return builder.end()


def metadata_record(text: str, at: int) -> tuple[bytes, MetadataIndex]:
    """What a bag says of itself, as the record for the offset `at`, and that record's place in the summary."""
    record = packed(Metadata(METADATA_NAME, {METADATA_KEY: text}))
    return record, MetadataIndex(at, len(record), METADATA_NAME)


def message_indexes(entries: Mapping[int, Sequence[int]], at: int) -> tuple[bytes, dict[int, int]]:
    """The message indexes that follow a chunk at the offset `at`, and the offset of each, by channel.

    `entries` are the stamps [ns] and offsets of the chunk's messages in turn, by channel.
    """
    records: list[bytes] = []
    offsets: dict[int, int] = {}
    for channel, found in entries.items():
        offsets[channel] = at
        size = 8 * len(found)
        records.append(struct.pack(f"<BQHI{len(found)}Q", Opcode.MESSAGE_INDEX, 6 + size, channel, size, *found))
        at += len(records[-1])
    return b"".join(records), offsets
