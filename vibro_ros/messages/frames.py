"""Where the robot's frames are at a state of the device: the transforms on /tf and /tf_static.

Frames and signs are those of `messages.urdf`. All that turns does so about y, so that two parts of a quaternion, y and
w, give its angle.
"""

import math
from collections.abc import Sequence
from typing import Any

from vibro_ros.messages.urdf import BASE, CONTINUOUS, FIXED, FLOATING, robot_joints, rod_angle, slider
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import Samples

ODOM = "odom"

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


def joints_of(scene: Scene) -> list[str]:
    """The joints that a robot of this scene has, names of `JOINTS`."""
    parts = [f"{side}_mass" for side in scene.guides] + [f"{side}_plate" for side in scene.plates]
    return [joint for joint in JOINTS if joint in ("crank", *parts)]


def fill_header(header: Any, stamp: int, frame: str) -> None:
    """Stamp, ROS time [ns], and frame of a message."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    header.frame_id = frame


class Frames:
    """The transforms of one robot.

    `prefix` begins every frame's name, and `published` is `ONLY_BASE` or `ALL`. `fixed` are the joints that never
    change, `moving` the others below `base_link`.
    """

    def __init__(self, scene: Scene, prefix: str = "", published: str = ALL):
        joints = robot_joints(scene) if published == ALL else ()
        self.fixed = tuple(joint for joint in joints if joint.kind == FIXED)
        self.moving = tuple(joint for joint in joints if joint.kind != FIXED)
        self._rods = [slider(scene, side) for side in scene.guides]
        self._prefix = prefix

    def fill(self, transforms: Sequence[Any], state: Samples, stamp: int) -> None:
        """Fill messages TransformStamped: that of `base_link` in `odom`, then one of each of `moving`.

        `stamp` is ROS time [ns].
        """
        base, *others = transforms
        self._begin(base, ODOM, BASE, stamp)
        _lay(base, state.body_height, 0.0, 1.0)
        base.transform.translation.x = state.body_position
        rotations = iter(self._rotations(state.crank_angle) if others else ())
        for message, joint in zip(others, self.moving, strict=True):
            self._begin(message, joint.parent, joint.child, stamp)
            if joint.kind in (CONTINUOUS, FLOATING):
                _lay(message, joint.height, *next(rotations))
            else:
                _lay(message, getattr(state, JOINTS[joint.child][0]), 0.0, 1.0)

    def fill_fixed(self, transforms: Sequence[Any], stamp: int) -> None:
        """Fill messages TransformStamped, one of each of `fixed`; `stamp` is ROS time [ns]."""
        for message, joint in zip(transforms, self.fixed, strict=True):
            self._begin(message, joint.parent, joint.child, stamp)
            _lay(message, joint.height, *_rotation(joint.angle))

    def _rotations(self, crank_angle: float) -> list[tuple[float, float]]:
        """y and w of the quaternion of the crank and of each rod, at the crank's angle [rad]."""
        return [_rotation(angle) for angle in (crank_angle, *(rod_angle(rod, crank_angle) for rod in self._rods))]

    def _begin(self, message: Any, parent: str, child: str, stamp: int) -> None:
        fill_header(message.header, stamp, self._prefix + parent)
        message.child_frame_id = self._prefix + child


def _rotation(angle: float) -> tuple[float, float]:
    """y and w of the quaternion that turns from z towards -x by an angle [rad]."""
    return -math.sin(0.5 * angle), math.cos(0.5 * angle)


def _lay(message: Any, height: float, y: float, w: float) -> None:
    """The place on the parent's z axis [m], and the quaternion's parts."""
    message.transform.translation.z = height
    message.transform.rotation.y, message.transform.rotation.w = y, w
