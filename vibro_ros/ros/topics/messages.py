"""ROS messages of the device's state and events: pure functions; `vibro_ros.messages.fields` says what is in them.

Here and there, `stamp` is ROS time [ns] and `prefix` begins every frame's name.
"""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped, WrenchStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from vibro_ros.messages import fields
from vibro_ros.messages.fields import JOINTS, PLATES
from vibro_ros.messages.frames import Frames
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import Samples

__all__ = ["JOINTS", "PLATES", "ground_contact", "impact", "joint_states", "message_class", "motor_power",
           "fixed_transforms", "odometry", "robot_description", "transforms"]


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
    except (ImportError, AttributeError, ValueError):  # ValueError: a name that is none
        raise ValueError(f"{type_name}: no such message here; install the ROS package {package}") from None


def odometry(state: Samples, stamp: int, prefix: str = "") -> Odometry:
    """Position [m] and velocity [m/s] of the body."""
    message = Odometry()
    fields.fill_odometry(message, state, stamp, prefix)
    return message


def joint_states(state: Samples, joints: Sequence[str], stamp: int, prefix: str = "") -> JointState:
    """Position, velocity and effort of `joints`, names of `JOINTS`."""
    message = JointState()
    fields.fill_joint_states(message, state, joints, stamp, prefix)
    return message


def ground_contact(state: Samples, stamp: int, prefix: str = "") -> WrenchStamped:
    """Force of the ground on the body [N]."""
    message = WrenchStamped()
    fields.fill_ground_contact(message, state, stamp, prefix)
    return message


def impact(event: np.void | Mapping, stamp: int, prefix: str = "") -> WrenchStamped:
    """Peak force [N] of one contact; `stamp` is its first instant. Of the event, kind and peak force are read."""
    message = WrenchStamped()
    fields.fill_impact(message, event, stamp, prefix)
    return message


def motor_power(state: Samples) -> Float64:
    """Power [W] that the motor gives; positive drives the robot."""
    message = Float64()
    fields.fill_motor_power(message, state)
    return message


def robot_description(scene: Scene) -> String:
    """The robot as URDF."""
    message = String()
    fields.fill_robot_description(message, scene)
    return message


def transforms(frames: Frames, state: Samples, turns: Sequence[float], stamp: int) -> Any:
    """Where the robot's frames are, a tf2_msgs/msg/TFMessage; `turns` are those of `Frames`."""
    message = message_class(ROBOT_TOPICS["tf"])(transforms=[TransformStamped() for _ in range(1 + len(frames.moving))])
    frames.fill(message.transforms, state, turns, stamp)
    return message


def fixed_transforms(frames: Frames, stamp: int) -> Any:
    """Where the frames are that never move, a tf2_msgs/msg/TFMessage."""
    message = message_class(ROBOT_TOPICS["tf_static"])(transforms=[TransformStamped() for _ in frames.fixed])
    frames.fill_fixed(message.transforms, stamp)
    return message
