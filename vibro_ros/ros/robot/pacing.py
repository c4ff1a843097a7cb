"""Simulated time against the wall clock: absolute deadlines, and time dropped after a stall."""

import time
from collections import deque
from collections.abc import Callable

LONGEST_SLEEP = 0.05
"""Longest single sleep [s], so that a stop is noticed however far away the deadline is."""
KEPT = 100_000
"""Most latenesses that wait for somebody to take them, the last ones: ten seconds at the highest rate."""


class Pacing:
    """Holds simulated time to `factor` times the wall clock.

    Deadlines are absolute, so sleeping too long once does not add up to drift. A lateness of at most
    `max_catch_up` is made good by ticks without sleep; after a longer stall the whole lateness is
    dropped, so that the device never bursts.

    Parameters
    ----------
    factor : float
        Simulated seconds per wall second; 0 never waits.
    max_catch_up : float
        Longest lateness [wall s] that is made good.
    now, sleep : callable
        The wall clock [s] and how to sleep on it.

    Attributes
    ----------
    factor : float
        As given, or as changed since; dimensionless.
    missed : int
        How often the next deadline had passed before anybody waited for it.
    stalls : int
        How often time was dropped.
    dropped : float
        Simulated time [s] dropped in all.
    """

    def __init__(
        self,
        factor: float,
        max_catch_up: float,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        self.missed = 0
        self.stalls = 0
        self.dropped = 0.0
        self.factor = factor
        self._max_catch_up = max_catch_up
        self._now = now
        self._sleep = sleep
        self._origin = now()
        self._lateness: deque[float] = deque(maxlen=KEPT)

    @property
    def follows_clock(self) -> bool:
        """Whether samples are due by the wall clock, not as soon as they can be had."""
        return self.factor != 0.0

    def start(self, instant: float | None = None) -> None:
        """Let simulated time 0 be an `instant` [s] of the wall clock; now unless given."""
        self._origin = self._now() if instant is None else instant

    def follow(self, simulated_time: float) -> None:
        """Let `simulated_time` [s] be now, after a pause: time that was not asked for is not late."""
        self._origin = self._now() - (simulated_time / self.factor if self.factor else 0.0)

    def change_factor(self, factor: float, simulated_time: float) -> None:
        """Go on at another factor from `simulated_time` [s], which is now."""
        self.factor = factor
        self.follow(simulated_time)

    def take_lateness(self) -> list[float]:
        """How much too late [wall s] each wait since the last call has ended; for one other thread."""
        taken, self._lateness = self._lateness, deque(maxlen=KEPT)
        return list(taken)

    def wait_until(self, simulated_time: float, stopped: Callable[[], bool] = lambda: False) -> float:
        """Sleep until `simulated_time` [s] is due, or `stopped` says so, which may also change the factor.

        Returns
        -------
        float
            Simulated time [s] dropped because the deadline passed more than `max_catch_up` ago; else 0.
        """
        if self.factor == 0.0:
            self._sleep(0.0)  # lets the executor's thread in
            return 0.0
        self.missed += self._ahead(simulated_time) < 0.0
        while (ahead := self._ahead(simulated_time)) > 0.0:
            if stopped():
                return 0.0
            self._sleep(min(ahead, LONGEST_SLEEP))
        self._lateness.append(-ahead)
        if -ahead <= self._max_catch_up:
            return 0.0
        self._origin -= ahead
        self.stalls += 1
        self.dropped += -ahead * self.factor
        return -ahead * self.factor

    def _ahead(self, simulated_time: float) -> float:
        """Wall time [s] until `simulated_time` [s] is due."""
        return self._origin + (simulated_time / self.factor if self.factor else 0.0) - self._now()
