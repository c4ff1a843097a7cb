"""The robot as a process of its own, commanded and observed over DDS: alone, beside another one in the same graph, and
by another vendor's DDS.
"""

import json
from collections import defaultdict
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from observation import COMMANDS, HEARD, PERIOD, Operator, messages_of, stop, stop_with_whole_bag
from rclpy.qos import QoSProfile
from recorded_bag import by_mcap, by_rosbags
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from vibro_ros.bag.reader import read_bag
from vibro_ros.recordings import replay


def raw_messages(folder: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Return stamps and bytes by topic, as two independent readers read them."""
    messages: dict[str, list] = defaultdict(list)
    for topic, stamp, data in by_rosbags(folder):
        messages[topic].append((stamp, data))
    assert by_mcap(folder) == by_rosbags(folder)
    return messages


def test_the_robot_moves_as_simulated_and_its_bag_has_every_message(start, bench, tmp_path):
    robot = start("robot", "--ros-args", "-p", "record.directory:=bags")
    operator = Operator(bench)
    operator.wait_for_robot()
    for speed in (300.0, 200.0, 100.0):  # all within one tick or two: the last must win
        operator.command(motor_speed=speed)
    operator.spin_for_samples(200)
    operator.command(upper_gap=0.0005, inclined_gap=-0.0003, motor_speed=130.0)
    operator.spin_for_samples(200)
    operator.command(motor_speed=60.0)
    operator.spin_for_samples(100)
    folder = tmp_path / stop_with_whole_bag(robot)

    recorded = raw_messages(folder)
    known = (*HEARD, *COMMANDS, "joint_commands", "robot_description", "tf_static", "tf", "vibro_robot/operations")
    assert set(read_bag(folder).topics) == {f"/{topic}" for topic in known}
    for topic, heard in operator.heard.items():
        data = [data for _, data in recorded[f"/{topic}"]]
        pieces = (data[first : first + len(heard)] for first in range(len(data) - len(heard) + 1))
        assert heard in pieces, f"{topic}: heard is not a piece of the bag, without a gap"
    bag = read_bag(folder)
    sent = [300.0, 200.0, 100.0, 130.0, 60.0], [0.0005], [-0.0003]
    assert tuple(bag[name]["value"].tolist() for name in COMMANDS) == sent
    assert abs(operator.odom().pose.pose.position.x) > 0.01  # [m]

    start_ns = recorded["/odom"][0][0]
    assert [stamp for stamp, _ in recorded["/odom"]] == [start_ns + PERIOD * i for i in range(len(recorded["/odom"]))]
    assert (bag.metadata["scene"], bag.metadata["start"]) == ("device", str(start_ns))
    assert json.loads(bag.metadata["parameters"])["upper.spring.damping"] == 2.0
    assert len(bag["impacts"]["time"]) > 10
    assert replay.main([str(folder)]) == 0  # and `test_publishers.py` says what the numbers of a message are


SPEEDS = {"r1": 90.0, "lab/r2": 60.0}
PREFIX = {"r1": "r1/", "lab/r2": "zweiter·"}


def frames_of(message) -> set[str]:
    return {message.header.frame_id, getattr(message, "child_frame_id", message.header.frame_id)}


@pytest.fixture
def two(start):
    """Start both robots, which record into the same folder."""
    robots = {name: start("robot", "--ros-args", "-r", f"__ns:=/{name}", "-p", f"frame_prefix:={PREFIX[name]}",
                          "-p", "effects.motor:=ideal") for name in SPEEDS}
    for robot in robots.values():
        robot.wait_for("ready")
    return robots


def test_robots_in_namespaces_get_their_own_commands_and_names(two, bench, tmp_path):
    frames: dict[str, set[str]] = {name: set() for name in SPEEDS}
    names: set[str] = set()
    power: dict[str, float] = {}
    bench.node.create_subscription(DiagnosticArray, "/diagnostics",
                                   lambda message: names.update(part.name for part in message.status), 10)
    for name, speed in SPEEDS.items():
        for kind, topic in ((Odometry, "odom"), (JointState, "joint_states"), (WrenchStamped, "ground_contact"),
                            (WrenchStamped, "impacts")):
            bench.node.create_subscription(
                kind, f"/{name}/{topic}", lambda message, name=name: frames[name].update(frames_of(message)),
                QoSProfile(depth=1000))
        bench.node.create_subscription(JointState, f"/{name}/joint_states",
                                       lambda message, name=name: power.update({name: message.velocity[0]}), 10)
        (publisher,) = bench.publishers({f"/{name}/motor_speed": Float64}).values()
        publisher.publish(Float64(data=speed))
    expected = {name: {PREFIX[name] + frame for frame in ("odom", "base_link", "upper_plate", "inclined_plate")}
                for name in SPEEDS}
    bench.spin_until(lambda: power == SPEEDS and frames == expected, "speeds and frames")
    bench.spin_until(lambda: len(names) == 4, "diagnostics")
    assert names == {f"{name}/vibro_robot: {part}" for name in SPEEDS for part in ("simulation", "recorder")}
    for robot in two.values():
        stop(robot)
    for name in SPEEDS:
        (bag,) = tmp_path.glob(f"vibro_robot_{name.replace('/', '_')}_2*")
        check_bag(bag, name)
    assert len(list(tmp_path.iterdir())) == 2


def check_bag(bag: Path, name: str) -> None:
    """Check that the bag has messages of its own robot only, and that a replay is identical."""
    recording = read_bag(bag)
    assert {topic for topic in recording.topics if not topic.startswith(f"/{name}/")} == {"/tf", "/tf_static"}
    assert set(recording["impacts"]["frame"]) <= {PREFIX[name] + f"{side}_plate" for side in ("upper", "inclined")}
    assert replay.main([str(bag)]) == 0


SPEED = 100.0  # rad/s
MOVED = 0.005  # m, backwards, before the test is content


def test_the_controller_commands_the_robot_and_reads_its_odometry(udp_only, start, bench, tmp_path):
    """Afterwards the peer is killed, which the robot does not notice."""
    pytest.importorskip("cyclonedds", reason="cyclonedds, of the extra `test`, is installed by `make test`")
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
