"""Robot time on /clock, by which other nodes live in simulated time."""

from collections.abc import Callable

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from vibro_ros.ros.node import qos
from vibro_ros.ros.node.ros_time import CLOCK
from vibro_ros.ros.robot.robot_time import RobotTime
from vibro_ros.ros.topics.template import SECOND


def clock_publisher(node: Node, robot_time: RobotTime) -> Callable[[], None]:
    """What publishes the time of the last sample.

    A controller of any rate then finds every sample before the time at which it was taken, and none twice.
    """
    publisher = node.create_publisher(Clock, CLOCK, qos.CLOCK)

    def publish() -> None:
        seconds, nanoseconds = divmod(robot_time.stamp, SECOND)
        publisher.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))

    return publish
