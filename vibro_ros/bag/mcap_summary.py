"""The ending of an MCAP file held against its data: the summary that index readers trust."""

import struct
from collections.abc import Iterator
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

from vibro_ros.bag.mcap_contents import Contents
from vibro_ros.bag.mcap_records import FOOTER_SIZE, HEAD, LARGEST_RECORD, MAGIC, MalformedError, parsed

_OF_SUMMARY = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.STATISTICS,
                         Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET})


def is_footer_reached(file: BinaryIO, at: int, size: int) -> bool:
    """Whether only a summary, a footer and the magic follow the end of data at the offset `at`."""
    try:
        footer = [at for opcode, at, _ in _records(file, at, size, lengths=True)][-1]
    except (MalformedError, IndexError):
        return False
    file.seek(size - len(MAGIC))
    return footer + FOOTER_SIZE == size and file.read() == MAGIC


def is_summary_true(file: BinaryIO, at: int, contents: Contents, whole: bool) -> bool:
    """Whether the summary behind the end of data at `at` tells the contents, as far as it tells any.

    Parameters
    ----------
    file : BinaryIO
        For which `is_footer_reached`.
    at : int
        Offset of the end of data.
    contents : Contents
        What the data are.
    whole : bool
        Whether all data could be read: a file without summary, which readers go through, is as good as its data.
    """
    file.seek(0, 2)
    try:
        found = list(_records(file, at, file.tell()))
        footer = parsed(Footer, found[-1][2])
        if footer.summary_start != (found[1][1] if len(found) > 2 else 0):
            return False
        return whole if len(found) <= 2 else _tells(found, contents)
    except MalformedError:
        return False


def announced(file: BinaryIO, size: int) -> tuple[dict[int, Schema], dict[int, Channel]]:
    """Schemas and channels by id, as the summary of a sealed file tells them; none where they cannot be read."""
    try:
        file.seek(max(0, size - FOOTER_SIZE))
        opcode, _ = HEAD.unpack(file.read(HEAD.size))
        start = parsed(Footer, file.read(FOOTER_SIZE - HEAD.size - len(MAGIC))).summary_start
        if opcode != Opcode.FOOTER or not 0 < start < size:
            return {}, {}
        found = list(_records(file, start, size, first=False))
        return ({one.id: one for one in (parsed(Schema, text) for code, _, text in found if code == Opcode.SCHEMA)},
                {one.id: one for one in (parsed(Channel, text) for code, _, text in found if code == Opcode.CHANNEL)})
    except (MalformedError, struct.error):  # struct.error: a file shorter than a footer
        return {}, {}


def _tells(found: list[tuple[int, int, bytes]], contents: Contents) -> bool:
    schemas, channels, chunks = (
        [parsed(kind, content) for opcode, _, content in found if opcode == code]
        for code, kind in ((Opcode.SCHEMA, Schema), (Opcode.CHANNEL, Channel), (Opcode.CHUNK_INDEX, ChunkIndex)))
    if any(contents.schemas.get(one.id) != one for one in schemas):
        return False
    if any(contents.channels.get(one.id) != one for one in channels):
        return False
    if channels and not {one.id for one in channels} >= {key for key, count in contents.counts.items() if count}:
        return False
    if chunks and sorted(map(_key, chunks)) != sorted(_key(one) for one in contents.indexes()):
        return False
    return all(_is_count_true(parsed(Statistics, content), contents)
               for opcode, _, content in found if opcode == Opcode.STATISTICS)


def _is_count_true(told: Statistics, contents: Contents) -> bool:
    counts = {key: count for key, count in told.channel_message_counts.items() if count}
    times = (told.message_start_time, told.message_end_time) if contents.messages else (contents.first, contents.last)
    return (told.message_count == contents.messages and times == (contents.first, contents.last)
            and (not told.channel_message_counts or counts == {key: n for key, n in contents.counts.items() if n}))


def _key(chunk: ChunkIndex) -> tuple:
    """What an index reader needs of a chunk; the times of one without messages mean nothing."""
    times = (chunk.message_start_time, chunk.message_end_time) if chunk.message_index_offsets else ()
    return (chunk.chunk_start_offset, chunk.chunk_length, chunk.compression, chunk.compressed_size,
            chunk.uncompressed_size, times)


def _records(file: BinaryIO, at: int, size: int, lengths: bool = False,
             first: bool = True) -> Iterator[tuple[int, int, bytes]]:
    """Opcode, offset and content (none for `lengths` alone) of each record to the footer, an end of data `first`."""
    end = size - len(MAGIC)
    while at + HEAD.size <= end:
        file.seek(at)
        opcode, length = HEAD.unpack(file.read(HEAD.size))
        known = opcode == Opcode.DATA_END if first else opcode in _OF_SUMMARY or opcode == Opcode.FOOTER
        if not known or length > LARGEST_RECORD or at + HEAD.size + length > end:
            raise MalformedError("not a summary")
        yield opcode, at, b"" if lengths else file.read(length)
        if opcode == Opcode.FOOTER:
            return
        first, at = False, at + HEAD.size + length
    raise MalformedError("no footer")
