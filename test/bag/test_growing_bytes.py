"""What grows by small pieces comes back whole, and takes a fraction of its size in memory."""

import random

import pytest
from mcap.records import ChunkIndex

from vibro_ros.bag.growing_bytes import BLOCK, GrowingBytes
from vibro_ros.bag.mcap_contents import Contents

START = 1_795_394_366_000_000_000  # ns


@pytest.mark.parametrize("size", [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 10 * BLOCK])
def test_it_gives_back_what_it_got(size):
    chance = random.Random(size)
    growing, expected = GrowingBytes(), bytearray()
    while len(expected) < size:
        piece = chance.randbytes(min(size - len(expected), chance.randrange(1, 1000)))
        growing.append(piece)
        expected += piece
        assert len(growing) == len(expected)
    assert bytes(growing) == expected


def test_the_index_of_ten_minutes_takes_less_than_half_of_its_size():
    """A robot flushes 20 chunks a second; a chunk holds messages of eight topics."""
    contents, chance, offset = Contents(), random.Random(1), 0
    contents.counts = {channel: 0 for channel in range(1, 9)}
    for number in range(20 * 600):
        offsets = {channel: offset + 30_000 + 200 * channel + chance.randrange(20) for channel in contents.counts}
        contents.add_chunk(ChunkIndex(
            chunk_start_offset=offset, chunk_length=30_000, message_start_time=START + 50_000_000 * number,
            message_end_time=START + 45_000_000 + 50_000_000 * number, message_index_offsets=offsets,
            message_index_length=1600, compression="", compressed_size=29_000, uncompressed_size=29_000), [])
        offset += 31_600 + chance.randrange(2000)
    assert contents.chunk_indexes.kept < 0.5 * len(contents.chunk_indexes)
    assert sum(1 for _ in contents.indexes()) == contents.chunks
