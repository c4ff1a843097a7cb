"""What a twin publishes: its estimate, the innovations, the parameters, and the state of robot and twin."""

import math
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from vibro_lab.twin.estimator import Departure, Estimate
from vibro_lab.twin.particles import INDEX, Innovation
from vibro_ros.ros import qos_profile

ESTIMATE, INNOVATIONS, PARAMETERS = PUBLISHED = "twin/odom", "twin/innovations", "twin/parameters"
_SECOND = 1_000_000_000  # ns
_UNKNOWN = 1e6  # variance of what the planar model leaves at 0


class Telling:
    """The publishers of a twin; every frame's name begins with `prefix`."""

    def __init__(self, node: Node, prefix: str):
        self._node, self._prefix = node, prefix
        self._odom = node.create_publisher(Odometry, ESTIMATE, 10)
        self._innovations = node.create_publisher(JointState, INNOVATIONS, 100)
        self._parameters = node.create_publisher(JointState, PARAMETERS, 10)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics",
                                                  qos_profile("diagnostics"))

    def _header(self, stamp: int, frame: str = "") -> Header:
        header = Header(frame_id=frame and self._prefix + frame)
        header.stamp.sec, header.stamp.nanosec = divmod(stamp, _SECOND)
        return header

    def tell(self, stamp: int, estimate: Estimate, innovations: list[Innovation]) -> None:
        """Publish what a step has given, at its instant, the ROS time `stamp` [ns]."""
        message = Odometry(header=self._header(stamp, "odom"), child_frame_id=self._prefix + "base_link")
        mean, variance = ({name: float(row[k]) for name, k in INDEX.items()} for row in (
            estimate.mean, estimate.variance))
        pose, twist = message.pose, message.twist
        pose.pose.orientation.w = 1.0
        pose.pose.position.x, pose.pose.position.z = mean["body_position"], mean["body_height"]
        twist.twist.linear.x, twist.twist.linear.z = mean["body_velocity"], mean["body_vertical_velocity"]
        for part, x, z in ((pose, "body_position", "body_height"), (twist, "body_velocity", "body_vertical_velocity")):
            part.covariance[::7] = [variance[x], _UNKNOWN, variance[z], *[_UNKNOWN] * 3]
        self._odom.publish(message)
        last = {one.field: one for one in innovations}
        self._innovations.publish(JointState(
            header=self._header(stamp), name=list(last), position=[one.value for one in last.values()],
            effort=[math.sqrt(one.variance) for one in last.values()]))
        if estimate.parameters:
            means, deviations = zip(*estimate.parameters.values(), strict=True)
            self._parameters.publish(JointState(header=self._header(stamp), name=list(estimate.parameters),
                                                position=means, effort=deviations))

    def report(self, now: int, departure: Departure | None, troubles: list[str], values: Mapping[str, str]) -> None:
        """Publish the diagnostics at ROS time `now` [ns]; `troubles` are sentences on the twin itself."""
        said = [*([f"the robot has left the model: {departure.words}"] if departure else []), *troubles]
        name = self._node.get_fully_qualified_name()
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if said else DiagnosticStatus.OK, name=f"{name.lstrip('/')}: twin",
            message=", ".join(said) or "the robot moves as the model", hardware_id=name,
            values=[KeyValue(key=key, value=value) for key, value in values.items()])
        self._diagnostics.publish(DiagnosticArray(header=self._header(now), status=[status]))
