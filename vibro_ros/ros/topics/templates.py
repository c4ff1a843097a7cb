"""Serialised messages that a tick fills in place: where numbers and stamp stand in them, and the kernel that writes.

Making, filling and serialising five messages takes three quarters of a tick at 1 kHz (290 us against 60, and 57 % of a
core against 18 for the whole robot); writing numbers into bytes that rclpy has made once costs next to nothing. Nothing
private of rclpy is relied on: `Template` is not given the place of a number, but lets rclpy serialise messages that
differ in one number and sees which bytes differ. So `messages.fields` stays the only place that says what is in a
message, and rclpy the only one that lays it out. The bytes before an aligned field, which rclpy leaves to chance, are
zeros here.

`checked_template` fills some messages at the start of every robot and compares them with rclpy's. Where rclpy lays a
message out in another way than is expected here, the log says so, and the robot serialises each message by rclpy.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message

from vibro_ros.bag.cdr import deserialised, first_difference, serialised
from vibro_ros.solver.compilation import entry_kernel

Make = Callable[[Sequence[float], int], Any]
"""Makes the message of some numbers and a stamp [ns]."""

AHEAD = 4
"""Bytes before a message: CDR aligns from behind its first 4 bytes, so doubles then lie at multiples of 8."""
SECOND = 1_000_000_000
"""Nanoseconds of a stamp's second."""
_DOUBLE, _WORD = 8, 4  # bytes
_MASK = 0xFFFFFFFF


class Template:
    """The bytes of a message of `type_name`, such as ``nav_msgs/msg/Odometry``, and where its numbers stand in them.

    `make` makes a message of rclpy of `count` numbers; its texts and lengths are the same for all numbers and stamps.
    ValueError when other numbers make a message of another length, or the message cannot be read.

    Attributes
    ----------
    blank : bytes
        The message of zeros, at time 0.
    doubles : list of (int, int, bool)
        Of each double: its place, counted in doubles from `AHEAD` bytes before the message; which number it is; and
        whether it is negated.
    words : list of (int, bool)
        Of each word of a stamp: its place, counted in words of 4 bytes from there; whether it holds the nanoseconds.
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
            self.doubles += [(place, which, bool(_numbers(one, "f8")[place] < 0.0))
                             for place in _changed(self.blank, one, "u8")]

    def agrees(self, filled: bytes, numbers: Sequence[float], stamp: int) -> bool:
        """Whether bytes are those that rclpy makes of numbers and stamp, but for those that belong to no field."""
        made = serialize_message(self._make(numbers, stamp))
        return len(filled) == len(made) and first_difference(filled, made, self._type_name) is None

    def _plain(self, numbers: Sequence[float], stamp: int) -> bytes:
        return plain_bytes(self._make(numbers, stamp), self._type_name)


class Sheet:
    """Serialised messages side by side, of the same numbers and the same stamp; for one thread.

    One kernel fills all of them. A tick finds next to nothing of its code in the processor's caches, because a
    millisecond has passed since the last one; so a loop of Python over messages and numbers would cost more. `messages`
    are the bytes of each message, as views of what `fill` fills, and `places` where it begins and ends in them.
    """

    def __init__(self, templates: Sequence[Template]):
        lengths = [-(-(AHEAD + len(template.blank)) // _DOUBLE) * _DOUBLE for template in templates]
        begins = np.cumsum([0, *lengths]).tolist()
        self._doubles = np.zeros(begins.pop() // _DOUBLE)
        self._words, room = self._doubles.view(np.uint32), self._doubles.view(np.uint8)
        placed = list(zip(begins, templates, strict=True))
        self._numbers = _table([(begin // _DOUBLE + place, which, negated) for begin, template in placed
                                for place, which, negated in template.doubles], 3)
        self._stamps = _table([(begin // _WORD + place, nanoseconds) for begin, template in placed
                               for place, nanoseconds in template.words], 2)
        self.places = [(begin + AHEAD, begin + AHEAD + len(template.blank)) for begin, template in placed]
        self.messages = [room[begin:end] for begin, end in self.places]
        for message, template in zip(self.messages, templates, strict=True):
            message[:] = np.frombuffer(template.blank, np.uint8)

    def fill(self, numbers: np.ndarray, stamp: int) -> None:
        """Write numbers, an array of float, and a stamp [ns] into the messages."""
        seconds, nanoseconds = divmod(stamp, SECOND)
        fill_in(numbers, self._numbers, self._stamps, seconds & _MASK, nanoseconds, self._doubles, self._words)

    def copy(self) -> bytes:
        """The bytes of all messages as they are now, and those between them."""
        return self._doubles.tobytes()


@entry_kernel
def fill_in(numbers, places, stamps, seconds, nanoseconds, doubles, words):
    """Write `numbers` and a stamp where they belong in the memory that `doubles`, of 8 bytes, and `words`, of 4, share.

    A row of `places` is a place among `doubles`, which number, and whether it is negated; one of `stamps` is a place
    among `words`, and whether the nanoseconds belong there.
    """
    for i in range(len(places)):
        number = numbers[places[i, 1]]
        doubles[places[i, 0]] = -number if places[i, 2] else number
    for i in range(len(stamps)):
        words[stamps[i, 0]] = nanoseconds if stamps[i, 1] else seconds


def checked_template(make: Make, type_name: str, count: int, warn: Callable[[str], object]) -> Template | None:
    """The template of a message of `count` numbers; None if bytes that are filled in are not those of rclpy.

    `warn` is then given the reason, in words.
    """
    # numbers that all differ and have both signs
    numbers = [(-1) ** i * (i + 1) / 3.0 for i in range(count)]
    try:
        template = Template(make, type_name, count)
        sheet = Sheet([template])
        for trial, stamp in ((numbers, 1_763_700_000_123_456_789), ([-number for number in numbers], 987_654_321)):
            sheet.fill(np.array(trial), stamp)
            if not template.agrees(sheet.messages[0].tobytes(), trial, stamp):
                raise ValueError("bytes filled in place are not those of rclpy")
    except ValueError as error:
        warn(f"{type_name}: rclpy serialises every message, which costs more: {error}")
        return None
    return template


def plain_bytes(message: Any, type_name: str) -> bytes:
    """The bytes of a message by rclpy, with zeros where bytes belong to no field: equal messages have equal bytes."""
    return serialised(deserialised(serialize_message(message), type_name), type_name)


def _numbers(data: bytes, kind: str) -> np.ndarray:
    """The message as numbers of one kind, from `AHEAD` on; what is left over at its end is not among them."""
    return np.frombuffer(bytes(AHEAD) + data, kind, (AHEAD + len(data)) // np.dtype(kind).itemsize)


def _changed(one: bytes, other: bytes, kind: str) -> list[int]:
    """Places of the numbers in which two messages differ."""
    if len(one) != len(other):
        raise ValueError(f"its length varies, {len(one)} bytes or {len(other)}")
    return np.flatnonzero(_numbers(one, kind) != _numbers(other, kind)).tolist()


def _table(rows: list, width: int) -> np.ndarray:
    return np.array(rows, dtype=np.int64).reshape(-1, width)
