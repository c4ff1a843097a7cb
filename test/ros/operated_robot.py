"""An operator who commands a robot and receives its messages, and the normal end of a robot."""

import signal
from pathlib import Path

from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from observation import whole_bag
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

PERIOD = 5_000_000  # [ns] of the default 200 Hz
HEARD = ("odom", "joint_states", "ground_contact", "impacts", "motor_power")
COMMANDS = ("motor_speed", "upper_gap", "inclined_gap")


class Operator:
    """A node that commands the robot and keeps every serialised message that the robot publishes."""

    def __init__(self, bench, topics=HEARD, names: dict[str, str] | None = None):
        self.bench = bench
        self.heard: dict[str, list[bytes]] = {topic: [] for topic in topics}
        names = names or {}
        kinds = {"odom": Odometry, "joint_states": JointState, "motor_power": Float64}
        for topic in topics:
            bench.node.create_subscription(kinds.get(topic, WrenchStamped), names.get(topic, topic),
                                           self.heard[topic].append, QoSProfile(depth=10_000), raw=True)
        self._publishers = {name: bench.node.create_publisher(Float64, names.get(name, name), 10) for name in COMMANDS}

    def wait_for_robot(self) -> None:
        self.bench.spin_until(lambda: all(publisher.get_subscription_count() for publisher in self._publishers.values())
                              and all(self.heard[topic] for topic in self.heard if topic != "impacts"), "robot up")

    def command(self, **values: float) -> None:
        for name, value in values.items():
            self._publishers[name].publish(Float64(data=value))

    def odom(self) -> Odometry:
        return deserialize_message(self.heard["odom"][-1], Odometry)

    def joint(self, name: str) -> tuple[float, float, float]:
        """Return position, velocity and effort from the last message."""
        message = deserialize_message(self.heard["joint_states"][-1], JointState)
        index = list(message.name).index(name)
        return message.position[index], message.velocity[index], message.effort[index]

    def spin_for_samples(self, count: int) -> None:
        until = len(self.heard["odom"]) + count
        self.bench.spin_until(lambda: len(self.heard["odom"]) >= until, f"{count} more samples")


def stop(robot, number: signal.Signals = signal.SIGINT) -> Path:
    """End the robot as a user does, and return its bag."""
    robot.send(number)
    return whole_bag(robot)
