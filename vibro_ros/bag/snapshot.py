"""The last seconds of what would be recorded, in memory."""

from collections import deque
from threading import Lock

Message = tuple[str, int, bytes]
"""Topic, stamp [ns], serialised message."""


class Snapshot:
    """Keeps messages whose stamps lie within `span` of the latest.

    Parameters
    ----------
    span : float
        Length [s].
    """

    def __init__(self, span: float):
        self._span = round(span * 1e9)
        self._kept: deque[Message] = deque()
        self._lock = Lock()

    def write(self, topic: str, stamp: int, data: bytes) -> None:
        """Take a message; those that have become too old go."""
        with self._lock:
            self._kept.append((topic, stamp, data))
            while self._kept[0][1] < stamp - self._span:
                self._kept.popleft()

    @property
    def latest(self) -> int:
        """Stamp [ns] of the last message; 0 before the first."""
        with self._lock:
            return self._kept[-1][1] if self._kept else 0

    def messages(self) -> list[Message]:
        """What is kept now, oldest first."""
        with self._lock:
            return list(self._kept)
