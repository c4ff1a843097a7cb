"""A recording played to ROS: commands to a live robot, all topics with the clock, and how it ends."""

import re
import signal
import subprocess
import sys

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from observation import stop
from random_run import RANGES
from rclpy.qos import DurabilityPolicy, QoSProfile
from robot_bag import rewritten
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, String

from vibro_ros.bag.reader import read_bag
from vibro_ros.bag.stream import BagStream
from vibro_ros.ros.controller import playback


@pytest.fixture
def commanded(recorded, tmp_path):
    """The recording from its first command on: a robot that has just started waits some seconds for the first one."""
    def from_first_command(messages):
        return messages[next(i for i, (topic, *_) in enumerate(messages) if topic.strip("/") in RANGES):]
    return rewritten(recorded, tmp_path / "commanded", from_first_command)


@pytest.mark.quiet
def test_commands_are_played_to_a_live_robot(commanded, start, tmp_path):
    """At three times the speed, by the installed name's own code: what arrives is what was sent, in order."""
    robot = start("robot", "--ros-args", "-p", "record.directory:=live")
    player = start("playback", str(commanded), "--rate", "3.0")
    assert player.end() == 0, player.text
    stop(robot)
    (live,) = (tmp_path / "live").iterdir()
    played, original = read_bag(live), read_bag(commanded)
    for name in RANGES:
        assert played[name]["value"].tolist() == original[name]["value"].tolist()
    sent = original["motor_speed"]["time"] / 3.0
    came = played["motor_speed"]["time"]
    # [s] at 3 times the speed; a busy machine may be late, by much less than a replay in real time would be
    assert np.abs((came - came[0]) - (sent - sent[0])).max() < 0.5


def test_all_topics_are_played_with_the_clock_and_a_signal_ends_it(recorded, start, bench):
    heard, clock = [], []
    bench.node.create_subscription(Odometry, "/odom", heard.append, QoSProfile(depth=1000), raw=True)
    bench.node.create_subscription(Clock, "/clock", clock.append, 1000)
    player = start("playback", str(recorded), "--all-topics", "--clock")
    bench.spin_until(lambda: len(heard) > 200 and len(clock) > 200, "a second of it")
    described: list[String] = []
    bench.node.create_subscription(String, "/robot_description", described.append, QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    bench.spin_until(lambda: described, "robot_description, a second after it was played")
    player.send(signal.SIGINT)
    assert player.end() == 130, player.text
    assert "Traceback" not in player.text
    with BagStream(recorded) as stream:
        sent = [bytes(data) for _, _, data in stream.messages(frozenset({"/odom"}))]
        first = sent.index(heard[0])
        assert heard == sent[first:first + len(heard)]
        times = [message.clock.sec * 10**9 + message.clock.nanosec for message in clock]
        assert times == sorted(times)
        assert stream.start <= times[0] < times[-1] <= stream.end


def test_an_abort_stops_the_motor(commanded, start, bench):
    heard = []

    def ignore(message):
        pass

    for name in RANGES:
        bench.node.create_subscription(Float64, name, heard.append if name == "motor_speed" else ignore, 100)
    player = start("playback", str(commanded))
    bench.spin_until(lambda: len(heard) > 3, "some commands")
    player.send(signal.SIGTERM)
    assert player.end() == 143, player.text
    bench.spin_until(lambda: heard[-1].data == 0.0, "the motor's stop")


@pytest.mark.parametrize(("words", "reason"), [
    (["--rate", "0"], "argument --rate: 0 is no number above 0; give one"),
    (["--rate", "fast"], "argument --rate: fast is no number above 0; give one"),
    (["--all-topics", "--wait", "2"], "--wait 2: --all-topics waits for nobody; leave one of the two out"),
    (["--nonsense"], "unrecognized arguments: --nonsense; `replay --publish --help` shows what there is"),
    (["--ros-args", "-p", "speed"], "parameter override rule: '-p speed'"),
])
def test_bad_arguments_of_a_playback_are_refused(recorded, words, reason):
    with pytest.raises(ValueError, match=re.escape(reason)):
        playback._run([str(recorded), *words])


def test_the_executable_plays_with_publish(recorded, domain_id):
    command = [sys.executable, "-m", "vibro_ros.recordings.replay", str(recorded), "--publish", "--wait", "0.2"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "replay: no robot listens to /motor_speed" in done.stderr
