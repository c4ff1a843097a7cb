"""Read a recording into numpy arrays, topic by topic.

Arrays of each message type; ``time`` is the recorded stamp [s] after the bag's first message
(`Bag.start_ns`), shape (n,), ascending; ``stamp`` is the header's stamp on the same scale [s]:

================================  ==========================================================
std_msgs/msg/Float64              ``time``, ``value`` (the topic's own unit)
nav_msgs/msg/Odometry             ``time``, ``stamp``, ``position`` [m] shape (n, 3), ``orientation``
                                  (quaternion x, y, z, w) shape (n, 4), ``linear_velocity`` [m/s]
                                  and ``angular_velocity`` [rad/s] shape (n, 3)
geometry_msgs/msg/WrenchStamped   ``time``, ``stamp``, ``frame`` (text, shape (n,)), ``force`` [N] and
                                  ``torque`` [N m] shape (n, 3)
sensor_msgs/msg/JointState        ``time``, ``stamp`` and, for each joint, ``<joint>.position``
                                  [m or rad], ``<joint>.velocity`` [m/s or rad/s],
                                  ``<joint>.effort`` [N or N m], shape (n,)
================================  ==========================================================

Topics of other types are counted, not read.
"""

from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, ReaderError

from vibro_ros.bag.storage import jazzy_types

Arrays = dict[str, np.ndarray]


class BagError(Exception):
    """A recording cannot be read; the message is one line for the user."""


class MissingTopicError(BagError, KeyError):
    """A recording lacks a topic."""

    __str__ = Exception.__str__  # KeyError would quote the sentence


@dataclass(frozen=True)
class RecordedTopic:
    """What a recording holds of one topic.

    Attributes
    ----------
    type_name : str
        ROS type, such as ``nav_msgs/msg/Odometry``.
    messages : int
        Number of messages.
    """

    type_name: str
    messages: int


@dataclass(frozen=True, eq=False)
class Bag(Mapping[str, Arrays]):
    """A recording in memory: ``bag["odom"]["position"]``.

    A topic is found by its full name (``/robot1/odom``), or by its last part (``odom``) when only
    one topic ends so.

    Attributes
    ----------
    path : Path
        The bag folder.
    start_ns : int
        Recorded stamp of the first message, ROS time [ns]; 0 in an empty bag.
    duration : float
        From the first message to the last [s].
    metadata : dict of str to str
        What the recorder said about itself (the bag's custom data).
    topics : dict of str to RecordedTopic
        Every topic, those of other types included, by full name.
    arrays : dict of str to dict of str to ndarray
        The module's table, by full name.
    """

    path: Path
    start_ns: int
    duration: float
    metadata: dict[str, str]
    topics: dict[str, RecordedTopic]
    arrays: dict[str, Arrays]

    def __getitem__(self, name: str) -> Arrays:
        return self.arrays[self.full_name(name)]

    def __iter__(self) -> Iterator[str]:
        return iter(self.arrays)

    def __len__(self) -> int:
        return len(self.arrays)

    def full_name(self, name: str) -> str:
        """Full name of the topic called `name`.

        Raises
        ------
        MissingTopicError
            When no topic, or more than one, is called so.
        """
        found = [topic for topic in self.arrays if name in (topic, topic.rpartition("/")[2])]
        if len(found) > 1:
            raise MissingTopicError(f"{self.path}: {name} is ambiguous; give one of {', '.join(found)}")
        if not found:
            recorded = ", ".join(self.topics) or "none"
            raise MissingTopicError(f"{self.path}: topic {name} is missing; recorded topics: {recorded}")
        return found[0]


def read_bag(path: str | Path) -> Bag:
    """Read a bag folder, of this recorder or of ``ros2 bag record``, message by message.

    Parameters
    ----------
    path : str or Path
        The bag folder.

    Raises
    ------
    BagError
        When the folder is missing, no bag, not sealed or damaged; the message names path, reason
        and remedy.
    """
    folder = Path(path)
    _check_folder(folder)
    try:
        with Reader(folder) as reader:
            return _read(folder, reader)
    except (ReaderError, OSError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise BagError(f"{folder}: damaged bag: {reason}; record it again") from error


def _check_folder(folder: Path) -> None:
    if not folder.exists():
        raise BagError(f"{folder}: no such folder; give the folder of a recording")
    if not folder.is_dir():
        raise BagError(f"{folder}: a file, not a bag; give the folder that holds metadata.yaml")
    if (folder / "metadata.yaml").is_file():
        return
    if any(folder.glob("*.mcap")):
        raise BagError(f"{folder}: the bag is not sealed: its recorder still runs, or was killed; "
                       "end the recorder, or record again")
    raise BagError(f"{folder}: not a bag, it holds no metadata.yaml; give the folder of a recording")


def _read(folder: Path, reader: Reader) -> Bag:
    empty = reader.message_count == 0
    start = 0 if empty else reader.start_time
    series = {connection.topic: _Series(connection, start)
              for connection in reader.connections if connection.msgtype in _LAYOUTS}
    readable = [connection for connection in reader.connections if connection.topic in series]
    if readable:  # rosbags takes an empty list for "all"
        for connection, stamp, data in reader.messages(readable):
            series[connection.topic].append(stamp, data)
    topics = {connection.topic: RecordedTopic(connection.msgtype, connection.msgcount)
              for connection in reader.connections}
    return Bag(folder, start, 0.0 if empty else (reader.end_time - 1 - start) * 1e-9,
               dict(reader.storage.metadata.custom or {}), topics,
               {topic: one.arrays() for topic, one in series.items()})


@dataclass(frozen=True)
class _Layout:
    """Columns of a message type: their widths, and a message's numbers in that order."""

    widths: Callable[[object], dict[str, int]]
    numbers: Callable[[object], tuple[float, ...]]
    stamped: bool = True
    framed: bool = False


class _Series:
    """Rows of one topic, growing message by message in compact arrays."""

    def __init__(self, connection: Connection, start_ns: int) -> None:
        self._topic, self._type = connection.topic, connection.msgtype
        self._layout = _LAYOUTS[self._type]
        self._start_ns = start_ns
        self._widths = self._layout.widths(None)
        self._times, self._stamps, self._rows = array("d"), array("d"), array("d")
        self._frames: list[str] = []

    def append(self, time_ns: int, data: bytes) -> None:
        try:
            message = jazzy_types().deserialize_cdr(data, self._type)
        except Exception as error:  # rosbags raises whatever its generated code meets
            raise ReaderError(f"unreadable message on {self._topic} at {time_ns} ns") from error
        if not self._times:
            self._widths = self._layout.widths(message)
        elif self._layout.widths(message) != self._widths:
            raise ReaderError(f"{self._topic} changes its joints at {time_ns} ns")
        self._times.append((time_ns - self._start_ns) * 1e-9)
        self._rows.extend(self._layout.numbers(message))
        if self._layout.stamped:
            stamp = message.header.stamp
            self._stamps.append((stamp.sec * 1_000_000_000 + stamp.nanosec - self._start_ns) * 1e-9)
        if self._layout.framed:
            self._frames.append(message.header.frame_id)

    def arrays(self) -> Arrays:
        arrays = {"time": np.array(self._times)}
        if self._layout.stamped:
            arrays["stamp"] = np.array(self._stamps)
        if self._layout.framed:
            arrays["frame"] = np.array(self._frames, dtype=str)
        rows = np.array(self._rows).reshape(len(self._times), sum(self._widths.values()))
        ends = np.cumsum(list(self._widths.values()), dtype=int)
        for (name, width), end in zip(self._widths.items(), ends, strict=True):
            arrays[name] = rows[:, end - 1] if width == 1 else rows[:, end - width:end]
        return arrays


def _xyz(vector: object) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _odometry(message: object) -> tuple[float, ...]:
    pose, twist = message.pose.pose, message.twist.twist
    turn = pose.orientation
    return *_xyz(pose.position), turn.x, turn.y, turn.z, turn.w, *_xyz(twist.linear), *_xyz(twist.angular)


def _wrench(message: object) -> tuple[float, ...]:
    return *_xyz(message.wrench.force), *_xyz(message.wrench.torque)


def _joints(message: object) -> tuple[float, ...]:
    return *message.position.tolist(), *message.velocity.tolist(), *message.effort.tolist()


def _joint_widths(message: object | None) -> dict[str, int]:
    if message is None:
        return {}
    return {f"{name}.{quantity}": 1 for quantity in ("position", "velocity", "effort")
            for name, _ in zip(message.name, getattr(message, quantity), strict=False)}


def _fixed(**widths: int) -> Callable[[object], dict[str, int]]:
    return lambda message: widths


_LAYOUTS = {
    "std_msgs/msg/Float64": _Layout(_fixed(value=1), lambda message: (message.data,), stamped=False),
    "nav_msgs/msg/Odometry": _Layout(
        _fixed(position=3, orientation=4, linear_velocity=3, angular_velocity=3), _odometry),
    "geometry_msgs/msg/WrenchStamped": _Layout(_fixed(force=3, torque=3), _wrench, framed=True),
    "sensor_msgs/msg/JointState": _Layout(_joint_widths, _joints),
}
