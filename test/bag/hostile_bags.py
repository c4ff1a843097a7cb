"""Bags that another hand was in: each makes one of a good bag, in place."""

import os
import random
import sqlite3
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import lz4.frame
from mcap.records import Channel, Chunk, Message, Schema
from rosbags.rosbag2.storage_mcap import zstd

from vibro_ros.bag.mcap_records import HEAD, MAGIC, packed

Maker = Callable[[Path], None]
"""Changes the bag folder that it is given; `folder.parent / "outside"` has files that nobody may change."""

LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{two}: &{two} [{', '.join(['*' + one] * 9)}]\n" for one, two in zip("abcdefg", "bcdefgh", strict=True))


def part(folder: Path) -> Path:
    """The bag's (first) file."""
    return sorted(file for file in folder.iterdir() if file.suffix in (".mcap", ".db3"))[0]


def edited(edit: Callable[[bytearray], bytes | bytearray | None]) -> Maker:
    """Change the bytes of the bag's file."""
    def make(folder: Path) -> None:
        data = bytearray(part(folder).read_bytes())
        part(folder).write_bytes(edit(data) or data)
    return make


def flipped(seed: int, name: str = "") -> Maker:
    """Flip one bit somewhere, in the file or in `name`."""
    def make(folder: Path) -> None:
        path = folder / name if name else part(folder)
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


def without_metadata(then: Maker) -> Maker:
    """As a killed recorder leaves it, and then something else."""
    def make(folder: Path) -> None:
        (folder / "metadata.yaml").unlink()
        then(folder)
    return make


def torn(then: Maker) -> Maker:
    """The file lacks its last 100 bytes, and then something else."""
    def make(folder: Path) -> None:
        os.truncate(part(folder), part(folder).stat().st_size - 100)
        then(folder)
    return make


def linked(name: str, target: str) -> Maker:
    """A symbolic link in the place of a file, or beside."""
    def make(folder: Path) -> None:
        path = part(folder) if name == "part" else folder / name
        path.unlink(missing_ok=True)
        path.symlink_to(str(folder.parent / "outside" / target) if "/" not in target else target)
    return make


def piped(name: str) -> Maker:
    """A named pipe in the place of a file."""
    def make(folder: Path) -> None:
        path = part(folder) if name == "part" else folder / name
        path.unlink(missing_ok=True)
        os.mkfifo(path)
    return make


def hard_linked(folder: Path) -> None:
    """The file has another name outside."""
    os.link(part(folder), folder.parent / "outside" / "same")


def foldered(name: str) -> Maker:
    """A folder in the place of a file."""
    def make(folder: Path) -> None:
        path = part(folder) if name == "part" else folder / name
        path.unlink(missing_ok=True)
        (path / "x").mkdir(parents=True)
    return make


def sql(*statements: str) -> Maker:
    """Run statements on the database."""
    def make(folder: Path) -> None:
        database = sqlite3.connect(part(folder), isolation_level=None)
        for statement in statements:
            database.execute(statement)
        database.close()
    return make


def journal(data: bytes, ending: str = "-journal") -> Maker:
    """Put a journal beside the database."""
    return lambda folder: part(folder).with_name(part(folder).name + ending).write_bytes(data) and None


MAGIC_OF_JOURNAL = bytes.fromhex("d9d505f920a163d7")


def journal_head(pages: int, page_size: int = 4096, records: int = 0) -> bytes:
    """The head of a hot journal that says how long the database was."""
    return (MAGIC_OF_JOURNAL + struct.pack(">IIIII", records, 1, pages, 512, page_size)).ljust(512, b"\0")


def super_journal(folder: Path) -> None:
    """A journal that names a file outside, which SQLite would delete."""
    name = str(folder.parent / "outside" / "precious").encode()
    end = struct.pack(">I", 0x40000001) + name + struct.pack(">II", len(name), sum(name)) + MAGIC_OF_JOURNAL
    journal(journal_head(1) + end)(folder)


_RECURSIVE = ("WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
              "SELECT i AS id, 1 AS topic_id, i AS timestamp, zeroblob(1000000) AS data FROM n")
DEEP = "[" * 100_000
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
OF_METADATA: dict[str, Maker] = {
    **{f"metadata flip {seed}": flipped(seed, "metadata.yaml") for seed in range(16)},
    "metadata of laughs": metadata(LAUGHS),
    "metadata of depth": metadata(DEEP),
    "metadata in themselves": metadata("rosbag2_bagfile_information: &x {version: 9, custom_data: *x}"),
    "metadata of many keys": metadata("".join(f"k{i}: 1\n" for i in range(60_000))),
    "metadata of dates": metadata("rosbag2_bagfile_information: {version: 2001-99-99}"),
    "metadata of maybe": metadata("rosbag2_bagfile_information: !!bool maybe"),
    "metadata of bytes": metadata(b"\xff\xfe" * 1000),
    "metadata of NUL": metadata(b"\0" * 1000),
    "metadata of UTF-16": metadata("a: 1".encode("utf-16")),
    "metadata of size": metadata(b"#" * 2**24),
    "empty metadata": metadata(b""),
    "version 99": replaced("version: 9", "version: 99"),
    "version of text": replaced("version: 9", "version: nine"),
    "names passwd": replaced("- run_0", "- ../../etc/passwd\n  - run_0"),
    "names only passwd": lambda folder: replaced(f"- {part(folder).name}", "- ../../etc/passwd")(folder),
    "names nothing": lambda folder: replaced(f"- {part(folder).name}", "[]")(folder),
    "names it twice": lambda folder: replaced(f"- {part(folder).name}",
                                              f"- {part(folder).name}\n  - {part(folder).name}")(folder),
    "names zero": lambda folder: replaced(f"- {part(folder).name}", "- /dev/zero")(folder),
    "names a number": lambda folder: replaced(f"- {part(folder).name}", "- 5")(folder),
    "wrong count": replaced("message_count: ", "message_count: 9"),
    "negative duration": replaced("nanoseconds: ", "nanoseconds: -"),
    "no duration": replaced("nanoseconds: ", "nanoseconds: .nan #"),
    "compressed": replaced("compression_mode: ''", "compression_mode: message"),
    "parameters of depth": custom("parameters", f"'{'[' * 50_000}'"),
    "parameters of numbers": custom("parameters", "'5'"),
    "parameters of lists": custom("parameters", "'{\"guide.angle\": [1, {}], \"rate.publish\": null}'"),
    "parameters of digits": custom("parameters", f"'{{\"guide.angle\": {'9' * 5000}}}'"),
    "a late start": custom("start", f"'{'9' * 4000}'"),
    "a start of text": custom("start", "'now\x1b[31m'") and custom("start", "now"),
    "topics of depth": custom("topics", f"'{'[' * 50_000}'"),
    "topics of another": custom("topics", "'{\"odom\": \"/motor_power\"}'"),
    "topics of numbers": custom("topics", "'{\"odom\": 5}'"),
    "a scene of lines": custom("scene", '"a\\nb\\e[31m"'),
    "link to metadata": linked("metadata.yaml", "precious"),
    "link to zero as metadata": linked("metadata.yaml", "/dev/zero"),
    "pipe as metadata": piped("metadata.yaml"),
    "folder as metadata": foldered("metadata.yaml"),
    "link as part": linked("part", "precious"),
    "link to zero as part": linked("part", "/dev/zero"),
    "pipe as part": piped("part"),
    "folder as part": foldered("part"),
    "pipe as another part": piped("run_1.mcap"),
    "link as temporary file": without_metadata(linked("metadata.yaml.tmp", "precious")),
    "link as torn": without_metadata(torn(linked("run_0.mcap.torn", "precious"))),
    "link as reserve": without_metadata(linked(".reserve", "precious")),
    "another name outside": without_metadata(torn(hard_linked)),
}
OF_SQLITE: dict[str, Maker] = {
    **{f"flip {seed}": flipped(seed) for seed in range(16)},
    **{f"noise {seed}": noise(seed, 4096) for seed in range(10)},
    **{f"cut {seed}": cut(seed) for seed in range(6)},
    "a view for ever": sql("DROP TABLE messages", f"CREATE VIEW messages AS {_RECURSIVE}"),
    "a view of topics": sql("ALTER TABLE topics RENAME TO t", "CREATE VIEW topics AS SELECT * FROM t"),
    "a virtual table": sql("DROP TABLE messages",
                           "CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)"),
    "a column that is made": sql(
        "DROP TABLE messages", "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL)",
        "INSERT INTO messages(topic_id, timestamp) VALUES (1, 1)"),
    "no messages": sql("DROP TABLE messages"),
    "no topics": sql("DELETE FROM topics"),
    "text as data": sql("UPDATE messages SET data = 'text' WHERE id % 3 = 0"),
    "nothing as data": sql("DROP TABLE messages", "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, "
                           "data)", "INSERT INTO messages VALUES (1, 1, 1, NULL), (2, 'x', 'y', 'z'), (3, 1, -5, 1.5)"),
    "stamps of text": sql("UPDATE messages SET timestamp = 'now' WHERE id % 7 = 0"),
    "stamps before time": sql("UPDATE messages SET timestamp = -timestamp WHERE id % 7 = 0"),
    "rows without numbers": sql("DROP TABLE messages", "CREATE TABLE messages(topic_id, timestamp, data, "
                                "PRIMARY KEY(topic_id, timestamp)) WITHOUT ROWID"),
    "a trigger": sql("CREATE TRIGGER t AFTER INSERT ON metadata BEGIN DELETE FROM messages; END"),
    "a huge row": sql("INSERT INTO messages VALUES (99999999, 1, 1, zeroblob(200000000))"),
    "a far row": sql(f"INSERT INTO messages VALUES ({2**63 - 1}, 1, 1763700009000000000, zeroblob(12))"),
    "names of bytes": sql("UPDATE topics SET name = CAST(x'ff00fe' AS TEXT) WHERE id = 1"),
    "labels of laughs": lambda folder: sql(f"UPDATE topics SET offered_qos_profiles = '{LAUGHS}'")(folder),
    "labels of depth": sql(f"UPDATE topics SET offered_qos_profiles = '{DEEP}'"),
    "metadata of bytes": sql("UPDATE metadata SET metadata = x'ff00'"),
    "journal of noise": journal(os.urandom(5000)),
    "journal without pages": journal(journal_head(0)),
    "journal of one page": journal(journal_head(1)),
    "journal of a huge database": journal(journal_head(2**31)),
    "journal that names another": super_journal,
    "journal that is a pipe": lambda folder: os.mkfifo(f"{part(folder)}-journal"),
    "journal that is a link": lambda folder: os.symlink("../outside/precious", f"{part(folder)}-journal"),
    "write-ahead log of noise": journal(os.urandom(5000), "-wal"),
    "text": lambda folder: part(folder).write_bytes(b"text" * 1000) and None,
    "names passwd": replaced("- run_0", "- ../../etc/passwd\n  - run_0"),
    "metadata of depth": metadata(DEEP),
    "link as part": linked("part", "precious"),
}
