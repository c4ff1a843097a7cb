"""What an MCAP file holds, and the summary, index and footer that say so at its end."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from vibro_ros.bag import mcap_records as mcap

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
    chunk_indexes : bytearray
        Their index records; packed, because a recording of a day has a million.
    metadata : list of (int, int, str)
        Offset, length and name of each metadata record.
    indexed : bool
        False when some message lies where an index of chunks would not find it; then none is written, and
        readers go through the file from its beginning.
    """

    schemas: dict[int, mcap.Schema] = field(default_factory=dict)
    channels: dict[int, mcap.Channel] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    first: int = NEVER
    last: int = 0
    chunks: int = 0
    chunk_indexes: bytearray = field(default_factory=bytearray)
    metadata: list[tuple[int, int, str]] = field(default_factory=list)
    indexed: bool = True

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())

    def add_channel(self, channel: mcap.Channel) -> None:
        """Take a channel in; a repetition changes nothing."""
        self.channels[channel.id] = channel
        self.counts.setdefault(channel.id, 0)

    def add_chunk(self, chunk: mcap.Chunk, counts: Iterable[tuple[int, int]]) -> None:
        """Take a chunk in: its index record, its times, and its number of messages by channel."""
        self.chunks += 1
        self.chunk_indexes += mcap.chunk_index(chunk)
        for channel, count in counts:
            self.add_messages(channel, count, chunk.first, chunk.last)

    def add_messages(self, channel: int, count: int, first: int, last: int) -> None:
        """Take messages of one channel in, which lie between two times [ns]."""
        self.counts[channel] += count
        self.first, self.last = min(self.first, first), max(self.last, last)

    def ending(self, at: int) -> bytes:
        """All that closes a file whose data end at the offset `at`: end of data, summary, footer."""
        end, position = mcap.data_end(), at + len(mcap.data_end())
        pieces, offsets, summary = [end], [], position
        for opcode, group in self._groups():
            if group:
                offsets.append(mcap.summary_offset(opcode, position, len(group)))
                pieces.append(group)
                position += len(group)
        return b"".join([*pieces, *offsets, mcap.footer(summary, position)])

    def _groups(self) -> Iterable[tuple[int, bytes]]:
        yield mcap.SCHEMA, b"".join(map(mcap.schema, self.schemas.values()))
        yield mcap.CHANNEL, b"".join(map(mcap.channel, self.channels.values()))
        yield mcap.CHUNK_INDEX, bytes(self.chunk_indexes) if self.indexed else b""
        yield mcap.METADATA_INDEX, b"".join(mcap.metadata_index(*one) for one in self.metadata)
        first = self.first if self.messages else 0  # the standard's value for a file without messages
        yield mcap.STATISTICS, mcap.statistics(len(self.schemas), len(self.metadata), self.chunks, first, self.last,
                                               self.counts)
