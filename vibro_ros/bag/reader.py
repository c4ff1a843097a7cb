"""Read a recording into numpy arrays, topic by topic."""

import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vibro_ros.bag.series import Series, readable_types
from vibro_ros.bag.stream import BagError, BagStream, RecordedTopic
from vibro_ros.messages.topics import ROBOT_TOPICS

__all__ = ["Arrays", "Bag", "BagError", "BagWarning", "MissingTopicError", "RecordedTopic", "load_bag",
           "read_bag"]

Arrays = dict[str, np.ndarray]


class BagWarning(UserWarning):
    """Part of a recording is not read."""


class MissingTopicError(BagError, KeyError):
    """A recording lacks a topic."""

    __str__ = Exception.__str__  # KeyError would quote the sentence


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
        What `read_bag` lists, by full name.
    flaws : tuple of str
        What of the recording is not read, one line each; empty when all of it is.
    """

    path: Path
    start_ns: int
    duration: float
    metadata: dict[str, str]
    topics: dict[str, RecordedTopic]
    arrays: dict[str, Arrays]
    flaws: tuple[str, ...] = ()

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


def read_bag(path: str | Path, columns: Mapping[str, Sequence[str]] | None = None) -> Bag:
    """Read a bag folder, of the robot's recorder or of ``ros2 bag record``, into numpy arrays by topic.

    Messages are read one by one into growing arrays: what is kept takes 8 bytes a number. Needs no ROS.

    Parameters
    ----------
    path : str or Path
        The bag folder, sealed; of one file or several, MCAP or sqlite3, compressed or not.
    columns : mapping of str to sequence of str, optional
        What to read when the bag is large: by the last part of a topic's name, names of its arrays, with ``*`` for any
        text (``{"odom": ["position"], "joint_states": ["*.position"]}``). ``time`` is always there. Topics that
        are not named are counted, not read. Everything by default.

    Returns
    -------
    Bag
        ``bag["odom"]["position"]``: arrays of each topic, by the type of its messages. ``time`` is the recorded
        stamp [s] after the bag's first message (`Bag.start_ns`), shape (n,), ascending; ``stamp`` is the header's
        stamp on the same scale [s]:

        ================================  ==========================================================
        std_msgs/msg/Float64              ``time``, ``value`` (the topic's own unit: rad/s for
                                          `motor_speed`, m for the gaps, W for `motor_power`)
        nav_msgs/msg/Odometry             ``time``, ``stamp``, ``position`` [m] shape (n, 3), ``orientation``
                                          (quaternion x, y, z, w) shape (n, 4), ``linear_velocity`` [m/s]
                                          and ``angular_velocity`` [rad/s] shape (n, 3)
        geometry_msgs/msg/WrenchStamped   ``time``, ``stamp``, ``frame`` (text, shape (n,)), ``force`` [N] and
                                          ``torque`` [N m] shape (n, 3)
        sensor_msgs/msg/JointState        ``time``, ``stamp`` and, for each joint, ``<joint>.position``
                                          [m or rad], ``<joint>.velocity`` [m/s or rad/s],
                                          ``<joint>.effort`` [N or N m], shape (n,)
        ================================  ==========================================================

        Topics of other types are counted, not read. What cannot be read - a damaged part of a file, a message
        that is not of its topic's type, as a hostile peer may publish it - is left out of the arrays and named in
        `Bag.flaws`; the rest is read.

    Raises
    ------
    BagError
        When the folder is missing, no bag, or not sealed, or when nothing in it can be read; the message names path,
        reason and remedy.

    Warns
    -----
    BagWarning
        Once, when something is left out: with the first of the flaws and their number.

    Examples
    --------
    >>> bag = vibro_ros.read_bag("vibro_robot_2026_11_21-10_29_21")
    >>> time, x = bag["odom"]["time"], bag["odom"]["position"][:, 0]
    >>> f"{(x[-1] - x[0]) / (time[-1] - time[0]):.3f} m/s"
    '-0.250 m/s'
    """
    bag = load_bag(path, columns)
    if bag.flaws:
        more = f" (and {len(bag.flaws) - 1} more, see the bag's flaws)" if len(bag.flaws) > 1 else ""
        warnings.warn(f"{bag.path}: not all of it is read: {bag.flaws[0]}{more}", BagWarning, stacklevel=2)
    return bag


def load_bag(path: str | Path, columns: Mapping[str, Sequence[str]] | None = None) -> Bag:
    """`read_bag` without its warning, for those who name the flaws themselves."""
    with BagStream(path) as stream:
        arrays = {topic: one.arrays() for topic, one in _series(stream, columns).items()}
        return Bag(stream.folder, stream.start, (stream.end - stream.start) * 1e-9, stream.metadata, stream.topics,
                   arrays, tuple(stream.flaws))


def _series(stream: BagStream, columns: Mapping[str, Sequence[str]] | None) -> dict[str, Series]:
    series = {topic: Series(one.type_name, stream.start, ("*",) if columns is None else columns[_last(topic)])
              for topic, one in stream.topics.items()
              if one.type_name in readable_types() and (columns is None or _last(topic) in columns)}
    seen: Counter[str] = Counter()
    for topic, stamp, data in stream.messages(frozenset(series)):
        try:
            series[topic].append(stamp, data)
        except ValueError as error:
            stream.unreadable.add(topic, seen[topic], stamp, error)
        seen[topic] += 1
    return series
