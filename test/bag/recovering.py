"""Recovers the bag folders named on stdin, each in a process that is killed at an instant or before a step.

The processes are forked from this one, which has imported all: a kill then hits the recovery, not its imports.

A line is `KILL FOLDER SECONDS`, or `STEP FOLDER`: then the process stops before every call that changes a file, says
which, and goes on for an empty line; `stop` kills it; at the end it says `done`. The answer to both is the wait status.
"""

import os
import signal
import sys
import time
from collections.abc import Callable
from functools import partial

from vibro_ros.bag.recovery import recover
from vibro_ros.recordings import recover as executable

CALLS = ("write", "ftruncate", "posix_fallocate", "fsync", "unlink", "rename", "replace", "link", "rmdir", "mkdir")


def forked(body: Callable[[], object]) -> int:
    """Process id of a process that does `body` and ends."""
    pid = os.fork()
    if pid:
        return pid
    try:
        body()
    except BaseException:  # it must not go on as its parent
        sys.excepthook(*sys.exc_info())
        os._exit(1)
    os._exit(0)


def silent(folder: str) -> None:
    """The executable, as one starts it; what it says goes nowhere."""
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    executable.main([folder])


def stepped(folder: str) -> None:
    """Recover and stop before every step."""
    for name in CALLS:
        setattr(os, name, _stepped(getattr(os, name)))
    recover(folder)
    print("done", flush=True)


def _stepped(call: Callable) -> Callable:
    def wait(*arguments, **options):
        print(call.__name__, flush=True)
        if sys.stdin.readline() == "stop\n":
            os.kill(os.getpid(), signal.SIGKILL)
        return call(*arguments, **options)
    return wait


def main() -> None:
    for line in sys.stdin:
        word, folder, *seconds = line.rstrip("\n").split("\t")
        pid = forked(partial(stepped if word == "STEP" else silent, folder))
        if word == "KILL":
            time.sleep(float(seconds[0]))
            os.kill(pid, signal.SIGKILL)
        print(os.waitpid(pid, 0)[1], flush=True)


main()
