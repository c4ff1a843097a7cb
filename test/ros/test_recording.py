"""The robot's bags: on request, with some topics only, in small files, each of which begins with the robot's URDF; and
when the disk is full or slow.
"""

import re
import resource
import time
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from observation import bags, messages_of, stamps_of, stop
from rosbags.rosbag2 import Reader

import vibro_ros
from vibro_ros.bag.folders import locked
from vibro_ros.bag.metadata import defined
from vibro_ros.bag.reader import read_bag
from vibro_ros.bag.recorder import BagWriter, Storage
from vibro_ros.bag.stream import BagStream
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.messages.urdf import robot_description
from vibro_ros.recordings import replay
from vibro_ros.recordings.recover import recover
from vibro_ros.ros.robot.recording import Plan, Recording, handle_unsealed_bags, plan_recording
from vibro_ros.ros.robot.run import RobotPublishers

DESCRIPTION = "/robot_description"
SETTINGS = {parameter.name: parameter.default for parameter in DEVICE_PARAMETERS}


@pytest.fixture
def topics(bench):
    """Topics that a robot records."""
    return plan_recording(SETTINGS, topics_of_a_robot(bench), {}).topics


def topics_of_a_robot(bench) -> dict[str, str]:
    """Return the resolved names of a robot's topics."""
    return RobotPublishers(bench.node, vibro_ros.Scene()).topics | {name: f"/{name}" for name in COMMAND_UNITS}


def test_recording_is_sealed_and_begun_on_request_and_every_file_begins_with_the_urdf(
        start, listener, record, tmp_path):
    robot = start("robot", "--ros-args", "-p", "record.max_duration:=0.2", "-p", "motor.speed:=60.0")
    listener.spin_for_samples(100)
    done, said = record(True)
    assert done and said.startswith("already recording to vibro_robot_")
    done, said = record(False)
    assert done and re.fullmatch(r"sealed vibro_robot_\S+: \d+ messages, 0 dropped", said)
    (first,) = bags(tmp_path)
    assert first.name in said
    assert f": {sum(topic.messages for topic in read_bag(first).topics.values())} messages" in said
    assert record(False) == (True, "not recording")
    status, _ = listener.wait_for_status("recorder", lambda status: status.message == "not recording")
    assert status.level == DiagnosticStatus.OK
    listener.spin_for_samples(20)
    done, said = record(True)
    assert done and said.startswith("recording to vibro_robot_")
    listener.spin_for_samples(100)
    stop(robot)
    earlier, last = bags(tmp_path)
    assert earlier == first and f"bag {last.name}: " in robot.lines[-1]
    gap = stamps_of(last)[0] - stamps_of(first)[-1]
    assert gap >= 20 * 5_000_000  # [ns] the samples between
    expected = robot_description(vibro_ros.load_scene("device"))
    for folder in (first, last):
        files = [path for path in folder.iterdir() if path.name != "metadata.yaml"]
        assert len(files) > 2
        for file in files:
            with Reader(file) as reader:
                assert stamps_of(file, DESCRIPTION) == [reader.start_time]
            assert [message.data for message in messages_of(file)[DESCRIPTION]] == [expected]
        with BagStream(folder) as stream:
            counted = sum(topic.messages for topic in stream.topics.values())
            assert (stream.metadata["written"], stream.metadata["lost"]) == (str(counted), "0")
        assert replay.main([str(folder)]) == 0


@pytest.mark.parametrize("wrong, reason", [
    ({"record.topics": ("odmo",)}, "record.topics: 'odmo' is not a topic of the robot; choose from odom, joint_states"),
    ({"record.topics": ()}, "record.topics: [] names no topic; give [all], some of odom, joint_states"),
    ({"record.max_size": 5.0}, "record.max_size: 5 is too small; give 0 for no limit, or at least 100000 bytes"),
], ids=["topic", "no topic", "size"])
def test_impossible_recordings_are_refused(bench, wrong, reason):
    with pytest.raises(ValueError, match=re.escape(reason)):
        plan_recording(SETTINGS | wrong, topics_of_a_robot(bench), {})


def test_unsealed_bags_are_sealed_on_request(bench, topics, tmp_path, monkeypatch):
    folder = tmp_path / "vibro_robot_1"
    writer = BagWriter(folder, defined(topics), {}, Storage())
    writer.write(topics[0].name, 1, bytes(100))
    writer.flush()
    handle_unsealed_bags(tmp_path, True, bench.node.get_logger())
    assert not (folder / "metadata.yaml").exists()  # it is in use
    writer.abandon()
    handle_unsealed_bags(tmp_path, False, bench.node.get_logger())
    assert not (folder / "metadata.yaml").exists()
    said = []
    log = SimpleNamespace(warning=said.append, error=said.append)
    with locked(folder), monkeypatch.context() as patch:  # another robot that starts at once seals it
        patch.setattr("vibro_ros.ros.robot.recording.unsealed_bags", lambda *_: [folder])
        handle_unsealed_bags(tmp_path, True, log)
    assert said == []
    handle_unsealed_bags(tmp_path, False, log)
    assert said[0].startswith(f"{folder}: not sealed, its robot was killed; seal it with `recover")
    handle_unsealed_bags(tmp_path, True, bench.node.get_logger())
    assert stamps_of(folder, topics[0].name) == [1]


def test_a_caller_begins_one_bag_a_second_at_most(bench, topics, tmp_path):
    with Recording(Plan(tmp_path, topics, Storage(), {}), bench.node.get_logger()) as recording:
        began = time.monotonic()
        while time.monotonic() < began + 1.5:
            recording.switch(True)
            recording.switch(False)
        took = time.monotonic() - began
    assert 5 <= len(bags(tmp_path)) <= 5 + took


UNLIMITED = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
@pytest.mark.quiet
def test_a_full_disk_is_logged_once_and_recording_resumes_when_there_is_room(start, listener, record, tmp_path):
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
