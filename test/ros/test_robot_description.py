"""robot_description: for whoever comes late, in every file of every bag, and equal when a run is computed again."""

from pathlib import Path

from observation import bags, stop
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.rosbag2 import Reader
from std_msgs.msg import String

import vibro_ros
from vibro_ros.bag.stream import BagStream
from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.urdf import robot_description
from vibro_ros.recordings import replay

TOPIC = "/robot_description"
LATE = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def descriptions(path: Path) -> list[tuple[int, str]]:
    """Recorded stamp and text of each description in a bag or in one of its files, by rosbags alone."""
    with Reader(path) as reader:
        chosen = [one for one in reader.connections if one.topic == TOPIC]
        return [(stamp, deserialised(bytes(data), "std_msgs/msg/String").data)
                for _, stamp, data in reader.messages(chosen)]


def first_stamp(path: Path) -> int:
    with Reader(path) as reader:
        return reader.start_time


def test_whoever_comes_late_hears_the_robots_own_urdf(start, bench, listener):
    changes = {"guide.angle": 1.3, "effects.upper_mass": False}
    words = [word for name, value in changes.items() for word in ("-p", f"{name}:={str(value).lower()}")]
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false", "-p", "frame_prefix:=r1/", *words)
    listener.spin_for_samples(50)
    heard: list[str] = []
    bench.node.create_subscription(String, TOPIC, lambda message: heard.append(message.data), LATE)
    bench.spin_until(lambda: heard, "robot_description")
    assert heard == [robot_description(vibro_ros.load_scene("device").with_parameters(changes))]
    stop(robot)


def test_every_file_of_every_bag_begins_with_it(start, listener, record, tmp_path):
    robot = start("robot", "--ros-args", "-p", "record.max_duration:=0.2", "-p", "motor.speed:=60.0")
    listener.spin_for_samples(100)
    record(False)
    listener.spin_for_samples(10)
    record(True)
    listener.spin_for_samples(100)
    stop(robot)
    expected = robot_description(vibro_ros.load_scene("device"))
    whole, late = bags(tmp_path)
    for folder in (whole, late):
        files = [path for path in folder.iterdir() if path.name != "metadata.yaml"]
        assert len(files) > 2
        for file in files:
            assert descriptions(file) == [(first_stamp(file), expected)]
        assert [text for _, text in descriptions(folder)] == [expected] * len(files)
        with BagStream(folder) as stream:
            counted = sum(topic.messages for topic in stream.topics.values())
            assert (stream.metadata["written"], stream.metadata["lost"]) == (str(counted), "0")
            assert stream.topics[TOPIC].transient_local and not stream.topics["/odom"].transient_local
        assert replay.main([str(folder)]) == 0
