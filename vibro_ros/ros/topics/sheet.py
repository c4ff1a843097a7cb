"""Serialised messages side by side, which one kernel fills: those that a tick publishes.

A tick finds next to nothing of its code in the processor's caches, because a millisecond has passed since the last one.
So what counts is how much code it touches: one kernel is cheaper than a loop of Python over messages and numbers.
"""

from collections.abc import Callable, Sequence

import numpy as np

from vibro_ros.ros.topics.template import AHEAD, SECOND, Make, Template
from vibro_ros.solver.compilation import entry_kernel

_DOUBLE, _WORD = 8, 4  # bytes
_MASK = 0xFFFFFFFF


class Sheet:
    """Messages of the same numbers and the same stamp; for one thread.

    Parameters
    ----------
    templates : sequence of Template
        What the messages are.

    Attributes
    ----------
    places : list of (int, int)
        Where each message begins and ends in the bytes of all.
    messages : list of ndarray
        The bytes of each message, as views of what `fill` fills.
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


def _table(rows: list, width: int) -> np.ndarray:
    return np.array(rows, dtype=np.int64).reshape(-1, width)


@entry_kernel
def fill_in(numbers, places, stamps, seconds, nanoseconds, doubles, words):
    """Write numbers and a stamp where they belong.

    Parameters
    ----------
    numbers : ndarray, shape (n,)
        The numbers.
    places : ndarray of int, shape (m, 3)
        Place among `doubles`, which number, and whether it is negated.
    stamps : ndarray of int, shape (k, 2)
        Place among `words`, and whether the nanoseconds belong there.
    seconds, nanoseconds : int
        The stamp.
    doubles, words : ndarray, shapes (d,) and (2 d,)
        The same memory as numbers of 8 bytes and of 4.
    """
    for i in range(len(places)):
        number = numbers[places[i, 1]]
        doubles[places[i, 0]] = -number if places[i, 2] else number
    for i in range(len(stamps)):
        words[stamps[i, 0]] = nanoseconds if stamps[i, 1] else seconds


def checked_template(make: Make, type_name: str, count: int, warn: Callable[[str], object]) -> Template | None:
    """The template of a message of `count` numbers; None if bytes that are filled in are not those of rclpy.

    Parameters
    ----------
    make : callable
        Makes a message.
    type_name : str
        Its type.
    count : int
        How many numbers `make` takes.
    warn : callable
        Told, in words, when there is none.
    """
    try:
        template = Template(make, type_name, count)
        sheet = Sheet([template])
        for numbers, stamp in _trials(count):
            sheet.fill(np.array(numbers), stamp)
            if not template.agrees(sheet.messages[0].tobytes(), numbers, stamp):
                raise ValueError("bytes filled in place are not those of rclpy")
    except ValueError as error:
        warn(f"{type_name}: rclpy serialises every message, which costs more: {error}")
        return None
    return template


def _trials(count: int) -> list[tuple[list[float], int]]:
    """Numbers that all differ and have both signs, and stamps."""
    numbers = [(-1) ** i * (i + 1) / 3.0 for i in range(count)]
    return [(numbers, 1_763_700_000_123_456_789), ([-number for number in numbers], 987_654_321)]
