"""The robot's place among the programs that want a processor: before those that need not keep time, if it may be."""

import os
from contextlib import suppress
from pathlib import Path

POLICY, PRIORITY = os.SCHED_RR, 1
"""Real time, in turn with others of that kind, and the lowest of its priorities. ros2_control asks for one likewise."""
_THREADS = Path("/proc/self/task")


def go_before_others(paced: bool) -> None:
    """Let all threads, and those that they begin, go before other programs while the robot is `paced`, and only then.

    A robot that runs as fast as it can takes all that it gets, and is to leave others their share. Nothing changes
    where the system does not allow it, nor for a user who has chosen a niceness. All threads, because they share the
    interpreter's lock: one that waits for a processor while it holds the lock would delay the others.
    """
    with suppress(OSError):
        if os.getpriority(os.PRIO_PROCESS, 0) == 0:
            policy, priority = (POLICY, PRIORITY) if paced else (os.SCHED_OTHER, 0)
            for thread in _THREADS.iterdir():
                os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))
