"""Read a recording into numpy arrays, topic by topic."""

import warnings
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from itertools import accumulate, chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vibro_ros.bag.stream import BagError, BagStream, RecordedTopic
from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.topics import ROBOT_TOPICS

if TYPE_CHECKING:
    import pandas

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
        found = [topic for topic in self.arrays if topic == name or topic.endswith(f"/{name}")
                 and ROBOT_TOPICS.get(_last(topic), types[topic]) == types[topic]]
        if len(found) > 1:
            raise MissingTopicError(f"{self.path}: {name} is ambiguous; give one of {', '.join(found)}")
        if not found:
            recorded = ", ".join(f"{topic} ({one.type_name})" for topic, one in self.topics.items()) or "none"
            raise MissingTopicError(f"{self.path}: topic {name} is missing; recorded topics: {recorded}")
        return found[0]

    def to_pandas(self) -> "Mapping[str, pandas.DataFrame]":
        """Every topic as a table of pandas, with the index ``time`` [s]; found by the same names as in the bag.

        Returns
        -------
        mapping of str to pandas.DataFrame
            The bag's arrays as columns of the same names. An array of shape (n, 3) becomes three columns such as
            ``position.x``, ``position.y`` and ``position.z``; a quaternion becomes four, with ``.w`` as the last.

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
        try:
            import pandas
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(f"to_pandas needs pandas ({error}): pip install pandas", name="pandas") from None
        tables = {}
        for topic, arrays in self.arrays.items():
            columns: Arrays = {}
            for name, values in arrays.items():
                columns |= {name: values} if values.ndim == 1 else {
                    f"{name}.{axis}": column for axis, column in zip("xyzw", values.T, strict=False)}
            tables[topic] = pandas.DataFrame(columns, index=pandas.Index(columns.pop("time"), name="time"))
        return replace(self, arrays=tables)


def _last(topic: str) -> str:
    return topic.rpartition("/")[2]


def read_bag(path: str | Path, columns: Mapping[str, Sequence[str]] | None = None) -> Bag:
    """Read a bag folder, of the robot's recorder or of ``ros2 bag record``, into numpy arrays by topic.

    Messages are read one by one into growing arrays: they take 8 bytes a number. Needs no ROS.

    Parameters
    ----------
    path : str or Path
        The bag folder, sealed or not; of one MCAP file or several, compressed chunks or not. `ros2 bag convert`
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
                                          ``<joint>.effort`` [N or N m], shape (n,)
        tf2_msgs/msg/TFMessage            one row for each transform: ``time``, ``stamp``, ``frame`` and ``child``
                                          (texts, shape (n,)), ``translation`` [m] shape (n, 3), ``rotation``
                                          (quaternion x, y, z, w) shape (n, 4)
        std_msgs/msg/String               ``time``, ``text`` (shape (n,), of Python texts): the robot's operations,
                                          such as ``reset`` or ``set {"ground.friction": 0.1}``, and its URDF
        ================================  ==========================================================

        Topics of other types are counted, not read. What cannot be read - a damaged part of a file, a message
        that is not of its topic's type, as a hostile peer may publish it - is left out of the arrays and named in
        `Bag.flaws`; the rest is read.

    Raises
    ------
    BagError
        When the folder is missing or no bag, or when nothing in it can be read; the message names path,
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
    """Columns of a message type: widths of the numbers, the numbers in that order, and texts, of each row."""

    widths: Callable[[Any], dict[str, int]]
    numbers: Callable[[Any], tuple[float, ...]]
    stamped: bool = True
    texts: Mapping[str, Callable[[Any], str]] = field(default_factory=dict)
    rows: Callable[[Any], Sequence[Any]] = lambda message: (message,)


class Series:
    """Chosen columns of one topic, growing message by message in compact arrays; their times are 0 at `start_ns` [ns].

    `columns` are patterns of the columns' names, as `fnmatch` reads them; without any, only times are kept, unread.
    """

    def __init__(self, type_name: str, start_ns: int, columns: Sequence[str] = ("*",)) -> None:
        self._type, self._patterns = type_name, columns
        self._layout = _LAYOUTS[self._type]
        self._start_ns = start_ns
        self._times, self._stamps, self._rows = array("d"), array("d"), array("d")
        self._ascending = True
        self._texts: dict[str, dict[str, int]] = {name: {} for name in self._layout.texts if self._wants(name)}
        self._text_numbers = {name: array("L") for name in self._texts}
        self._stamped = self._layout.stamped and self._wants("stamp")
        self._choose(None)

    def append(self, time_ns: int, data: bytes) -> None:
        """Add one serialised message recorded at `time_ns`.

        Raises
        ------
        ValueError
            When it cannot be read, or does not fit to the columns; nothing is added then.
        """
        rows = self._read(data) if self._patterns else 1
        time = (time_ns - self._start_ns) * 1e-9
        self._ascending &= not self._times or time >= self._times[-1]
        self._times.extend([time] * rows)

    def arrays(self) -> dict[str, np.ndarray]:
        """The columns by name, as `vibro_ros.read_bag` lists them; nothing can be appended any more."""
        arrays = {"time": _as_array(self._times)}
        if self._stamped:
            arrays["stamp"] = _as_array(self._stamps)
        for name, texts in self._texts.items():  # as objects a long text takes memory once, not in every row
            kind = object if self._type == "std_msgs/msg/String" else str
            arrays[name] = np.array(list(texts), dtype=kind)[_as_array(self._text_numbers[name])]
        rows = _as_array(self._rows).reshape(len(self._times), len(self._chosen))
        end = 0
        for name, width in self._columns.items():
            end += width
            arrays[name] = rows[:, end - 1] if width == 1 else rows[:, end - width:end]
        if self._ascending:
            return arrays
        order = np.argsort(arrays["time"], kind="stable")
        return {name: column[order] for name, column in arrays.items()}

    def _read(self, data: bytes) -> int:
        rows = self._layout.rows(deserialised(data, self._type))
        found = [self._checked(row) for row in rows]
        for row, (numbers, texts) in zip(rows, found, strict=True):
            self._rows.extend(numbers if len(self._chosen) == len(numbers) else [numbers[i] for i in self._chosen])
            if self._stamped:
                stamp = row.header.stamp
                self._stamps.append((stamp.sec * 1_000_000_000 + stamp.nanosec - self._start_ns) * 1e-9)
            for name, text in texts.items():
                known = self._texts[name]
                self._text_numbers[name].append(known.setdefault(text, len(known)))
        return len(rows)

    def _checked(self, row: Any) -> tuple[tuple[float, ...], dict[str, str]]:
        """The numbers and texts of a row (ValueError when they do not fit to the columns)."""
        texts = {name: self._layout.texts[name](row) for name in self._texts}
        widths, numbers = self._layout.widths(row), self._layout.numbers(row)
        if len(numbers) != sum(widths.values()):
            raise ValueError("it names a joint twice")
        if not self._times:
            self._choose(row)
        elif widths != self._widths:
            raise ValueError("its joints are others than those of the first message")
        return numbers, texts

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


def _xyzw(turn: Any) -> tuple[float, float, float, float]:
    return turn.x, turn.y, turn.z, turn.w


def _odometry(message: Any) -> tuple[float, ...]:
    pose, twist = message.pose.pose, message.twist.twist
    return *_xyz(pose.position), *_xyzw(pose.orientation), *_xyz(twist.linear), *_xyz(twist.angular)


def _wrench(message: Any) -> tuple[float, ...]:
    return *_xyz(message.wrench.force), *_xyz(message.wrench.torque)


def _frame(name: str) -> str:
    if len(name) > LONGEST_FRAME:
        raise ValueError(f"its frame has more than {LONGEST_FRAME} characters")
    return name


_JOINT_QUANTITIES = ("position", "velocity", "effort")


def _joints(message: Any) -> tuple[float, ...]:
    return tuple(chain(*(getattr(message, quantity).tolist() for quantity in _told(message))))


def _joint_widths(message: Any) -> dict[str, int]:
    if message is None:
        return {}
    return {f"{name}.{quantity}": 1 for quantity in _told(message) for name in message.name}


def _told(message: Any) -> list[str]:
    """Quantities with a number for each joint; others may belong to any of them (`messages.joint_commands`)."""
    return [quantity for quantity in _JOINT_QUANTITIES if len(getattr(message, quantity)) == len(message.name)]


_ODOMETRY = {"position": 3, "orientation": 4, "linear_velocity": 3, "angular_velocity": 3}
_LAYOUTS = {
    "std_msgs/msg/Float64": _Layout(lambda message: {"value": 1}, lambda message: (message.data,), stamped=False),
    "nav_msgs/msg/Odometry": _Layout(lambda message: _ODOMETRY, _odometry),
    "std_msgs/msg/String": _Layout(lambda message: {}, lambda message: (), stamped=False,
                                   texts={"text": lambda message: message.data}),
    "geometry_msgs/msg/WrenchStamped": _Layout(lambda message: {"force": 3, "torque": 3}, _wrench,
                                               texts={"frame": lambda message: _frame(message.header.frame_id)}),
    "sensor_msgs/msg/Imu": _Layout(
        lambda message: {"acceleration": 3, "angular_velocity": 3, "acceleration_variance": 3,
                         "angular_velocity_variance": 3},
        lambda message: (*_xyz(message.linear_acceleration), *_xyz(message.angular_velocity),
                         *message.linear_acceleration_covariance[::4], *message.angular_velocity_covariance[::4])),
    "sensor_msgs/msg/BatteryState": _Layout(
        lambda message: {"voltage": 1, "current": 1}, lambda message: (message.voltage, message.current)),
    "geometry_msgs/msg/PoseWithCovarianceStamped": _Layout(
        lambda message: {"position": 3, "variance": 3},
        lambda message: (*_xyz(message.pose.pose.position), *message.pose.covariance[:15:7])),
    "sensor_msgs/msg/JointState": _Layout(_joint_widths, _joints),
    "tf2_msgs/msg/TFMessage": _Layout(
        lambda row: {"translation": 3, "rotation": 4},
        lambda row: (*_xyz(row.transform.translation), *_xyzw(row.transform.rotation)),
        texts={"frame": lambda row: _frame(row.header.frame_id), "child": lambda row: _frame(row.child_frame_id)},
        rows=lambda message: message.transforms),
}
