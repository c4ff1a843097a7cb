"""What a sqlite3 file of a bag holds."""

import sqlite3
from pathlib import Path

from vibro_ros.bag.metadata import FileInformation, TopicInformation, custom_data, qos_profiles


def scan_sqlite(path: Path) -> tuple[FileInformation, list[TopicInformation], dict[str, str]]:
    """Times and messages by topic, topics, and custom data of one file.

    Opening it for writing rolls back what a killed recorder had not committed.

    Raises
    ------
    sqlite3.Error
        When it is no such database, or damaged.
    """
    database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=rw", uri=True)
    try:
        database.execute("BEGIN IMMEDIATE")  # rolls a hot journal back
        database.rollback()
        rows = database.execute(f"SELECT id, {', '.join(_columns(database))} FROM topics ORDER BY id").fetchall()
        counts = dict(database.execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"))
        first, last = database.execute("SELECT MIN(timestamp), MAX(timestamp) FROM messages").fetchone()
        topics = [TopicInformation(name, kind, qos_profiles(qos), digest, encoding)
                  for _, name, kind, encoding, qos, digest in rows]
        by_name = {name: counts.get(number, 0) for number, name, *_ in rows}
        return FileInformation(path.name, first or 0, last or 0, by_name), topics, _custom(database)
    finally:
        database.close()


def _columns(database: sqlite3.Connection) -> list[str]:
    """What to ask of a topic; databases of older ROS releases lack the last two."""
    found = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    optional = [name if name in found else "''" for name in ("offered_qos_profiles", "type_description_hash")]
    return ["name", "type", "serialization_format", *optional]


def _custom(database: sqlite3.Connection) -> dict[str, str]:
    try:
        row = database.execute("SELECT metadata FROM metadata ORDER BY id DESC LIMIT 1").fetchone()
    except sqlite3.OperationalError:  # no such table
        return {}
    return custom_data(row[0]) if row else {}
