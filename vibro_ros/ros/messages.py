"""ROS messages of the device's state and events: pure functions.

Units are SI and signs REP-103's: the robot's `base_link` has x forward and z up, and moves in the frame `odom`.

Every number is cast with `float`: rclpy serialises an int or a numpy scalar in a float field to garbage, silently.
"""

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3, Wrench, WrenchStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Header

from vibro_ros.samples import Samples

ODOM = "odom"
BASE = "base_link"
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


def time_of(stamp: int) -> Time:
    """ROS time from nanoseconds."""
    return Time(sec=stamp // 1_000_000_000, nanosec=stamp % 1_000_000_000)


def odometry(state: Samples, stamp: int) -> Odometry:
    """Position [m] and velocity [m/s] of the body; `stamp` is ROS time [ns], here and below."""
    message = Odometry(header=_header(stamp, ODOM), child_frame_id=BASE)
    message.pose.pose.position.x = float(state.body_position)
    message.pose.pose.position.z = float(state.body_height)
    message.pose.pose.orientation.w = 1.0
    message.twist.twist.linear.x = float(state.body_velocity)
    message.twist.twist.linear.z = float(state.body_vertical_velocity)
    return message


def joint_states(state: Samples, joints: Sequence[str], stamp: int) -> JointState:
    """Position, velocity and effort of `joints`, names of `JOINTS`."""
    position, velocity, effort = ([float(getattr(state, JOINTS[joint][which])) for joint in joints]
                                  for which in range(3))
    return JointState(header=_header(stamp, BASE), name=list(joints), position=position, velocity=velocity,
                      effort=effort)


def ground_contact(state: Samples, stamp: int) -> WrenchStamped:
    """Force of the ground on the body [N]: friction along x (negative: slows forward motion), normal along z."""
    return _force(stamp, BASE, x=-float(state.friction_force), z=float(state.normal_force))


def impact(event: np.void, stamp: int) -> WrenchStamped:
    """Peak force [N] of one contact, the force of the mass on the plate.

    The frame is the plate's; its z axis points along the guide, outwards from the crank (for the upper plate: up), so
    the peak force is positive. `stamp` is the first instant of contact.
    """
    return _force(stamp, PLATES[str(event["kind"])], x=0.0, z=float(event["peak_force"]))


def motor_power(state: Samples) -> Float64:
    """Power [W] that the motor gives; positive drives the robot."""
    return Float64(data=float(state.motor_power))


def _header(stamp: int, frame: str) -> Header:
    return Header(stamp=time_of(stamp), frame_id=frame)


def _force(stamp: int, frame: str, x: float, z: float) -> WrenchStamped:
    return WrenchStamped(header=_header(stamp, frame), wrench=Wrench(force=Vector3(x=x, y=0.0, z=z)))
