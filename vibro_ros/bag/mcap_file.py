"""One MCAP file of a bag: reads it record by record, sealed or not, and makes the end with which `recover` seals it.

The library `mcap` parses each record. Its readers are not used on files of unknown origin, because they allocate a
buffer of the length in a record before they compare it with the file, and stop at the first damage. Here the length is
compared with the file first, so that the lengths inside a record are bounded by its own; a chunk is decompressed to no
more than the size that it states, and its checksum is verified. A damaged chunk costs only that chunk. A record whose
own length is damaged costs the rest of the file.
"""

import os
import struct
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, TypeVar
from zlib import crc32

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.writer import MCAP0_MAGIC as MAGIC

from vibro_ros.bag.metadata import LAST_STAMP, FileInformation, TopicInformation, custom_data, qos_profiles
from vibro_ros.process.files import open_to_read

METADATA_NAME = "rosbag2"
METADATA_KEY = "serialized_metadata"

LARGEST_RECORD = 128 * 2**20
"""Largest content [bytes] of a record, and of a decompressed chunk; a larger one is not read."""
UNFOLDING = 100
"""Largest total size of the decompressed chunks, in multiples of the file's size, beyond `FREE_UNFOLDING`."""
FREE_UNFOLDING = 32 * 2**20
"""Total size [bytes] of decompressed chunks that is always allowed."""

HEAD = struct.Struct("<BQ")
"""Head of a record: its opcode, and the length of the content that follows."""

Message = tuple[str, int, bytes]
"""Topic, recorded stamp [ns], serialised message."""

_Record = TypeVar("_Record", bound=McapRecord)
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence number, log time, publish time; the data follow
_FOOTER_SIZE = HEAD.size + 20 + len(MAGIC)  # bytes, with the magic that ends the file


class ForeignFileError(ValueError):
    """The file is no ROS 2 recording; the message says why."""


class DamagedError(ValueError):
    """Bytes are not the record that they should be."""


def records(file: BinaryIO, at: int, end: int) -> Iterator[tuple[int, int, int, bytes]]:
    """Yield opcode, offset, offset of the next record, and content of each record from `at` to `end`.

    Ends early at bytes that are no record. The content of attachments is left out, because it is not needed and may be
    large.
    """
    while at + HEAD.size <= end:
        file.seek(at)
        head = file.read(HEAD.size)
        opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
        is_attachment, following = opcode == Opcode.ATTACHMENT, at + HEAD.size + length
        if not 0 < opcode <= Opcode.DATA_END or following > end or (length > LARGEST_RECORD and not is_attachment):
            return
        yield opcode, at, following, b"" if is_attachment else file.read(length)
        at = following


class McapFile:
    """An MCAP file of ROS 2, scanned once when this object is made; the file is open only while it is read.

    ForeignFileError when the file is empty, not MCAP, or not of ROS 2; OSError when it cannot be read.

    Attributes
    ----------
    information : FileInformation
        Its name, times, and readable messages by topic.
    topics : list of TopicInformation
        Each topic of `information`, once.
    custom : dict of str to str
        The bag's custom data in the file.
    ordered : bool
        Whether the messages are in the order of their stamps.
    flaws : list of str
        Sentences on the parts that are not read.
    size, end : int
        Size of the file, and offset of the end of its last whole record of data [bytes].
    damaged : int
        Bytes that cannot be read in whole records, or after these in a sealed file.
    sealed : bool
        Whether the file has its footer.
    """

    def __init__(self, path: Path):
        self.path = path
        self.ordered = True
        self.custom: dict[str, str] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()  # messages by channel
        self._first, self._last, self._previous_stamp = LAST_STAMP, 0, 0
        self._blocks = array("Q")  # offsets of the readable chunks, and of the readable messages outside of chunks
        self._unchunked = 0  # messages outside of chunks
        self._damaged: dict[int, int] = {}  # offsets of damaged records, and their bytes
        self._damage = ""  # description of the first damage
        with open_to_read(path, follow=False) as file:
            self.size = os.fstat(file.fileno()).st_size
            self._begin = self.end = self._header(file)
            self.sealed, summary = self._footer(file)
            self._look_through(file, summary)
        self.damaged = sum(self._damaged.values())
        self.topics, self._read_channels, self.flaws = self._topics_and_flaws()
        counts = dict.fromkeys((topic.name for topic in self.topics), 0)
        for number, topic_name in self._read_channels.items():
            counts[topic_name] += self._counts[number]
        self.information = FileInformation(path.name, *((self._first, self._last) if self._counts else (0, 0)), counts)

    def messages(self, topics: frozenset[str]) -> Iterator[Message]:
        """Yield the messages of some topics in the order of the file (OSError if it cannot be opened any more)."""
        chosen = {channel: topic for channel, topic in self._read_channels.items() if topic in topics}
        try:
            with open_to_read(self.path, follow=False) as file:
                for offset in self._blocks if chosen else ():
                    opcode, _, _, content = next(records(file, offset, self.size))
                    for kind, _, inner in records_in(opcode, content):
                        if kind == Opcode.MESSAGE:
                            channel, stamp = _message_head(inner)
                            if channel in chosen:
                                yield chosen[channel], stamp, inner[_MESSAGE_HEAD.size:]
        except (DamagedError, StopIteration) as error:  # it was readable when it was scanned
            self.flaws.append(f"{self.path.name}: changed while it was read: {error or 'it ends too early'}")

    def ending(self, metadata: str) -> bytes:
        """Return the bytes that seal the file from `end` on: message indexes, metadata, summary and footer (OSError).

        Message indexes are added for the last chunk, if some of its indexes were torn off; `metadata` is the bag's, as
        text. A damaged chunk stays in the file, but the summary does not list it.
        """
        indexes, noted = bytearray(), []
        chunk: ChunkIndex | None = None
        chunks, is_indexed = 0, not self._unchunked
        with open_to_read(self.path, follow=False) as file:
            for opcode, at, following, content in records(file, self._begin, self.end):
                if opcode == Opcode.MESSAGE_INDEX and chunk:
                    chunk.message_index_offsets[int.from_bytes(content[:2], "little")] = at
                    chunk.message_index_length = following - chunk.chunk_start_offset - chunk.chunk_length
                elif opcode == Opcode.CHUNK:
                    if chunk:
                        indexes += record_bytes(chunk)
                        is_indexed &= bool(chunk.message_index_offsets)
                    chunk = None if at in self._damaged else _chunk_index(at, following, parse_record(Chunk, content))
                    chunks += chunk is not None
                elif opcode == Opcode.METADATA and at not in self._damaged:
                    noted.append(MetadataIndex(at, following - at, parse_record(Metadata, content).name))
            torn = _missing_indexes(file, chunk, self.end) if chunk else b""
        at = self.end + len(torn)
        record = record_bytes(Metadata(METADATA_NAME, {METADATA_KEY: metadata}))
        noted.append(MetadataIndex(at, len(record), METADATA_NAME))
        if chunk:
            indexes += record_bytes(chunk)
        data_end = record_bytes(DataEnd(data_section_crc=0))
        counts = {channel: self._counts[channel] for channel in self._channels}
        first, last = (self._first, self._last) if self._counts else (0, 0)
        statistics = Statistics(
            attachment_count=0, channel_count=len(counts), channel_message_counts=counts, chunk_count=chunks,
            message_count=sum(counts.values()), message_start_time=first, message_end_time=last,
            metadata_count=len(noted), schema_count=len(self._schemas))
        # Without an index of chunks, readers scan the file from its beginning.
        summary = [record_bytes(*self._schemas.values(), *self._channels.values(), statistics),
                   bytes(indexes) if is_indexed else b"", record_bytes(*noted)]
        footer = Footer(summary_start=at + len(record) + len(data_end), summary_offset_start=0, summary_crc=0)
        return b"".join([torn, record, data_end, *summary, record_bytes(footer), MAGIC])

    def _header(self, file: BinaryIO) -> int:
        """Check magic and header, and return the offset of the first record after them."""
        if self.size == 0:
            raise ForeignFileError("the file is empty, nothing was recorded")
        if file.read(len(MAGIC)) != MAGIC[:self.size]:
            raise ForeignFileError("not an MCAP file")
        opcode, _, following, content = next(records(file, len(MAGIC), self.size), (0, 0, 0, b""))
        if opcode != Opcode.HEADER:
            raise ForeignFileError("the file ends within its header, nothing was recorded")
        try:
            profile = parse_record(Header, content).profile
        except DamagedError as error:
            raise ForeignFileError(f"its header cannot be read: {error}") from error
        if profile != "ros2":
            raise ForeignFileError(f"an MCAP file, but not of ROS 2: its profile is {profile[:60]!r}")
        return following

    def _footer(self, file: BinaryIO) -> tuple[bool, int]:
        """Return whether the file has its footer, and the offset of the summary that the footer names."""
        at = max(self._begin, self.size - _FOOTER_SIZE)
        opcode, _, following, content = next(records(file, at, self.size), (0, 0, 0, b""))
        if opcode != Opcode.FOOTER or following != self.size - len(MAGIC) or file.read(len(MAGIC)) != MAGIC:
            return False, self.size
        summary = parse_record(Footer, content).summary_start
        return True, summary if summary else self.size

    def _look_through(self, file: BinaryIO, summary: int) -> None:
        """Scan all records and count what can be read.

        From the summary only schemas and channels are taken, in case a damaged chunk announced them.
        """
        unfolded, has_end = 0, False
        for opcode, at, following, content in records(file, self._begin, self.size):
            if opcode == Opcode.DATA_END:
                has_end = True
                break
            self.end = following
            try:
                if opcode == Opcode.CHUNK:
                    size = parse_record(Chunk, content).uncompressed_size
                    if unfolded + size > FREE_UNFOLDING + UNFOLDING * self.size:
                        raise DamagedError(f"its chunks unfold to more than {UNFOLDING} times the file's size")
                    unfolded += size
                heads = []
                for kind, _, inner in records_in(opcode, content):
                    if kind == Opcode.MESSAGE:
                        heads.append(_message_head(inner))
                    else:
                        self._define(kind, inner)
                if opcode in (Opcode.CHUNK, Opcode.MESSAGE):
                    self._count(at, heads)
                    self._unchunked += opcode == Opcode.MESSAGE
            except DamagedError as error:
                self._damaged[at] = following - at
                self._damage = self._damage or f"{error} at byte {at}"
        if self.sealed and not has_end:
            self._damaged[self.end] = self.size - self.end
            self._damage = self._damage or f"not a record at byte {self.end}"
        for opcode, _, _, content in records(file, max(summary, self.end), self.size) if self.sealed else ():
            try:
                self._define(opcode, content)
            except DamagedError:
                return

    def _define(self, opcode: int, content: bytes) -> None:
        """Take a schema, a channel or the bag's metadata (DamagedError if it is malformed or contradicts another)."""
        if opcode == Opcode.METADATA:
            about = parse_record(Metadata, content)
            if about.name == METADATA_NAME:
                self.custom = custom_data(about.metadata.get(METADATA_KEY, ""))
        elif opcode in _DEFINITIONS:
            found: Any = parse_record(_DEFINITIONS[opcode], content)
            known: dict = self._schemas if opcode == Opcode.SCHEMA else self._channels
            if known.setdefault(found.id, found) != found:
                raise DamagedError(f"{type(found).__name__.lower()} {found.id} is announced twice, and differs")

    def _count(self, at: int, heads: list[tuple[int, int]]) -> None:
        """Count the messages of the chunk or the message at the offset `at`; `heads` has their channels and stamps."""
        self._blocks.append(at)
        if heads:
            stamps = [stamp for _, stamp in heads]
            self.ordered &= self._previous_stamp <= stamps[0] and stamps == sorted(stamps)
            self._previous_stamp = stamps[-1]
            self._first, self._last = min(self._first, *stamps), max(self._last, *stamps)
            self._counts.update(channel for channel, _ in heads)

    def _topics_and_flaws(self) -> tuple[list[TopicInformation], dict[int, str], list[str]]:
        """Return each topic once, the topic of each channel that is read, and sentences on what is not read."""
        name, flaws = self.path.name, []
        if self.damaged:
            flaws.append(f"{name}: {self.damaged} damaged bytes are not read: {self._damage}")
        unannounced = sum(self._counts.pop(channel) for channel in self._counts.keys() - self._channels.keys())
        if unannounced:
            flaws.append(f"{name}: {unannounced} messages of topics that are not announced are not read")
        if not self.sealed:
            rest = self.size - self.end
            flaws.append(f"{name}: it is not sealed, because its recorder still runs or was killed; " + (
                f"its last {rest} bytes are torn and not read" if rest else "all that was written is read")
                + "; `recover` seals it for other programs")
        topics: dict[str, TopicInformation] = {}
        read: dict[int, str] = {}
        for number, channel in self._channels.items():
            schema = self._schemas.get(channel.schema_id)
            topic = schema and TopicInformation(
                channel.topic, schema.name, qos_profiles(channel.metadata.get("offered_qos_profiles", "")),
                channel.metadata.get("topic_type_hash", ""), channel.message_encoding)
            if topic and topic.encoding == "cdr" and topics.setdefault(topic.name, topic).type_name == topic.type_name:
                read[number] = channel.topic
            else:
                flaws.append(f"{name}: {self._counts[number]} messages on {channel.topic} are not read: their "
                             "channel has no type, another type than the topic, or is not encoded as CDR")
        return list(topics.values()), read, flaws


_DEFINITIONS: dict[int, type] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}


def record_bytes(*given: McapRecord) -> bytes:
    """Return the bytes of records, one after the other."""
    builder = RecordBuilder()
    for one in given:
        one.write(builder)
    return builder.end()


def parse_record(kind: type[_Record], content: bytes) -> _Record:
    """Return the record of this kind with this content (DamagedError if it is malformed).

    A chunk that is shorter than its content is refused, because its damaged length covers the records after it.
    """
    stream = BytesIO(content)
    try:
        record = kind.read(ReadDataStream(stream))
    except (McapError, struct.error, UnicodeDecodeError, OverflowError) as error:
        raise DamagedError(f"not a {kind.__name__}: {error}") from error
    if kind is Chunk and stream.tell() != len(content):
        raise DamagedError("a chunk has another length than it says")
    return record


def chunk_content(chunk: Chunk) -> bytes:
    """Return the records in a chunk as bytes (DamagedError if it cannot be decompressed, or checksum or size differ).

    Never makes more bytes than the size that the chunk states, nor more than `LARGEST_RECORD`.
    """
    size = chunk.uncompressed_size
    if size > LARGEST_RECORD:
        raise DamagedError(f"a chunk says that it unfolds to {size} bytes, more than {LARGEST_RECORD}")
    if chunk.compression not in _DECOMPRESSORS:
        raise DamagedError(f"a chunk has the unknown compression {chunk.compression[:60]!r}")
    try:
        raw = _DECOMPRESSORS[chunk.compression](chunk.data, size + 1)
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:  # RuntimeError: of lz4
        raise DamagedError(f"a chunk cannot be decompressed: {error}") from error
    if len(raw) != size:
        raise DamagedError(f"a chunk does not unfold to the {size} bytes that it says")
    if chunk.uncompressed_crc and crc32(raw) != chunk.uncompressed_crc:
        raise DamagedError("a chunk has another checksum than it says")
    return raw


_DECOMPRESSORS: dict[str, Callable[[bytes, int], bytes]] = {
    "": lambda data, most: data,
    "lz4": lambda data, most: lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most),
    "zstd": lambda data, most: zstandard.ZstdDecompressor().stream_reader(data).read(most),
}


def records_in(opcode: int, content: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Yield opcode, offset and content of each record in a chunk, or of a record that is no chunk (DamagedError)."""
    if opcode != Opcode.CHUNK:
        yield opcode, 0, content
        return
    raw, end = chunk_content(parse_record(Chunk, content)), 0
    for kind, at, following, inner in records(BytesIO(raw), 0, len(raw)):
        yield kind, at, inner
        end = following
    if end < len(raw):
        raise DamagedError("a record ends too early")


def _message_head(content: bytes) -> tuple[int, int]:
    """Return channel and log time [ns] of a message (DamagedError if it is malformed)."""
    if len(content) < _MESSAGE_HEAD.size:
        raise DamagedError("a message ends too early")
    channel, _, stamp, _ = _MESSAGE_HEAD.unpack_from(content)
    if stamp > LAST_STAMP:
        raise DamagedError(f"a message at {stamp} ns, later than bags can say")
    return channel, stamp


def _chunk_index(at: int, following: int, chunk: Chunk) -> ChunkIndex:
    """Return the index of the chunk from the offset `at` to `following`, without its message indexes."""
    return ChunkIndex(
        chunk_start_offset=at, chunk_length=following - at, compression=chunk.compression,
        compressed_size=len(chunk.data), uncompressed_size=chunk.uncompressed_size, message_index_offsets={},
        message_start_time=chunk.message_start_time, message_end_time=chunk.message_end_time, message_index_length=0)


def _missing_indexes(file: BinaryIO, chunk: ChunkIndex, end: int) -> bytes:
    """Return the message indexes of a file's last chunk, to be written at `end`; empty if none is missing.

    Their offsets are entered in `chunk`.
    """
    opcode, _, _, content = next(records(file, chunk.chunk_start_offset, end))
    entries: dict[int, list[tuple[int, int]]] = {}  # stamp and offset of each message, by channel
    for kind, at, inner in records_in(opcode, content):
        if kind == Opcode.MESSAGE:
            channel, stamp = _message_head(inner)
            entries.setdefault(channel, []).append((stamp, at))
    if chunk.message_index_offsets.keys() >= entries.keys():
        return b""
    pieces: list[bytes] = []
    for channel, found in entries.items():
        chunk.message_index_offsets[channel] = end + sum(map(len, pieces))
        pieces.append(record_bytes(MessageIndex(channel, found)))
    missing = b"".join(pieces)
    chunk.message_index_length = end + len(missing) - chunk.chunk_start_offset - chunk.chunk_length
    return missing
