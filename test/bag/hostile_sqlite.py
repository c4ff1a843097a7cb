"""Databases that another hand was in: other tables, rows and types, and journals beside them."""

import os
import sqlite3
import struct
from pathlib import Path

from hostile_files import DEEP, LAUGHS, Maker, cut, flipped, linked, noise, part
from hostile_metadata import metadata, replaced


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
