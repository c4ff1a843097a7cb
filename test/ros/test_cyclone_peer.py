"""Another vendor's DDS, without ROS: a process with Cyclone DDS commands the robot and reads its odometry."""

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
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


class CyclonePeer:
    """The process `cyclone_peer.py` and what it has read of `odom`."""

    def __init__(self, speed: float):
        self.read: list[list] = []
        words = [sys.executable, str(Path(__file__).with_name("cyclone_peer.py")), repr(speed)]
        self._process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    @property
    def ended(self) -> bool:
        return self._process.poll() is not None

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()

    def _read(self) -> None:
        self.read.extend(json.loads(line) for line in iter(self._process.stdout.readline, "") if line.endswith("\n"))


@pytest.fixture
def peer(domain_id: int) -> Iterator[CyclonePeer]:
    peer = CyclonePeer(SPEED)
    yield peer
    peer.kill()


def test_it_commands_the_robot_and_reads_the_odometry_that_the_bag_holds(udp_only, start, bench, peer, tmp_path):
    """Then it dies without a word, which the robot does not notice."""
    robot = start("robot")
    bench.spin_until(lambda: peer.ended or (peer.read and peer.read[-1][3] < -MOVED), "the body moves back")
    assert not peer.ended
    peer.kill()
    sent, published = recorded(tmp_path / stop(robot))
    assert sent == [SPEED]
    assert peer.read[-1][3] < -MOVED
    assert [published[stamp] for stamp, *_ in peer.read] == [rest for _, *rest in peer.read]


def recorded(bag: Path) -> tuple[list[float], dict[int, list]]:
    """The commands [rad/s] in a bag; and frames, x [m] and forward velocity [m/s] of its odometry by stamp [ns]."""
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
