"""Warnings that tell without flooding the log.

rclpy's own throttle (`throttle_duration_sec`) counts nothing: who reads the log would not learn how many warnings it
left out. It also knows a warning by its line of code, where each topic and each peer here has a limit of its own.
"""

import time
from collections.abc import Callable


class Throttle:
    """Lets a short burst of warnings through, then one for each `period`.

    Parameters
    ----------
    burst : int
        Warnings let through at once.
    period : float
        Time [s] after which one more is let through.
    now : callable
        The clock [s].
    """

    def __init__(self, burst: int = 5, period: float = 1.0, now: Callable[[], float] = time.monotonic):
        self._burst = burst
        self._period = period
        self._now = now
        self._tokens = float(burst)
        self._last = now()
        self._withheld = 0

    def admit(self, text: str) -> str | None:
        """`text`, with the number of those withheld before it, if it may be said now; else None."""
        now = self._now()
        self._tokens = min(self._burst, self._tokens + (now - self._last) / self._period)
        self._last = now
        if self._tokens < 1.0:
            self._withheld += 1
            return None
        self._tokens -= 1.0
        withheld, self._withheld = self._withheld, 0
        return f"{text} ({withheld} more like it not shown)" if withheld else text
