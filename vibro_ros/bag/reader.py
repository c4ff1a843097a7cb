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

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import Reader

from vibro_ros.bag.series import Series, readable_types

Arrays = dict[str, np.ndarray]

ROBOT_TOPICS = {
    "odom": "nav_msgs/msg/Odometry",
    "joint_states": "sensor_msgs/msg/JointState",
    "ground_contact": "geometry_msgs/msg/WrenchStamped",
    "impacts": "geometry_msgs/msg/WrenchStamped",
    "motor_power": "std_msgs/msg/Float64",
    "motor_speed": "std_msgs/msg/Float64",
    "upper_gap": "std_msgs/msg/Float64",
    "inclined_gap": "std_msgs/msg/Float64",
}  # a topic that ends like one of these and has another type is somebody else's


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
        found = [topic for topic in self.arrays if name in (topic, _last(topic)) and self._as_robot_types(topic)]
        if len(found) > 1:
            raise MissingTopicError(f"{self.path}: {name} is ambiguous; give one of {', '.join(found)}")
        if not found:
            recorded = ", ".join(f"{topic} ({one.type_name})" for topic, one in self.topics.items()) or "none"
            raise MissingTopicError(f"{self.path}: topic {name} is missing; recorded topics: {recorded}")
        return found[0]

    def _as_robot_types(self, topic: str) -> bool:
        type_name = self.topics[topic].type_name
        return ROBOT_TOPICS.get(_last(topic), type_name) == type_name


def _last(topic: str) -> str:
    return topic.rpartition("/")[2]


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
    except Exception as error:  # rosbags' parser meets damage with whatever breaks first
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
                       f"end the recorder, or seal it with `recover {folder}`")
    raise BagError(f"{folder}: not a bag, it holds no metadata.yaml; give the folder of a recording")


def _read(folder: Path, reader: Reader) -> Bag:
    empty = reader.message_count == 0
    start = 0 if empty else reader.start_time
    series = {connection.topic: Series(connection.topic, connection.msgtype, start)
              for connection in reader.connections if connection.msgtype in readable_types()}
    readable = [connection for connection in reader.connections if connection.topic in series]
    if readable:  # rosbags takes an empty list for "all"
        for connection, stamp, data in reader.messages(readable):
            series[connection.topic].append(stamp, data)
    topics = {connection.topic: RecordedTopic(connection.msgtype, connection.msgcount)
              for connection in reader.connections}
    return Bag(folder, start, 0.0 if empty else (reader.end_time - 1 - start) * 1e-9,
               dict(reader.storage.metadata.custom or {}), topics,
               {topic: one.arrays() for topic, one in series.items()})
