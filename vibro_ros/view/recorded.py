"""What a recording says of a motion: samples of its quantities, impacts, and what the robot was told."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from vibro_ros.bag.reader import Arrays
from vibro_ros.bag.robot_topics import robot_topics
from vibro_ros.bag.series import Series
from vibro_ros.bag.stream import BagStream
from vibro_ros.messages.fields import JOINTS, PLATES
from vibro_ros.messages.topics import CHECKPOINT, INPUTS, ROBOT_TOPICS

MOST_SAMPLES = 1_000_000
"""Samples of a topic that are read, an hour and a half at 200 Hz: more than a page can show."""
MOST_INPUTS = 200_000
"""Commands, operations and checkpoints that are read, and impacts."""

#: Where a quantity stands: name of the column, part of it, sign.
Columns = dict[str, tuple[str, int | None, float]]
#: What a message says of quantities, by topic: name of the quantity, column of the topic, part of the column and sign.
#: A position's velocity stands beside it: with it, what was between the samples is known better.
_BODY: dict[str, Columns] = {
    "odom": {"body_position": ("position", 0, 1.0), "body_height": ("position", 2, 1.0),
             "body_velocity": ("linear_velocity", 0, 1.0), "body_vertical_velocity": ("linear_velocity", 2, 1.0)},
    "ground_contact": {"normal_force": ("force", 2, 1.0), "friction_force": ("force", 0, -1.0)},
    "motor_power": {"motor_power": ("value", None, 1.0)}}
_COLUMNS = {"odom": ("position", "linear_velocity", "stamp"), "joint_states": ("*",),
            "ground_contact": ("force", "stamp"), "motor_power": ("value",), "impacts": ("stamp", "frame", "force")}
STATE = ("odom", "joint_states")
"""Topics that say where everything is."""

#: Says which share of the work is done, from 0 to 1.
Progress = Callable[[float], object]


class Input(NamedTuple):
    """What the robot was told, or a checkpoint: recorded stamp [ns], the robot's own name of the topic, message."""

    stamp: int
    name: str
    data: bytes


class Track(NamedTuple):
    """A quantity at the instants at which it was recorded [s], ascending, and its rate there if that was, too."""

    times: np.ndarray
    values: np.ndarray
    rates: np.ndarray | None


class Recorded:
    """The robot's samples in a bag.

    Parameters
    ----------
    stream : BagStream
        The bag.
    progress : callable
        Is told how far reading is.

    Attributes
    ----------
    inputs : list of Input
        In the order of recording.
    cut_short : bool
        Whether more was recorded than is read.
    arrays : dict of str to Arrays
        Samples by the robot's own names of the topics; times count from the bag's first message.
    """

    def __init__(self, stream: BagStream, progress: Progress):
        self._stream, self.topics = stream, robot_topics(stream)
        self.inputs: list[Input] = []
        self.cut_short = False
        self.arrays: dict[str, Arrays] = {}
        self._read(STATE, progress)

    def _read(self, wanted: tuple[str, ...], progress: Progress) -> None:
        """Read the samples of some topics and, with those of the state, the inputs."""
        names = {self.topics[name]: name for name in wanted if name in self.topics}
        told = {self.topics[name]: name for name in (*INPUTS, CHECKPOINT) if name in self.topics}
        series = {topic: Series(ROBOT_TOPICS[name], self._stream.start, _COLUMNS[name])
                  for topic, name in names.items()}
        told = told if wanted == STATE else {}
        read = {**dict.fromkeys(names, 0), **dict.fromkeys(told, 0)}
        most = {**dict.fromkeys(names, MOST_SAMPLES), **dict.fromkeys(told, MOST_INPUTS)}
        total = max(1, sum(self._stream.topics[topic].messages for topic in read if topic in self._stream.topics))
        for number, (topic, stamp, data) in enumerate(self._stream.messages(frozenset(read))):
            if number % 1000 == 0:
                progress(min(1.0, number / total))
            if read[topic] == most[topic]:
                self.cut_short = True
                break
            if topic in told:
                self.inputs.append(Input(stamp, told[topic], bytes(data)))
            else:
                self._append(series[topic], topic, read[topic], stamp, data)
            read[topic] += 1
        self.arrays |= {name: series[topic].arrays() for topic, name in names.items() if read[topic]}

    def _append(self, series: Series, topic: str, index: int, stamp: int, data: bytes) -> None:
        try:
            series.append(stamp, data)
        except ValueError as error:
            self._stream.unreadable.add(topic, index, stamp, error)

    def read_forces(self, progress: Progress) -> None:
        """Read the other topics as well, which only an interpolated motion needs."""
        self._read(("ground_contact", "motor_power", "impacts"), progress)

    def tracks(self, times_of: Callable[[Arrays], np.ndarray]) -> dict[str, Track]:
        """Every recorded quantity; `times_of` gives the instants [s] of a topic's samples."""
        found: dict[str, Track] = {}
        for topic, columns in self._columns():
            arrays = self.arrays[topic]
            times, first = np.unique(times_of(arrays), return_index=True)
            values = {name: _column(arrays, *column)[first] for name, column in columns.items()}
            for name, of_name in values.items():
                finite = np.isfinite(of_name)
                rates = values.get(RATES.get(name, ""))
                if rates is not None:
                    finite &= np.isfinite(rates)
                found[name] = Track(times[finite], of_name[finite], None if rates is None else rates[finite])
        return found

    def _columns(self) -> Iterator[tuple[str, Columns]]:
        """Topics that were read, and where their quantities stand in the arrays."""
        yield from ((topic, columns) for topic, columns in _BODY.items() if topic in self.arrays)
        if "joint_states" in self.arrays:
            arrays = self.arrays["joint_states"]
            yield "joint_states", {
                quantity: (f"{joint}.{part}", None, 1.0) for joint, quantities in JOINTS.items()
                for quantity, part in zip(quantities, ("position", "velocity", "effort"), strict=True)
                if f"{joint}.{part}" in arrays}

    def impacts(self) -> list[tuple[float, str, float]]:
        """Stamp [s] after the bag's first message, side and peak force [N] of each recorded impact."""
        arrays = self.arrays.get("impacts")
        if arrays is None:
            return []
        return [(float(stamp), side, float(force))
                for side, plate in zip(("upper", "inclined"), PLATES.values(), strict=True)
                for stamp, frame, force in zip(arrays["stamp"], arrays["frame"], arrays["force"][:, 2], strict=True)
                if frame.endswith(plate)]  # a prefix may stand before it


RATES = {"body_position": "body_velocity", "body_height": "body_vertical_velocity",
          **{position: velocity for position, velocity, _ in JOINTS.values()}}
"""The rate of a quantity."""


def _column(arrays: Arrays, name: str, part: int | None, sign: float) -> np.ndarray:
    column = arrays[name]
    return sign * (column if part is None else column[:, part])
