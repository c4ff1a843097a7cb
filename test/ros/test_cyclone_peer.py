"""Another vendor's DDS, without ROS: a process with Cyclone DDS commands the robot and reads its odometry."""

import json
from pathlib import Path

import pytest
from observation import messages_of, stop_with_whole_bag

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
    recorded = messages_of(tmp_path / stop_with_whole_bag(robot))
    assert [command.data for command in recorded["/motor_speed"]] == [SPEED]
    published = {sample.header.stamp.sec * 10**9 + sample.header.stamp.nanosec: [
        sample.header.frame_id, sample.child_frame_id, sample.pose.pose.position.x, sample.twist.twist.linear.x]
        for sample in recorded["/odom"]}
    for stamp, *rest in map(json.loads, peer.lines):
        assert published[stamp] == rest
