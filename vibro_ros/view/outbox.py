"""What waits to be sent to one page: bounded, so that a page that reads slowly costs no memory.

Where there is no room, samples are dropped, the oldest first: a page that comes late is to show what is now.
"""

from collections import deque
from dataclasses import dataclass

from vibro_ros.view import frames

MOST_BYTES = 2_000_000
"""Of samples that wait: 10 s at 1 kHz."""
MOST_TEXTS = 200
"""Texts that wait; a page that reads has none."""
AT_ONCE = 250_000
"""Bytes of samples in one frame."""


@dataclass(eq=False)
class _Item:
    kind: str
    data: str | bytes


class Outbox:
    """A line of frames, in the order in which they were put in.

    Attributes
    ----------
    dropped : int
        Bytes of samples that the page will never get.
    """

    def __init__(self):
        self.dropped = 0
        self._line: deque[_Item] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._line)

    def add_samples(self, rows: bytes) -> None:
        """Rows of samples, without a frame's head."""
        self._line.append(_Item("samples", rows))
        self._bytes += len(rows)
        if self._bytes > MOST_BYTES:
            self._drop_oldest("samples")

    def add_text(self, kind: str, text: str) -> None:
        """A text; one of a kind that says how things stand replaces the one that waits, and what it makes void."""
        if kind in ("robot", "absent"):  # what waits is of the time before
            self._line = deque(one for one in self._line if one.kind not in ("robot", "absent", "samples", "impacts"))
            self._bytes = 0
        elif kind == "status":
            self._line = deque(one for one in self._line if one.kind != kind)
        self._line.append(_Item(kind, text))
        if len(self._line) > MOST_TEXTS and sum(type(one.data) is str for one in self._line) > MOST_TEXTS:
            self._drop_oldest("impacts", "log", "answer", "status")

    def add_motion(self, text: str, payload: bytes) -> None:
        """A motion: its header's text and its payload's frame; one that waits is dropped."""
        self._line = deque(one for one in self._line if one.kind != "motion")
        self._line += [_Item("motion", text), _Item("motion", payload)]

    def take(self) -> str | bytes:
        """The next frame; rows that follow one another make one frame."""
        first = self._line.popleft()
        if first.kind != "samples":
            return first.data
        parts, size = [], 0
        while True:
            assert isinstance(first.data, bytes)
            parts.append(first.data)
            size += len(first.data)
            if size >= AT_ONCE or not self._line or self._line[0].kind != "samples":
                break
            first = self._line.popleft()
        self._bytes -= size
        return frames.samples(parts)

    def _drop_oldest(self, *kinds: str) -> None:
        for item in self._line:
            if item.kind in kinds:
                self._line.remove(item)
                if item.kind == "samples":
                    self._bytes -= len(item.data)
                    self.dropped += len(item.data)
                return
