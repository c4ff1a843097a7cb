"""How far a study is, and how long it will take."""

import math
import threading
import time
from typing import Self

from tqdm import tqdm

from vibro_ros.process.entry_point import say

_LINES = 10.0  # s between lines that say how far it is, where no bar can be drawn
_DELAY = 2.0  # s before a bar is drawn
_ALIVE = 1.5  # s between signs of life


class Progress:
    """A bar with the time that is left or, where standard error is no terminal, a line now and then; a context.

    Parameters
    ----------
    what : str
        What is done.
    unit : str
        What is counted, such as ``run``.
    total, done : int
        How many there are, and how many were done before [-].
    """

    def __init__(self, what: str, unit: str, total: int, done: int = 0):
        self._bar = tqdm(desc=what, total=total, initial=done, unit=unit, disable=None, delay=_DELAY, smoothing=0.1)
        self._what, self._unit, self._total, self._first, self._done = what, unit, total, done, done
        self._begun = self._said = time.monotonic()

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def add(self, count: int) -> None:
        """Note that `count` more are done."""
        self._done += count
        self._bar.update(count)
        now = time.monotonic()
        if self._bar.disable and now - self._said > _LINES:
            left = (now - self._begun) / (self._done - self._first) * (self._total - self._done)
            say("study", f"{self._what}: {self._done} of {self._total} {self._unit}s, "
                         f"{tqdm.format_interval(left)} left")
            self._said = now


class SignsOfLife:
    """A line on standard error every other second, however long or short the steps of the work are; a context.

    Parameters
    ----------
    what : str
        What is done.

    Attributes
    ----------
    where : str
        How far it is; empty while nothing is done.
    """

    _said = -math.inf  # s, when a line came last, of whichever step of this process

    def __init__(self, what: str):
        self._what, self.where = what, ""
        self._over = threading.Event()
        # A daemon: a stop signal that comes while the context is entered leaves nobody to end the thread.
        self._thread = threading.Thread(target=self._speak, daemon=True)

    def __enter__(self) -> Self:
        self._begun = time.monotonic()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _speak(self) -> None:
        while not self._over.wait(max(0.0, SignsOfLife._said + _ALIVE - time.monotonic())):
            SignsOfLife._said = time.monotonic()
            so_far = f"{time.monotonic() - self._begun:.0f} s so far"
            say("study", f"{self._what}: {', '.join(filter(None, [self.where, so_far]))}")
