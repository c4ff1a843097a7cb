"""The robot's samples from the bytes of their messages, whoever has sent these.

What a robot of a known scene publishes on a topic differs from sample to sample in numbers and stamp alone, and
`Template` has found by trial where in the bytes these stand. So a message is read there, many at once, once all its
other bytes have been compared with the robot's. A message that another library or another byte order wrote is brought
into the robot's form first; one with other frames or joints is no sample of this robot.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibro_ros.bag.cdr import deserialised, serialised
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.model.scene import Scene
from vibro_ros.ros.topics.publishers import sample_makers
from vibro_ros.ros.topics.templates import AHEAD, SECOND, Make, Template
from vibro_ros.simulation.samples import FIELDS

STAMPED = ("odom", "joint_states", "ground_contact")
"""Topics that together have every sample's numbers, each with the sample's stamp."""
MOST_ODD = 40
"""Messages in another form that are looked at in one batch, a thousand a second: each costs a hundred times as much as
one in the robot's form."""


class Readings(NamedTuple):
    """What a batch of one topic's messages says.

    Attributes
    ----------
    stamps : ndarray of int, shape (n,)
        ROS time [ns].
    values : ndarray, shape (n, fields)
        Numbers, in the order of `Decoder.fields`.
    chosen : list of int
        Which messages of the batch they are from.
    """

    stamps: np.ndarray
    values: np.ndarray
    chosen: list[int]


class Decoder:
    """Reads one topic of a robot.

    Parameters
    ----------
    type_name : str
        Type of the topic.
    make : callable
        Makes the message of the values of all `FIELDS` and a stamp.

    Attributes
    ----------
    fields : list of int
        Which of `FIELDS` the messages have.

    Raises
    ------
    ValueError
        When such messages have no fixed form.
    """

    def __init__(self, type_name: str, make: Make):
        template = Template(make, type_name, len(FIELDS))
        self._type_name, self._blank = type_name, np.frombuffer(template.blank, np.uint8)
        places = {which: (place, -1.0 if negated else 1.0) for place, which, negated in template.doubles}
        self.fields = sorted(places)
        self._places = [places[which][0] for which in self.fields]
        self._signs = np.array([places[which][1] for which in self.fields])
        self._seconds, self._nanoseconds = ([place for place, nanoseconds in template.words if nanoseconds is wanted]
                                            for wanted in (False, True))
        self._room = -(-(AHEAD + len(self._blank)) // 8) * 8
        fixed = np.ones(self._room, bool)
        fixed[:AHEAD] = fixed[AHEAD + len(self._blank):] = False
        for size, found in ((8, self._places), (4, [*self._seconds, *self._nanoseconds])):
            for place in found:
                fixed[place * size:(place + 1) * size] = False
        self._fixed = np.flatnonzero(fixed)
        self._expected = self._blank[self._fixed - AHEAD]

    def read(self, messages: Sequence[bytes]) -> Readings:
        """What of the messages is of the robot; the others are left out."""
        size = len(self._blank)
        plain = [number for number, data in enumerate(messages) if len(data) == size]
        stamps, values, good = self._read(b"".join(messages[number] for number in plain))
        first = Readings(stamps[good], values[good], [plain[i] for i in np.flatnonzero(good)])
        if len(first.chosen) == len(messages):
            return first
        return _joined(first, self._read_odd(messages, set(range(len(messages))).difference(first.chosen)))

    def _read_odd(self, messages: Sequence[bytes], numbers: set[int]) -> Readings:
        """What of the messages with these numbers is of the robot, in another form."""
        formed = {}
        for number in sorted(numbers)[:MOST_ODD]:
            try:
                data = serialised(deserialised(messages[number], self._type_name), self._type_name)
            except ValueError:
                continue
            if len(data) == len(self._blank):
                formed[number] = data
        stamps, values, good = self._read(b"".join(formed.values()))
        kept = [number for number, taken in zip(formed, good, strict=True) if taken]
        return Readings(stamps[good], values[good], kept)

    def _read(self, data: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stamps, values, and which are good, of messages of the right length side by side."""
        bytes_of = np.frombuffer(data, np.uint8).reshape(-1, len(self._blank))
        room = np.zeros((len(bytes_of), self._room), np.uint8)
        room[:, AHEAD:AHEAD + len(self._blank)] = bytes_of
        words = room.view("<u4")
        seconds = words[:, self._seconds[0]].astype("<i4").astype(np.int64)
        nanoseconds = words[:, self._nanoseconds[0]].astype(np.int64)
        values = room.view("<f8")[:, self._places] * self._signs
        good = (room[:, self._fixed] == self._expected).all(axis=1) & np.isfinite(values).all(axis=1)
        good &= (seconds >= 0) & (nanoseconds < SECOND)
        return seconds * SECOND + nanoseconds, values, good


def decoders(scene: Scene, prefix: str) -> dict[str, Decoder]:
    """A decoder for each of `STAMPED`, for a robot of this scene whose frames' names begin with `prefix`."""
    made = sample_makers(scene, prefix)
    return {topic: Decoder(ROBOT_TOPICS[topic], made[topic]) for topic in STAMPED}


def _joined(one: Readings, other: Readings) -> Readings:
    """Both, in the order of the messages."""
    chosen = [*one.chosen, *other.chosen]
    order = np.argsort(chosen)
    return Readings(np.concatenate([one.stamps, other.stamps])[order],
                    np.concatenate([one.values, other.values])[order], [chosen[i] for i in order])
