"""The robot's bags when it is killed, and when its disk is full, gone, slow or read-only."""

import contextlib
import json
import os
import random
import re
import resource
import subprocess
import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from observation import bags, stamps_of, stop

from vibro_ros.bag.reader import read_bag
from vibro_ros.recordings.recover import recover

UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
KILLS = int(os.environ.get("VIBRO_ROS_ROBOT_KILLS", "2"))  # VIBRO_ROS_ROBOT_KILLS=100 for the long version
LONGEST_LOSS = 0.1  # [s] what the recorder promises


@pytest.mark.quiet
@pytest.mark.parametrize("attempt", range(KILLS))
def test_a_killed_robot_loses_the_last_moments_and_the_next_one_tells_how_to_seal(udp_only, start, listener, tmp_path,
                                                                                  attempt):
    rate = (50.0, 1000.0)[attempt % 2]
    robot = start("robot", "--ros-args", "-p", f"rate.publish:={rate}")
    listener.spin_for_samples(1)
    end = time.monotonic() + random.uniform(0.0, 1.0)
    while time.monotonic() < end:
        listener.spin_for_samples(1)
    robot.kill()
    with contextlib.suppress(AssertionError):  # what was still on its way
        listener.bench.spin_until(lambda: False, "the rest", patience=0.3)
    (folder,) = bags(tmp_path)
    if attempt == 0:
        following = start("robot")
        assert "[WARN]" in following.wait_for(f"{folder.name}: not sealed, its robot was killed; seal it with `recover")
        following.wait_for("ready")
        stop(following)
    assert not recover(folder).was_sealed
    recorded, heard = stamps_of(folder), listener.stamps
    assert recorded == [recorded[0] + i * round(1e9 / rate) for i in range(len(recorded))]
    last = recorded[-1] if recorded else heard[0]  # one that is killed at once may lose all that it has published
    assert (heard[-1] - last) * 1e-9 <= LONGEST_LOSS
    if not recorded:
        return
    bag = read_bag(folder)
    assert json.loads(bag.metadata["parameters"])["rate.publish"] == rate
    assert (bag.metadata["scene"], bag.metadata["seed"]) == ("device", "0")
    assert recorded[0] == int(bag.metadata["start"])
    assert "exact" in bag.metadata["solver"] and bag.metadata["version"] and "numpy" in bag.metadata["platform"]


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
    assert all(len(set(b - a for a, b in zip(found, found[1:], strict=False))) == 1
               for found in (stamps_of(first), stamps_of(second)))


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


@contextlib.contextmanager
def read_only(*folders: Path):
    """Make folders read-only; for root, who ignores permissions, in another way."""
    def change(mode: int, attribute: str) -> int:
        if os.geteuid():
            for folder in folders:
                folder.chmod(mode)
            return 0
        return subprocess.run(["chattr", attribute, *map(str, folders)], capture_output=True).returncode

    if change(0o555, "+i"):
        pytest.skip("root can write to every folder of this file system: it knows no immutable ones")
    try:
        yield
    finally:
        change(0o755, "-i")


def test_a_folder_turned_read_only_is_told_once_and_recording_resumes(start, listener, record, tmp_path):
    robot = start("robot", "--ros-args", "-p", "record.max_duration:=0.5")
    listener.spin_for_samples(20)
    (first,) = bags(tmp_path)
    with read_only(tmp_path, first):
        line = robot.wait_for("not recorded: ")
        assert re.search("Permission denied|Operation not permitted", line)
        assert f"messages are there; `recover {first.name}` seals the bag for other programs" in line
        listener.spin_for_samples(50)
        done, said = record(True)
        assert not done and said.startswith("cannot record to vibro_robot_")
    assert record(True)[0]
    listener.spin_for_samples(20)
    stop(robot, code=1)
    assert robot.text.count("not recorded: ") == 1
    assert not recover(first).was_sealed
    assert len(stamps_of(first)) >= 100  # a file of 0.5 s, at 200 Hz
    assert len(stamps_of(bags(tmp_path)[-1])) >= 20
