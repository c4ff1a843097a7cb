"""Turn the messages of one topic into columns of numbers."""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import accumulate, chain
from typing import Any

import numpy as np

from vibro_ros.bag.cdr import deserialised

LONGEST_FRAME = 1000
"""Characters of a frame's name; the array of all names takes as much for each message as the longest one."""


def readable_types() -> frozenset[str]:
    """Names of the message types that a `Series` can hold."""
    return frozenset(_LAYOUTS)


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
        ROS type, one of `readable_types`.
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
        arrays = self._arrays()
        if self._ascending:
            return arrays
        order = np.argsort(arrays["time"], kind="stable")
        return {name: column[order] for name, column in arrays.items()}

    def _arrays(self) -> dict[str, np.ndarray]:
        arrays = {"time": _as_array(self._times)}
        if self._stamped:
            arrays["stamp"] = _as_array(self._stamps)
        if self._framed:
            arrays["frame"] = np.array(list(self._frames), dtype=str)[_as_array(self._frame)]
        rows = _as_array(self._rows).reshape(len(self._times), len(self._chosen))
        end = 0
        for name, width in self._kept.items():
            end += width
            arrays[name] = rows[:, end - 1] if width == 1 else rows[:, end - width:end]
        return arrays

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
        self._kept = {name: width for name, width in self._widths.items() if self._wants(name)}
        starts = dict(zip(self._widths, accumulate(self._widths.values(), initial=0), strict=False))
        self._chosen = [starts[name] + i for name, width in self._kept.items() for i in range(width)]

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


def _joints(message: Any) -> tuple[float, ...]:
    joints = len(message.name)
    return tuple(chain(*(getattr(message, quantity)[:joints].tolist() for quantity in _JOINT_QUANTITIES)))


_JOINT_QUANTITIES = ("position", "velocity", "effort")


def _joint_widths(message: Any) -> dict[str, int]:
    if message is None:
        return {}
    return {f"{name}.{quantity}": 1 for quantity in _JOINT_QUANTITIES
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
