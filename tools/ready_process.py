"""Robots and other nodes as processes that a measurement starts, waits for and ends."""

import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from vibro_ros.process.stop_signals import StopRequest

LOOK = 0.1
"""Time [s] between two looks at what a process has said, and whether to stop."""


@contextmanager
def ready_process(words: Sequence[str], sleep: Callable[[float], None]) -> Iterator[subprocess.Popen]:
    """The process of `python -m` with `words`, once it has said that it is ready; what it says later goes to nobody.

    Parameters
    ----------
    words : sequence of str
        The module, and its arguments.
    sleep : callable
        Waits for a time [s], and may raise.

    Raises
    ------
    RuntimeError
        When the process ends before; the message holds what it has said.
    """
    with tempfile.NamedTemporaryFile() as said:
        child = subprocess.Popen([sys.executable, "-m", *words], stdout=said, stderr=subprocess.STDOUT)
        try:
            while "ready" not in (text := Path(said.name).read_text(errors="replace")):
                if child.poll() is not None:
                    raise RuntimeError(f"{words[0]} has ended: {text}")
                sleep(LOOK)
            yield child
        finally:
            child.send_signal(signal.SIGINT)
            child.wait()


def sleep_unless(stop: StopRequest, duration: float) -> None:
    """Wait for `duration` [s] (KeyboardInterrupt when a stop signal comes, where no process is left behind)."""
    until = time.monotonic() + duration
    while (rest := until - time.monotonic()) > 0.0:
        if stop:
            raise KeyboardInterrupt
        time.sleep(min(rest, LOOK))
