"""A sqlite3 file of a bag, opened for reading.

A database may be anything: views that compute for ever, columns that are made when they are read, pages that refer to
each other in circles. So only plain tables are read, in the order of their rows, and each row has to have a greater
number than the one before.
"""

import contextlib
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from vibro_ros.bag.mcap_records import LARGEST_RECORD
from vibro_ros.bag.metadata import LAST_STAMP, FileInformation, TopicInformation, custom_data, qos_profiles
from vibro_ros.bag.part import CDR, Message, PartContents
from vibro_ros.process.untrusted import opened

MOST_TOPICS = 10_000
"""Of a database; further ones are not read."""
LONGEST_TEXT = 50_000
"""Characters of a topic's name, type, label or hash; further ones are not read."""

JOURNALS = ("-journal", "-wal")
"""What SQLite puts behind a database's name for a transaction that is not over."""

_JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
_COLUMNS = {"topics": ("id", "name", "type", "serialization_format"), "messages": ("topic_id", "timestamp", "data")}
_OF_THE_MACHINE = (7, 10, 14)  # SQLite's codes for no memory, an error of the disk, and a file that cannot be opened
_FAR = 2**62  # greater than the number of any row that a recorder writes


class DatabaseError(ValueError):
    """A file that is no readable database of rosbag2; the message says why."""


class SqlitePart:
    """Looks through the file when it is made; see `Part`.

    Parameters
    ----------
    path : Path
        A regular file.
    name : str
        What messages call it.
    alone : bool
        Whether to read the database as it is, whatever its journal says.

    Raises
    ------
    DatabaseError
        When it is no such database, or a transaction in it is not over.
    OSError
        When it cannot be read.
    """

    is_sealed = True  # a database needs no ending
    damaged = 0

    def __init__(self, path: Path, name: str, alone: bool = False):
        for ending in () if alone else JOURNALS:
            if is_hot(path, ending):
                raise DatabaseError(f"{path.name}{ending} holds a transaction that is not over; `recover` settles it")
        self._path, self._name = path, name
        self._flaws: list[str] = []
        with self._open():
            for table, columns in _COLUMNS.items():
                self._check_table(table, columns)
            self.contents = self._contents()

    def messages(self, topics: frozenset[str]) -> Iterator[Message]:
        """Those of some topics, in the order of their rows."""
        chosen = {number: name for number, name in self._topics.items() if name in topics}
        what = f"topic_id, timestamp, CASE WHEN {_READABLE} THEN data END"
        with self._open():
            for _, number, stamp, data in self._rows(what, []) if chosen else ():
                if number in chosen and _is_stamp(stamp) and data is not None:
                    yield chosen[number], stamp, data

    @contextlib.contextmanager
    def _open(self) -> Iterator[None]:
        os.close(opened(self._path, follow=False))  # SQLite itself opens whatever it is
        self._database = sqlite3.connect(f"{self._path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
        try:
            self._database.text_factory = lambda data: data.decode(errors="replace")
            if hasattr(self._database, "setlimit"):  # from Python 3.11 on
                self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_RECORD + 2**20)
            for pragma in ("trusted_schema = OFF", "cell_size_check = ON", "mmap_size = 0"):
                self._database.execute(f"PRAGMA {pragma}")
            yield
        except (sqlite3.Error, OverflowError) as error:
            if getattr(error, "sqlite_errorcode", 0) & 0xFF in _OF_THE_MACHINE:
                raise OSError(0, str(error), str(self._path)) from error
            raise DatabaseError(f"not a readable database of rosbag2: {error}") from error
        finally:
            self._database.close()

    def _check_table(self, table: str, columns: tuple[str, ...]) -> None:
        row = self._database.execute("SELECT type, sql FROM sqlite_master WHERE name = ?", (table,)).fetchone()
        if row is None or row[0] != "table" or "virtual" in str(row[1]).lower().split()[:2]:
            raise DatabaseError(f"not a readable database of rosbag2: it has no table {table!r}")
        found = {row[1]: row[6] for row in self._database.execute(f"PRAGMA table_xinfo({table})")}
        if any(found.get(column) != 0 for column in columns):  # 0: a column that is stored, not made when it is read
            raise DatabaseError(f"not a readable database of rosbag2: its table {table!r} lacks {', '.join(columns)}")

    def _contents(self) -> PartContents:
        topics = self._read_topics()
        counts = {topic.name: 0 for topic in topics}
        first, last, ordered, bad = LAST_STAMP, 0, True, 0
        damage: list[str] = []
        for _, number, stamp, readable in self._rows(f"topic_id, timestamp, {_READABLE}", damage):
            if number not in self._topics or not _is_stamp(stamp) or not readable:
                bad += 1
                continue
            counts[self._topics[number]] += 1
            ordered &= stamp >= last
            first, last = min(first, stamp), max(last, stamp)
        if damage:
            self._flaws.append(f"{self._name}: {len(damage)} damaged places are not read, the first {damage[0]}")
        if bad:
            self._flaws.append(f"{self._name}: {bad} rows are not read: they are of no topic, without a stamp, or hold "
                               f"no bytes, or more than {LARGEST_RECORD}")
        information = FileInformation(self._name, first if any(counts.values()) else 0, last, counts)
        return PartContents(information, topics, self._custom(), ordered, self._flaws)

    def _read_topics(self) -> list[TopicInformation]:
        names = {row[1] for row in self._database.execute("PRAGMA table_xinfo(topics)") if row[6] == 0}
        columns = [f"substr({name}, 1, {LONGEST_TEXT})" if name in names else "''" for name in (
            "name", "type", "serialization_format", "offered_qos_profiles", "type_description_hash")]
        rows = self._database.execute(f"SELECT id, {', '.join(columns)} FROM topics ORDER BY rowid LIMIT {MOST_TOPICS}")
        topics: dict[str, TopicInformation] = {}
        self._topics: dict[int, str] = {}
        for number, *texts in rows:
            name, kind, encoding, qos, digest = (text if isinstance(text, str) else "" for text in texts)
            topic = TopicInformation(name, kind, qos_profiles(qos), digest, encoding)
            if not name or encoding != CDR or topics.setdefault(name, topic).type_name != kind:
                self._flaws.append(f"{self._name}: topic {name or number} is not read: it has no name, another type "
                                   "than before, or is not encoded as CDR")
            else:
                self._topics[number] = name
        return list(topics.values())

    def _rows(self, what: str, damage: list[str]) -> Iterator[tuple]:
        """Number and `what` of each message that can be read, in the order of the numbers; adds to the `damage`."""
        last: int | None = -1
        while last is not None:
            try:
                for row in self._database.execute(f"SELECT rowid, {what} FROM messages NOT INDEXED WHERE rowid > ?",
                                                  (last,)):
                    if row[0] <= last:
                        raise sqlite3.DatabaseError("its rows are not in order")
                    last = row[0]
                    yield row
                return
            except sqlite3.Error as error:
                if getattr(error, "sqlite_errorcode", 0) & 0xFF in _OF_THE_MACHINE:
                    raise
                damage.append(f"behind row {last}: {error}")
                last = self._readable_after(last)

    def _readable_after(self, last: int) -> int | None:
        """The number behind which reading can go on when it failed behind `last`; None at the end."""
        following = self._next(last + 1)
        if following is not None:  # its number can be read, its content cannot
            return following
        bad, step = last + 1, 1
        while self._next(bad + step) is None:
            bad, step = bad + step, 2 * step
            if bad > _FAR:
                return None
        good = bad + step
        while good - bad > 1:  # from `good` on, rows can be read, from `bad` on not
            middle = (good + bad) // 2
            good, bad = (middle, bad) if self._next(middle) is not None else (good, middle)
        return good - 1

    def _next(self, number: int) -> int | None:
        """The first number of a row from one on; None when there is none, or it cannot be read."""
        try:
            row = self._database.execute("SELECT rowid FROM messages NOT INDEXED WHERE rowid >= ? LIMIT 1",
                                         (number,)).fetchone()
        except sqlite3.Error:
            return None
        return row[0] if row is not None and row[0] >= number else None

    def _custom(self) -> dict[str, str]:
        try:
            self._check_table("metadata", ("metadata",))
            row = self._database.execute("SELECT metadata FROM metadata ORDER BY rowid DESC LIMIT 1").fetchone()
        except (sqlite3.Error, DatabaseError):  # databases of older ROS releases have none
            return {}
        return custom_data(row[0]) if row and isinstance(row[0], str) else {}


def is_hot(path: Path, ending: str) -> bool:
    """Whether a database's journal holds something that SQLite would write back (OSError when it cannot be read)."""
    journal = path.with_name(path.name + ending)
    if not os.path.lexists(journal):
        return False
    with open(opened(journal, follow=False), "rb") as file:
        head = file.read(len(_JOURNAL_MAGIC))
    return head == _JOURNAL_MAGIC if ending == "-journal" else bool(head)


_READABLE = f"typeof(data) = 'blob' AND length(data) <= {LARGEST_RECORD}"


def _is_stamp(value: object) -> bool:
    return isinstance(value, int) and 0 <= value <= LAST_STAMP
