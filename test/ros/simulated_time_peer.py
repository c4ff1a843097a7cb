"""A node as an author would write it for the hardware: a timer, a subscription, a command, and nothing for lock-step.
"""

import sys

import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import Float64

NAME = "simulated_time_peer"
PERIOD = 0.02  # s


class Peer(Node):
    """Commands a motor speed that depends on every digit of the latest odometry, 100 times."""

    def __init__(self):
        super().__init__(NAME)
        self._x, self._calls = 0.0, 0
        self._publisher = self.create_publisher(Float64, "motor_speed", 10)
        self.create_subscription(Odometry, "odom", self._receive, 10)
        self.create_timer(PERIOD, self._command)

    def _receive(self, message: Odometry) -> None:
        self._x = message.pose.pose.position.x

    def _command(self) -> None:
        self._publisher.publish(Float64(data=80.0 + 1000.0 * abs(self._x) % 40.0))
        self._calls += 1
        if self._calls == 100:
            sys.exit(0)


if __name__ == "__main__":
    rclpy.init()
    try:
        rclpy.spin(Peer())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
