"""Find a chunk in an MCAP file where the records' own lengths are lost."""

import re
from typing import BinaryIO

from vibro_ros.bag.mcap_records import HEAD

_CHUNK = re.compile(rb"\x06.{36}(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)", re.DOTALL)
"""A chunk's head to its compression; the length of its data follows."""
_HEAD = 64  # bytes, more than the head of a chunk
_BLOCK = 2**20  # bytes that are searched at a time


def next_chunk(file: BinaryIO, at: int, size: int) -> int:
    """Offset of the next chunk whose two lengths agree, from the offset `at` on; 0 when there is none.

    Parameters
    ----------
    file : BinaryIO
        The file.
    at : int
        Where to begin.
    size : int
        Bytes of the file.
    """
    while at < size:
        file.seek(at)
        block = file.read(min(_BLOCK + _HEAD, size - at))
        for match in _CHUNK.finditer(block):
            _, length = HEAD.unpack_from(block, match.start())
            data = int.from_bytes(block[match.end():match.end() + 8], "little")
            content = match.end() + 8 - match.start() - HEAD.size + data
            if content == length and at + match.start() + HEAD.size + length <= size:
                return at + match.start()
        at += _BLOCK
    return 0
