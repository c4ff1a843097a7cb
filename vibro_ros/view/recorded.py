"""Samples, impacts and inputs of a recording, and interpolation between samples where the motion is not exact."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from vibro_ros.bag.reader import COLUMNS, JOINT_QUANTITIES, STAMP, Arrays, Column, Series, numbers_at, series_of
from vibro_ros.bag.stream import BagStream, robot_topics
from vibro_ros.messages.frames import JOINTS
from vibro_ros.messages.robot_messages import PLATES
from vibro_ros.messages.topics import CHECKPOINT, INPUTS, TOPICS
from vibro_ros.simulation.samples import FIELDS, resets
from vibro_ros.simulation.validity import GAP
from vibro_ros.view.motion import Interpolated, Progress, Span, polynomials_through

MOST_SAMPLES = 1_000_000
"""Most samples of a topic that are read, an hour and a half at 200 Hz: more than a page can show."""
MOST_INPUTS = 200_000  # most messages that are read of each topic of commands, operations and checkpoints
_FASTEST = 1e100  # rad/s

UNSTAMPED = tuple(name for name, topic in TOPICS.items() if topic.numbers and not topic.frame)
"""Topics of quantities whose messages have no stamp."""

QUANTITIES = frozenset(FIELDS) - {"time"}
#: Quantity of each array of `joint_states`.
_OF_JOINTS = {f"{joint}.{part}": quantity for joint, quantities in JOINTS.items()
              for quantity, part in zip(quantities, JOINT_QUANTITIES, strict=True)}
STATE = ("odom", "joint_states")  # topics with the robot's state

DEGREE = 3
NEAR = 3e-9  # distance [s] within which instants count as equal, because stamps are rounded to nanoseconds


class Input(NamedTuple):
    """A command, an operation or a checkpoint: recorded stamp [ns], topic (its key in `TOPICS`), bytes."""

    stamp: int
    name: str
    data: bytes


class Signal(NamedTuple):
    """A recorded quantity: ascending instants [s], its values, and its rates of change if these were recorded, too."""

    times: np.ndarray
    values: np.ndarray
    rates: np.ndarray | None


class Recorded:
    """The robot's samples and inputs in a bag; `progress` is called with the share that has been read.

    `inputs` are in the order of recording. `arrays` has the samples by topic (keys of `TOPICS`); their times count from
    the bag's first message. `cut_short` says whether the end of the recording was not read.
    """

    def __init__(self, stream: BagStream, progress: Progress):
        self._stream, self.topics = stream, robot_topics(stream)
        self.inputs: list[Input] = []
        self.cut_short = False
        self.arrays: dict[str, Arrays] = {}
        self._read(STATE, progress, (*INPUTS, CHECKPOINT))

    def _read(self, sampled: tuple[str, ...], progress: Progress, inputs: tuple[str, ...] = ()) -> None:
        """Read the messages of `sampled` topics, and of the `inputs`; all by their keys in `TOPICS`."""
        names = {self.topics[name]: name for name in sampled if name in self.topics}
        input_names = {self.topics[name]: name for name in inputs if name in self.topics}
        series = {topic: Series(TOPICS[name].type, self._stream.start, columns=columns_of(name))
                  for topic, name in names.items()}
        read = dict.fromkeys([*names, *input_names], 0)
        total = max(1, sum(self._stream.topics[topic].messages for topic in read if topic in self._stream.topics))
        for number, (topic, stamp, data) in enumerate(self._stream.messages(frozenset(read))):
            if number % 1000 == 0:
                progress(min(1.0, number / total))
            if read[topic] == (MOST_INPUTS if topic in input_names else MOST_SAMPLES):
                self.cut_short = True
                break
            if topic in input_names:
                self.inputs.append(Input(stamp, input_names[topic], bytes(data)))
            else:
                try:
                    series[topic].append(stamp, data)
                except ValueError as error:
                    self._stream.unreadable.add(topic, read[topic], stamp, error)
            read[topic] += 1
        self.arrays |= {name: series[topic].arrays() for topic, name in names.items() if read[topic]}

    def read_forces(self) -> None:
        """Read the other topics, which only an interpolated motion needs."""
        self._read(("ground_contact", *UNSTAMPED, "impacts"), lambda share: None)

    def signals(self, times_of: Callable[[Arrays], np.ndarray]) -> dict[str, Signal]:
        """Return every recorded quantity; `times_of` returns the instants [s] of a topic's samples."""
        signals: dict[str, Signal] = {}
        parts = [(topic, part) for topic, arrays in self.arrays.items() for part in series_of(arrays)]
        for topic, arrays in parts:
            if topic == "impacts":
                continue
            times, first = np.unique(times_of(arrays), return_index=True)
            negated = {field[1:] for field in TOPICS[topic].numbers.values() if field.startswith("-")}
            values = {name: (-column if name in negated else column)[first] for name, column in (
                (_OF_JOINTS.get(array, array), column) for array, column in arrays.items()) if name in QUANTITIES}
            for name, of_name in values.items():
                finite = np.isfinite(of_name)
                rates = values.get(RATES.get(name, ""))
                if rates is not None:
                    finite &= np.isfinite(rates)
                signals[name] = Signal(times[finite], of_name[finite], None if rates is None else rates[finite])
        return signals

    def impacts(self) -> list[tuple[float, str, float]]:
        """Return stamp [s] from the bag's first message, side and peak force [N] of each recorded impact."""
        arrays = self.arrays.get("impacts")
        if arrays is None:
            return []
        return [(float(stamp), side, float(force))
                for side, plate in zip(("upper", "inclined"), PLATES.values(), strict=True)
                for stamp, frame, force in zip(arrays["stamp"], arrays["frame"], arrays["force"][:, 2], strict=True)
                if frame.endswith(plate)]  # after the robot's frame_prefix


def columns_of(topic: str) -> dict[str, Column]:
    """Return the columns to read of a topic: the fields of a sample in its messages, with signs as in the message."""
    numbers = {field.lstrip("-"): numbers_at(path) for path, field in TOPICS[topic].numbers.items()}
    if not numbers:
        return dict(COLUMNS[TOPICS[topic].type])
    return {**numbers, "stamp": STAMP} if TOPICS[topic].frame else numbers


RATES = {"body_position": "body_velocity", "body_height": "body_vertical_velocity",
         **{position: velocity for position, velocity, _ in JOINTS.values()}}
"""Rate of change of each position, as a quantity."""


def interpolate(signals: Mapping[str, Signal], names: Sequence[str], span: Span,
                resets: Sequence[float]) -> Interpolated:
    """Interpolate between the samples in a `span` [s]: borders [s], shape (p, 2), and Chebyshev coefficients (SI).

    The coefficients have the shape (p, names, DEGREE + 1), and are NaN for quantities that were not recorded. There is
    no piece across the instants [s] of `resets`, nor across gaps.
    """
    # The instants of the first signal with samples are used, because all topics have the same rate.
    times = next((signal.times for signal in signals.values() if len(signal.times) > 1), np.empty(0))
    longest = _longest(times)
    times = times[(times >= span[0] - NEAR) & (times <= span[1] + NEAR)]
    borders = np.column_stack([times[:-1], times[1:]])
    after = np.searchsorted(np.sort(np.array(resets)), borders + NEAR)
    borders = np.clip(borders[(np.diff(times) <= longest) & (after[:, 0] == after[:, 1])], *span)
    borders = borders[np.diff(borders)[:, 0] > NEAR]
    if not names:
        return borders, np.empty((len(borders), 0, DEGREE + 1))
    return borders, polynomials_through(
        borders, lambda instants: np.stack([_at(signals.get(name), instants) for name in names], axis=2), DEGREE + 1)


def reset_instants(crank: Signal) -> list[float]:
    """Return the instants [s] of the first samples after resets; without recorded speeds, the crank turns forwards."""
    speeds = np.full(len(crank.times), _FASTEST) if crank.rates is None else crank.rates
    return crank.times[1:][resets(crank.times, crank.values, speeds)].tolist()


def _longest(times: np.ndarray) -> float:
    """Return the longest pause [s] between neighbouring samples that is no gap."""
    return GAP * float(np.median(np.diff(times))) if len(times) > 1 else 0.0


def _at(signal: Signal | None, instants: np.ndarray) -> np.ndarray:
    """Interpolate a quantity at instants [s], same shape; NaN beyond its samples and in its gaps."""
    if signal is None or len(signal.times) < 2:
        return np.full(instants.shape, np.nan)
    times, values, rates = signal
    left = np.clip(np.searchsorted(times, instants, side="right") - 1, 0, len(times) - 2)
    pause = times[left + 1] - times[left]
    s = (instants - times[left]) / pause
    step = values[left + 1] - values[left]
    value = values[left] + s * step
    if rates is not None:  # cubic Hermite: the correction of the straight line by the rates
        value += s * (1.0 - s) * ((1.0 - s) * (rates[left] * pause - step) - s * (rates[left + 1] * pause - step))
    known = (s >= 0.0) & (s <= 1.0) & (pause <= _longest(times))
    return np.where(known, value, np.nan)
