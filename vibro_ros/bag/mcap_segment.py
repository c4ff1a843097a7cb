"""One MCAP file of a bag while it is written.

Messages gather in a chunk in memory, which `flush` hands to the operating system in one piece: a killed process
loses what came after the last flush, and leaves at most one torn record at the end.
"""

import os
import struct
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from zlib import crc32

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Header, Metadata, MetadataIndex, Schema
from rosbags.rosbag2.storage_mcap import zstd

from vibro_ros.bag.definitions import Definition
from vibro_ros.bag.identity import check_in_place, identity_of
from vibro_ros.bag.mcap_contents import Contents
from vibro_ros.bag.mcap_records import HEAD, MAGIC, packed
from vibro_ros.bag.metadata import FileInformation, as_text

LIBRARY = "vibro_ros"
METADATA_NAME = "rosbag2"
METADATA_KEY = "serialized_metadata"
CHUNK_SIZE = 2**20  # bytes; the largest chunk, unless one message is larger

_COMPRESSORS = {"none": ("", bytes), "zstd": ("zstd", zstd.compress)}
_MESSAGE_HEAD = struct.Struct("<BQHIQQ")
"""Of a message record, packed here because thousands come a second: opcode, length, channel, sequence, two times."""
_INDEX_SIZE = 25  # bytes, of a channel's index behind a chunk, without its entries, and of its place in the summary
_CHUNK_SIZE_BESIDE = 160  # bytes, at most, of a chunk's head and of its record in the summary


class McapSegment:
    """Writes one MCAP file; header, topics and metadata are on the disk once it is made.

    Parameters
    ----------
    path : Path
        File to make; it must not exist.
    definitions : sequence of Definition
        The topics; a message names its topic by the position in this sequence, counted from 1.
    metadata : str
        What the bag says of itself so far, as rosbag2 keeps it inside the file.
    compression : str
        ``none`` or ``zstd``, of chunks.

    Raises
    ------
    OSError
        When the file cannot be made or written.
    """

    SUFFIX = ".mcap"

    def __init__(self, path: Path, definitions: Sequence[Definition], metadata: str, compression: str):
        self.path = path
        self._contents = Contents()
        self._topics = [definition.information.name for definition in definitions]
        self._compression, self._compress = _COMPRESSORS[compression]
        self._file = path.open("xb", buffering=0)
        self.identity = identity_of(os.fstat(self._file.fileno()))
        self._good = 0
        self._first: int
        self._last: int
        self._begin_chunk()
        try:
            self._append(MAGIC + packed(Header("ros2", LIBRARY)) + self._announce(definitions))
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
            When the disk is full, or another file, or none, is where this one was made.
        """
        if self._pieces:
            self._write_chunk()
        check_in_place(self.path, self.identity)

    @property
    def stored(self) -> int:
        """Number of messages that the operating system has."""
        return self._contents.messages

    @property
    def size(self) -> int:
        """Bytes on the disk if the file were sealed now without compression of the pending chunk."""
        indexes = sum(_INDEX_SIZE + 8 * len(found) for found in self._entries.values())
        return self._good + self._size + indexes + (_CHUNK_SIZE_BESIDE if indexes else 0) + self.ending_size

    @property
    def ending_size(self) -> int:
        """Bytes that sealing will take, about."""
        return len(self._contents.chunk_indexes) + self._fixed_size

    @property
    def information(self) -> FileInformation:
        """What is stored, for metadata.yaml."""
        found = self._contents
        counts = {self._topics[channel - 1]: count for channel, count in found.counts.items()}
        return FileInformation(self.path.name, found.first if found.messages else 0, found.last, counts)

    def describe(self, metadata: str) -> None:
        """Say this of the bag from now on (OSError when the disk fails)."""
        self._append_metadata(metadata)

    def seal(self, metadata: str) -> None:
        """Write metadata, index and footer after what is stored, and close; a failed write leaves nothing behind.

        Messages that were not flushed are lost.
        """
        check_in_place(self.path, self.identity)
        self._append_metadata(metadata)
        self._append(self._contents.ending(self._good))
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
            self._contents.schemas[schema.id] = schema
            self._contents.add_channel(Channel(
                id=number, topic=topic.name, message_encoding=topic.encoding, schema_id=schema.id, metadata={
                    "offered_qos_profiles": as_text(topic.qos).strip(), "topic_type_hash": topic.type_hash}))
        records = packed(*self._contents.schemas.values(), *self._contents.channels.values())
        # In the file twice, at its beginning and in the summary; so are the metadata, which grow a little.
        self._fixed_size = len(records) + 2048
        return records

    def _append_metadata(self, text: str) -> None:
        record, offset = packed(Metadata(METADATA_NAME, {METADATA_KEY: text})), self._good
        self._append(record)
        self._contents.metadata.append(MetadataIndex(offset, len(record), METADATA_NAME))

    def _begin_chunk(self) -> None:
        self._pieces: list[bytes] = []
        self._entries = defaultdict[int, list[int]](list)  # stamps and offsets in turn
        self._size = 0
        self._first, self._last = 2**63 - 1, 0

    def _write_chunk(self) -> None:
        raw, entries, first, last = b"".join(self._pieces), self._entries, self._first, self._last
        self._begin_chunk()
        data = self._compress(raw)
        record = packed(Chunk(compression=self._compression, data=data, message_start_time=first, message_end_time=last,
                              uncompressed_crc=crc32(raw), uncompressed_size=len(raw)))
        indexes, offsets, offset = [], {}, self._good + len(record)
        for channel, found in entries.items():
            indexes.append(_message_index(channel, found))
            offsets[channel] = offset
            offset += len(indexes[-1])
        index = ChunkIndex(chunk_start_offset=self._good, chunk_length=len(record), message_start_time=first,
                           message_end_time=last, message_index_offsets=offsets,
                           message_index_length=offset - self._good - len(record), compression=self._compression,
                           compressed_size=len(data), uncompressed_size=len(raw))
        self._append(b"".join([record, *indexes]))
        self._contents.add_chunk(index, ((channel, len(found) // 2) for channel, found in entries.items()))

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


def _message_index(channel: int, entries: Sequence[int]) -> bytes:
    """The record of a channel's messages in a chunk, from their stamps and offsets in turn."""
    size = 8 * len(entries)
    return struct.pack(f"<BQHI{len(entries)}Q", Opcode.MESSAGE_INDEX, 6 + size, channel, size, *entries)
