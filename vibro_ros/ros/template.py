"""The bytes of a message that differs from sample to sample in numbers and stamp alone: made once, filled each time.

A template is not told where a number stands. It lets rclpy serialise messages of samples that differ in one number, and
sees which bytes differ. So `messages.fields` stays the only place that says what is in a message, and rclpy the only
one that lays it out. The bytes before an aligned field, which rclpy leaves to chance, are zeros here.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message

from vibro_ros.bag.cdr import deserialised, first_difference, serialised
from vibro_ros.simulation.samples import Samples

Make = Callable[[Samples, int], Any]
"""Makes the message of a sample and a stamp [ns]."""
Serialise = Callable[[Samples, int], bytes]
"""Makes the bytes of this message."""

_NUMBERS = tuple(field.name for field in fields(Samples))
_SECOND = 1_000_000_000  # ns
_AHEAD = bytes(4)  # before a message: CDR aligns from behind its first 4 bytes, so doubles then lie at multiples of 8
_WORD = 0xFFFFFFFF


class Template:
    """The bytes of one topic's messages; for one thread.

    Parameters
    ----------
    make : callable
        Makes a message of rclpy; its texts and lengths are the same for every sample and stamp.
    type_name : str
        Its type, such as ``nav_msgs/msg/Odometry``.

    Raises
    ------
    ValueError
        When another sample makes a message of another length, or the message cannot be read.
    """

    def __init__(self, make: Make, type_name: str):
        self._make, self._type_name = make, type_name
        blank = self._plain(_sample(), 0)
        room = memoryview(bytearray(_AHEAD + blank))
        self._message = room[len(_AHEAD):]
        self._doubles, self._words = room[:len(room) // 8 * 8].cast("d"), room[:len(room) // 4 * 4].cast("I")
        self._seconds = _changed(blank, self._plain(_sample(), _SECOND), "u4")
        self._nanoseconds = _changed(blank, self._plain(_sample(), 1), "u4")
        self._same: list[tuple[int, str]] = []
        self._negated: list[tuple[int, str]] = []
        for name in _NUMBERS:
            one = self._plain(_sample(**{name: 1.0}), 0)
            for place in _changed(blank, one, "u8"):
                (self._negated if _seen(one, "f8")[place] < 0.0 else self._same).append((place, name))

    def fill(self, state: Samples, stamp: int) -> bytes:
        """Return the serialised message of a sample and a stamp [ns]."""
        doubles, words = self._doubles, self._words
        for place, name in self._same:
            doubles[place] = getattr(state, name)
        for place, name in self._negated:
            doubles[place] = -getattr(state, name)
        seconds, nanoseconds = divmod(stamp, _SECOND)
        for place in self._seconds:
            words[place] = seconds & _WORD
        for place in self._nanoseconds:
            words[place] = nanoseconds
        return bytes(self._message)

    def agrees(self, state: Samples, stamp: int) -> bool:
        """Whether `fill` gives the bytes of rclpy, but for those that belong to no field."""
        filled, made = self.fill(state, stamp), serialize_message(self._make(state, stamp))
        return len(filled) == len(made) and first_difference(filled, made, self._type_name) is None

    def _plain(self, state: Samples, stamp: int) -> bytes:
        """The message by rclpy, with zeros where bytes belong to no field."""
        made = serialize_message(self._make(state, stamp))
        return serialised(deserialised(made, self._type_name), self._type_name)


def serialiser(make: Make, type_name: str, warn: Callable[[str], object]) -> Serialise:
    """The cheapest way to the bytes of a topic's messages: a template; where it fails, rclpy for every message.

    Parameters
    ----------
    make : callable
        Makes a message.
    type_name : str
        Its type.
    warn : callable
        Told, in words, when it is not the template.
    """
    try:
        template = Template(make, type_name)
        if all(template.agrees(*trial) for trial in _trials()):
            return template.fill
        reason = "bytes filled in place are not those of rclpy"
    except ValueError as error:
        reason = str(error)
    warn(f"{type_name}: rclpy serialises every message, which costs more: {reason}")
    return lambda state, stamp: serialize_message(make(state, stamp))


def _sample(**numbers: float) -> Samples:
    """A sample of zeros but for `numbers`."""
    return Samples(**{**dict.fromkeys(_NUMBERS, 0.0), **numbers})


def _trials() -> list[tuple[Samples, int]]:
    """Samples in which every number is another and has both signs, and stamps."""
    numbers = {name: (-1) ** i * (i + 1) / 3.0 for i, name in enumerate(_NUMBERS)}
    return [(_sample(**numbers), 1_763_700_000_123_456_789),
            (_sample(**{name: -number for name, number in numbers.items()}), 987_654_321)]


def _seen(data: bytes, kind: str) -> np.ndarray:
    """The message as numbers of one kind, from `_AHEAD` on; what is left over at its end is not among them."""
    return np.frombuffer(_AHEAD + data, kind, (len(_AHEAD) + len(data)) // np.dtype(kind).itemsize)


def _changed(one: bytes, other: bytes, kind: str) -> list[int]:
    """Places of the numbers in which two messages differ."""
    if len(one) != len(other):
        raise ValueError(f"its length varies, {len(one)} bytes or {len(other)}")
    return np.flatnonzero(_seen(one, kind) != _seen(other, kind)).tolist()
