"""Changes that turn a good bag into a hostile one, in place."""

import os
import random
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import lz4.frame
import zstandard
from mcap.records import Channel, Chunk, McapRecord, Message, Schema

from vibro_ros.bag.mcap_file import MAGIC
from vibro_ros.bag.mcap_writer import record_bytes

HEAD = struct.Struct("<BQ")  # of a record: opcode, length of the content

Maker = Callable[[Path], None]
"""Changes the bag folder that it is given; `folder.parent / "outside"` has files that nobody may change."""

LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{following}: &{following} [{', '.join(['*' + anchor] * 9)}]\n"
    for anchor, following in zip("abcdefg", "bcdefgh", strict=True))
DEEP = "[" * 100_000


def first_file(folder: Path) -> Path:
    """Return the first MCAP file of a bag."""
    return sorted(folder.glob("*.mcap"))[0]


def edited(edit: Callable[[bytearray], bytes | bytearray | None]) -> Maker:
    """Change the bytes of the bag's file."""
    def make(folder: Path) -> None:
        data = bytearray(first_file(folder).read_bytes())
        first_file(folder).write_bytes(edit(data) or data)
    return make


def flipped(seed: int, name: str = "") -> Maker:
    """Flip one bit somewhere, in the file or in `name`."""
    def make(folder: Path) -> None:
        path = folder / name if name else first_file(folder)
        data = bytearray(path.read_bytes())
        data[random.Random(seed).randrange(len(data))] ^= 1 << random.Random(seed + 1).randrange(8)
        path.write_bytes(data)
    return make


def noise(seed: int, size: int) -> Maker:
    """Overwrite a stretch with random bytes."""
    def edit(data: bytearray) -> None:
        at = random.Random(seed).randrange(len(data) - size)
        data[at:at + size] = random.Random(seed).randbytes(size)
    return edited(edit)


def cut(seed: int) -> Maker:
    """End the file early."""
    return edited(lambda data: data[:random.Random(seed).randrange(1, len(data))])


def without_metadata(change: Maker) -> Maker:
    """Remove metadata.yaml, as in the bag of a killed recorder, and then apply another change."""
    def make(folder: Path) -> None:
        (folder / "metadata.yaml").unlink()
        change(folder)
    return make


def torn(change: Maker) -> Maker:
    """Cut the last 100 bytes off the file, and then apply another change."""
    def make(folder: Path) -> None:
        os.truncate(first_file(folder), first_file(folder).stat().st_size - 100)
        change(folder)
    return make


def linked(name: str, target: str) -> Maker:
    """Put a symbolic link in the place of a file, or beside it."""
    def make(folder: Path) -> None:
        path = first_file(folder) if name == "part" else folder / name
        path.unlink(missing_ok=True)
        path.symlink_to(str(folder.parent / "outside" / target) if "/" not in target else target)
    return make


def wrong_length(seed: int, value: int) -> Maker:
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
    """Copy some records to another place, which may be in the middle of a record."""
    def edit(data: bytearray) -> bytes:
        chance = random.Random(seed)
        heads = list(_heads(data))
        begin, end = sorted(chance.sample(heads, 2))
        at = chance.choice([chance.choice(heads), chance.randrange(len(data))])
        return bytes(data[:at] + data[begin:end] + data[at:])
    return edited(edit)


def behind_header(*records: McapRecord | bytes) -> Maker:
    """Put records right behind the header."""
    inserted = b"".join(record if isinstance(record, bytes) else record_bytes(record) for record in records)
    return edited(lambda data: data[:(at := list(_heads(data))[1])] + inserted + data[at:])


def chunk(compression: str, data: bytes, size: int, crc: int = 0) -> Chunk:
    """Return a chunk that states an uncompressed size of `size` bytes."""
    return Chunk(compression=compression, data=data, message_start_time=0, message_end_time=0, uncompressed_crc=crc,
                 uncompressed_size=size)


def zeros(size: int) -> bytes:
    """Return `size` zeros compressed by zstd, without ever allocating them."""
    packer = zstandard.ZstdCompressor().compressobj()
    return b"".join([*(packer.compress(bytes(2**20)) for _ in range(size // 2**20)), packer.flush()])


def tiny_messages(count: int) -> bytes:
    """Return the content of a chunk with many messages without data on channel 1."""
    return record_bytes(Message(channel_id=1, log_time=5, publish_time=5, sequence=0, data=b"")) * count


def labelled(text: str) -> tuple[Schema, Channel]:
    """Return a topic whose QoS label is `text`."""
    return Schema(id=99, data=b"float64 data", encoding="ros2msg", name="std_msgs/msg/Float64"), Channel(
        id=99, topic="/x", message_encoding="cdr", schema_id=99, metadata={"offered_qos_profiles": text})


def custom(key: str, value: str) -> Maker:
    """Replace a value of the custom data in metadata.yaml."""
    def make(folder: Path) -> None:
        lines = (folder / "metadata.yaml").read_text().splitlines()
        at = next(i for i, line in enumerate(lines) if line.startswith(f"    {key}:"))
        end = next(i for i in range(at + 1, len(lines)) if not lines[i].startswith("      "))
        (folder / "metadata.yaml").write_text("\n".join([*lines[:at], f"    {key}: {value}", *lines[end:]]) + "\n")
    return make


def metadata(text: str | bytes) -> Maker:
    """Replace metadata.yaml."""
    data = text if isinstance(text, bytes) else text.encode()
    return lambda folder: (folder / "metadata.yaml").write_bytes(data) and None


def replaced(old: str, new: str) -> Maker:
    """Replace text in metadata.yaml."""
    def make(folder: Path) -> None:
        text = (folder / "metadata.yaml").read_text()
        assert old in text
        (folder / "metadata.yaml").write_text(text.replace(old, new, 1))
    return make


def piped(name: str) -> Maker:
    """Put a named pipe in the place of a file."""
    def make(folder: Path) -> None:
        path = first_file(folder) if name == "part" else folder / name
        path.unlink(missing_ok=True)
        os.mkfifo(path)
    return make


def hard_linked(folder: Path) -> None:
    """Give the file a second name outside of the bag."""
    os.link(first_file(folder), folder.parent / "outside" / "same")


OF_MCAP: dict[str, Maker] = {
    **{f"flip {seed}": flipped(seed) for seed in range(4)},
    "noise": noise(9, 568),
    **{f"cut {seed}": cut(seed) for seed in range(2)},
    **{f"killed, cut {seed}": without_metadata(cut(seed)) for seed in (20, 21)},
    "killed, flip": without_metadata(torn(flipped(50))),
    **{f"spliced {seed}": spliced(seed) for seed in (1, 2)},
    **{f"length {value:x}": wrong_length(seed, value) for seed, value in enumerate((0, 50, 2**40, 2**64 - 1))},
    "bomb": behind_header(chunk("zstd", zeros(2**30), 2**30)),
    "bomb that lies": behind_header(chunk("zstd", zeros(2**30), 1000)),
    "many bombs": behind_header(*[chunk("zstd", zeros(100 * 2**20), 100 * 2**20)] * 200),
    "bomb of messages": behind_header(chunk("zstd", zstandard.compress(tiny_messages(50_000)), 31 * 50_000)),
    "bomb of lz4": behind_header(chunk("lz4", lz4.frame.compress(bytes(2**28)), 2**28)),
    "a size of 2^63": behind_header(chunk("", b"", 2**63)),
    "unknown compression": behind_header(chunk("bz2", b"x" * 100, 100)),
    "many bad records": behind_header((b"\4\1" + bytes(8)) * 20_000),
    "twice": edited(lambda data: data + data),
    "zeros at the end": edited(lambda data: data + bytes(100_000)),
    "empty": lambda folder: first_file(folder).write_bytes(b"") and None,
    "magic": edited(lambda data: MAGIC),
    "label of laughs": behind_header(*labelled(LAUGHS)),
    "label of numbers": behind_header(*labelled("[1, {depth: [1]}, {depth: -1}]")),
}

OF_METADATA: dict[str, Maker] = {
    "metadata flip": flipped(0, "metadata.yaml"),
    "metadata of laughs": metadata(LAUGHS),
    "version of text": replaced("version: 9", "version: nine"),
    "names passwd": replaced("- run_0", "- ../../etc/passwd\n  - run_0"),
    "names nothing": replaced("- run_0.mcap", "[]"),
    "names it twice": replaced("- run_0.mcap", "- run_0.mcap\n  - run_0.mcap"),
    "names a number": replaced("- run_0.mcap", "- 5"),
    "wrong count": replaced("message_count: ", "message_count: 9"),
    "compressed": replaced("compression_mode: ''", "compression_mode: message"),
    "parameters of depth": custom("parameters", f"'{'[' * 50_000}'"),
    "parameters of numbers": custom("parameters", "'5'"),
    "parameters of lists": custom("parameters", "'{\"guide.angle\": [1, {}], \"rate.publish\": null}'"),
    "parameters of digits": custom("parameters", f"'{{\"guide.angle\": {'9' * 5000}}}'"),
    "a late start": custom("start", f"'{'9' * 4000}'"),
    "topics of depth": custom("topics", f"'{'[' * 50_000}'"),
    "topics of another": custom("topics", "'{\"odom\": \"/motor_power\"}'"),
    "a scene of lines": custom("scene", '"a\\nb\\e[31m"'),
    "link to zero as metadata": linked("metadata.yaml", "/dev/zero"),
    "pipe as metadata": piped("metadata.yaml"),
    "part as link": linked("part", "precious"),
    "pipe as part": piped("part"),
    **{f"link as {name}": without_metadata(torn(linked(name, "precious"))) for name in (
        "run_0.mcap.torn", "metadata.yaml.tmp", "metadata.yaml", "run_1.mcap")},
    "another name outside": without_metadata(torn(hard_linked)),
}
