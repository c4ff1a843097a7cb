"""What peers send and a node cannot take: counted, and said without flooding the log."""

import time
from collections.abc import Callable
from types import TracebackType

from rclpy.impl.rcutils_logger import RcutilsLogger

from vibro_ros.process.files import one_line

LONGEST_SENTENCE = 1000
"""Characters of a sentence that an answer or the log gives as a reason, whatever of a peer's is in it."""
LONGEST_SHOWN = 60
"""Characters of a peer's text that are repeated to it or to the log."""


class Refusals:
    """The refusals of one node.

    `count` are the messages and requests that were refused, `failures` the callbacks that ended with an error of this
    package's own.
    """

    def __init__(self, log: Callable[[], RcutilsLogger]):
        self.count = 0
        self.failures = 0
        self._log = log
        self._throttles: dict[str, Throttle] = {}

    def refuse(self, name: str, reason: str) -> None:
        """Count what came under `name` (a topic's, a service's) and was refused, and say why."""
        self.count += 1
        if text := self._admitted(name, f"{name}: refused: {one_line(reason, LONGEST_SENTENCE)}"):
            self._log().warning(text)

    def catch(self, name: str, error: Exception) -> None:
        """Count what raised an `error` that nobody foresaw, and say its kind, where it is caught.

        It is a refusal if rclpy raised it, as it does for a request that it cannot take, and a failure to be reported
        if this package's own code did.
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
    """A peer's `text` as it can be shown: one printable line, not too long, with quotes when it is empty."""
    return one_line(" ".join(text.split()), LONGEST_SHOWN) or "''"


def _own_place(traceback: TracebackType | None) -> str:
    """Module and line of the innermost frame of this package below the one that catches; nothing without one."""
    place = ""
    while traceback and (traceback := traceback.tb_next):
        module = traceback.tb_frame.f_globals.get("__name__", "")
        if module.partition(".")[0] == __package__.partition(".")[0]:
            place = f"{module}, line {traceback.tb_lineno},"
    return place


class Throttle:
    """Lets a short burst of warnings through, then one for each `period` [s] of the clock `now`.

    rclpy's own throttle (`throttle_duration_sec`) does not count what it leaves out, and knows a warning by its line of
    code, where each topic and each peer here has a limit of its own.
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
