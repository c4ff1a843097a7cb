"""Read a recording into numpy arrays, topic by topic."""

import warnings
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import accumulate, chain
from pathlib import Path
from typing import Any

import numpy as np

from vibro_ros.bag.cdr import deserialised
from vibro_ros.bag.stream import BagError, BagStream, RecordedTopic
from vibro_ros.messages.topics import ROBOT_TOPICS

__all__ = ["Arrays", "Bag", "BagError", "BagWarning", "MissingTopicError", "RecordedTopic", "load_bag",
           "read_bag"]

Arrays = dict[str, np.ndarray]

LONGEST_FRAME = 1000
"""Characters of a frame's name; the array of all names takes as much for each message as the longest one."""


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
        types = {topic: one.type_name for topic, one in self.topics.items()}
        found = [topic for topic in self.arrays if name in (topic, _last(topic))
                 and ROBOT_TOPICS.get(_last(topic), types[topic]) == types[topic]]
        if len(found) > 1:
            raise MissingTopicError(f"{self.path}: {name} is ambiguous; give one of {', '.join(found)}")
        if not found:
            recorded = ", ".join(f"{topic} ({one.type_name})" for topic, one in self.topics.items()) or "none"
            raise MissingTopicError(f"{self.path}: topic {name} is missing; recorded topics: {recorded}")
        return found[0]


def _last(topic: str) -> str:
    return topic.rpartition("/")[2]


def read_bag(path: str | Path, columns: Mapping[str, Sequence[str]] | None = None) -> Bag:
    """Read a bag folder, of the robot's recorder or of ``ros2 bag record``, into numpy arrays by topic.

    Messages are read one by one into growing arrays: they take 8 bytes a number. Needs no ROS.

    Parameters
    ----------
    path : str or Path
        The bag folder, sealed; of one MCAP file or several, with or without compressed chunks. `ros2 bag convert`
        makes such a bag of one in the storage sqlite3.
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
        series = {topic: Series(one.type_name, stream.start, ("*",) if columns is None else columns[_last(topic)])
                  for topic, one in stream.topics.items()
                  if one.type_name in _LAYOUTS and (columns is None or _last(topic) in columns)}
        seen: Counter[str] = Counter()
        for topic, stamp, data in stream.messages(frozenset(series)):
            try:
                series[topic].append(stamp, data)
            except ValueError as error:
                stream.unreadable.add(topic, seen[topic], stamp, error)
            seen[topic] += 1
        arrays = {topic: one.arrays() for topic, one in series.items()}
        return Bag(stream.folder, stream.start, (stream.end - stream.start) * 1e-9, stream.metadata, stream.topics,
                   arrays, tuple(stream.flaws))


@dataclass(frozen=True)
class _Layout:
    """Columns of a message type: their widths, and a message's numbers in that order."""

    widths: Callable[[Any], dict[str, int]]
    numbers: Callable[[Any], tuple[float, ...]]
    stamped: bool = True
    framed: bool = False


class Series:
    """Chosen columns of one topic, growing message by message in compact arrays.

    Parameters
    ----------
    type_name : str
        ROS type, one of those that `read_bag` lists.
    start_ns : int
        Zero of the arrays' times, ROS time [ns].
    columns : sequence of str
        Patterns of the columns' names, as `fnmatch` reads them; without any, only times are kept, unread.
    """

    def __init__(self, type_name: str, start_ns: int, columns: Sequence[str] = ("*",)) -> None:
        self._type, self._patterns = type_name, columns
        self._layout = _LAYOUTS[self._type]
        self._start_ns = start_ns
        self._times, self._stamps, self._rows = array("d"), array("d"), array("d")
        self._ascending = True
        self._frames: dict[str, int] = {}
        self._frame = array("L")
        self._stamped = self._layout.stamped and self._wants("stamp")
        self._framed = self._layout.framed and self._wants("frame")
        self._choose(None)

    def append(self, time_ns: int, data: bytes) -> None:
        """Add one serialised message recorded at `time_ns`.

        Raises
        ------
        ValueError
            When it cannot be read, or does not fit to the columns; nothing is added then.
        """
        if self._patterns:
            self._read(data)
        time = (time_ns - self._start_ns) * 1e-9
        self._ascending &= not self._times or time >= self._times[-1]
        self._times.append(time)

    def arrays(self) -> dict[str, np.ndarray]:
        """The columns by name, as `vibro_ros.read_bag` lists them; nothing can be appended any more."""
        arrays = {"time": _as_array(self._times)}
        if self._stamped:
            arrays["stamp"] = _as_array(self._stamps)
        if self._framed:
            arrays["frame"] = np.array(list(self._frames), dtype=str)[_as_array(self._frame)]
        rows = _as_array(self._rows).reshape(len(self._times), len(self._chosen))
        end = 0
        for name, width in self._columns.items():
            end += width
            arrays[name] = rows[:, end - 1] if width == 1 else rows[:, end - width:end]
        if self._ascending:
            return arrays
        order = np.argsort(arrays["time"], kind="stable")
        return {name: column[order] for name, column in arrays.items()}

    def _read(self, data: bytes) -> None:
        message = deserialised(data, self._type)
        if self._framed and len(message.header.frame_id) > LONGEST_FRAME:
            raise ValueError(f"its frame has more than {LONGEST_FRAME} characters")
        widths, numbers = self._layout.widths(message), self._layout.numbers(message)
        if len(numbers) != sum(widths.values()):
            raise ValueError("it names a joint twice")
        if not self._times:
            self._choose(message)
        elif widths != self._widths:
            raise ValueError("its joints are others than those of the first message")
        self._rows.extend(numbers if len(self._chosen) == len(numbers) else [numbers[i] for i in self._chosen])
        if self._stamped:
            stamp = message.header.stamp
            self._stamps.append((stamp.sec * 1_000_000_000 + stamp.nanosec - self._start_ns) * 1e-9)
        if self._framed:
            self._frame.append(self._frames.setdefault(message.header.frame_id, len(self._frames)))

    def _choose(self, message: Any) -> None:
        """Fix the columns from the first message; without one, from the type."""
        self._widths = self._layout.widths(message)
        self._columns = {name: width for name, width in self._widths.items() if self._wants(name)}
        starts = dict(zip(self._widths, accumulate(self._widths.values(), initial=0), strict=False))
        self._chosen = [starts[name] + i for name, width in self._columns.items() for i in range(width)]

    def _wants(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self._patterns)


def _as_array(numbers: array) -> np.ndarray:
    """The same memory as an ndarray."""
    return np.frombuffer(numbers, dtype=numbers.typecode) if numbers else np.empty(0, dtype=numbers.typecode)


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _odometry(message: Any) -> tuple[float, ...]:
    pose, twist = message.pose.pose, message.twist.twist
    turn = pose.orientation
    return *_xyz(pose.position), turn.x, turn.y, turn.z, turn.w, *_xyz(twist.linear), *_xyz(twist.angular)


def _wrench(message: Any) -> tuple[float, ...]:
    return *_xyz(message.wrench.force), *_xyz(message.wrench.torque)


_JOINT_QUANTITIES = ("position", "velocity", "effort")


def _joints(message: Any) -> tuple[float, ...]:
    joints = len(message.name)
    return tuple(chain(*(getattr(message, quantity)[:joints].tolist() for quantity in _JOINT_QUANTITIES)))


def _joint_widths(message: Any) -> dict[str, int]:
    if message is None:
        return {}
    return {f"{name}.{quantity}": 1 for quantity in _JOINT_QUANTITIES
            for name, _ in zip(message.name, getattr(message, quantity), strict=False)}


_ODOMETRY = {"position": 3, "orientation": 4, "linear_velocity": 3, "angular_velocity": 3}
_LAYOUTS = {
    "std_msgs/msg/Float64": _Layout(lambda message: {"value": 1}, lambda message: (message.data,), stamped=False),
    "nav_msgs/msg/Odometry": _Layout(lambda message: _ODOMETRY, _odometry),
    "geometry_msgs/msg/WrenchStamped": _Layout(lambda message: {"force": 3, "torque": 3}, _wrench, framed=True),
    "sensor_msgs/msg/JointState": _Layout(_joint_widths, _joints),
}
