"""The robot's place among the programs that want a processor: before those that need not keep time, if it may be."""

import os
from contextlib import suppress
from pathlib import Path

NICENESS = -10
"""Of each thread. ros2_control asks for a real-time priority likewise; this one starves nobody."""
_THREADS = Path("/proc/self/task")


def step_ahead() -> None:
    """Let all threads, and those that they begin, go before other programs; nothing where the system does not let us.

    A user who has chosen another niceness knows why, and keeps it. All threads, because they share the interpreter's
    lock: one that waits for a processor while it holds the lock would delay the others.
    """
    with suppress(OSError):
        if os.getpriority(os.PRIO_PROCESS, 0) == 0:
            for thread in _THREADS.iterdir():
                os.setpriority(os.PRIO_PROCESS, int(thread.name), NICENESS)
