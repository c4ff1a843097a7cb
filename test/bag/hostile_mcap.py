"""MCAP files that another hand was in: records that lie, repeat, unfold without end or carry hostile labels."""

import random
import struct
from collections.abc import Iterator

import lz4.frame
from hostile_files import DEEP, LAUGHS, Maker, cut, edited, flipped, noise, part, torn, without_metadata
from mcap.records import Channel, Chunk, Message, Schema
from rosbags.rosbag2.storage_mcap import zstd

from vibro_ros.bag.mcap_records import HEAD, MAGIC, packed


def lying_length(seed: int, value: int) -> Maker:
    """Give a record another length than it has."""
    def edit(data: bytearray) -> None:
        heads = list(_heads(data))
        at = heads[random.Random(seed).randrange(len(heads))]
        data[at + 1:at + 9] = struct.pack("<Q", value)
    return edited(edit)


def _heads(data: bytes) -> Iterator[int]:
    at = len(MAGIC)
    while at + HEAD.size <= len(data) - len(MAGIC):
        yield at
        at += HEAD.size + HEAD.unpack_from(data, at)[1]


def spliced(seed: int) -> Maker:
    """Copy some records to another place, which may be amid a record."""
    def edit(data: bytearray) -> bytes:
        chance = random.Random(seed)
        heads = list(_heads(data))
        begin, end = sorted(chance.sample(heads, 2))
        at = chance.choice([chance.choice(heads), chance.randrange(len(data))])
        return bytes(data[:at] + data[begin:end] + data[at:])
    return edited(edit)


def appended_chunk(chunk: Chunk) -> Maker:
    """Put a chunk right behind the header."""
    def edit(data: bytearray) -> bytes:
        at = list(_heads(data))[1]
        return bytes(data[:at]) + packed(chunk) + bytes(data[at:])
    return edited(edit)


def chunk(compression: str, data: bytes, size: int, crc: int = 0) -> Chunk:
    """A chunk that says that it unfolds to `size` bytes."""
    return Chunk(compression=compression, data=data, message_start_time=0, message_end_time=0, uncompressed_crc=crc,
                 uncompressed_size=size)


def zeros(size: int) -> bytes:
    """So many zeros, packed by zstd, without ever being there."""
    packer = zstd.ZstdCompressor()
    return b"".join([*(packer.compress(bytes(2**20)) for _ in range(size // 2**20)), packer.flush()])


def tiny_messages(count: int) -> bytes:
    """A chunk's content: many messages without data on channel 1."""
    return packed(Message(channel_id=1, log_time=5, publish_time=5, sequence=0, data=b"")) * count


def label(text: str) -> Maker:
    """Announce a topic whose QoS label is `text`."""
    def edit(data: bytearray) -> bytes:
        at = list(_heads(data))[1]
        records = packed(Schema(id=99, data=b"float64 data", encoding="ros2msg", name="std_msgs/msg/Float64"), Channel(
            id=99, topic="/x", message_encoding="cdr", schema_id=99, metadata={"offered_qos_profiles": text}))
        return bytes(data[:at]) + records + bytes(data[at:])
    return edited(edit)


OF_MCAP: dict[str, Maker] = {
    **{f"flip {seed}": flipped(seed) for seed in range(40)},
    **{f"noise {seed}": noise(seed, 1 + 7 * seed ** 2) for seed in range(12)},
    **{f"cut {seed}": cut(seed) for seed in range(12)},
    **{f"killed, cut {seed}": without_metadata(cut(seed)) for seed in range(20, 30)},
    **{f"killed, flip {seed}": without_metadata(torn(flipped(seed))) for seed in range(50, 60)},
    **{f"spliced {seed}": spliced(seed) for seed in range(14)},
    **{f"length {value:x} {seed}": lying_length(seed, value) for seed, value in enumerate(
        (0, 1, 2**31, 2**63, 2**64 - 1, 50, 10_000, 2**40))},
    "bomb": appended_chunk(chunk("zstd", zeros(2**30), 2**30)),
    "bomb that lies": appended_chunk(chunk("zstd", zeros(2**30), 1000)),
    "many bombs": edited(lambda data: bytes(data[:list(_heads(data))[1]]) + packed(chunk(
        "zstd", zeros(100 * 2**20), 100 * 2**20)) * 200 + bytes(data[list(_heads(data))[1]:])),
    "bomb of messages": appended_chunk(chunk("zstd", zstd.compress(tiny_messages(2_000_000)), 31 * 2_000_000)),
    "bomb of lz4": appended_chunk(chunk("lz4", lz4.frame.compress(bytes(2**28)), 2**28)),
    "a size of 2^63": appended_chunk(chunk("", b"", 2**63)),
    "unknown compression": appended_chunk(chunk("bz2", b"x" * 100, 100)),
    "twice": edited(lambda data: data + data),
    "zeros at the end": edited(lambda data: data + bytes(100_000)),
    "zeros": edited(lambda data: bytes(len(data))),
    "empty": edited(lambda data: bytearray()) and (lambda folder: part(folder).write_bytes(b"") and None),
    "magic": edited(lambda data: MAGIC),
    "label of laughs": label(LAUGHS),
    "label of depth": label(DEEP),
    "label of nothing": label("!!bool maybe"),
    "label of numbers": label("[1, {depth: [1]}, {depth: -1}]"),
    "killed, label of laughs": without_metadata(torn(label(LAUGHS))),
}
