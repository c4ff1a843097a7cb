"""MCAP records (https://mcap.dev/spec) as bytes, by the library `mcap`, and what torn files need beyond it.

The library reads and writes a file from one end to the other. A recording that survives its process needs single
records at known offsets, each of them whole or none. A record is its opcode (1 byte), the length of its content
(8 bytes) and its content; times are ROS time [ns].
"""

import struct
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import TypeVar
from zlib import crc32

import lz4.frame
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, McapRecord
from mcap.writer import MCAP0_MAGIC as MAGIC
from rosbags.rosbag2.storage_mcap import zstd

HEAD = struct.Struct("<BQ")
"""Opcode and length of content."""

MESSAGE_HEAD = struct.Struct("<HIQQ")
"""Channel, sequence number, log time, publish time; the data follow."""

LARGEST_RECORD = 128 * 2**20
"""Bytes of a record's content, and of a chunk's when it is decompressed; a longer one is not read."""

Record = TypeVar("Record", bound=McapRecord)


class MalformedError(ValueError):
    """Bytes that are not the record they should be."""


def packed(*records: McapRecord) -> bytes:
    """Records one after the other."""
    builder = RecordBuilder()
    for one in records:
        one.write(builder)
    return builder.end()


FOOTER_SIZE = len(packed(Footer(summary_start=0, summary_offset_start=0, summary_crc=0))) + len(MAGIC)
"""Bytes of the last record and of the magic behind it."""


def parsed(kind: type[Record], content: bytes) -> Record:
    """The record of this kind with this content (MalformedError where it ends too early, or is no text).

    Of a chunk, which is long, one that ends too late is refused, too: its length would swallow what follows.
    """
    stream = _Whole(content)
    try:
        record = kind.read(ReadDataStream(stream))
    except (EndOfFile, UnicodeDecodeError, OverflowError) as error:
        raise MalformedError(f"not a {kind.__name__}: {error}") from error
    if kind is Chunk and stream.tell() != len(content):
        raise MalformedError("a chunk has another length than it says")
    return record


def chunk_content(chunk: Chunk) -> bytes:
    """The records in a chunk (MalformedError when it cannot be decompressed, or has another checksum or size).

    Never makes more bytes than the chunk says, nor more than `LARGEST_RECORD`.
    """
    if chunk.uncompressed_size > LARGEST_RECORD:
        raise MalformedError(f"a chunk says that it unfolds to {chunk.uncompressed_size} bytes, more than "
                             f"{LARGEST_RECORD}")
    if chunk.compression not in _DECOMPRESSORS:
        raise MalformedError(f"a chunk has the unknown compression {chunk.compression!r}")
    try:
        raw = _DECOMPRESSORS[chunk.compression](chunk.data, chunk.uncompressed_size + 1)
    except (zstd.ZstdError, RuntimeError, EOFError) as error:  # RuntimeError: of lz4
        raise MalformedError(f"a chunk cannot be decompressed: {error}") from error
    if len(raw) != chunk.uncompressed_size:
        raise MalformedError(f"a chunk does not unfold to the {chunk.uncompressed_size} bytes that it says")
    if chunk.uncompressed_crc and crc32(raw) != chunk.uncompressed_crc:
        raise MalformedError("a chunk has another checksum than it says")
    return raw


_DECOMPRESSORS: dict[str, Callable[[bytes, int], bytes]] = {
    "": lambda data, most: data,
    "lz4": lambda data, most: lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most),
    "zstd": lambda data, most: zstd.ZstdDecompressor().decompress(data, max_length=most),
}


def records(content: bytes) -> Iterator[tuple[int, int, int, int]]:
    """Opcode, offset, and begin and end of the content, of each record in `content` (MalformedError when torn)."""
    at = 0
    while at < len(content):
        if at + HEAD.size > len(content):
            raise MalformedError("a record ends too early")
        opcode, length = HEAD.unpack_from(content, at)
        begin, end = at + HEAD.size, at + HEAD.size + length
        if not is_opcode(opcode) or end > len(content):
            raise MalformedError("a record ends too early")
        yield opcode, at, begin, end
        at = end


def is_opcode(number: int) -> bool:
    """Whether the standard knows it."""
    return 0 < number <= Opcode.DATA_END


class _Whole(BytesIO):
    """Bytes of which a part is never less than was asked for."""

    def read(self, size: int = -1) -> bytes:  # type: ignore[override]  # mcap never asks with None
        piece = super().read(size)
        if len(piece) < size:
            raise MalformedError("a record ends too early")
        return piece
