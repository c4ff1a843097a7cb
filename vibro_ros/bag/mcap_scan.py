"""Go through an MCAP file record by record, to the first that is torn."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_mcap import decompress

from vibro_ros.bag import mcap_records as mcap
from vibro_ros.bag.mcap_contents import Contents
from vibro_ros.bag.mcap_segment import METADATA_KEY, METADATA_NAME

_MESSAGE_HEAD = struct.Struct("<HIQ")
"""Channel, sequence number, log time."""


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
        file.seek(max(0, size - mcap.FOOTER_SIZE))
        end = file.read()
    return len(end) == mcap.FOOTER_SIZE and end[0] == mcap.FOOTER and end.endswith(mcap.MAGIC)


class _Scanner:
    """The state of a scan; a chunk is taken into the contents when its indexes, which follow it, are seen."""

    def __init__(self, file: BinaryIO, size: int):
        self._file = file
        self._found = Scan(size=size)
        self._chunk: mcap.Chunk | None = None
        self._entries: dict[int, list[tuple[int, int]]] = {}
        self._seen: dict[int, int] = {}
        self._seen_end = 0
        self._damage = 0

    def run(self) -> Scan:
        found = self._found
        found.end = self._header()
        for opcode, offset, content in self._records(found.end):
            if opcode == mcap.DATA_END:
                found.sealed = self._reaches_footer(offset)
                break
            self._take(opcode, offset, content)
            end = offset + mcap.HEAD.size + len(content)
            if opcode != mcap.MESSAGE_INDEX and not self._damage:
                found.end = end
        self._finish_chunk(last=not found.sealed)
        return found

    def _header(self) -> int:
        """Offset of the first record after the header."""
        if self._found.size == 0:
            raise ForeignFileError("the file is empty, nothing was recorded")
        if self._file.read(len(mcap.MAGIC)) != mcap.MAGIC[:self._found.size]:
            raise ForeignFileError("not an MCAP file")
        head = next(self._records(len(mcap.MAGIC)), None)
        if head is None or head[0] != mcap.HEADER:
            raise ForeignFileError("the file ends within its header, nothing was recorded")
        profile = mcap.Parser(head[2]).text()
        if profile != "ros2":
            raise ForeignFileError(f"an MCAP file, but not of ROS 2: its profile is {profile!r}")
        return len(mcap.MAGIC) + mcap.HEAD.size + len(head[2])

    def _records(self, at: int) -> Iterator[tuple[int, int, bytes]]:
        """Opcode, offset and content of each whole record from the offset `at` on."""
        while at + mcap.HEAD.size <= self._found.size:
            self._file.seek(at)
            opcode, length = mcap.HEAD.unpack(self._file.read(mcap.HEAD.size))
            end = at + mcap.HEAD.size + length
            if not 0 < opcode <= mcap.LAST_OPCODE or end > self._found.size:
                return
            yield opcode, at, self._file.read(length)
            at = end

    def _take(self, opcode: int, offset: int, content: bytes) -> None:
        try:
            if opcode == mcap.MESSAGE_INDEX:
                self._seen[mcap.Parser(content).u16()] = offset
                self._seen_end = offset + mcap.HEAD.size + len(content)
                return
            self._finish_chunk(last=False)
            self._take_record(opcode, offset, content)
            self._found.damaged += self._damage  # what lies between readable records stays, unindexed
            self._damage = 0
        except (mcap.MalformedError, ReaderError):
            self._damage += mcap.HEAD.size + len(content)

    def _take_record(self, opcode: int, offset: int, content: bytes) -> None:
        contents = self._found.contents
        if opcode == mcap.CHUNK:
            self._begin_chunk(offset, content)
        elif opcode == mcap.METADATA:
            parser = mcap.Parser(content)
            name, labels = parser.text(), parser.labels()
            contents.metadata.append((offset, mcap.HEAD.size + len(content), name))
            if name == METADATA_NAME:
                self._found.metadata = labels.get(METADATA_KEY, "")
        elif opcode == mcap.MESSAGE:
            channel, stamp = _message_head(content, 0, len(content), contents)
            contents.add_messages(channel, 1, stamp, stamp)
            contents.indexed = False
        else:
            self._take_definition(opcode, content)

    def _take_definition(self, opcode: int, content: bytes) -> None:
        if opcode == mcap.SCHEMA:
            schema = mcap.parsed_schema(content)
            self._found.contents.schemas[schema.id] = schema
        elif opcode == mcap.CHANNEL:
            self._found.contents.add_channel(mcap.parsed_channel(content))

    def _begin_chunk(self, offset: int, content: bytes) -> None:
        head = mcap.parsed_chunk(content)
        try:
            raw = decompress(head.records, head.compression, head.size, head.crc)
        except ReaderError:
            raise
        except Exception as error:  # each decompressor has errors of its own
            raise mcap.MalformedError("a chunk cannot be decompressed") from error
        entries: dict[int, list[tuple[int, int]]] = {}
        for opcode, at, begin, end in mcap.records(raw):
            if opcode == mcap.MESSAGE:
                channel, stamp = _message_head(raw, begin, end, self._found.contents)
                entries.setdefault(channel, []).append((stamp, at))
            else:
                self._take_definition(opcode, raw[begin:end])
        stamps = [stamp for found in entries.values() for stamp, _ in found]
        length = mcap.HEAD.size + len(content)
        self._chunk = mcap.Chunk(min(stamps, default=0), max(stamps, default=0), offset, length, {}, 0,
                                 head.compression, len(head.records), head.size)
        self._entries, self._seen = entries, {}

    def _finish_chunk(self, last: bool) -> None:
        """Take the chunk before into the contents; the `last` one gets the indexes that were torn off."""
        chunk, self._chunk = self._chunk, None
        if chunk is None:
            return
        begin = chunk.offset + chunk.length
        offsets, length = {}, 0
        if self._seen.keys() >= self._entries.keys():
            offsets = {channel: self._seen[channel] for channel in self._entries}
            length = self._seen_end - begin if self._seen else 0
            self._found.end = max(self._found.end, begin + length)
        elif last:
            for channel, found in self._entries.items():
                offsets[channel] = begin + length
                self._found.tail += mcap.message_index(channel, found)
                length = len(self._found.tail)
        else:
            self._found.contents.indexed = False
        self._found.contents.add_chunk(chunk._replace(indexes=offsets, index_length=length),
                                       ((channel, len(found)) for channel, found in self._entries.items()))

    def _reaches_footer(self, offset: int) -> bool:
        for opcode, at, content in self._records(offset):
            if opcode == mcap.FOOTER:
                end = at + mcap.HEAD.size + len(content)
                self._file.seek(end)
                return self._file.read() == mcap.MAGIC
        return False


def _message_head(content: bytes, begin: int, end: int, contents: Contents) -> tuple[int, int]:
    """Channel and log time [ns] of the message between two offsets."""
    if end - begin < mcap.MESSAGE_OVERHEAD:
        raise mcap.MalformedError("a message ends too early")
    channel, _, stamp = _MESSAGE_HEAD.unpack_from(content, begin)
    if channel not in contents.channels:
        raise mcap.MalformedError("a message of a topic that was not announced")
    return channel, stamp
