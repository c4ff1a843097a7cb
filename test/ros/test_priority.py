"""A robot paced in real time takes a real-time priority where the system allows it; any other robot does not."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from asking import answer_of, set_parameter
from observation import stop
from std_srvs.srv import SetBool

from vibro_ros.ros.robot.pacing import NICENESS, POLICY, PRIORITY, PRIORITY_REMEDY

BUSY, CROWDED = 15, 10.0  # busy processes, and the time [s] beside them
STARTED = os.getpriority(os.PRIO_PROCESS, 0)  # niceness of the tests; a robot takes no priority if it is not 0
REFUSED = ("setpriv", "--bounding-set=-sys_nice", "--inh-caps=-sys_nice")  # starts a program as most containers do


def may_go_before_others() -> bool:
    """Whether a robot may take the priority; tested in a child process, which ends at once."""
    if STARTED:
        return False
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


def test_a_robot_started_with_a_niceness_keeps_it(start, listener):
    robot = start("robot", wrapper=("nice", "-n", "3"))
    listener.spin_for_samples(20)
    assert policies(robot) == {os.SCHED_OTHER}


def test_only_a_robot_paced_in_real_time_has_priority(start, bench, listener):
    robot = start("robot")
    listener.spin_for_samples(20)
    first = POLICY if may_go_before_others() else os.SCHED_OTHER
    assert policies(robot) == {first}
    for factor in (0.0, 1.5, 1.0):
        set_parameter(bench, "rate.real_time_factor", factor)
        assert policies(robot) == {first if factor == 1.0 else os.SCHED_OTHER}
    for paused in (True, False):
        assert answer_of(bench, SetBool, "/vibro_robot/pause", data=paused).success
        assert policies(robot) == {os.SCHED_OTHER if paused else first}


def test_the_first_stall_names_how_to_allow_the_priority(start, listener):
    robot = start("robot", wrapper=REFUSED if may_go_before_others() else ())
    listener.spin_for_samples(20)
    assert policies(robot) == {os.SCHED_OTHER}
    robot.send(signal.SIGSTOP)
    time.sleep(0.5)  # the stall itself
    robot.send(signal.SIGCONT)
    remedy = f"run in time; {'' if STARTED else PRIORITY_REMEDY}leave it a core, or raise rate.max_catch_up"
    assert remedy in robot.wait_for("stalled: ")
    stop(robot)


def test_without_the_policy_an_unpaused_robot_gets_a_lower_niceness():
    """Where `ulimit -e` allows it; the policy is refused as in a group of processes without real-time budget."""
    program = """
import os, threading
from vibro_ros.ros.robot.pacing import set_real_time_priority
def refuse(*_):
    raise PermissionError
threading.Thread(target=threading.Event().wait, daemon=True).start()
allowed = os.sched_setscheduler
for paused in (False, True):
    os.sched_setscheduler = allowed if paused else refuse
    set_real_time_priority(1.0, paused)
    print(*{os.getpriority(os.PRIO_PROCESS, int(thread)) for thread in os.listdir("/proc/self/task")})
"""
    levels = subprocess.run([sys.executable, "-c", program], check=True, text=True, capture_output=True).stdout
    assert levels.split() == [str(NICENESS if may_go_before_others() else STARTED), str(STARTED)]


@pytest.mark.quiet
def test_beside_fifteen_busy_processes_a_robot_keeps_its_clock(start, listener):
    """Where the priority is refused, the robot says at its first stall how to allow it; another test proves this."""
    robot = start("robot", "--ros-args", "-p", "rate.publish:=200.0", "-p", "motor.speed:=100.0")
    listener.spin_for_samples(20)
    crowd = [subprocess.Popen(["timeout", str(2.0 * CROWDED), "sh", "-c", "while :; do :; done"]) for _ in range(BUSY)]
    try:
        time.sleep(CROWDED)
    finally:
        for process in crowd:
            process.terminate()
            process.wait()
    stop(robot)
    dropped = float(robot.wait_for(" s dropped in ").split(" simulated, ")[1].split(" s dropped")[0])
    assert dropped <= 0.01 * CROWDED or not may_go_before_others()
