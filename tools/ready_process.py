"""Robots and other nodes as processes that a measurement starts, waits for and ends."""

import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def ready_process(words: Sequence[str]) -> Iterator[subprocess.Popen]:
    """The process of `python -m` with `words`, once it has said that it is ready; what it says later goes to nobody.

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
                time.sleep(0.1)
            yield child
        finally:
            child.send_signal(signal.SIGINT)
            child.wait()
