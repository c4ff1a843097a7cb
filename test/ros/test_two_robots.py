"""Two robots in one graph: namespaces and frame prefixes keep them apart, live and in their bags."""

from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from observation import stop
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from vibro_ros.bag.reader import read_bag
from vibro_ros.recordings import replay

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


def test_each_hears_its_own_commands_and_is_known_by_its_own_names(two, bench, tmp_path):
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
