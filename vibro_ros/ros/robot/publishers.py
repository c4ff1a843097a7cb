"""The robot's publishers: each message that `messages.robot_messages` makes goes to ROS and to the bag, as bytes.

rclpy publishes bytes at a tenth of the cost of a message: 1.4 us a topic against 13.
"""

from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher

from vibro_ros.messages.frames import NONE
from vibro_ros.messages.robot_messages import RobotMessages
from vibro_ros.messages.topics import SAMPLES, TOPICS, full_name
from vibro_ros.model.scene import Scene
from vibro_ros.ros.node import qos
from vibro_ros.ros.robot.pacing import RobotTime
from vibro_ros.sensors.device import Measurement

Record = Callable[[str, int, bytes], None]
"""Takes a topic's resolved name, a stamp [ns] and the serialised message."""


class RobotPublishers:
    """The robot's publishers; `publishers` has them, and `topics` their resolved names, by its own names of the topics.

    The parameters are those of `RobotMessages`, but `control`: whether `robot_description` tells ros2_control how to
    command the robot. Where the type of `tf` is missing, there are no transforms, and the log says so.
    """

    def __init__(self, node: Node, scene: Scene, prefix: str = "", transforms: str = NONE,
                 variances: Sequence[Sequence[float]] = ((), ()), control: bool = False):
        if transforms != NONE:
            try:
                message_class(TOPICS["tf"].type)
            except ValueError as error:
                node.get_logger().info(f"no tf: {error}")
                transforms = NONE
        of_joints = ("joint_commands", "joint_states") if control else ()
        self._messages = RobotMessages(scene, prefix, transforms, variances,
                                       {name: node.resolve_topic_name(name) for name in of_joints})
        self.publishers: dict[str, Publisher] = {
            name: node.create_publisher(message_class(TOPICS[name].type), full_name(name), qos.profile(name))
            for name in self._messages.topics}
        self._samples = node.create_publisher(message_class(TOPICS[SAMPLES].type), full_name(SAMPLES),
                                              qos.profile(SAMPLES))
        self.topics = {name: publisher.topic_name for name, publisher in self.publishers.items()}

    def begin(self, stamp: int) -> list[tuple[str, bytes]]:
        """Publish what is said once, at ROS time `stamp` [ns]; resolved names and messages, for a bag's files."""
        once = list(self._messages.once(stamp))
        for name, data in once:
            self.publishers[name].publish(data)
        return [(self.topics[name], data) for name, data in once]

    def publish(self, values: np.ndarray, events: np.ndarray, robot_time: RobotTime, record: Record,
                measurements: Sequence[Measurement] = ()) -> None:
        """Publish and record a sample, the contacts that ended since the one before it, and the measurements.

        The other parameters are those of `RobotMessages.of_sample`. Everything is recorded at the sample's instant, so
        that the bag is in time order; an impact's and a measurement's own instant stands in its header.
        """
        stamp = robot_time.stamp
        for name, data in self._messages.of_sample(values, events, measurements, stamp, robot_time.stamp_of):
            self.publishers[name].publish(data)
            record(self.topics[name], stamp, data)
        if self._samples.get_subscription_count():
            self._samples.publish(self._messages.whole_sample(values, robot_time.start, robot_time.time))


@cache
def message_class(type_name: str) -> type:
    """The class of a type such as ``nav_msgs/msg/Odometry``.

    Raises
    ------
    ValueError
        If no package here has it; the message names the package to install.
    """
    package, _, name = type_name.partition("/msg/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError, ValueError):  # ValueError: an empty name
        raise ValueError(f"{type_name}: no such message here; install the ROS package {package}") from None
