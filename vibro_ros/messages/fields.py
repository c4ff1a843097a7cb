"""What the robot's messages say of the device's state and events, for the classes of any ROS library.

Units are SI and signs REP-103's: the robot's `base_link` has x forward and z up, and moves in the frame `odom`.
The functions fill a blank message of the right type: rclpy's in the node, rosbags' where a recording is computed
again, so that both say the same by construction. A `stamp` is ROS time [ns], a `prefix` begins every frame's name.

Every number is cast with `float`: rclpy serialises an int or a numpy scalar in a float field to garbage, silently.
"""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from vibro_ros.messages.urdf import (
    BASE,
    CONTINUOUS,
    FIXED,
    FLOATING,
    IMU,
    robot_description,
    robot_joints,
    rod_angle,
    slider,
)
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import Samples

ODOM = "odom"
PLATES = {"upper_contact": "upper_plate", "inclined_contact": "inclined_plate"}
"""Frame of the plate that an event of this kind strikes."""

JOINTS = {
    "crank": ("crank_angle", "motor_speed", "motor_torque"),
    "upper_mass": ("upper_position", "upper_velocity", "upper_drive_force"),
    "inclined_mass": ("inclined_position", "inclined_velocity", "inclined_drive_force"),
    "upper_plate": ("upper_plate_position", "upper_plate_velocity", "upper_plate_force"),
    "inclined_plate": ("inclined_plate_position", "inclined_plate_velocity", "inclined_plate_force"),
}
"""Position, velocity and effort of each joint, as fields of the state.

The crank's are an angle [rad], never wrapped, its speed [rad/s] and the motor's torque [N m]. The others are
positions along their guide [m], outwards positive from the crank's centre, speeds [m/s] and forces [N]: on a mass that
of its drive (outwards positive), on a plate that of the contact (compression positive).
"""

NONE, ONLY_BASE, ALL = "none", "base", "all"
"""What of the tree is published: nothing; where `base_link` is in `odom`; that and every link."""


def stamp_at(start: int, time: float) -> int:
    """ROS time [ns] of the simulated `time` [s], where `start` is that of simulated time 0."""
    return start + round(time * 1e9)


def joints_of(scene: Scene) -> list[str]:
    """The joints that a robot of this scene has, names of `JOINTS`."""
    parts = [f"{side}_mass" for side in scene.guides] + [f"{side}_plate" for side in scene.plates]
    return [joint for joint in JOINTS if joint in ("crank", *parts)]


def fill_odometry(message: Any, state: Samples, stamp: int, prefix: str = "",
                  variances: Sequence[Sequence[float]] = ((), ())) -> None:
    """Position [m] and velocity [m/s] of the body; `variances` are the diagonals of both covariances, of 6 numbers."""
    fill_header(message.header, stamp, prefix + ODOM)
    message.child_frame_id = prefix + BASE
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x = float(state.body_position)
    pose.position.z = float(state.body_height)
    pose.orientation.w = 1.0
    twist.linear.x = float(state.body_velocity)
    twist.linear.z = float(state.body_vertical_velocity)
    for part, diagonal in zip((message.pose, message.twist), variances, strict=True):
        for index, variance in enumerate(diagonal):
            part.covariance[7 * index] = float(variance)


def fill_joint_states(message: Any, state: Samples, joints: Sequence[str], stamp: int, prefix: str = "") -> None:
    """Position, velocity and effort of `joints`, names of `JOINTS`."""
    fill_header(message.header, stamp, prefix + BASE)
    message.name = list(joints)
    message.position, message.velocity, message.effort = (
        [float(getattr(state, JOINTS[joint][which])) for joint in joints] for which in range(3))


def fill_ground_contact(message: Any, state: Samples, stamp: int, prefix: str = "") -> None:
    """Force of the ground on the body [N]: friction along x (negative: slows forward motion), normal along z."""
    fill_header(message.header, stamp, prefix + BASE)
    message.wrench.force.x = -float(state.friction_force)
    message.wrench.force.z = float(state.normal_force)


def fill_impact(message: Any, event: np.void | Mapping, stamp: int, prefix: str = "") -> None:
    """Peak force [N] of one contact, the force of the mass on the plate.

    The frame is the plate's; its z axis points along the guide, outwards from the crank (for the upper plate: up), so
    the peak force is positive. `stamp` is the first instant of contact.
    """
    fill_header(message.header, stamp, prefix + PLATES[str(event["kind"])])
    message.wrench.force.z = float(event["peak_force"])


def fill_imu(message: Any, values: np.ndarray, stamp: int, prefix: str = "") -> None:
    """Specific force [m/s²] and angular rate [rad/s], with their variances: REP-145, without an orientation."""
    fill_header(message.header, stamp, prefix + IMU)
    numbers = [float(value) for value in values]
    force, turning = message.linear_acceleration, message.angular_velocity
    force.x, force.y, force.z, turning.x, turning.y, turning.z, *variances = numbers
    message.orientation.w = 1.0
    message.orientation_covariance[0] = -1.0  # there is none
    for covariance, variance in zip((message.linear_acceleration_covariance, message.angular_velocity_covariance),
                                    variances, strict=True):
        covariance[0] = covariance[4] = covariance[8] = variance


def fill_encoder(message: Any, values: np.ndarray, stamp: int, prefix: str = "") -> None:
    """Angle [rad] and speed [rad/s] of the crank; an encoder knows no effort, which is NaN as in ros2_control."""
    fill_header(message.header, stamp, prefix + BASE)
    message.name = ["crank"]
    angle, speed = values
    message.position, message.velocity, message.effort = [float(angle)], [float(speed)], [math.nan]


def fill_battery(message: Any, values: np.ndarray, stamp: int, prefix: str = "") -> None:
    """Voltage [V] and current [A] of the supply, the current negative while it is drawn; the rest is not known."""
    fill_header(message.header, stamp, prefix + BASE)
    drawn, voltage = values
    message.voltage, message.current, message.present = float(voltage), -float(drawn), True
    message.temperature = message.charge = message.capacity = message.design_capacity = message.percentage = math.nan


def fill_tracking(message: Any, values: np.ndarray, stamp: int, prefix: str = "") -> None:
    """Place of the body [m] in the frame `odom`, with its variances; the body does not turn."""
    fill_header(message.header, stamp, prefix + ODOM)
    pose, covariance = message.pose.pose, message.pose.covariance
    pose.position.x, pose.position.y, pose.position.z, variance = (float(value) for value in values)
    pose.orientation.w = 1.0
    covariance[0] = covariance[7] = covariance[14] = variance


MEASUREMENTS = {"imu": fill_imu, "encoder": fill_encoder, "current": fill_battery, "tracking": fill_tracking}
"""What fills the message of each sensor, with the values of a `sensors.device.Measurement`."""


def fill_motor_power(message: Any, state: Samples) -> None:
    """Power [W] that the motor gives; positive drives the robot."""
    message.data = float(state.motor_power)


def fill_motor_current(message: Any, state: Samples) -> None:
    """Current [A] of a dc motor."""
    message.data = float(state.motor_current)


def fill_electrical_power(message: Any, state: Samples) -> None:
    """Power [W] that a dc motor takes from its supply."""
    message.data = float(state.electrical_power)


def fill_robot_description(message: Any, scene: Scene, topics: Mapping[str, str] = MappingProxyType({})) -> None:
    """The robot as URDF. Its names of links have no prefix, as robot_state_publisher has it.

    With the resolved `topics` of commands and states of the joints it tells ros2_control how to command the robot.
    """
    message.data = robot_description(scene, topics)


def fill_entity_state(message: Any, state: Samples, stamp: int, frame: str) -> None:
    """Place [m] and velocity [m/s] of the body; its accelerations are not known, which is NaN."""
    fill_header(message.header, stamp, frame)
    message.pose.position.x, message.pose.position.z = float(state.body_position), float(state.body_height)
    message.twist.linear.x = float(state.body_velocity)
    message.twist.linear.z = float(state.body_vertical_velocity)
    message.acceleration.linear.x = message.acceleration.linear.z = math.nan


def fill_header(header: Any, stamp: int, frame: str) -> None:
    """Stamp [ns] and frame of a message."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    header.frame_id = frame


class Frames:
    """The transforms of one robot: where each of its frames lies at a state of the device.

    Frames and signs are those of `messages.urdf`; `prefix` begins every frame's name, and `published` is `ONLY_BASE`
    or `ALL`. `fixed` are the joints that never change, `moving` the others below `base_link`. All that turns does so
    about y, so that two parts of a quaternion, y and w, give its angle. They are the only numbers here that are no
    field of the state: `Frames.turns` computes them.
    """

    def __init__(self, scene: Scene, prefix: str = "", published: str = ALL):
        joints = robot_joints(scene) if published == ALL else ()
        self.fixed = tuple(joint for joint in joints if joint.kind == FIXED)
        self.moving = tuple(joint for joint in joints if joint.kind != FIXED)
        self._rods = [slider(scene, side) for side in scene.guides]
        self._prefix = prefix

    def turns(self, crank_angle: float) -> list[float]:
        """y and w of the quaternion of each of `moving` that turns, one after the other, at the crank's angle [rad]."""
        if not self.moving:
            return []
        angles = [crank_angle, *(rod_angle(rod, crank_angle) for rod in self._rods)]
        return [part for angle in angles for part in _turned(angle)]

    def fill(self, transforms: Sequence[Any], state: Samples, turns: Sequence[float], stamp: int) -> None:
        """Fill blank messages TransformStamped: that of `base_link` in `odom`, then one of each of `moving`.

        `turns` are `Frames.turns` of the crank's angle of `state`, `stamp` is ROS time [ns].
        """
        base, *others = transforms
        self._begin(base, ODOM, BASE, stamp)
        _lay(base, float(state.body_height), 0.0, 1.0)
        base.transform.translation.x = float(state.body_position)
        parts = iter(turns)
        for message, joint in zip(others, self.moving, strict=True):
            self._begin(message, joint.parent, joint.child, stamp)
            if joint.kind in (CONTINUOUS, FLOATING):
                _lay(message, joint.height, float(next(parts)), float(next(parts)))
            else:
                _lay(message, float(getattr(state, JOINTS[joint.child][0])), 0.0, 1.0)

    def fill_fixed(self, transforms: Sequence[Any], stamp: int) -> None:
        """Fill blank transforms, one of each of `fixed`; `stamp` is ROS time [ns]."""
        for message, joint in zip(transforms, self.fixed, strict=True):
            self._begin(message, joint.parent, joint.child, stamp)
            _lay(message, joint.height, *_turned(joint.angle))

    def _begin(self, message: Any, parent: str, child: str, stamp: int) -> None:
        fill_header(message.header, stamp, self._prefix + parent)
        message.child_frame_id = self._prefix + child


def _turned(angle: float) -> tuple[float, float]:
    """y and w of the quaternion that turns from z towards -x by an angle [rad]."""
    return -math.sin(0.5 * angle), math.cos(0.5 * angle)


def _lay(message: Any, height: float, y: float, w: float) -> None:
    """The place on the parent's z axis [m], and the quaternion's parts."""
    message.transform.translation.z = height
    message.transform.rotation.y, message.transform.rotation.w = y, w
