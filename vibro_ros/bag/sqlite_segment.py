"""One sqlite3 file of a bag while it is written: transactions are committed by `flush`."""

import sqlite3
from collections.abc import Sequence
from pathlib import Path

from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from vibro_ros.bag.definitions import Definition
from vibro_ros.bag.identity import check_in_place, identity_of
from vibro_ros.bag.metadata import BAG_VERSION, FileInformation, as_text

_LONGEST_WAIT = 1.0  # s, for another process that reads the file


class SqliteSegment:
    """Writes one sqlite3 file, in the tables of rosbag2; as `McapSegment`, without compression.

    Every error of the database is an OSError.
    """

    SUFFIX = ".db3"

    def __init__(self, path: Path, definitions: Sequence[Definition], metadata: str, compression: str):
        if compression != "none":
            raise ValueError(f"sqlite3 files know no compression {compression!r}; give none, or record mcap")
        self.path = path
        self._topics = [definition.information.name for definition in definitions]
        self._counts = dict.fromkeys(range(1, len(definitions) + 1), 0)
        self._first, self._last = 2**63 - 1, 0
        self._pending: dict[int, int] = {}
        self._pending_first, self._pending_last = self._first, self._last
        path.touch(exist_ok=False)
        self.identity = identity_of(path.stat())
        self._database = sqlite3.connect(path, timeout=_LONGEST_WAIT, check_same_thread=False)  # one thread at a time
        try:
            self._database.executescript(f"BEGIN; {Sqlite3Writer.SQLITE_SCHEMA} COMMIT;")
            self._announce(definitions)
            self._put_metadata(metadata)
        except sqlite3.Error as error:
            self._database.close()
            path.unlink(missing_ok=True)
            raise _as_os_error(error) from error

    def write(self, topic: int, stamp: int, data: bytes) -> None:
        """Take a message (OSError when the database fails)."""
        self._execute("INSERT INTO messages (topic_id, timestamp, data) VALUES(?, ?, ?)", (topic, stamp, data))
        self._pending[topic] = self._pending.get(topic, 0) + 1
        self._pending_first = min(self._pending_first, stamp)
        self._pending_last = max(self._pending_last, stamp)

    def flush(self) -> None:
        """Commit (OSError when the disk is full, or the file is no longer where it was made)."""
        self._commit()
        check_in_place(self.path, self.identity)
        for topic, count in self._pending.items():
            self._counts[topic] += count
        self._pending.clear()
        self._first, self._last = self._pending_first, self._pending_last

    @property
    def stored(self) -> int:
        """Number of messages committed."""
        return sum(self._counts.values())

    @property
    def size(self) -> int:
        """Bytes of the database, with what is not committed yet."""
        ((pages,),) = self._execute("PRAGMA page_count")
        ((page_size,),) = self._execute("PRAGMA page_size")
        return pages * page_size + self.ending_size

    @property
    def ending_size(self) -> int:
        """Bytes that sealing will take, about."""
        return 16384

    @property
    def information(self) -> FileInformation:
        """What is stored, for metadata.yaml."""
        counts = {self._topics[topic - 1]: count for topic, count in self._counts.items()}
        return FileInformation(self.path.name, self._first if self.stored else 0, self._last, counts)

    def describe(self, metadata: str) -> None:
        """Say this of the bag from now on (OSError when the database fails)."""
        try:
            self._put_metadata(metadata)
        except sqlite3.Error as error:
            raise _as_os_error(error) from error

    def seal(self, metadata: str) -> None:
        """Write the metadata and close; messages that were not flushed are lost."""
        check_in_place(self.path, self.identity)
        try:
            self._database.rollback()
            self._put_metadata(metadata)
            self._database.close()
        except sqlite3.Error as error:
            raise _as_os_error(error) from error

    def abandon(self) -> None:
        """Close without sealing; `recover` can do that later."""
        self._database.close()

    def _announce(self, definitions: Sequence[Definition]) -> None:
        types = {one.information.type_name: one for one in definitions}
        self._database.executemany(
            "INSERT INTO message_definitions (topic_type, encoding, encoded_message_definition, type_description_hash)"
            " VALUES(?, 'ros2msg', ?, ?)",
            [(name, one.text, one.information.type_hash) for name, one in types.items()])
        self._database.executemany(
            "INSERT INTO topics VALUES(?, ?, ?, ?, ?, ?)",
            [(number, topic.name, topic.type_name, topic.encoding, as_text(topic.qos).strip(), topic.type_hash)
             for number, topic in enumerate((one.information for one in definitions), start=1)])

    def _put_metadata(self, text: str) -> None:
        """Replace the metadata and commit."""
        self._database.execute("DELETE FROM metadata")
        self._database.execute("INSERT INTO metadata(metadata_version, metadata) VALUES(?, ?)", (BAG_VERSION, text))
        self._database.commit()

    def _execute(self, statement: str, values: tuple = ()) -> sqlite3.Cursor:
        try:
            return self._database.execute(statement, values)
        except sqlite3.Error as error:
            raise _as_os_error(error) from error

    def _commit(self) -> None:
        try:
            self._database.commit()
        except sqlite3.Error as error:
            raise _as_os_error(error) from error


def _as_os_error(error: sqlite3.Error) -> OSError:
    """The database's error in the words that a disk's error would have."""
    return OSError(0, str(error))
