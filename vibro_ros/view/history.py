"""The last seconds of a live robot's samples, for slow motion."""

from collections import deque

import numpy as np

from vibro_ros.view.frames import COLUMNS
from vibro_ros.view.requests import MOST_SECONDS

STAMP = 1e-9
"""Unit of stamps [s]: times that are nearer to each other differ by rounding."""
_TIME = COLUMNS.index("time")


class History:
    """Rows of `COLUMNS`, in the order of time; what is older than `MOST_SECONDS` is forgotten."""

    def __init__(self):
        self._parts: deque[np.ndarray] = deque()

    def clear(self) -> None:
        """Forget everything."""
        self._parts.clear()

    def add(self, rows: np.ndarray) -> None:
        """Rows that are later than all before; shape (n, len(COLUMNS)), n above 0."""
        self._parts.append(rows)
        while self._parts[0][-1, _TIME] < rows[-1, _TIME] - MOST_SECONDS:
            self._parts.popleft()

    def last(self) -> np.ndarray | None:
        """The latest row; None without any."""
        return self._parts[-1][-1] if self._parts else None

    def samples(self, seconds: float) -> dict[str, np.ndarray]:
        """Every quantity over the last `seconds` [s]; empty arrays without any rows."""
        rows = np.concatenate([np.empty((0, len(COLUMNS))), *self._parts])
        if len(rows):
            rows = rows[rows[:, _TIME] > rows[-1, _TIME] - seconds - STAMP]
        return dict(zip(COLUMNS, np.ascontiguousarray(rows.T), strict=True))
