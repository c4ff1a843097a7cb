"""Where the robot was lately, as odometry tells it: what feedback believes, and what it refuses to."""

import math
from collections import deque

WINDOW = 0.25
"""Time [s] over which a position is averaged, because the body swings with every turn of the crank."""
LEAP, FASTEST = 0.1, 5.0
"""Two samples further apart than 0.1 m and what 5 m/s makes of their time are no motion: odometry was reset."""


class Track:
    """The positions of the last `WINDOW`, from samples that follow each other in time.

    Attributes
    ----------
    position, stamp : float or None
        Mean over the window of the position [m] and of its time [s], counted from the first sample; None before it.
    heard : float or None
        When the last sample was taken over, in the caller's time [s].
    leaps : int
        How often the position leapt, and the window began anew.
    refused : int
        Samples that were refused.
    reason : str
        Why the last of them was.
    """

    def __init__(self):
        self.heard: float | None = None
        self.leaps = self.refused = 0
        self.reason = ""
        self._first: int | None = None
        self._samples: deque[tuple[float, float]] = deque()

    @property
    def position(self) -> float | None:
        """Mean position [m] of the window."""
        return math.fsum(position for _, position in self._samples) / len(self._samples) if self._samples else None

    @property
    def stamp(self) -> float | None:
        """Mean time [s] of the window."""
        return math.fsum(stamp for stamp, _ in self._samples) / len(self._samples) if self._samples else None

    def add(self, nanoseconds: int, position: float, time: float) -> None:
        """Take a sample over, or refuse it.

        Parameters
        ----------
        nanoseconds : int
            Its stamp.
        position : float
            Of the body [m].
        time : float
            The caller's time [s] now.
        """
        if not math.isfinite(position):
            self._refuse(f"a position of {position} m")
            return
        self._first = nanoseconds if self._first is None else self._first
        stamp = (nanoseconds - self._first) / 1e9
        if self._samples and stamp <= self._samples[-1][0]:
            self._refuse(f"a stamp {self._samples[-1][0] - stamp:g} s before the latest")
            return
        if self._samples and abs(position - self._samples[-1][1]) > LEAP + FASTEST * (stamp - self._samples[-1][0]):
            self.leaps += 1
            self._samples.clear()
        self.heard = time
        self._samples.append((stamp, position))
        while self._samples[0][0] < stamp - WINDOW:
            self._samples.popleft()

    def _refuse(self, reason: str) -> None:
        self.refused, self.reason = self.refused + 1, reason
