"""A robot paced in real time takes a real-time priority where the system allows it; any other robot does not."""

import os
from pathlib import Path

from asking import answer_of, set_parameter
from std_srvs.srv import SetBool

from vibro_ros.ros.robot.pacing import POLICY, PRIORITY


def may_go_before_others() -> bool:
    """Whether this user may take the priority; tested in a child process, which ends at once."""
    child = os.fork()
    if child == 0:
        try:
            os.sched_setscheduler(0, POLICY, os.sched_param(PRIORITY))
        except OSError:
            os._exit(1)
        os._exit(0)
    return os.waitpid(child, 0)[1] == 0


def policies(robot) -> set[int]:
    return {os.sched_getscheduler(int(thread.name)) for thread in Path(f"/proc/{robot.pid}/task").iterdir()}


def test_a_robot_that_is_nice_goes_before_nobody(start, listener):
    robot = start("robot", before=("nice", "-n", "3"))
    listener.spin_for_samples(20)
    assert policies(robot) == {os.SCHED_OTHER}


def test_a_robot_that_runs_or_steps_as_fast_as_it_can_steps_back_and_paced_again_goes_before(start, bench, listener):
    robot = start("robot")
    listener.spin_for_samples(20)
    may = os.getpriority(os.PRIO_PROCESS, 0) == 0 and may_go_before_others()
    first = POLICY if may else os.SCHED_OTHER
    assert policies(robot) == {first}
    for factor in (0.0, 1.5, 1.0):
        set_parameter(bench, "rate.real_time_factor", factor)
        assert policies(robot) == {first if factor == 1.0 else os.SCHED_OTHER}
    for paused in (True, False):
        assert answer_of(bench, SetBool, "/vibro_robot/pause", data=paused).success
        assert policies(robot) == {os.SCHED_OTHER if paused else first}
