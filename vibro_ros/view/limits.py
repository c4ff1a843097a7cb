"""How much one page may ask: a number of messages a second, and a number of bad ones before its connection ends."""

import time
from collections.abc import Callable

RATE = 20.0
"""Messages a second that a page may send."""
BURST = 40.0
"""Messages that it may send at once after a rest."""
MOST_STRIKES = 100
"""Messages that were too many or meant nothing, after which a page is sent away; good ones make up for them."""


class Allowance:
    """The allowance of one connection.

    Parameters
    ----------
    now : callable
        The clock [s].

    Attributes
    ----------
    strikes : float
        Messages that were refused lately, dimensionless.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic):
        self.strikes = 0.0
        self._now, self._last, self._tokens = now, now(), BURST

    @property
    def over(self) -> bool:
        """Whether the connection is to end."""
        return self.strikes > MOST_STRIKES

    def admits(self) -> bool:
        """Whether a message that has come now may be looked at."""
        now = self._now()
        self._tokens = min(BURST, self._tokens + (now - self._last) * RATE)
        self._last = now
        if self._tokens < 1.0:
            self.strikes += 1.0
            return False
        self._tokens -= 1.0
        self.strikes = max(0.0, self.strikes - 0.1)
        return True

    def strike(self) -> None:
        """Count a message that meant nothing."""
        self.strikes += 1.0
