"""A robot goes before programs that need not keep time, where the system lets it, and only a robot that keeps time does."""

import os
from pathlib import Path

import pytest

from vibro_ros.ros.priority import NICENESS


def may_step_ahead() -> bool:
    """Whether this user may; asked in a child, which cannot take it back."""
    child = os.fork()
    if child == 0:
        try:
            os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
        except OSError:
            os._exit(1)
        os._exit(0)
    return os.waitpid(child, 0)[1] == 0


def niceness_of(robot) -> set[int]:
    threads = Path(f"/proc/{robot.pid}/task").iterdir()
    return {os.getpriority(os.PRIO_PROCESS, int(thread.name)) for thread in threads}


@pytest.mark.parametrize(("words", "before", "ahead"), [
    ((), (), True), (("-p", "rate.real_time_factor:=0.0"), (), False), ((), ("nice", "-n", "3"), False)])
def test_who_keeps_time_goes_before_others(start, listener, words, before, ahead):
    robot = start("robot", "--ros-args", *words, before=before)
    listener.spin_for_samples(20)
    own = os.getpriority(os.PRIO_PROCESS, 0)
    expected = NICENESS if ahead and own == 0 and may_step_ahead() else own + (3 if before else 0)
    assert niceness_of(robot) == {expected}
