"""What a scan finds in an MCAP file, gathered record by record."""

from array import array
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, MessageIndex, Metadata, MetadataIndex, Schema

from vibro_ros.bag.mcap_contents import Contents
from vibro_ros.bag.mcap_records import HEAD, MESSAGE_HEAD, MalformedError, chunk_content, packed, parsed, records
from vibro_ros.bag.mcap_segment import METADATA_KEY, METADATA_NAME
from vibro_ros.bag.mcap_summary import announced
from vibro_ros.bag.metadata import LAST_STAMP

UNFOLDING = 100
"""How many times as long as the file its chunks may be when they are unfolded, beyond `FREE_UNFOLDING`."""
FREE_UNFOLDING = 32 * 2**20
"""Bytes that chunks may unfold to in any case."""

INDEX_HEAD = 6
"""Bytes of a message index before its entries: its channel and their length."""


@dataclass
class Scan:
    """What a file holds, sealed or not.

    Attributes
    ----------
    contents : Contents
        What is readable.
    blocks : array of int
        Offsets of the readable chunks, and of the readable messages outside of chunks.
    ordered : bool
        Whether every message is at least as late as the one before.
    end : int
        Offset at which the readable data end; what follows is the ending, or torn.
    tail : bytes
        Index of the last chunk, to be written at `end`, when the file does not have it whole.
    ended : bool
        Whether the file has its footer.
    sealed : bool
        Whether it has a summary, too, that tells what was found.
    size : int
        Of the file [bytes].
    damaged : int
        Bytes before `end` that cannot be read.
    lost : int
        Records within readable chunks that cannot be read, such as messages of a topic that is not announced.
    damage : str
        What is wrong with the first of either; empty without any.
    metadata : str
        What the bag says of itself, written last; empty when nothing was found.
    """

    contents: Contents = field(default_factory=Contents)
    blocks: array = field(default_factory=lambda: array("Q"))
    ordered: bool = True
    end: int = 0
    tail: bytes = b""
    ended: bool = False
    sealed: bool = False
    size: int = 0
    damaged: int = 0
    lost: int = 0
    damage: str = ""
    metadata: str = ""


class Gathering:
    """Fills a `Scan`; a chunk is taken into its contents when its indexes, which follow it, are seen."""

    def __init__(self, file: BinaryIO, found: Scan):
        self._file, self._scan = file, found
        self._chunk: ChunkIndex | None = None
        self._entries: dict[int, array] = {}
        self._seen: dict[int, int] = {}
        self._seen_end = 0
        self._last = 0  # greatest stamp so far
        self._unfolded = 0
        self._spare: tuple[dict[int, Schema], dict[int, Channel]] | None = None  # what the summary announces

    def see_index(self, offset: int, length: int, begin: bytes) -> None:
        """Note an index at an offset, `length` bytes long of which the first six are `begin`: the rest is known."""
        if length < INDEX_HEAD or int.from_bytes(begin[2:], "little") != length - INDEX_HEAD:
            raise MalformedError("not a MessageIndex")
        channel = int.from_bytes(begin[:2], "little")
        self._seen[channel] = offset
        self._seen_end = offset + HEAD.size + length

    def take_record(self, opcode: int, offset: int, content: bytes) -> None:
        """Take a record of data at an offset into the contents (MalformedError when it cannot be read)."""
        contents = self._scan.contents
        if opcode == Opcode.CHUNK:
            self._begin_chunk(offset, content)
        elif opcode == Opcode.METADATA:
            found = parsed(Metadata, content)
            contents.metadata.append(MetadataIndex(offset, HEAD.size + len(content), found.name))
            if found.name == METADATA_NAME:
                self._scan.metadata = found.metadata.get(METADATA_KEY, "")
        elif opcode == Opcode.MESSAGE:
            channel, stamp = self._message_head(content, 0, len(content))
            contents.add_messages(channel, 1, stamp, stamp)
            contents.indexed = False
            self._scan.blocks.append(offset)
        else:
            self._take_definition(opcode, content)

    def _take_definition(self, opcode: int, content: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            self._scan.contents.add_schema(parsed(Schema, content))
        elif opcode == Opcode.CHANNEL:
            self._scan.contents.add_channel(parsed(Channel, content))

    def _begin_chunk(self, offset: int, content: bytes) -> None:
        chunk = parsed(Chunk, content)
        if self._unfolded + chunk.uncompressed_size > FREE_UNFOLDING + UNFOLDING * self._scan.size:
            raise MalformedError(f"its chunks unfold to more than {UNFOLDING} times the file's size")
        raw = chunk_content(chunk)
        self._unfolded += len(raw)
        entries = self._chunk_entries(raw, offset)
        self._chunk = ChunkIndex(
            chunk_start_offset=offset, chunk_length=HEAD.size + len(content), compression=chunk.compression,
            compressed_size=len(chunk.data), uncompressed_size=chunk.uncompressed_size,
            message_start_time=min(chain.from_iterable(found[::2] for found in entries.values()), default=0),
            message_end_time=max(chain.from_iterable(found[::2] for found in entries.values()), default=0),
            message_index_offsets={}, message_index_length=0)
        self._entries, self._seen = entries, {}
        self._scan.blocks.append(offset)

    def _chunk_entries(self, raw: bytes, offset: int) -> dict[int, array]:
        """By channel, stamp [ns] and offset of each message of the chunk at `offset`, one after the other."""
        entries: dict[int, array] = {}
        for opcode, at, begin, end in records(raw):
            try:
                if opcode == Opcode.MESSAGE:
                    channel, stamp = self._message_head(raw, begin, end)
                    entries.setdefault(channel, array("Q")).extend((stamp, at))
                else:
                    self._take_definition(opcode, raw[begin:end])
            except MalformedError as error:
                self._scan.lost += 1
                self._scan.damage = self._scan.damage or f"{error} in the chunk at byte {offset}"
        return entries

    def _message_head(self, content: bytes, begin: int, end: int) -> tuple[int, int]:
        """Channel and log time [ns] of the message between two offsets."""
        channel, stamp = message_head(content, begin, end)
        if channel not in self._scan.contents.channels:
            self._announce(channel)
        self._scan.ordered &= stamp >= self._last
        self._last = stamp
        return channel, stamp

    def _announce(self, channel: int) -> None:
        """Take from the summary what the data do not tell of a channel, because it was damaged there."""
        if self._spare is None:
            self._spare = announced(self._file, self._scan.size)
        schemas, channels = self._spare
        if channel not in channels:
            raise MalformedError("a message of a topic that was not announced")
        found = channels[channel]
        if found.schema_id in schemas:
            self._scan.contents.schemas.setdefault(found.schema_id, schemas[found.schema_id])
        self._scan.contents.add_channel(found)

    def finish_chunk(self, last: bool) -> None:
        """Take the chunk before into the contents; the `last` one gets the indexes that were torn off."""
        chunk, self._chunk = self._chunk, None
        if chunk is None:
            return
        begin = chunk.chunk_start_offset + chunk.chunk_length
        offsets, length = {}, 0
        if self._seen.keys() >= self._entries.keys():
            offsets = {channel: self._seen[channel] for channel in self._entries}
            length = self._seen_end - begin if self._seen else 0
            self._scan.end = max(self._scan.end, begin + length)
        elif last:
            for channel, found in self._entries.items():
                offsets[channel] = begin + length
                pairs = list(zip(found[::2], found[1::2], strict=True))
                self._scan.tail += packed(MessageIndex(channel, pairs))
                length = len(self._scan.tail)
        else:
            self._scan.contents.indexed = False
        self._scan.contents.add_chunk(replace(chunk, message_index_offsets=offsets, message_index_length=length),
                                       ((channel, len(found) // 2) for channel, found in self._entries.items()))


def message_head(content: bytes, begin: int, end: int) -> tuple[int, int]:
    """Channel and log time [ns] of the message between two offsets (MalformedError when it is none)."""
    if end - begin < MESSAGE_HEAD.size:
        raise MalformedError("a message ends too early")
    channel, _, stamp, _ = MESSAGE_HEAD.unpack_from(content, begin)
    if stamp > LAST_STAMP:
        raise MalformedError(f"a message at {stamp} ns, later than bags can say")
    return channel, stamp
