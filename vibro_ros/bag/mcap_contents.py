"""What an MCAP file holds, and the summary, index and footer that say so at its end."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, DataEnd, Footer, MetadataIndex, Schema, Statistics, SummaryOffset

from vibro_ros.bag.growing_bytes import GrowingBytes
from vibro_ros.bag.mcap_records import MAGIC, MalformedError, packed, parsed, records

NEVER = 2**63 - 1
"""Time of the first message [ns] of a file that has none yet."""


@dataclass
class Contents:
    """Everything that a summary tells of a file's data.

    Attributes
    ----------
    schemas, channels : dict
        By id.
    counts : dict of int to int
        Messages by channel.
    first, last : int
        Least and greatest log time [ns]; `NEVER` and 0 without messages.
    chunks : int
        Number of chunks.
    chunk_indexes : GrowingBytes
        Their index records; packed and compressed, because a recording of a day has two million.
    metadata : list of MetadataIndex
        Where each metadata record lies.
    indexed : bool
        False when some message lies where an index of chunks would not find it; then none is written, and
        readers go through the file from its beginning.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    first: int = NEVER
    last: int = 0
    chunks: int = 0
    chunk_indexes: GrowingBytes = field(default_factory=GrowingBytes)
    metadata: list[MetadataIndex] = field(default_factory=list)
    indexed: bool = True

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())

    def add_schema(self, schema: Schema) -> None:
        """Take a schema in; a repetition changes nothing (MalformedError when it differs)."""
        if self.schemas.setdefault(schema.id, schema) != schema:
            raise MalformedError(f"schema {schema.id} is announced twice, and differs")

    def add_channel(self, channel: Channel) -> None:
        """Take a channel in; a repetition changes nothing (MalformedError when it differs)."""
        if self.channels.setdefault(channel.id, channel) != channel:
            raise MalformedError(f"channel {channel.id} is announced twice, and differs")
        self.counts.setdefault(channel.id, 0)

    def add_chunk(self, chunk: ChunkIndex, counts: Iterable[tuple[int, int]]) -> None:
        """Take a chunk in: its index record, its times, and its number of messages by channel."""
        self.chunks += 1
        self.chunk_indexes.append(packed(chunk))
        for channel, count in counts:
            self.add_messages(channel, count, chunk.message_start_time, chunk.message_end_time)

    def add_messages(self, channel: int, count: int, first: int, last: int) -> None:
        """Take messages of one channel in, which lie between two times [ns]."""
        self.counts[channel] += count
        self.first, self.last = min(self.first, first), max(self.last, last)

    def indexes(self) -> Iterator[ChunkIndex]:
        """The chunks' index records."""
        packed_indexes = bytes(self.chunk_indexes)
        for _, _, begin, end in records(packed_indexes):
            yield parsed(ChunkIndex, packed_indexes[begin:end])

    def ending(self, at: int) -> bytes:
        """All that closes a file whose data end at the offset `at`: end of data, summary, footer; without checksums."""
        end = packed(DataEnd(data_section_crc=0))
        pieces, offsets, position = [end], [], at + len(end)
        summary = position
        for opcode, group in self._groups():
            if group:
                offsets.append(SummaryOffset(group_opcode=opcode, group_start=position, group_length=len(group)))
                pieces.append(group)
                position += len(group)
        footer = Footer(summary_start=summary, summary_offset_start=position, summary_crc=0)
        return b"".join([*pieces, packed(*offsets, footer), MAGIC])

    def _groups(self) -> Iterable[tuple[Opcode, bytes]]:
        yield Opcode.SCHEMA, packed(*self.schemas.values())
        yield Opcode.CHANNEL, packed(*self.channels.values())
        yield Opcode.CHUNK_INDEX, bytes(self.chunk_indexes) if self.indexed else b""
        yield Opcode.METADATA_INDEX, packed(*self.metadata)
        yield Opcode.STATISTICS, packed(self._statistics())

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0, channel_count=len(self.channels), channel_message_counts=self.counts,
            chunk_count=self.chunks, message_count=self.messages, message_end_time=self.last,
            message_start_time=self.first if self.messages else 0,  # the standard's value for a file without messages
            metadata_count=len(self.metadata), schema_count=len(self.schemas))
