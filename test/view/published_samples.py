"""The robot's samples as a node of the test's own hears them, named as the quantities of the view."""

from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

QOS = QoSProfile(depth=10_000)
OF_JOINTS = {"crank": ("crank_angle", "motor_speed", "motor_torque"),
             "upper_mass": ("upper_position", "upper_velocity", "upper_drive_force"),
             "inclined_mass": ("inclined_position", "inclined_velocity", "inclined_drive_force"),
             "upper_plate": ("upper_plate_position", "upper_plate_velocity", "upper_plate_force"),
             "inclined_plate": ("inclined_plate_position", "inclined_plate_velocity", "inclined_plate_force")}


class Published:
    """Keeps every sample by its stamp [ns]."""

    def __init__(self, bench):
        self._bench = bench
        self._bodies: dict[int, dict[str, float]] = {}
        self._joints: dict[int, dict[str, float]] = {}
        bench.node.create_subscription(Odometry, "odom", self._hear_body, QOS)
        bench.node.create_subscription(JointState, "joint_states", self._hear_joints, QOS)

    @property
    def samples(self) -> dict[int, dict[str, float]]:
        """What is known of each instant of which both messages have come."""
        return {stamp: self._bodies[stamp] | self._joints[stamp] for stamp in self._bodies.keys() & self._joints.keys()}

    def hear_until(self, stamp: int) -> None:
        """Listen until a sample has come that is later [ns]."""
        self._bench.spin_until(lambda: max(self._bodies.keys() & self._joints.keys(), default=0) > stamp, "samples")

    def _hear_body(self, message: Odometry) -> None:
        position, velocity = message.pose.pose.position, message.twist.twist.linear
        self._bodies[_stamp(message)] = {"body_position": position.x, "body_height": position.z,
                                         "body_velocity": velocity.x, "body_vertical_velocity": velocity.z}

    def _hear_joints(self, message: JointState) -> None:
        found = self._joints.setdefault(_stamp(message), {})
        for name, *values in zip(message.name, message.position, message.velocity, message.effort, strict=True):
            found |= dict(zip(OF_JOINTS[name], values, strict=True))


def _stamp(message) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
