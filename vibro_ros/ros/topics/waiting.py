"""Commands and operations that have arrived and wait for the stepping thread."""

from collections import deque
from collections.abc import Iterable
from itertools import chain, count
from operator import itemgetter
from threading import Lock
from typing import Any

MOST_WAITING = 100
"""Commands of one topic that wait. A command costs the device 30 to 70 us, so that those of the three topics together
delay a tick by 20 ms at most, a fifth of what `rate.max_catch_up` makes good unless told otherwise."""


class Waiting:
    """A bounded line for each topic, in one order of arrival; one thread adds, another takes.

    Where a line is full the new command displaces its oldest. All that wait take effect at the same instant, one after
    the other, and of one topic the last one stands: so it is the last that must not be lost, neither to older ones nor
    to a flood on another topic.

    Parameters
    ----------
    names : iterable of str
        The lines.
    most : int
        Length of a line.

    Attributes
    ----------
    dropped : int
        Messages that were displaced.
    """

    def __init__(self, names: Iterable[str], most: int = MOST_WAITING):
        self.dropped = 0
        self._most = most
        self._arrivals = count()
        self._lock = Lock()
        self._lines: dict[str, deque[tuple[int, str, Any]]] = {name: deque() for name in names}

    def is_full(self, name: str) -> bool:
        """Whether the next one would displace the oldest of its line."""
        return len(self._lines[name]) >= self._most

    def add(self, name: str, data: Any) -> None:
        """Put a message, or what was asked for, at the end of its line."""
        line = self._lines[name]
        with self._lock:
            if len(line) == self._most:
                line.popleft()
                self.dropped += 1
            line.append((next(self._arrivals), name, data))

    def take(self) -> list[tuple[str, Any]]:
        """Everything that waits, with its line's name, in the order of arrival."""
        if not any(self._lines.values()):  # as before most ticks; what comes at this moment waits for the next one
            return []
        with self._lock:
            taken = sorted(chain.from_iterable(self._lines.values()), key=itemgetter(0))
            for line in self._lines.values():
                line.clear()
        return [(name, data) for _, name, data in taken]
