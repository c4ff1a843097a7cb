"""Go through an MCAP file record by record, over what is damaged, to where it is torn.

Nothing that a file says of itself is believed: each length is held against the file's own, each chunk is unfolded and
compared with its checksum, and the summary with what was found. What cannot be read is jumped over, to the next record
or, where the records' own lengths are lost, to the next chunk.
"""

from array import array
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Header, MessageIndex, Metadata, MetadataIndex, Schema

from vibro_ros.bag.mcap_contents import Contents
from vibro_ros.bag.mcap_records import (
    HEAD,
    LARGEST_RECORD,
    MAGIC,
    MESSAGE_HEAD,
    MalformedError,
    chunk_content,
    packed,
    parsed,
    records,
)
from vibro_ros.bag.mcap_search import next_chunk
from vibro_ros.bag.mcap_segment import METADATA_KEY, METADATA_NAME
from vibro_ros.bag.mcap_summary import announced, is_footer_reached, is_summary_true
from vibro_ros.bag.metadata import LAST_STAMP

UNFOLDING = 100
"""How many times as long as the file its chunks may be when they are unfolded, beyond `FREE_UNFOLDING`."""
FREE_UNFOLDING = 32 * 2**20
"""Bytes that chunks may unfold to in any case."""

_OF_DATA = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX,
                      Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END})
_NEVER_IN_SUMMARY = frozenset({Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX})
_DATA_END_LENGTH = 4
_LONGEST_HEADER = 2**20  # bytes


class ForeignFileError(ValueError):
    """A file that is no ROS 2 recording; the message says why."""


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


def scan(file: BinaryIO, size: int) -> Scan:
    """Read the first `size` bytes of an MCAP file as far as they can be read.

    Raises
    ------
    ForeignFileError
        When the file is empty, no MCAP, or not of ROS 2.
    OSError
        When it cannot be read.
    """
    return _Scanner(file, size).run()


class _Scanner:
    """The state of a scan; a chunk is taken into the contents when its indexes, which follow it, are seen."""

    def __init__(self, file: BinaryIO, size: int):
        self._file = file
        self._found = Scan(size=size)
        self._chunk: ChunkIndex | None = None
        self._entries: dict[int, array] = {}
        self._seen: dict[int, int] = {}
        self._seen_end = 0
        self._damage: list[tuple[int, str]] = []  # bytes and reasons, since the last record that is readable
        self._last = 0  # greatest stamp so far
        self._unfolded = 0
        self._spare: tuple[dict[int, Schema], dict[int, Channel]] | None = None  # what the summary announces

    def run(self) -> Scan:
        found = self._found
        found.end = self._header()
        ended = self._scan_data(found.end)
        self._finish_chunk(last=not ended)
        if ended:
            self._accept_damage()
            found.end, found.ended = ended, True
            found.sealed = is_summary_true(self._file, ended, found.contents, whole=not found.damaged)
        return found

    def _header(self) -> int:
        """Offset of the first record after the header."""
        if self._found.size == 0:
            raise ForeignFileError("the file is empty, nothing was recorded")
        if self._read(0, len(MAGIC)) != MAGIC[:self._found.size]:
            raise ForeignFileError("not an MCAP file")
        if self._found.size < len(MAGIC) + HEAD.size:
            raise ForeignFileError("the file ends within its header, nothing was recorded")
        opcode, length = HEAD.unpack(self._read(len(MAGIC), HEAD.size))
        end = len(MAGIC) + HEAD.size + length
        if opcode != Opcode.HEADER or end > self._found.size or length > _LONGEST_HEADER:
            raise ForeignFileError("the file ends within its header, nothing was recorded")
        try:
            profile = parsed(Header, self._read(end - length, length)).profile
        except MalformedError as error:
            raise ForeignFileError(f"its header cannot be read: {error}") from error
        if profile != "ros2":
            raise ForeignFileError(f"an MCAP file, but not of ROS 2: its profile is {profile!r}")
        return end

    def _scan_data(self, at: int) -> int:
        """Take every record from the offset `at` on; offset of the end of data when the file has its footer, else 0."""
        while True:
            head = self._head(at)
            reason = "not a record"
            if head:
                opcode, length = head
                if opcode == Opcode.DATA_END and is_footer_reached(self._file, at, self._found.size):
                    return at
                reason = self._take(opcode, at, length)
            if reason:
                after = self._beyond(at, head)
                if not after:
                    return 0
                self._damage.append((after - at, f"{reason} at byte {at}"))
                at = after
            else:
                at += HEAD.size + length

    def _head(self, at: int) -> tuple[int, int] | None:
        """Opcode and length of the record at an offset; None where none can be."""
        if at + HEAD.size > self._found.size:
            return None
        opcode, length = HEAD.unpack(self._read(at, HEAD.size))
        if opcode not in _OF_DATA or at + HEAD.size + length > self._found.size:
            return None
        return None if opcode == Opcode.DATA_END and length != _DATA_END_LENGTH else (opcode, length)

    def _beyond(self, at: int, head: tuple[int, int] | None) -> int:
        """Where to go on behind an unreadable record at an offset; 0 when nothing follows."""
        chunk = next_chunk(self._file, at + 1, self._found.size)
        following = at + HEAD.size + head[1] if head else 0
        next_head = self._head(following) if following else None
        if next_head and head[0] == Opcode.DATA_END and next_head[0] not in _NEVER_IN_SUMMARY:
            return chunk  # a summary that is torn begins with topics, as data do
        return following if next_head and not 0 < chunk < following else chunk

    def _take(self, opcode: int, offset: int, length: int) -> str:
        """Take a record in; why not, or nothing."""
        try:
            if opcode == Opcode.DATA_END:
                raise MalformedError("an end of data that does not end the file")
            if length > LARGEST_RECORD and opcode != Opcode.ATTACHMENT:
                raise MalformedError(f"a record of {length} bytes, more than {LARGEST_RECORD}")
            if opcode == Opcode.MESSAGE_INDEX:
                self._see_index(offset, length)
                return ""
            content = b"" if opcode == Opcode.ATTACHMENT else self._read(offset + HEAD.size, length)
            self._finish_chunk(last=False)
            self._take_record(opcode, offset, content)
        except MalformedError as error:
            return str(error)
        self._accept_damage()
        self._found.end = offset + HEAD.size + length
        return ""

    def _accept_damage(self) -> None:
        """What lies between readable records stays in the file, unindexed."""
        self._found.damaged += sum(size for size, _ in self._damage)
        self._found.damage = self._found.damage or next((reason for _, reason in self._damage), "")
        self._damage.clear()

    def _see_index(self, offset: int, length: int) -> None:
        channel, size = int.from_bytes(self._read(offset + HEAD.size, 2), "little"), length - 6
        if size < 0 or int.from_bytes(self._read(offset + HEAD.size + 2, 4), "little") != size:
            raise MalformedError("not a MessageIndex")
        self._seen[channel] = offset  # the rest is long, and known
        self._seen_end = offset + HEAD.size + length

    def _take_record(self, opcode: int, offset: int, content: bytes) -> None:
        contents = self._found.contents
        if opcode == Opcode.CHUNK:
            self._begin_chunk(offset, content)
        elif opcode == Opcode.METADATA:
            found = parsed(Metadata, content)
            contents.metadata.append(MetadataIndex(offset, HEAD.size + len(content), found.name))
            if found.name == METADATA_NAME:
                self._found.metadata = found.metadata.get(METADATA_KEY, "")
        elif opcode == Opcode.MESSAGE:
            channel, stamp = self._message_head(content, 0, len(content))
            contents.add_messages(channel, 1, stamp, stamp)
            contents.indexed = False
            self._found.blocks.append(offset)
        else:
            self._take_definition(opcode, content)

    def _take_definition(self, opcode: int, content: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            self._found.contents.add_schema(parsed(Schema, content))
        elif opcode == Opcode.CHANNEL:
            self._found.contents.add_channel(parsed(Channel, content))

    def _begin_chunk(self, offset: int, content: bytes) -> None:
        chunk = parsed(Chunk, content)
        if self._unfolded + chunk.uncompressed_size > FREE_UNFOLDING + UNFOLDING * self._found.size:
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
        self._found.blocks.append(offset)

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
                self._found.lost += 1
                self._found.damage = self._found.damage or f"{error} in the chunk at byte {offset}"
        return entries

    def _message_head(self, content: bytes, begin: int, end: int) -> tuple[int, int]:
        """Channel and log time [ns] of the message between two offsets."""
        channel, stamp = message_head(content, begin, end)
        if channel not in self._found.contents.channels:
            self._announce(channel)
        self._found.ordered &= stamp >= self._last
        self._last = stamp
        return channel, stamp

    def _announce(self, channel: int) -> None:
        """Take from the summary what the data do not tell of a channel, because it was damaged there."""
        if self._spare is None:
            self._spare = announced(self._file, self._found.size)
        schemas, channels = self._spare
        if channel not in channels:
            raise MalformedError("a message of a topic that was not announced")
        found = channels[channel]
        if found.schema_id in schemas:
            self._found.contents.schemas.setdefault(found.schema_id, schemas[found.schema_id])
        self._found.contents.add_channel(found)

    def _finish_chunk(self, last: bool) -> None:
        """Take the chunk before into the contents; the `last` one gets the indexes that were torn off."""
        chunk, self._chunk = self._chunk, None
        if chunk is None:
            return
        begin = chunk.chunk_start_offset + chunk.chunk_length
        offsets, length = {}, 0
        if self._seen.keys() >= self._entries.keys():
            offsets = {channel: self._seen[channel] for channel in self._entries}
            length = self._seen_end - begin if self._seen else 0
            self._found.end = max(self._found.end, begin + length)
        elif last:
            for channel, found in self._entries.items():
                offsets[channel] = begin + length
                pairs = list(zip(found[::2], found[1::2], strict=True))
                self._found.tail += packed(MessageIndex(channel, pairs))
                length = len(self._found.tail)
        else:
            self._found.contents.indexed = False
        self._found.contents.add_chunk(replace(chunk, message_index_offsets=offsets, message_index_length=length),
                                       ((channel, len(found) // 2) for channel, found in self._entries.items()))

    def _read(self, at: int, size: int) -> bytes:
        self._file.seek(at)
        data = self._file.read(size)
        if len(data) < min(size, self._found.size - at):
            raise MalformedError("the file was cut while it was read")
        return data


def message_head(content: bytes, begin: int, end: int) -> tuple[int, int]:
    """Channel and log time [ns] of the message between two offsets (MalformedError when it is none)."""
    if end - begin < MESSAGE_HEAD.size:
        raise MalformedError("a message ends too early")
    channel, _, stamp, _ = MESSAGE_HEAD.unpack_from(content, begin)
    if stamp > LAST_STAMP:
        raise MalformedError(f"a message at {stamp} ns, later than bags can say")
    return channel, stamp
