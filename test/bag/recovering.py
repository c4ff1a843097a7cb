"""Recovers the bag folders named on stdin, each in a process that is killed before a step.

The processes are forked from this one, which has imported all: a kill then hits the recovery, not its imports. Each
stops before every call that changes a file, says which, and goes on for an empty line; `stop` kills it; at the end it
says `done`. The answer is the wait status.
"""

import os
import signal
import sys
from collections.abc import Callable

from vibro_ros.recordings.recover import recover

CALLS = ("write", "ftruncate", "posix_fallocate", "fsync", "unlink", "rename", "replace", "link", "rmdir", "mkdir")


def stepped(folder: str) -> None:
    """Recover a bag, and stop before every step until the parent writes a line."""
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
        pid = os.fork()
        if not pid:
            try:
                stepped(line.rstrip("\n"))
            except BaseException:  # it must not go on as its parent
                sys.excepthook(*sys.exc_info())
                os._exit(1)
            os._exit(0)
        print(os.waitpid(pid, 0)[1], flush=True)


main()
