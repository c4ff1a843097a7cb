"""Frames on /tf and /tf_static and the URDF: live, in bags and in replays, also if tf2_msgs is missing."""

import math
import os

import pytest
from observation import bags, messages_of, stop
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from robot_bag import rewritten
from std_msgs.msg import String
from tree_of_frames import frames_of

from vibro_ros.bag.reader import read_bag
from vibro_ros.bag.stream import BagStream
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.codec import deserialised, serialised
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.messages.urdf import robot_description
from vibro_ros.recordings import replay
from vibro_ros.recordings.comparison import compare
from vibro_ros.recordings.replay import what_if

TFMessage = pytest.importorskip("tf2_msgs.msg", reason="types of tf2_msgs are not built: no compiler").TFMessage
LATE = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
LINKS = {"body", "crank", *(f"{side}_{part}" for side in ("upper", "inclined")
                            for part in ("guide", "rod", "mass", "plate"))}


def spin_for_tf(bench, topic: str, count: int) -> dict[str, str]:
    """Return the parent of each child in `count` messages of a topic."""
    heard: list = []
    bench.node.create_subscription(TFMessage, topic, heard.append, LATE if "static" in topic else 100)
    bench.spin_until(lambda: len(heard) >= count, topic)
    return {transform.child_frame_id: transform.header.frame_id
            for message in heard for transform in message.transforms}


def offered(bench, topic: str) -> list[tuple[ReliabilityPolicy, DurabilityPolicy]]:
    publishers = bench.node.get_publishers_info_by_topic(topic)
    return [(publisher.qos_profile.reliability, publisher.qos_profile.durability) for publisher in publishers]


def test_late_subscribers_get_every_frame_and_the_urdf_by_the_given_names(
        start, bench, listener, tmp_path):
    robot = start("robot", "--ros-args", "-p", "frame_prefix:=r1/", "-p", "guide.angle:=1.3", "-r", "/tf:=/lab/tf",
                  "-r", "/tf_static:=/lab/tf_static", "-p", "record.topics:=[tf, /lab/tf_static]")
    listener.spin_for_samples(50)  # whoever listens from now on is late
    parents = spin_for_tf(bench, "/lab/tf", 20) | spin_for_tf(bench, "/lab/tf_static", 1)
    assert frames_of(parents) == {f"r1/{frame}" for frame in ("odom", "base_link", *LINKS)}
    assert offered(bench, "/lab/tf") == [(ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE)]
    assert offered(bench, "/lab/tf_static") == [(ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)]
    heard: list[String] = []
    bench.node.create_subscription(String, "robot_description", heard.append, LATE)
    bench.spin_until(lambda: heard, "robot_description")
    assert heard[0].data == robot_description(load_scene("device").with_parameters({"guide.angle": 1.3}))
    stop(robot)
    (folder,) = bags(tmp_path)
    assert set(read_bag(folder).topics) == {"/lab/tf", "/lab/tf_static"}
    with BagStream(folder) as stream:
        assert compare(stream).difference is None


def test_beside_a_robot_state_publisher_only_the_base_is_published(start, bench, listener, tmp_path):
    robot = start("robot", "--ros-args", "-p", "tf.publish:=base")
    listener.spin_for_samples(20)
    assert spin_for_tf(bench, "/tf", 20) == {"base_link": "odom"}
    assert offered(bench, "/tf_static") == []
    stop(robot)
    (folder,) = bags(tmp_path)
    recorded = read_bag(folder)
    assert set(recorded["tf"]["child"]) == {"base_link"} and "/tf_static" not in recorded.topics
    assert replay.main([str(folder)]) == 0


def test_a_robot_without_optional_packages_logs_it_once_and_runs(start, listener, tmp_path,
                                                                                          monkeypatch):
    for package in (tmp_path / "shadow" / "tf2_msgs", tmp_path / "shadow" / "simulation_interfaces"):
        package.mkdir(parents=True)
        (package / "__init__.py").write_text("raise ImportError('not installed')\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path / "shadow"), os.environ["PYTHONPATH"]]))
    robot = start("robot")
    listener.spin_for_samples(20)
    stop(robot)
    (line,) = [line for line in robot.lines if "tf2_msgs" in line]
    assert "no tf: tf2_msgs/msg/TFMessage: no such message here; install the ROS package tf2_msgs" in line
    (line,) = [line for line in robot.lines if "simulation_interfaces" in line]
    assert line.endswith("]: simulation_interfaces is not installed: without its services")
    (folder,) = bags(tmp_path)
    assert "/robot_description" in read_bag(folder).topics and "/tf" not in read_bag(folder).topics
    assert replay.main([str(folder)]) == 0


@pytest.mark.process
def test_another_robot_of_the_same_commands_has_its_own_frames_and_a_moved_frame_is_found(recorded, tmp_path):
    varied, failure = what_if(recorded, {"guide.angle": 1.2})
    assert failure == "" and replay.main([str(varied)]) == 0
    (fixed,) = messages_of(varied)["/tf_static"]
    guide = next(transform for transform in fixed.transforms if transform.child_frame_id == "inclined_guide")
    assert math.isclose(2.0 * math.acos(guide.transform.rotation.w), 1.2)
    assert 'rpy="0 -1.2 0"' in messages_of(varied)["/robot_description"][0].data

    def turn(messages: list) -> list:
        seen = [i for i, (topic, *_) in enumerate(messages) if topic == "/tf"]
        topic, stamp, data = messages[seen[50]]
        message = deserialised(bytes(data), ROBOT_TOPICS["tf"])
        message.transforms[2].transform.rotation.y += 1e-15
        messages[seen[50]] = topic, stamp, serialised(message, ROBOT_TOPICS["tf"])
        return messages

    with BagStream(rewritten(recorded, tmp_path / "turned", turn)) as stream:
        difference = compare(stream).difference
    assert (difference.topic, difference.index, difference.field) == (
        "/tf", 50, "transforms[2].transform.rotation.y")
