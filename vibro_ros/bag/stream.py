"""A bag's messages one after the other, as bytes, whatever its size and storage."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from rosbags.rosbag2 import Reader

QOS_DEPTH = 10
"""Of a topic of which the bag does not say it."""


class BagError(Exception):
    """A recording cannot be read; the message is one line for the user."""


@dataclass(frozen=True)
class RecordedTopic:
    """What a recording holds of one topic.

    Attributes
    ----------
    type_name : str
        ROS type, such as ``nav_msgs/msg/Odometry``.
    messages : int
        Number of messages.
    qos_depth : int
        History depth that the publisher offered.
    """

    type_name: str
    messages: int
    qos_depth: int = QOS_DEPTH


class BagStream:
    """A sealed bag folder, opened for reading; a context manager.

    Parameters
    ----------
    path : str or Path
        The bag folder, of this recorder or of ``ros2 bag record``.

    Attributes
    ----------
    folder : Path
        The bag folder.
    start, end : int
        Recorded stamps [ns] of the first and the last message; 0 in an empty bag.
    metadata : dict of str to str
        The bag's custom data.
    topics : dict of str to RecordedTopic
        Every topic, by full name.

    Raises
    ------
    BagError
        When the folder is missing, no bag, not sealed or damaged; the message names path, reason and remedy.
    """

    def __init__(self, path: str | Path):
        self.folder = Path(path)
        _check_folder(self.folder)
        self._stack = ExitStack()
        try:
            self._reader = self._stack.enter_context(Reader(self.folder))
            empty = self._reader.message_count == 0
            self.start, self.end = (0, 0) if empty else (self._reader.start_time, self._reader.end_time - 1)
            self.metadata = {str(key): str(text) for key, text in (self._reader.storage.metadata.custom or {}).items()}
            self.topics = {one.topic: RecordedTopic(one.msgtype, one.msgcount, _depth(one))
                           for one in self._reader.connections}
        except Exception as error:  # rosbags' parser meets damage with whatever breaks first
            self._stack.close()
            raise self.damage(error) from error

    def __enter__(self) -> "BagStream":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def messages(self, topics: frozenset[str] | None = None) -> Iterator[tuple[str, int, bytes]]:
        """Topic, recorded stamp [ns] and serialised message of each message, in the order of recording.

        Parameters
        ----------
        topics : frozenset of str
            Which; None for all.

        Raises
        ------
        BagError
            When the bag turns out to be damaged.
        """
        chosen = [one for one in self._reader.connections if topics is None or one.topic in topics]
        if not chosen:  # rosbags takes an empty list for "all"
            return
        source = self._reader.messages(chosen)
        while True:
            try:
                connection, stamp, data = next(source)
            except StopIteration:
                return
            except Exception as error:  # as above
                raise self.damage(error) from error
            yield connection.topic, stamp, data

    def damage(self, error: Exception) -> BagError:
        """The error of a bag that breaks off with `error`."""
        reason = " ".join(str(error).split()).rstrip(".")
        return BagError(f"{self.folder}: damaged bag: {reason}; record it again")


def _depth(connection: object) -> int:
    profiles = connection.ext.offered_qos_profiles
    return profiles[0].depth if profiles else QOS_DEPTH


def _check_folder(folder: Path) -> None:
    if not folder.exists():
        raise BagError(f"{folder}: no such folder; give the folder of a recording")
    if not folder.is_dir():
        raise BagError(f"{folder}: a file, not a bag; give the folder that holds metadata.yaml")
    if (folder / "metadata.yaml").is_file():
        return
    if any(folder.glob("*.mcap")) or any(folder.glob("*.db3")):
        raise BagError(f"{folder}: the bag is not sealed: its recorder still runs, or was killed; "
                       f"end the recorder, or seal it with `recover {folder}`")
    raise BagError(f"{folder}: not a bag, it holds no metadata.yaml; give the folder of a recording")
