"""The messages of a twin: measurements and commands of its robot, and what it publishes.

`RobotSubscriptions` reads measurements and commands, and refuses the rest. It polls messages as bytes, because eight
hundred messages a second would wake the executor as often. A measurement counts at its stamp, a command at its arrival.
`TwinPublishers` publishes the estimate, the innovations, the parameters, and the state of robot and twin.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64, Header

from vibro_lab.identification.noise import is_measured
from vibro_lab.identification.recording import ONE_TURN
from vibro_lab.twin.estimator import Departure, Estimate
from vibro_lab.twin.particles import INDEX, Innovation, MeasuredNumber
from vibro_ros import ACCELERATIONS, JOINTS, TOPICS, Scene, commands_in, commands_of, deserialised, of_imu
from vibro_ros.ros import GuardedNode, PollingSubscription, qos_profile

MOST_TAKEN = 2000
"""Most messages of a topic that wait, and are taken in one poll."""
LARGEST = 1e6
"""Largest magnitude of a measured value, in SI units."""
OLDEST, EARLIEST = 10.0, 1.0
"""Longest times [s] by which a stamp may be behind, and ahead of, the twin's own clock when its message arrives."""
EXACT = 1e-8
"""Variance [m²] of a tracking system that gives none: a tenth of a millimetre."""

Numbers = list[tuple[str, float, float]]
"""Quantity, value and variance of each number in a message."""


class _SensorTopic(NamedTuple):
    type: type
    read: Callable[["RobotSubscriptions", Any], Numbers]


class RobotSubscriptions:
    """The subscriptions of a twin to the sensors and commands of `scene`, the robot as it is believed to be.

    `received` counts the messages by topic; the node counts refusals. An `odom` whose variances are 0 is not used: it
    is a simulated robot's truth, or has no statement. `waited` is the time [s] between the last two polls of the
    measurements, during which messages waited for this node. `joint_noise` is the standard deviation [m] of the
    positions in `joint_states`; 0 if nobody measures them.
    """

    def __init__(self, node: GuardedNode, scene: Scene, joint_noise: float):
        self.received, self.waited, self._polled = Counter[str](), 0.0, 0
        self._node, self._scene, self._joint_noise = node, scene, joint_noise
        self._angle, self._angles, self._turns = math.nan, (math.inf, -math.inf), 0
        self._tick = (2.0 * math.pi / scene["sensors.encoder.ticks"])**2 / 12.0
        self._limit = of_imu(scene, "accelerometer.range") or math.inf
        best_effort = QoSProfile(depth=MOST_TAKEN, reliability=ReliabilityPolicy.BEST_EFFORT)  # hears every publisher
        self._sensors = {name: PollingSubscription(node, sensor.type, name, best_effort)
                         for name, sensor in SENSORS.items() if name != "joint_states" or joint_noise}
        self._commands = {name: PollingSubscription(node, JointState if name == "joint_commands" else Float64, name,
                                                    qos_profile(name)) for name in commands_of(scene)}

    def measurements(self, now: int) -> Iterator[tuple[int, MeasuredNumber]]:
        """Yield stamp [ns] and measurement, whose own time is 0, of all that has arrived; `now` is ROS time [ns]."""
        self.waited, self._polled = max(0.0, (now - (self._polled or now)) * 1e-9), now
        for name, subscription in self._sensors.items():
            for data, _ in subscription.take(MOST_TAKEN):
                try:
                    message = deserialised(data, TOPICS[name].type)
                    stamp = _checked_stamp(message.header.stamp, now, self.waited)
                    numbers = [number for number in SENSORS[name].read(self, message) if is_measured(number[2])]
                    for field, value, variance in numbers:
                        _check_number(field, value, variance)
                except ValueError as error:
                    self._node.refusals.refuse(subscription.topic, str(error))
                    continue
                self.received[name if numbers else f"{name}, without a variance"] += 1
                for field, value, variance in numbers:
                    limit = self._limit if field in ACCELERATIONS else math.inf
                    yield stamp, MeasuredNumber(0.0, field, value, variance, limit)

    def commands(self) -> Iterator[tuple[int, dict[str, float]]]:
        """Yield wall time of arrival [ns] and commands, arguments of `Simulator.command`, of all that has arrived."""
        for name, subscription in self._commands.items():
            for data, arrived in subscription.take(MOST_TAKEN):
                try:
                    given, faults = commands_in(name, deserialised(data, TOPICS[name].type), self._scene)
                    given = {command: self._scene.checked_command(command, value) for command, value in given.items()}
                except ValueError as error:
                    self._node.refusals.refuse(subscription.topic, str(error))
                    continue
                for fault in faults:
                    self._node.refusals.refuse(subscription.topic, fault)
                self.received[name] += 1
                if given:
                    yield arrived, given

    def _pose(self, pose: Any) -> Numbers:
        """Return place and height from a pose with covariance."""
        position, covariance = pose.pose.position, pose.covariance
        heights = [("body_height", position.z, covariance[14])] * self._scene.body_hops
        return [("body_position", position.x, covariance[0]), *heights] if self._scene.body_moves else heights

    def _of_odometry(self, message: Any) -> Numbers:
        velocity, covariance = message.twist.twist.linear, message.twist.covariance
        speeds = [("body_velocity", velocity.x, covariance[0])] * self._scene.body_moves
        speeds += [("body_vertical_velocity", velocity.z, covariance[14])] * self._scene.body_hops
        return [number for number in (*self._pose(message.pose), *speeds) if number[2] != 0.0]

    def _of_tracking(self, message: Any) -> Numbers:
        return [(field, value, variance or EXACT) for field, value, variance in self._pose(message.pose)]

    def _of_imu(self, message: Any) -> Numbers:
        force, variance = message.linear_acceleration, message.linear_acceleration_covariance[0]
        axes = [(ACCELERATIONS[0], force.x, variance)] * self._scene.body_moves
        return axes + [(ACCELERATIONS[1], force.z, variance)] * self._scene.body_hops

    def _of_encoder(self, message: Any) -> Numbers:
        if "crank" not in message.name or len(message.position) != len(message.name):
            raise ValueError("no position of the joint crank")
        return [("crank_angle", self._unwrapped(float(message.position[message.name.index("crank")])), self._tick)]

    def _unwrapped(self, angle: float) -> float:
        """Return the crank's angle [rad] with all its turns, also where the encoder gives it within one turn."""
        last, (low, high) = self._angle, self._angles
        self._angle, self._angles = angle, (min(low, angle), max(high, angle))
        if self._angles[1] - self._angles[0] <= ONE_TURN and abs(angle - last) > math.pi:
            self._turns -= round((angle - last) / math.tau)
        return angle + math.tau * self._turns

    def _of_joints(self, message: Any) -> Numbers:
        if len(message.position) != len(message.name):
            raise ValueError(f"{len(message.position)} positions for {len(message.name)} joints")
        parts = {f"{side}_mass" for side in self._scene.guides} | {f"{side}_plate" for side in self._scene.plates}
        return [(JOINTS[name][0], float(value), self._joint_noise**2)
                for name, value in zip(message.name, message.position, strict=True)
                if name in parts and not math.isnan(value)]


SENSORS: Mapping[str, _SensorTopic] = {
    "tracking": _SensorTopic(PoseWithCovarianceStamped, RobotSubscriptions._of_tracking),
    "odom": _SensorTopic(Odometry, RobotSubscriptions._of_odometry),
    "imu/data_raw": _SensorTopic(Imu, RobotSubscriptions._of_imu),
    "encoder": _SensorTopic(JointState, RobotSubscriptions._of_encoder),
    "joint_states": _SensorTopic(JointState, RobotSubscriptions._of_joints),
}
"""Topics of sensors by the robot's own names."""


def _checked_stamp(stamp: Any, now: int, waited: float) -> int:
    """Return a stamp [ns] (ValueError if it is far from the ROS time `now` [ns]).

    The message may have waited for this node for up to `waited` [s], which is no difference of clocks.
    """
    behind = (now - (at := 1_000_000_000 * stamp.sec + stamp.nanosec)) * 1e-9
    if not -EARLIEST <= behind <= OLDEST + waited:
        side = "behind" if behind > 0.0 else "ahead of"
        raise ValueError(f"its stamp is {abs(behind):.6g} s {side} this node's clock; let both have one clock")
    return at


def _check_number(field: str, value: float, variance: float) -> None:
    if not abs(value) <= LARGEST:
        raise ValueError(f"{field} {value:g} with variance {variance:g} is no measurement; give numbers within "
                         f"±{LARGEST:g}")


ESTIMATE, INNOVATIONS, PARAMETERS = PUBLISHED = "twin/odom", "twin/innovations", "twin/parameters"
_SECOND = 1_000_000_000  # ns
_UNKNOWN = 1e6  # variance of what the planar model leaves at 0


class TwinPublishers:
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

    def publish_step(self, stamp: int, estimate: Estimate, innovations: list[Innovation]) -> None:
        """Publish the results of a filter step at its instant, the ROS time `stamp` [ns]."""
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
        last = {innovation.field: innovation for innovation in innovations}
        self._innovations.publish(JointState(
            header=self._header(stamp), name=list(last), position=[innovation.value for innovation in last.values()],
            effort=[math.sqrt(innovation.variance) for innovation in last.values()]))
        if estimate.parameters:
            means, deviations = zip(*estimate.parameters.values(), strict=True)
            self._parameters.publish(JointState(header=self._header(stamp), name=list(estimate.parameters),
                                                position=means, effort=deviations))

    def report(self, now: int, departure: Departure | None, troubles: list[str], values: Mapping[str, str]) -> None:
        """Publish the diagnostics at ROS time `now` [ns]; `troubles` are sentences on the twin itself."""
        complaints = [*([f"the robot has left the model: {departure.words}"] if departure else []), *troubles]
        name = self._node.get_fully_qualified_name()
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if complaints else DiagnosticStatus.OK, name=f"{name.lstrip('/')}: twin",
            message=", ".join(complaints) or "the robot moves as the model", hardware_id=name,
            values=[KeyValue(key=key, value=value) for key, value in values.items()])
        self._diagnostics.publish(DiagnosticArray(header=self._header(now), status=[status]))
