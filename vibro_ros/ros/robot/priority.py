"""The robot's place among the programs that want a processor: before those that need not keep time, if it may be."""

import os
from contextlib import suppress
from pathlib import Path

POLICY, PRIORITY = os.SCHED_RR, 1
"""Real time, in turn with others of that kind, and the lowest of its priorities. ros2_control asks for one likewise."""
_THREADS = Path("/proc/self/task")


def find_place(factor: float, paused: bool) -> None:
    """Go before other programs while the robot keeps time at a real-time `factor` up to 1, and only then.

    A robot that is to be faster may take all the time of a processor, as does one that takes steps while it is paused.
    It is to leave their share to the program that hears its samples, and to its own thread that serves requests.

    Nothing changes where the system does not allow it, nor for a user who has chosen a niceness. It concerns all
    threads, and those that they begin, because they share the interpreter's lock: one that waits for a processor while
    it holds the lock would delay the others.
    """
    with suppress(OSError):
        if os.getpriority(os.PRIO_PROCESS, 0) == 0:
            policy, priority = (POLICY, PRIORITY) if 0.0 < factor <= 1.0 and not paused else (os.SCHED_OTHER, 0)
            for thread in _THREADS.iterdir():
                os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))
