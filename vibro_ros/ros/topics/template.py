"""Where numbers and stamp stand in the bytes of messages that differ in nothing else.

A template is not told where a number stands. It lets rclpy serialise messages that differ in one number, and sees which
bytes differ. So `messages.fields` stays the only place that says what is in a message, and rclpy the only one that lays
it out. The bytes before an aligned field, which rclpy leaves to chance, are zeros here.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message

from vibro_ros.bag.cdr import deserialised, first_difference, serialised

Make = Callable[[Sequence[float], int], Any]
"""Makes the message of some numbers and a stamp [ns]."""

AHEAD = 4
"""Bytes before a message: CDR aligns from behind its first 4 bytes, so doubles then lie at multiples of 8."""
SECOND = 1_000_000_000
"""Nanoseconds of a stamp's second."""


class Template:
    """The bytes of a message, and where its numbers stand in them.

    Parameters
    ----------
    make : callable
        Makes a message of rclpy; its texts and lengths are the same for all numbers and stamps.
    type_name : str
        Its type, such as ``nav_msgs/msg/Odometry``.
    count : int
        How many numbers `make` takes.

    Attributes
    ----------
    blank : bytes
        The message of zeros, at time 0.
    doubles : list of (int, int, bool)
        Of each double: its place, counted in doubles from `AHEAD` bytes before the message; which number it is; and
        whether it is negated.
    words : list of (int, bool)
        Of each word of a stamp: its place, counted in words of 4 bytes from there; whether it holds the nanoseconds.

    Raises
    ------
    ValueError
        When other numbers make a message of another length, or the message cannot be read.
    """

    def __init__(self, make: Make, type_name: str, count: int):
        self._make, self._type_name = make, type_name
        zeros = [0.0] * count
        self.blank = self._plain(zeros, 0)
        self.words = [(place, nanoseconds) for stamp, nanoseconds in ((SECOND, False), (1, True))
                      for place in _changed(self.blank, self._plain(zeros, stamp), "u4")]
        self.doubles: list[tuple[int, int, bool]] = []
        for which in range(count):
            one = self._plain([*zeros[:which], 1.0, *zeros[which + 1:]], 0)
            self.doubles += [(place, which, bool(_seen(one, "f8")[place] < 0.0))
                             for place in _changed(self.blank, one, "u8")]

    def agrees(self, filled: bytes, numbers: Sequence[float], stamp: int) -> bool:
        """Whether bytes are those that rclpy makes of numbers and stamp, but for those that belong to no field."""
        made = serialize_message(self._make(numbers, stamp))
        return len(filled) == len(made) and first_difference(filled, made, self._type_name) is None

    def _plain(self, numbers: Sequence[float], stamp: int) -> bytes:
        """The message by rclpy, with zeros where bytes belong to no field."""
        return plain_bytes(self._make(numbers, stamp), self._type_name)


def plain_bytes(message: Any, type_name: str) -> bytes:
    """The bytes of a message by rclpy, with zeros where bytes belong to no field: equal messages have equal bytes."""
    return serialised(deserialised(serialize_message(message), type_name), type_name)


def _seen(data: bytes, kind: str) -> np.ndarray:
    """The message as numbers of one kind, from `AHEAD` on; what is left over at its end is not among them."""
    return np.frombuffer(bytes(AHEAD) + data, kind, (AHEAD + len(data)) // np.dtype(kind).itemsize)


def _changed(one: bytes, other: bytes, kind: str) -> list[int]:
    """Places of the numbers in which two messages differ."""
    if len(one) != len(other):
        raise ValueError(f"its length varies, {len(one)} bytes or {len(other)}")
    return np.flatnonzero(_seen(one, kind) != _seen(other, kind)).tolist()
