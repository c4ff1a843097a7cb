"""The robot's bags when its disk is full, and when it is slow."""

import resource

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from observation import bags, stamps_of, stop

from vibro_ros.recordings.recover import recover

UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
@pytest.mark.quiet
def test_a_full_disk_is_told_once_and_recording_resumes_when_there_is_room(start, listener, record, tmp_path):
    robot = start("robot")
    listener.spin_for_samples(50)
    resource.prlimit(robot.pid, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))  # [bytes] no write succeeds
    line = robot.wait_for("not recorded: recording to vibro_robot_")
    assert "[ERROR]" in line and "File too large" in line and "~/record" in line
    status, values = listener.wait_for_status("recorder", lambda status: status.level == DiagnosticStatus.ERROR)
    assert "File too large" in status.message and values["fault"] == status.message
    assert int(values["lost"]) > 0 and int(values["dropped"]) > 0
    done, said = record(False)
    assert done and said.startswith("not recording: recording to vibro_robot_") and "File too large" in said
    done, said = record(True)
    assert not done and "cannot record to" in said and "File too large" in said
    (first,) = bags(tmp_path)  # nothing is left of the attempt
    resource.prlimit(robot.pid, resource.RLIMIT_FSIZE, UNLIMITED)
    assert record(True)[0]
    listener.spin_for_samples(20)
    stop(robot, code=1)
    assert len([line for line in robot.lines if "[ERROR]" in line]) == 1
    assert "0.000 s dropped in 0 stalls" in robot.lines[-2]
    assert robot.lines[-1].startswith("robot: recording to vibro_robot_")
    recover(first)
    second = bags(tmp_path)[1]
    assert len(stamps_of(first)) >= 10 and len(stamps_of(second)) >= 20
    assert all(len(set(b - a for a, b in zip(stamps, stamps[1:], strict=False))) == 1
               for stamps in (stamps_of(first), stamps_of(second)))


SLOW = """
import sys, time
from vibro_ros.bag.recorder import _Sink
from vibro_ros.ros.robot import robot
flush, stalled = _Sink.flush, []
def slow(self):  # waits for the disk as a write does: without the interpreter lock
    if not stalled and self.size > 500_000:
        stalled.append(True)
        time.sleep(2.0)
    flush(self)
_Sink.flush = slow
code = robot.main(["--ros-args", "-p", "rate.publish:=1000.0"])
print("stalled" if stalled else "never stalled")
sys.exit(code)
"""


@pytest.mark.quiet
def test_a_disk_that_stalls_for_two_seconds_costs_no_message_and_no_time(start, listener, tmp_path):
    robot = start("-c", SLOW)
    listener.spin_for_samples(2800)
    stop(robot)
    assert robot.lines[-1] == "stalled", robot.text
    assert " 0 dropped; " in robot.text and "not recorded" not in robot.text
    (folder,) = bags(tmp_path)
    recorded = stamps_of(folder)
    # a machine too busy to run the robot at all drops time, but that leaves no hole in the stamps
    assert recorded == [recorded[0] + i * 1_000_000 for i in range(len(recorded))]
    assert len(recorded) >= 2800
