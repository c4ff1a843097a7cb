"""One MCAP file of a bag, sealed or not: what can be read of it, its messages, and a sealed copy.

`StreamReader` of the library `mcap` reads the records. No read takes more memory than the file has bytes, because
`_BoundedFile` compares each length with the file first. Chunks are unfolded here, to no more than the size that they
state, and their checksums are verified, so that a damaged chunk costs only that chunk. Damage outside of chunks costs
the rest of the file.
"""

import os
import struct
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, DataEnd, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader

from vibro_ros.bag.mcap_writer import MAGIC, McapWriter
from vibro_ros.bag.metadata import (
    LAST_STAMP,
    METADATA_KEY,
    METADATA_NAME,
    FileInformation,
    TopicInformation,
    custom_data,
    qos_profiles,
)
from vibro_ros.process.files import open_to_read

LARGEST_RECORD = 128 * 2**20
"""Largest content [bytes] of a record, and of a decompressed chunk; a larger one is not read."""
UNFOLDING = 100
"""Largest total size of the decompressed chunks, in multiples of the file's size, beyond `FREE_UNFOLDING`."""
FREE_UNFOLDING = 32 * 2**20  # total size [bytes] of decompressed chunks that is always allowed
SCHEMAS = ("ros2msg", "ros2idl")  # encodings of the schemas of ROS 2

Entry = tuple[int, int, int, int, bytes]
"""Channel, sequence number, recorded stamp [ns], publish time [ns] and data of a message."""

_HEAD = struct.Struct("<BQ")  # of a record: its opcode, and the length of the content that follows
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence number, log time, publish time; the data follow
_FOOTER = _HEAD.pack(Opcode.FOOTER, 20)  # head of a footer; 20 bytes and the magic follow and end the file


class ForeignFileError(ValueError):
    """The file is no ROS 2 recording; the message says why."""


class DamagedError(ValueError):
    """Bytes are not the record that they should be."""


class McapFile:
    """An MCAP file of ROS 2, scanned once when this object is made; the file is open only while it is read.

    ForeignFileError when the file is empty, not MCAP, or not of ROS 2; OSError when it cannot be read.
    """

    information: FileInformation  # its name, times, and readable messages by topic
    topics: list[TopicInformation]  # each topic of `information`, once
    custom: dict[str, str]  # the bag's custom data in the file
    ordered: bool  # whether the messages are in the order of their stamps
    flaws: list[str]  # sentences on the parts that are not read
    sealed: bool  # whether the file has its footer
    size: int  # of the file [bytes]
    end: int  # offset of the end of its last whole record of data [bytes]
    damaged: int  # bytes that cannot be read in whole records, or after these in a sealed file
    is_whole: bool  # whether a copy of its messages and of the bag's metadata has all that is in the file

    def __init__(self, path: Path):
        self.path, self.custom = path, {}
        self.ordered = self.is_whole = True
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()  # messages by channel
        self._first, self._last, self._previous_stamp = LAST_STAMP, 0, 0
        self._compression, self._unfolded_size, self.damaged = "", 0, 0
        self._blocks = array("Q")  # offsets of the readable chunks, and of the readable messages outside of chunks
        self._damage = ""  # description of the first damage
        with open_to_read(path, follow=False) as file:
            self.size = os.fstat(file.fileno()).st_size
            profile = self._scan(file)
        self.topics, self._read_channels, self.flaws = self._topics_and_flaws()
        if profile != "ros2" and not self._read_channels:
            encodings = ", ".join(sorted({channel.message_encoding for channel in self._channels.values()}))
            raise ForeignFileError(f"an MCAP file, but not of ROS 2: its profile is {profile[:60]!r}, and its messages "
                                   f"are encoded as {encodings[:60] or 'nothing'}, not as CDR with types of ROS 2")
        counts = dict.fromkeys((topic.name for topic in self.topics), 0)
        for number, topic_name in self._read_channels.items():
            counts[topic_name] += self._counts[number]
        self.information = FileInformation(path.name, *((self._first, self._last) if self._counts else (0, 0)), counts)
        self.is_whole &= len(self.flaws) == (not self.sealed) and self.end == self.size

    def messages(self, topics: frozenset[str]) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, recorded stamp [ns] and data of the messages of some topics in the file's order (OSError)."""
        chosen = {channel: topic for channel, topic in self._read_channels.items() if topic in topics}
        if chosen:
            for channel, _, stamp, _, data in self._entries():
                if channel in chosen:
                    yield chosen[channel], stamp, data

    def copy_sealed(self, target: BinaryIO, metadata: str) -> None:
        """Write all readable messages to a new MCAP file, with the bag's `metadata` as text, and seal it (OSError)."""
        read = [channel for number, channel in self._channels.items() if number in self._read_channels]
        writer = McapWriter(target.write, list(self._schemas.values()), read, "zstd" if self._compression else "")
        for channel, sequence, stamp, published, data in self._entries():
            if channel in self._read_channels:
                writer.add_message(channel, stamp, data, published, sequence)
        writer.add_metadata(METADATA_NAME, {METADATA_KEY: metadata})
        writer.finish()

    def _records(self, file: BinaryIO) -> Iterator[tuple[int, McapRecord]]:
        """Yield each whole record behind the magic, and the offset of its end; ends at the footer, or at damage."""
        bounded = _BoundedFile(file, self.size)
        with suppress(*_UNREADABLE):
            for record in StreamReader(bounded, skip_magic=True, emit_chunks=True,  # type: ignore[arg-type]
                                       record_size_limit=LARGEST_RECORD).records:
                yield self.size - bounded.left, record

    def _entries(self) -> Iterator[Entry]:
        """Yield the readable messages in the order of the file."""
        try:
            with open_to_read(self.path, follow=False) as file:
                for offset in self._blocks:
                    file.seek(offset)
                    _, record = next(self._records(file))
                    if isinstance(record, Message):
                        yield record.channel_id, record.sequence, record.log_time, record.publish_time, record.data
                    elif isinstance(record, Chunk):
                        raw = unfolded(record)
                        for opcode, begin, end in records_in(raw):
                            if opcode == Opcode.MESSAGE:
                                channel, sequence, stamp, published = _MESSAGE_HEAD.unpack_from(raw, begin)
                                yield channel, sequence, stamp, published, raw[begin + _MESSAGE_HEAD.size:end]
        except (DamagedError, StopIteration, struct.error) as error:  # it was readable when it was scanned
            self.flaws.append(f"{self.path.name}: changed while it was read: {error or 'it ends too early'}")

    def _scan(self, file: BinaryIO) -> str:
        """Go through all records, count what can be read, and return the file's profile."""
        self._check_ends(file)
        records = self._records(file)
        self.end, header = next(records, (0, None))
        if not isinstance(header, Header):
            raise ForeignFileError("the file ends within its header, nothing was recorded")
        has_end = False
        for end, record in records:
            if has_end := isinstance(record, DataEnd):
                break
            begin, self.end = self.end, end
            try:
                self._take(record, begin)
            except DamagedError as error:
                self._note_damage(end - begin, f"{error} at byte {begin}")
        if self.sealed and not has_end:
            self._note_damage(self.size - self.end, f"not a record at byte {self.end}")
        for _, record in records:  # the summary, in case a damaged chunk announced a topic
            if isinstance(record, (Schema, Channel)):
                with suppress(DamagedError):
                    self._announce(record)
        return header.profile

    def _check_ends(self, file: BinaryIO) -> None:
        """Set `sealed` by the file's end, and stop behind the magic at its beginning (ForeignFileError without it)."""
        if self.size == 0:
            raise ForeignFileError("the file is empty, nothing was recorded")
        file.seek(max(0, self.size - 20 - len(_FOOTER) - len(MAGIC)))
        tail = file.read()
        self.sealed = tail.startswith(_FOOTER) and tail.endswith(MAGIC)
        file.seek(0)
        if file.read(len(MAGIC)) != MAGIC[:self.size]:
            raise ForeignFileError("not an MCAP file")

    def _take(self, record: McapRecord, begin: int) -> None:
        """Count what can be read in a record that begins at the offset `begin` (DamagedError)."""
        if isinstance(record, Chunk):
            self._unfolded_size += record.uncompressed_size
            if self._unfolded_size > FREE_UNFOLDING + UNFOLDING * self.size:
                raise DamagedError(f"its chunks unfold to more than {UNFOLDING} times the file's size")
            self._compression = record.compression
            self._count(begin, self._heads_in(unfolded(record)))
        elif isinstance(record, Message):
            self._count(begin, [(record.channel_id, record.log_time)])
        elif isinstance(record, (Schema, Channel)):
            self._announce(record)
        elif isinstance(record, Metadata) and record.name == METADATA_NAME:
            self.custom = custom_data(record.metadata.get(METADATA_KEY, ""))
        elif isinstance(record, (Attachment, Metadata)):
            self.is_whole = False

    def _note_damage(self, size: int, words: str) -> None:
        self.damaged += size
        self._damage = self._damage or words

    def _announce(self, record: Schema | Channel) -> None:
        """Take a schema or a channel (DamagedError if it contradicts another)."""
        known: dict = self._schemas if isinstance(record, Schema) else self._channels
        if known.setdefault(record.id, record) != record:
            raise DamagedError(f"{type(record).__name__.lower()} {record.id} is announced twice, and differs")

    def _heads_in(self, raw: bytes) -> list[tuple[int, int]]:
        """Return channel and stamp of each message in an unfolded chunk, and take what it announces (DamagedError)."""
        heads = []
        for opcode, begin, end in records_in(raw):
            if opcode == Opcode.MESSAGE:
                if end - begin < _MESSAGE_HEAD.size:
                    raise DamagedError("a message ends too early")
                channel, _, stamp, _ = _MESSAGE_HEAD.unpack_from(raw, begin)
                heads.append((channel, stamp))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                kind: type[Schema | Channel] = Schema if opcode == Opcode.SCHEMA else Channel
                try:
                    record = kind.read(ReadDataStream(_BoundedFile(BytesIO(raw[begin:end]), end - begin)))
                except _UNREADABLE as error:
                    raise DamagedError(f"not a {kind.__name__}: {error}") from error
                self._announce(record)
        return heads

    def _count(self, offset: int, heads: list[tuple[int, int]]) -> None:
        """Count the messages, given by channel and stamp, of the chunk or message at `offset` (DamagedError)."""
        if not heads:
            return
        stamps = [stamp for _, stamp in heads]
        if max(stamps) > LAST_STAMP:
            raise DamagedError(f"a message at {max(stamps)} ns, later than bags can say")
        self._blocks.append(offset)
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
            topic = schema and schema.encoding in SCHEMAS and TopicInformation(
                channel.topic, schema.name, qos_profiles(channel.metadata.get("offered_qos_profiles", "")),
                channel.metadata.get("topic_type_hash", ""), channel.message_encoding)
            if topic and topic.encoding == "cdr" and topics.setdefault(topic.name, topic).type_name == topic.type_name:
                read[number] = channel.topic
            else:
                flaws.append(f"{name}: {self._counts[number]} messages on {channel.topic} are not read: their channel "
                             "has no type of ROS 2, another type than the topic, or is not encoded as CDR")
        return list(topics.values()), read, flaws


class _BoundedFile:
    """The next `left` bytes of a file; a read of more bytes than that, or than `LARGEST_RECORD`, raises EndOfFile.

    `mcap` itself would allocate a buffer of any length that a record states, and takes what is there for the whole.
    """

    def __init__(self, file: BinaryIO, size: int):
        self._file, self.left = file, size - file.tell()

    def read(self, length: int) -> bytes:
        if not 0 <= length <= min(self.left, LARGEST_RECORD):
            raise EndOfFile
        self.left -= length
        return self._file.read(length)


_UNREADABLE = (McapError, struct.error, UnicodeDecodeError)


def unfolded(chunk: Chunk) -> bytes:
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


def records_in(raw: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of the content of each record in an unfolded chunk (DamagedError)."""
    at, size = 0, len(raw)
    while at < size:
        opcode, length = _HEAD.unpack_from(raw, at) if at + _HEAD.size <= size else (0, size)
        begin = at + _HEAD.size
        at = begin + length
        if at > size:
            raise DamagedError("a record ends too early")
        if opcode == 0:  # of no record, and a chunk of zeros would have a million of them
            raise DamagedError("not a record")
        yield opcode, begin, at
