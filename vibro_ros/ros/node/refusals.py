"""Messages and requests of peers that a node refuses: counted, and logged without flooding the log."""

import time
from collections.abc import Callable
from types import TracebackType

from rclpy.impl.rcutils_logger import RcutilsLogger

from vibro_ros.process.files import one_line

LONGEST_SENTENCE = 1000  # longest reason [characters] in an answer or in the log; it may quote what a peer sent
LONGEST_SHOWN = 60  # longest text of a peer [characters] that is quoted in an answer or in the log


class Refusals:
    """Counts and logs the refusals of one node.

    `count` is the number of messages and requests that were refused, `failures` that of callbacks that ended with an
    exception raised in this package's own code.
    """

    def __init__(self, log: Callable[[], RcutilsLogger]):
        self.count = 0
        self.failures = 0
        self._log = log
        self._throttles: dict[str, Throttle] = {}

    def refuse(self, name: str, reason: str) -> None:
        """Count and log the refusal of a message or request on the topic or service `name`."""
        self.count += 1
        if text := self._admitted(name, f"{name}: refused: {one_line(reason, LONGEST_SENTENCE)}"):
            self._log().warning(text)

    def catch(self, name: str, error: Exception) -> None:
        """Count and log an unexpected exception in a callback; to be called where it is caught.

        It is a refusal if rclpy raised it, as it does for a malformed request, and a failure that the user should
        report if this package's own code did.
        """
        kind = f"{type(error).__name__}: {peer_text(str(error))}"
        place = _own_place(error.__traceback__)
        if not place:
            self.refuse(name, kind)
            return
        self.failures += 1
        if text := self._admitted(name, f"{name}: failed in {place} with {kind}; please report it. The node goes on"):
            self._log().error(text)

    def _admitted(self, name: str, text: str) -> str | None:
        return self._throttles.setdefault(name, Throttle()).admit(text)


def peer_text(text: str) -> str:
    """Return a peer's `text` as one short printable line; a pair of quotes if it is empty."""
    return one_line(" ".join(text.split()), LONGEST_SHOWN) or "''"


def _own_place(traceback: TracebackType | None) -> str:
    """Return module and line of the innermost frame of this package below the one that catches; empty without one."""
    place = ""
    while traceback and (traceback := traceback.tb_next):
        module = traceback.tb_frame.f_globals.get("__name__", "")
        if module.partition(".")[0] == __package__.partition(".")[0]:
            place = f"{module}, line {traceback.tb_lineno},"
    return place


class Throttle:
    """Admits a burst of warnings, then one in each `period` [s] of the clock `now`.

    rclpy's own throttle (`throttle_duration_sec`) does not count the warnings that it drops, and has one limit for each
    line of code, while here each topic and service needs its own.
    """

    def __init__(self, burst: int = 5, period: float = 1.0, now: Callable[[], float] = time.monotonic):
        self._burst = burst
        self._period = period
        self._now = now
        self._tokens = float(burst)
        self._last = now()
        self._withheld = 0

    def admit(self, text: str) -> str | None:
        """Return `text`, with the number of warnings withheld before it, if it may be logged now; else None."""
        now = self._now()
        self._tokens = min(self._burst, self._tokens + (now - self._last) / self._period)
        self._last = now
        if self._tokens < 1.0:
            self._withheld += 1
            return None
        self._tokens -= 1.0
        withheld, self._withheld = self._withheld, 0
        return f"{text} ({withheld} more like it not shown)" if withheld else text
