"""Go through an MCAP file record by record, to the first that is torn."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Header, MessageIndex, Metadata, MetadataIndex, Schema

from vibro_ros.bag.mcap_contents import Contents
from vibro_ros.bag.mcap_records import (
    FOOTER_SIZE,
    HEAD,
    MAGIC,
    MalformedError,
    chunk_content,
    is_opcode,
    packed,
    parsed,
    records,
)
from vibro_ros.bag.mcap_segment import METADATA_KEY, METADATA_NAME

_MESSAGE_HEAD = struct.Struct("<HIQQ")
"""Channel, sequence number, log time, publish time; the data follow."""


class ForeignFileError(ValueError):
    """A file that is no ROS 2 recording; the message says why."""


@dataclass
class Scan:
    """What a file holds, sealed or not.

    Attributes
    ----------
    contents : Contents
        What is readable.
    end : int
        Offset at which the readable data end; an unsealed file is cut there.
    tail : bytes
        Index of the last chunk, to be written at `end`, when the file does not have it whole.
    sealed : bool
        Whether the file has its footer.
    size : int
        Of the file [bytes].
    damaged : int
        Bytes of whole chunks before `end` that cannot be read.
    metadata : str
        What the bag says of itself, written last; empty when nothing was found.
    """

    contents: Contents = field(default_factory=Contents)
    end: int = 0
    tail: bytes = b""
    sealed: bool = False
    size: int = 0
    damaged: int = 0
    metadata: str = ""


def scan(path: Path) -> Scan:
    """Read an MCAP file as far as it can be read.

    Raises
    ------
    ForeignFileError
        When the file is empty, no MCAP, or not of ROS 2.
    OSError
        When it cannot be read.
    """
    with path.open("rb") as file:
        return _Scanner(file, path.stat().st_size).run()


def is_sealed(path: Path) -> bool:
    """Whether a file ends as a sealed MCAP file does; without a look at what is before."""
    with path.open("rb") as file:
        size = path.stat().st_size
        file.seek(max(0, size - FOOTER_SIZE))
        end = file.read()
    return len(end) == FOOTER_SIZE and end[0] == Opcode.FOOTER and end.endswith(MAGIC)


class _Scanner:
    """The state of a scan; a chunk is taken into the contents when its indexes, which follow it, are seen."""

    def __init__(self, file: BinaryIO, size: int):
        self._file = file
        self._found = Scan(size=size)
        self._chunk: ChunkIndex | None = None
        self._entries: dict[int, list[tuple[int, int]]] = {}
        self._seen: dict[int, int] = {}
        self._seen_end = 0
        self._damage = 0

    def run(self) -> Scan:
        found = self._found
        found.end = self._header()
        for opcode, offset, content in self._records(found.end):
            if opcode == Opcode.DATA_END:
                found.sealed = self._reaches_footer(offset)
                break
            self._take(opcode, offset, content)
            end = offset + HEAD.size + len(content)
            if opcode != Opcode.MESSAGE_INDEX and not self._damage:
                found.end = end
        self._finish_chunk(last=not found.sealed)
        return found

    def _header(self) -> int:
        """Offset of the first record after the header."""
        if self._found.size == 0:
            raise ForeignFileError("the file is empty, nothing was recorded")
        if self._file.read(len(MAGIC)) != MAGIC[:self._found.size]:
            raise ForeignFileError("not an MCAP file")
        head = next(self._records(len(MAGIC)), None)
        if head is None or head[0] != Opcode.HEADER:
            raise ForeignFileError("the file ends within its header, nothing was recorded")
        profile = parsed(Header, head[2]).profile
        if profile != "ros2":
            raise ForeignFileError(f"an MCAP file, but not of ROS 2: its profile is {profile!r}")
        return len(MAGIC) + HEAD.size + len(head[2])

    def _records(self, at: int) -> Iterator[tuple[int, int, bytes]]:
        """Opcode, offset and content of each whole record from the offset `at` on."""
        while at + HEAD.size <= self._found.size:
            self._file.seek(at)
            opcode, length = HEAD.unpack(self._file.read(HEAD.size))
            end = at + HEAD.size + length
            if not is_opcode(opcode) or end > self._found.size:
                return
            yield opcode, at, self._file.read(length)
            at = end

    def _take(self, opcode: int, offset: int, content: bytes) -> None:
        try:
            if opcode == Opcode.MESSAGE_INDEX:
                self._seen[int.from_bytes(content[:2], "little")] = offset  # its channel; the rest is long, and known
                self._seen_end = offset + HEAD.size + len(content)
                return
            self._finish_chunk(last=False)
            self._take_record(opcode, offset, content)
            self._found.damaged += self._damage  # what lies between readable records stays, unindexed
            self._damage = 0
        except MalformedError:
            self._damage += HEAD.size + len(content)

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
            channel, stamp = _message_head(content, 0, len(content), contents)
            contents.add_messages(channel, 1, stamp, stamp)
            contents.indexed = False
        else:
            self._take_definition(opcode, content)

    def _take_definition(self, opcode: int, content: bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = parsed(Schema, content)
            self._found.contents.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            self._found.contents.add_channel(parsed(Channel, content))

    def _begin_chunk(self, offset: int, content: bytes) -> None:
        chunk = parsed(Chunk, content)
        raw = chunk_content(chunk)
        entries: dict[int, list[tuple[int, int]]] = {}
        for opcode, at, begin, end in records(raw):
            if opcode == Opcode.MESSAGE:
                channel, stamp = _message_head(raw, begin, end, self._found.contents)
                entries.setdefault(channel, []).append((stamp, at))
            else:
                self._take_definition(opcode, raw[begin:end])
        stamps = [stamp for found in entries.values() for stamp, _ in found]
        self._chunk = ChunkIndex(
            chunk_start_offset=offset, chunk_length=HEAD.size + len(content), compression=chunk.compression,
            compressed_size=len(chunk.data), uncompressed_size=chunk.uncompressed_size,
            message_start_time=min(stamps, default=0), message_end_time=max(stamps, default=0),
            message_index_offsets={}, message_index_length=0)
        self._entries, self._seen = entries, {}

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
                self._found.tail += packed(MessageIndex(channel, found))
                length = len(self._found.tail)
        else:
            self._found.contents.indexed = False
        self._found.contents.add_chunk(replace(chunk, message_index_offsets=offsets, message_index_length=length),
                                       ((channel, len(found)) for channel, found in self._entries.items()))

    def _reaches_footer(self, offset: int) -> bool:
        for opcode, at, content in self._records(offset):
            if opcode == Opcode.FOOTER:
                end = at + HEAD.size + len(content)
                self._file.seek(end)
                return self._file.read() == MAGIC
        return False


def _message_head(content: bytes, begin: int, end: int, contents: Contents) -> tuple[int, int]:
    """Channel and log time [ns] of the message between two offsets."""
    if end - begin < _MESSAGE_HEAD.size:
        raise MalformedError("a message ends too early")
    channel, _, stamp, _ = _MESSAGE_HEAD.unpack_from(content, begin)
    if channel not in contents.channels:
        raise MalformedError("a message of a topic that was not announced")
    return channel, stamp
