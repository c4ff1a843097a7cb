"""Read a recording into numpy arrays, topic by topic."""

import math
import warnings
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from vibro_ros.bag.stream import BagError, BagStream, RecordedTopic
from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.simulation.samples import AXES, as_table

if TYPE_CHECKING:
    import pandas

__all__ = ["Arrays", "Bag", "BagError", "BagWarning", "MissingTopicError", "RecordedTopic", "load_bag",
           "read_bag"]

Arrays = dict[str, np.ndarray]

JOINT_STATE, TRANSFORMS = "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
MOST_JOINTS = 10_000  # most joints of a topic; each takes memory that is much larger than its name in a message
_MOST_LAYOUTS = 100  # that are kept; a robot has a few
_JOINTS = ""  # the key of a message's joints among its columns
LONGEST_FRAME = 1000
"""Longest name of a frame [characters]; in the array of names every row takes the memory of the longest one."""


class BagWarning(UserWarning):
    """Part of a recording was not read."""


class MissingTopicError(BagError, KeyError):
    """A recording lacks a topic, or a topic lacks an array."""

    __str__ = Exception.__str__  # KeyError would quote the sentence


class TopicArrays(Arrays):
    """The arrays of a topic by name; a column of an array of several has the name of the array and its axis:
    ``bag["odom"]["position.x"]``, as in `Bag.to_pandas`.
    """

    def __missing__(self, name: str) -> np.ndarray:
        whole, _, axis = name.rpartition(".")
        columns = {key: AXES[:values.shape[1]] for key, values in self.items() if values.ndim == 2}
        if axis and axis in columns.get(whole, ""):
            return self[whole][:, AXES.index(axis)]
        listed = ", ".join(f"{key}.{axes[0]} … {key}.{axes[-1]}" if (axes := columns.get(key)) else key for key in self)
        raise MissingTopicError(f"{name}: the topic has no such array; give one of {listed}")


@dataclass(frozen=True, eq=False)
class Bag(Mapping[str, Arrays]):
    """A recording in memory: ``bag["odom"]["position"]``.

    A topic is found by its full name (``/robot1/odom``), or by its last part (``odom``) when only
    one topic ends so.
    """

    path: Path  # the bag folder
    start_ns: int  # recorded stamp of the first message, ROS time [ns]; 0 in an empty bag
    duration: float  # time from the first message to the last [s]
    metadata: dict[str, str]  # the bag's custom data, in which the recorder describes the run
    topics: dict[str, RecordedTopic]  # every topic, by full name, including those of types that are not read
    arrays: Mapping[str, Arrays]  # the arrays that `read_bag` lists, by full name of the topic
    flaws: tuple[str, ...] = ()  # sentences on the parts that were not read

    def __getitem__(self, name: str) -> Arrays:
        return self.arrays[self.full_name(name)]

    def __iter__(self) -> Iterator[str]:
        return iter(self.arrays)

    def __len__(self) -> int:
        return len(self.arrays)

    def __repr__(self) -> str:
        topics = ", ".join(f"{topic} ({len(arrays['time'])})" for topic, arrays in self.arrays.items())
        return f"<Bag {self.path}: {self.duration:g} s, messages read: {topics or 'none'}>"

    def full_name(self, name: str) -> str:
        """Return the full name of the topic called `name` (MissingTopicError when none, or more than one, has it)."""
        types = {topic: recorded.type_name for topic, recorded in self.topics.items()}
        matches = [topic for topic in self.arrays if topic == name or topic.endswith(f"/{name}")
                   and ROBOT_TOPICS.get(_last_part(topic), types[topic]) == types[topic]]
        if len(matches) > 1:
            raise MissingTopicError(f"{self.path}: {name} is ambiguous; give one of {', '.join(matches)}")
        if not matches:
            names = ", ".join(f"{topic} ({recorded.type_name})" for topic, recorded in self.topics.items()) or "none"
            raise MissingTopicError(f"{self.path}: topic {name} is missing; recorded topics: {names}")
        return matches[0]

    def series(self, name: str) -> Iterator[Arrays]:
        """Yield the columns of the topic called `name` that have the same instants, each time with their ``time``, and
        ``stamp`` if there is any: first those with the topic's instants, then those of each joint with its own.

        MissingTopicError when no topic, or more than one, has this name.
        """
        return series_of(self[name])

    def to_pandas(self) -> "Mapping[str, pandas.DataFrame]":
        """Return every topic as a table of pandas, with the index ``time`` [s], by the same names as in the bag.

        Returns
        -------
        mapping of str to pandas.DataFrame
            The bag's arrays as columns of the same names. An array of shape (n, 3) becomes three columns such as
            ``position.x``, ``position.y`` and ``position.z``; a quaternion becomes four, with ``.w`` as the last. A
            joint with instants of its own has rows of its own; the other joints are NaN there.

        Raises
        ------
        ModuleNotFoundError
            Without pandas; the message says how to install it.

        Examples
        --------
        >>> tables = vibro_ros.read_bag("vibro_robot_2026_11_21-10_29_21").to_pandas()
        >>> tables["odom"]["position.x"].diff().abs().sum()
        >>> tables["joint_states"]["upper_mass.position"].plot()
        """
        tables = {}
        for topic, arrays in self.arrays.items():
            parts = [as_table(part) for part in series_of(arrays)]
            if len(parts) > 1:  # the first may have no joint
                import pandas

                parts = [pandas.concat([part for part in parts if set(part) - {"stamp"}]).sort_index(kind="stable")]
            (tables[topic],) = parts
        return replace(self, arrays=tables)


def _last_part(topic: str) -> str:
    return topic.rpartition("/")[2]


def read_bag(path: str | Path, columns: Mapping[str, Sequence[str]] | None = None) -> Bag:
    """Read a bag folder, of the robot's recorder or of ``ros2 bag record``, into numpy arrays by topic.

    Messages are read one by one into growing arrays of 8 bytes a number. Needs no ROS.

    Parameters
    ----------
    path : str or Path
        The bag folder, sealed or not; of one MCAP file or several, compressed chunks or not. `ros2 bag convert`
        makes such a bag of one in the storage sqlite3.
    columns : mapping of str to sequence of str, optional
        The arrays to read, if not all: names of arrays, with ``*`` for any text, by the last part of a topic's name
        (``{"odom": ["position"], "joint_states": ["*.position"]}``). ``time`` is always read. Topics that are not named
        are counted, not read.

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
                                          and ``angular_velocity`` [rad/s] shape (n, 3), and the
                                          variances ``position_variance`` and
                                          ``linear_velocity_variance`` of two of them, shape (n, 3)
        sensor_msgs/msg/Imu               ``time``, ``stamp``, ``acceleration`` (specific force) [m/s²],
                                          ``angular_velocity`` [rad/s], and the variances on their axes
                                          ``acceleration_variance``, ``angular_velocity_variance``, shape (n, 3)
        sensor_msgs/msg/BatteryState      ``time``, ``stamp``, ``voltage`` [V] and ``current`` [A], shape (n,)
        geometry_msgs/msg/                ``time``, ``stamp``, ``position`` [m] and its ``variance`` [m²], shape (n, 3)
        PoseWithCovarianceStamped
        geometry_msgs/msg/WrenchStamped   ``time``, ``stamp``, ``frame`` (text, shape (n,)), ``force`` [N] and
                                          ``torque`` [N m] shape (n, 3)
        sensor_msgs/msg/JointState        ``time``, ``stamp`` and, for each joint, ``<joint>.position``
                                          [m or rad], ``<joint>.velocity`` [m/s or rad/s],
                                          ``<joint>.effort`` [N or N m], shape (n,). A joint that only m of
                                          the n messages name has shape (m,), and ``<joint>.time``,
                                          ``<joint>.stamp`` for its instants. What a message lacks of a joint
                                          that it names is NaN
        tf2_msgs/msg/TFMessage            one row for each transform: ``time``, ``stamp``, ``frame`` and ``child``
                                          (texts, shape (n,)), ``translation`` [m] shape (n, 3), ``rotation``
                                          (quaternion x, y, z, w) shape (n, 4)
        std_msgs/msg/String               ``time``, ``text`` (shape (n,), of Python texts): the robot's operations,
                                          such as ``reset`` or ``set {"ground.friction": 0.1}``, and its URDF
        ================================  ==========================================================

        Topics of other types are counted, not read. What cannot be read (a damaged part of a file, or a message that is
        not of its topic's type, which a hostile peer may publish) is left out of the arrays and named in `Bag.flaws`;
        the rest is read.

    Raises
    ------
    BagError
        When the folder is missing or no bag, or when nothing in it can be read; the message names path,
        reason and remedy.

    Warns
    -----
    BagWarning
        Once, when something is left out, with the first of the flaws and their number.

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
    """Read a bag as `read_bag` does, without its warning, for callers that report the flaws themselves."""
    with BagStream(path) as stream:
        patterns = {topic: ("*",) if columns is None else columns.get(_last_part(topic)) for topic in stream.topics}
        series = {topic: Series(recorded.type_name, stream.start, chosen)
                  for topic, recorded in stream.topics.items()
                  if recorded.type_name in COLUMNS and (chosen := patterns[topic]) is not None}
        counts: Counter[str] = Counter()
        for topic, stamp, data in stream.messages(frozenset(series)):
            try:
                series[topic].append(stamp, data)
            except ValueError as error:
                stream.unreadable.add(topic, counts[topic], stamp, error)
            counts[topic] += 1
        arrays = {topic: TopicArrays(rows.arrays()) for topic, rows in series.items()}
        return Bag(stream.folder, stream.start, (stream.end - stream.start) * 1e-9, stream.metadata, stream.topics,
                   arrays, tuple(stream.flaws))


class Series:
    """Columns of one topic, which grow message by message in compact arrays; their times count from `start_ns` [ns].

    `patterns` select the columns by name, as in `fnmatch`. `columns` are those of messages of the type `type_name`, by
    default those in `COLUMNS`.
    """

    def __init__(self, type_name: str, start_ns: int, patterns: Sequence[str] = ("*",),
                 columns: Mapping[str, "Column"] | None = None) -> None:
        self._type, self._start_ns, self._patterns = type_name, start_ns, patterns
        known = COLUMNS[type_name] if columns is None else columns
        self._columns = {name: column for name, column in known.items() if self._is_chosen(name)}
        self._rows: dict[str, array] = {}  # by joint, the numbers of the messages that name it
        self._layouts: dict[tuple[tuple[str, ...], ...], _Layout] = {}  # by joints and quantities of a message
        self._times = array("d")
        self._values: dict[str, array] = {name: array("L" if column.is_text else "d")
                                          for name, column in self._columns.items()}
        self._texts: dict[str, dict[str, int]] = {name: {} for name, column in self._columns.items() if column.is_text}

    def append(self, time_ns: int, data: bytes) -> None:
        """Add a serialised message recorded at `time_ns`, or nothing (ValueError when it does not fit the columns)."""
        message = deserialised(data, self._type)
        rows = message.transforms if self._type == TRANSFORMS else (message,)
        for row in [self._read(row) for row in rows]:
            for joint in row.pop(_JOINTS, ()):
                self._rows[joint].append(len(self._times))
            self._times.append((time_ns - self._start_ns) * 1e-9)
            for name, value in row.items():
                if name == "stamp":
                    value = (value - self._start_ns) * 1e-9
                elif name in self._texts:
                    numbers = self._texts[name]
                    value = numbers.setdefault(value, len(numbers))
                if isinstance(value, (tuple, list)):
                    self._values[name].extend(value)
                else:
                    self._values[name].append(value)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the columns by name, as `vibro_ros.read_bag` lists them; nothing can be appended afterwards."""
        arrays = {"time": _as_array(self._times)}
        for name, values in self._values.items():
            arrays[name] = _as_array(values)
            if name in self._texts:  # as objects a long text takes memory once, not in every row
                kind = object if self._type == "std_msgs/msg/String" else str
                arrays[name] = np.array(list(self._texts[name]), dtype=kind)[arrays[name]]
            elif name in self._columns and self._columns[name].width > 1:
                arrays[name] = arrays[name].reshape(len(self._times), self._columns[name].width)
        for joint, rows in self._rows.items():
            if len(rows) < len(self._times):
                arrays |= {f"{joint}.{name}": arrays[name][_as_array(rows)] for name in ("time", "stamp")
                           if name in arrays}
        if (np.diff(arrays["time"]) >= 0.0).all():
            return arrays
        orders = {_joint_of(name): np.argsort(times, kind="stable") for name, times in arrays.items()
                  if name.endswith("time")}
        return {name: column[orders.get(_joint_of(name), orders[None])] for name, column in arrays.items()}

    def _read(self, row: Any) -> dict[str, Any]:
        """Return the values of a row by column (ValueError when they do not fit the columns)."""
        values = {name: column.read(row) for name, column in self._columns.items()}
        return values | self._read_joints(row) if self._type == JOINT_STATE else values

    def _read_joints(self, message: Any) -> dict[str, Any]:
        """Return the joints of a message, and their quantities from the arrays with a number for each joint.

        In shorter arrays the numbers may belong to any of the joints (`messages.topics.joint_commands`).
        """
        quantities = [quantity for quantity in JOINT_QUANTITIES if len(getattr(message, quantity)) == len(message.name)]
        key = tuple(message.name), tuple(quantities)
        layout = self._layouts.get(key) or self._layouts.setdefault(key, self._layout(message.name, quantities))
        values = chain(*(getattr(message, quantity).tolist() for quantity in quantities))
        return {_JOINTS: layout.joints, **layout.lacking,
                **{name: value for name, value in zip(layout.names, values, strict=True) if name in self._values}}

    def _layout(self, joints: list[str], quantities: list[str]) -> "_Layout":
        """Return the layout of messages with these joints and quantities; begin the columns that are new."""
        names = [f"{joint}.{quantity}" for quantity in quantities for joint in joints]
        if len(set(names)) < len(names):
            raise ValueError("it names a joint twice")
        if new := [name for name in names if self._is_chosen(name) and name not in self._values]:
            if len(self._rows.keys() | set(joints)) > MOST_JOINTS:
                raise ValueError(f"with it the topic has more than {MOST_JOINTS} joints")
            self._layouts.clear()  # messages of other layouts lack the new columns
            for name in new:
                rows = self._rows.setdefault(name.rpartition(".")[0], array("L"))
                self._values[name] = array("d", [math.nan]) * len(rows)
        if len(self._layouts) >= _MOST_LAYOUTS:
            self._layouts.clear()
        known = [joint for joint in joints if joint in self._rows]
        return _Layout(known, names, {name: math.nan for joint in known for quantity in JOINT_QUANTITIES
                                      if (name := f"{joint}.{quantity}") in self._values and name not in names})

    def _is_chosen(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self._patterns)


class _Layout(NamedTuple):
    """The columns that the messages with the same joints and quantities fill."""

    joints: list[str]
    names: list[str]  # of the columns, in the order of the numbers in a message
    lacking: dict[str, float]  # NaN for each column that such messages lack


def series_of(arrays: Arrays) -> Iterator[Arrays]:
    """Yield the columns of a topic that have the same instants, each time with their ``time``, and ``stamp`` if there
    is any: first those with the topic's instants, then those of each joint with instants of its own."""
    parts: dict[str | None, Arrays] = {None: {}, **{_joint_of(name): {} for name in arrays if name.endswith(".time")}}
    for name, column in arrays.items():
        last = name.rpartition(".")[2]
        parts.get(_joint_of(name), parts[None])[last if last in ("time", "stamp") else name] = column
    yield from parts.values()


def _joint_of(name: str) -> str | None:
    """Return the joint of a column such as `crank.position`; None for those of the whole topic."""
    joint, dot, _ = name.rpartition(".")
    return joint if dot else None


def _as_array(numbers: array) -> np.ndarray:
    """Return an ndarray over the same memory."""
    return np.frombuffer(numbers, dtype=numbers.typecode) if numbers else np.empty(0, dtype=numbers.typecode)


class Column(NamedTuple):
    """How a column is read from a message: as `width` numbers, or as a text."""

    read: Callable[[Any], Any]
    width: int = 1
    is_text: bool = False


def numbers_at(*paths: str) -> Column:
    """Return a column of the numbers at some paths in a message, such as ``twist.twist.linear.x``."""
    return Column(attrgetter(*paths), len(paths))


def _axes(path: str, axes: str = "xyz") -> Column:
    return numbers_at(*(f"{path}.{axis}" for axis in axes))


def _variances(path: str, of_diagonal: slice = slice(None, None, 4)) -> Column:
    """Return a column of three variances from the covariance at a path; `of_diagonal` selects them."""
    read = attrgetter(path)
    return Column(lambda message: read(message)[of_diagonal].tolist(), 3)


def _stamp(message: Any) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def _frame(path: str) -> Column:
    read = attrgetter(path)

    def checked(message: Any) -> str:
        if len(name := read(message)) > LONGEST_FRAME:
            raise ValueError(f"its frame has more than {LONGEST_FRAME} characters")
        return name

    return Column(checked, is_text=True)


STAMP = Column(_stamp)  # column of the header's stamp [ns], which becomes seconds on the scale of ``time``
_FIRST_OF_SIX = slice(0, 15, 7)  # of the diagonal of a matrix with six rows
JOINT_QUANTITIES = ("position", "velocity", "effort")
COLUMNS: Mapping[str, Mapping[str, Column]] = {
    "std_msgs/msg/Float64": {"value": numbers_at("data")},
    "std_msgs/msg/String": {"text": Column(attrgetter("data"), is_text=True)},
    "nav_msgs/msg/Odometry": {
        "stamp": STAMP, "position": _axes("pose.pose.position"), "orientation": _axes("pose.pose.orientation", "xyzw"),
        "linear_velocity": _axes("twist.twist.linear"), "angular_velocity": _axes("twist.twist.angular"),
        "position_variance": _variances("pose.covariance", _FIRST_OF_SIX),
        "linear_velocity_variance": _variances("twist.covariance", _FIRST_OF_SIX)},
    "geometry_msgs/msg/WrenchStamped": {
        "stamp": STAMP, "frame": _frame("header.frame_id"), "force": _axes("wrench.force"),
        "torque": _axes("wrench.torque")},
    "sensor_msgs/msg/Imu": {
        "stamp": STAMP, "acceleration": _axes("linear_acceleration"), "angular_velocity": _axes("angular_velocity"),
        "acceleration_variance": _variances("linear_acceleration_covariance"),
        "angular_velocity_variance": _variances("angular_velocity_covariance")},
    "sensor_msgs/msg/BatteryState": {"stamp": STAMP, "voltage": numbers_at("voltage"),
                                     "current": numbers_at("current")},
    "geometry_msgs/msg/PoseWithCovarianceStamped": {
        "stamp": STAMP, "position": _axes("pose.pose.position"), "variance": _variances("pose.covariance",
                                                                                        _FIRST_OF_SIX)},
    JOINT_STATE: {"stamp": STAMP},  # and columns named after the joints
    TRANSFORMS: {
        "stamp": STAMP, "frame": _frame("header.frame_id"), "child": _frame("child_frame_id"),
        "translation": _axes("transform.translation"), "rotation": _axes("transform.rotation", "xyzw")},
}
"""The columns of each message type, by name; for TFMessage, those of each transform in the message."""
