"""Another vendor's DDS, without ROS: a process with Cyclone DDS commands the robot and reads its odometry."""

import json
from pathlib import Path

import pytest
from nav_msgs.msg import Odometry
from operated_robot import stop
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import Reader
from std_msgs.msg import Float64

pytest.importorskip("cyclonedds", reason="cyclonedds, of the extra `test`, is installed by `make test`")

SPEED = 100.0  # rad/s
MOVED = 0.005  # m, backwards, before the test is content


def test_it_commands_the_robot_and_reads_the_odometry_that_the_bag_holds(udp_only, start, bench, tmp_path):
    """Afterwards the peer is killed, which the robot does not notice."""
    peer = start(str(Path(__file__).with_name("cyclone_peer.py")), repr(SPEED))
    robot = start("robot")
    bench.spin_until(lambda: peer.ended or (peer.lines and json.loads(peer.lines[-1])[3] < -MOVED), "the body's way")
    assert not peer.ended, peer.text
    peer.kill()
    sent, published = recorded(tmp_path / stop(robot))
    assert sent == [SPEED]
    for stamp, *rest in map(json.loads, peer.lines):
        assert published[stamp] == rest


def recorded(bag: Path) -> tuple[list[float], dict[int, list]]:
    """Return the commands [rad/s] in a bag, and frames, x [m] and forward velocity [m/s] of its odometry by stamp [ns].
    """
    commands, samples = [], {}
    with Reader(bag) as reader:
        for connection, _, data in reader.messages():
            if connection.topic == "/motor_speed":
                commands.append(deserialize_message(bytes(data), Float64).data)
            if connection.topic == "/odom":
                one = deserialize_message(bytes(data), Odometry)
                samples[one.header.stamp.sec * 10**9 + one.header.stamp.nanosec] = [
                    one.header.frame_id, one.child_frame_id, one.pose.pose.position.x, one.twist.twist.linear.x]
    return commands, samples
