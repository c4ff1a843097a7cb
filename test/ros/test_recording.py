"""The robot's bags during a run: on request, with some topics only, in small files; each file begins with the robot's
URDF.
"""

import re
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
from vibro_ros.ros.robot.recording import Plan, offer_recovery, open_recording, plan_recording
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


def test_recording_is_sealed_and_begun_on_request_and_every_file_of_every_bag_begins_with_the_urdf(
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
def test_recordings_that_cannot_be_are_refused(bench, wrong, reason):
    with pytest.raises(ValueError, match=re.escape(reason)):
        plan_recording(SETTINGS | wrong, topics_of_a_robot(bench), {})


def test_bags_left_unsealed_are_sealed_if_the_robot_is_told_to(bench, topics, tmp_path, monkeypatch):
    folder = tmp_path / "vibro_robot_1"
    writer = BagWriter(folder, defined(topics), {}, Storage())
    writer.write(topics[0].name, 1, bytes(100))
    writer.flush()
    offer_recovery(tmp_path, True, bench.node.get_logger())
    assert not (folder / "metadata.yaml").exists()  # it is in use
    writer.abandon()
    offer_recovery(tmp_path, False, bench.node.get_logger())
    assert not (folder / "metadata.yaml").exists()
    said = []
    log = SimpleNamespace(warning=said.append, error=said.append)
    with locked(folder), monkeypatch.context() as patch:  # another robot that starts at once seals it
        patch.setattr("vibro_ros.ros.robot.recording.unsealed_bags", lambda *_: [folder])
        offer_recovery(tmp_path, True, log)
    assert said == []
    offer_recovery(tmp_path, False, log)
    assert said[0].startswith(f"{folder}: not sealed, its robot was killed; seal it with `recover")
    offer_recovery(tmp_path, True, bench.node.get_logger())
    assert stamps_of(folder, topics[0].name) == [1]


def test_a_caller_begins_one_bag_a_second_at_most(bench, topics, tmp_path):
    with open_recording(Plan(tmp_path, topics, Storage(), {}), False, bench.node.get_logger()) as recording:
        began = time.monotonic()
        while time.monotonic() < began + 1.5:
            recording.switch(True)
            recording.switch(False)
        took = time.monotonic() - began
    assert 5 <= len(bags(tmp_path)) <= 5 + took
