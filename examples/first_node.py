"""Let the robot crawl for some distance, then stop its motor: listens to `odom` and commands `motor_speed`."""

import rclpy
from nav_msgs.msg import Odometry
from rclpy.node import Node
from std_msgs.msg import Float64


class FirstNode(Node):
    def __init__(self):
        super().__init__("first_node")
        self.distance = self.declare_parameter("distance", 0.2).value  # m
        self.start = None  # m, where the body was when the first message came
        self.arrived = rclpy.Future()
        self.motor = self.create_publisher(Float64, "motor_speed", 10)
        self.create_subscription(Odometry, "odom", self.on_odometry, 10)

    def on_odometry(self, message):
        x = message.pose.pose.position.x  # m
        self.start = x if self.start is None else self.start
        near = abs(x - self.start) < self.distance
        self.motor.publish(Float64(data=100.0 if near else 0.0))  # rad/s
        if not near and abs(message.twist.twist.linear.x) < 0.001:  # m/s
            self.get_logger().info(f"stopped after {x - self.start:+.3f} m")
            self.arrived.set_result(True)


if __name__ == "__main__":
    rclpy.init()
    node = FirstNode()
    rclpy.spin_until_future_complete(node, node.arrived)
    rclpy.try_shutdown()
