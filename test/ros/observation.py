"""What the tests do to a robot and observe of it: commands, samples, diagnostics, its end and its bags."""

import signal
import time
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from vibro_ros.messages.codec import deserialised

PERIOD = 5_000_000  # [ns] of the default 200 Hz
OBSERVED = ("odom", "joint_states", "ground_contact", "impacts", "motor_power")
COMMANDS = ("motor_speed", "upper_gap", "inclined_gap")


class Operator:
    """A node that commands the robot and keeps every serialised message that the robot publishes."""

    def __init__(self, bench, topics=OBSERVED, names: dict[str, str] | None = None):
        self.bench = bench
        self.received: dict[str, list[bytes]] = {topic: [] for topic in topics}
        names = names or {}
        kinds = {"odom": Odometry, "joint_states": JointState, "motor_power": Float64}
        for topic in topics:
            bench.node.create_subscription(kinds.get(topic, WrenchStamped), names.get(topic, topic),
                                           self.received[topic].append, QoSProfile(depth=10_000), raw=True)
        self._publishers = {name: bench.node.create_publisher(Float64, names.get(name, name), 10) for name in COMMANDS}

    def wait_for_robot(self) -> None:
        self.bench.spin_until(lambda: all(publisher.get_subscription_count() for publisher in self._publishers.values())
                              and all(messages for topic, messages in self.received.items() if topic != "impacts"),
                              "robot up")

    def command(self, **values: float) -> None:
        for name, value in values.items():
            self._publishers[name].publish(Float64(data=value))

    def odom(self) -> Odometry:
        return deserialize_message(self.received["odom"][-1], Odometry)

    def joint(self, name: str) -> tuple[float, float, float]:
        """Return position, velocity and effort from the last message."""
        message = deserialize_message(self.received["joint_states"][-1], JointState)
        index = list(message.name).index(name)
        return message.position[index], message.velocity[index], message.effort[index]

    def spin_for_samples(self, count: int) -> None:
        until = len(self.received["odom"]) + count
        self.bench.spin_until(lambda: len(self.received["odom"]) >= until, f"{count} more samples")


class Listener:
    """A subscriber that keeps the stamps [ns] of odom and the latest diagnostics by part."""

    def __init__(self, bench):
        self.bench = bench
        self.stamps: list[int] = []
        self.parts: dict[str, DiagnosticStatus] = {}
        bench.node.create_subscription(Odometry, "odom", self._receive, QoSProfile(depth=10_000), raw=True)
        bench.node.create_subscription(DiagnosticArray, "/diagnostics", self._take_status, 10)

    def _receive(self, data: bytes) -> None:
        stamp = deserialize_message(data, Odometry).header.stamp
        self.stamps.append(stamp.sec * 10**9 + stamp.nanosec)

    def _take_status(self, message: DiagnosticArray) -> None:
        self.parts |= {status.name: status for status in message.status}

    def spin_for_samples(self, count: int) -> None:
        """Receive `count` samples in addition to those already queued, which were published before the call."""
        idle, patience = 0, time.monotonic() + 5.0  # a busy machine is never idle beside 1000 samples a second
        while idle < 3 and time.monotonic() < patience:  # one of the three may hear diagnostics
            samples_before = len(self.stamps)
            self.bench.spin_once()
            idle = idle + 1 if len(self.stamps) == samples_before else 0
        until = len(self.stamps) + count
        self.bench.spin_until(lambda: len(self.stamps) >= until, f"{count} samples")

    def wait_for_status(self, part: str, condition) -> tuple[DiagnosticStatus, dict[str, str]]:
        name = f"vibro_robot: {part}"
        self.bench.spin_until(lambda: name in self.parts and condition(self.parts[name]), f"status of {part}")
        return self.parts[name], {pair.key: pair.value for pair in self.parts[name].values}


def value_of(status: DiagnosticStatus, key: str) -> float:
    return next(float(pair.value) for pair in status.values if pair.key == key)


def bags(folder: Path) -> list[Path]:
    return sorted(folder.glob("vibro_robot_*"), key=lambda path: path.stat().st_mtime_ns)


def stamps_of(folder: Path, topic: str = "/odom") -> list[int]:
    with Reader(folder) as reader:
        chosen = [connection for connection in reader.connections if connection.topic == topic]
        return [stamp for _, stamp, _ in reader.messages(chosen)]


def check_end(program, code: int = 0) -> None:
    """Check that the process ends with this exit code and without an unexpected line of output."""
    assert program.end() == code, program.text
    assert "Traceback" not in program.text and "please report" not in program.text, program.text


def stop(program, code: int = 0, number: signal.Signals = signal.SIGINT) -> None:
    """End a program as a user does."""
    program.send(number)
    check_end(program, code)


def whole_bag(robot) -> Path:
    """Return the bag of a robot that has ended normally, and check that it has every message."""
    check_end(robot)
    line = robot.wait_for("]: bag ")
    assert " 0 dropped;" in line
    return Path(line.split("]: bag ")[1].split(": ")[0])


def stop_with_whole_bag(robot, number: signal.Signals = signal.SIGINT) -> Path:
    """End the robot as a user does, and return its bag, which has every message."""
    robot.send(number)
    return whole_bag(robot)


def messages_of(folder: Path) -> dict[str, list]:
    """Return the messages by topic, read by rosbags."""
    with Reader(folder) as reader:
        messages: dict[str, list] = {connection.topic: [] for connection in reader.connections}
        for connection, _, data in reader.messages():
            messages[connection.topic].append(deserialised(bytes(data), connection.msgtype))
    return messages


def write(folder: Path, text: str) -> str:
    """Write a script of the controller into the test's folder and return its name."""
    (folder / "script.yaml").write_text(text)
    return "script.yaml"
