"""MCAP records (https://mcap.dev/spec) as bytes, by the library `mcap`, and what torn files need beyond it.

The library reads and writes a file from one end to the other. A recording that survives its process needs single
records at known offsets, each of them whole or none. A record is its opcode (1 byte), the length of its content
(8 bytes) and its content; times are ROS time [ns].
"""

import struct
from collections.abc import Iterator
from io import BytesIO
from typing import TypeVar

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, McapRecord
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC as MAGIC

HEAD = struct.Struct("<BQ")
"""Opcode and length of content."""

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
    """The record of this kind with this content (MalformedError where it ends too early, or is no text)."""
    try:
        return kind.read(ReadDataStream(_Whole(content)))
    except (EndOfFile, UnicodeDecodeError, OverflowError) as error:
        raise MalformedError(f"not a {kind.__name__}: {error}") from error


def chunk_content(chunk: Chunk) -> bytes:
    """The records in a chunk (MalformedError when it cannot be decompressed, or has another checksum or size)."""
    try:
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    except Exception as error:  # each decompressor has errors of its own
        raise MalformedError(f"a chunk cannot be read: {error}") from error
    if size != chunk.uncompressed_size:  # the library takes an unknown compression for none
        raise MalformedError(f"a chunk has {size} bytes instead of {chunk.uncompressed_size}")
    return stream.read(size)


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

    def read(self, size: int = -1) -> bytes:
        piece = super().read(size)
        if len(piece) < size:
            raise MalformedError("a record ends too early")
        return piece
