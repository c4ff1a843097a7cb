"""Transforms of the robot's frames at a state of the device, for /tf and /tf_static.

Frames and signs are those of `messages.urdf`. All rotations are about y, so that only y and w of a quaternion vary.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibro_ros.messages.codec import new_message
from vibro_ros.messages.urdf import BASE, CONTINUOUS, FIXED, FLOATING, robot_joints, rods
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import FIELDS

ODOM = "odom"
_POSITION, _HEIGHT, _ANGLE = map(FIELDS.index, ("body_position", "body_height", "crank_angle"))

JOINTS = {
    "crank": ("crank_angle", "motor_speed", "motor_torque"),
    "upper_mass": ("upper_position", "upper_velocity", "upper_drive_force"),
    "inclined_mass": ("inclined_position", "inclined_velocity", "inclined_drive_force"),
    "upper_plate": ("upper_plate_position", "upper_plate_velocity", "upper_plate_force"),
    "inclined_plate": ("inclined_plate_position", "inclined_plate_velocity", "inclined_plate_force"),
}
"""Position, velocity and effort of each joint, as fields of a sample.

The crank has an angle [rad], never wrapped, a speed [rad/s] and the motor's torque [N m]. Masses and plates have
positions along their guide [m], outwards positive from the crank's centre, speeds [m/s] and forces [N]: the effort of a
mass is the force of its drive (outwards positive), of a plate the contact force (compression positive).
"""

NONE, ONLY_BASE, ALL = "none", "base", "all"
"""Values of `tf.publish`: no transforms; only that of `base_link` in `odom`; that and those of all joints."""


def joints_of(scene: Scene) -> list[str]:
    """Return the joints that a robot of this scene has, by their names in `JOINTS`."""
    parts = [f"{side}_mass" for side in scene.guides] + [f"{side}_plate" for side in scene.plates]
    return [joint for joint in JOINTS if joint in ("crank", *parts)]


def fill_header(header: Any, stamp: int, frame: str) -> None:
    """Set stamp (ROS time [ns]) and frame in a message's header."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    header.frame_id = frame


class Frames:
    """Transforms of one robot, as TransformStamped messages that are filled again for each sample.

    `moving` has the transform of `base_link` in `odom` and those of the joints that move, which all share the message
    `stamp`; `fixed` has those of the joints that never move. `prefix` begins every frame's name, and `published` is
    `ONLY_BASE` or `ALL`.
    """

    def __init__(self, scene: Scene, stamp: Any, prefix: str = "", published: str = ALL):
        from vibro_ros.solver.readout import write_turns  # compiled code, which readers of bags do not need

        self._write_turns, self._rods = write_turns, np.array(rods(scene)).reshape(-1, 3)
        self.moving, self.fixed = [_transform(prefix + ODOM, prefix + BASE)], list[Any]()
        self._sliders, self._turning, turn = list[tuple[Any, int]](), list[Any](), np.empty(2)
        for joint in robot_joints(scene) if published == ALL else ():
            message = _transform(prefix + joint.parent, prefix + joint.child)
            message.transform.translation.z = joint.height
            (self.fixed if joint.kind == FIXED else self.moving).append(message)
            if joint.kind == FIXED:
                write_turns(self._rods, joint.angle, turn)
                message.transform.rotation.y, message.transform.rotation.w = turn.tolist()
            elif joint.kind in (CONTINUOUS, FLOATING):
                self._turning.append(message.transform.rotation)
            else:
                self._sliders.append((message.transform.translation, FIELDS.index(JOINTS[joint.child][0])))
        for message in self.moving:
            message.header.stamp = stamp
        self._turns = np.empty(2 * len(self._turning))

    def turns(self, values: Sequence[float]) -> list[float]:
        """Return y and w of the quaternions of the crank and of each rod, at the `values` of a sample."""
        self._write_turns(self._rods, values[_ANGLE], self._turns)
        return self._turns.tolist()

    def fill(self, values: Sequence[float], turns: Sequence[float]) -> None:
        """Set the transforms in `moving` from the `values` of a sample, in the order of `FIELDS`, and its `turns`."""
        base = self.moving[0].transform.translation
        base.x, base.z = values[_POSITION], values[_HEIGHT]
        for translation, index in self._sliders:
            translation.z = values[index]
        for i, rotation in enumerate(self._turning):
            rotation.y, rotation.w = turns[2 * i:2 * i + 2]


def _transform(parent: str, child: str) -> Any:
    message = new_message("geometry_msgs/msg/TransformStamped")
    message.header.frame_id, message.child_frame_id, message.transform.rotation.w = parent, child, 1.0
    return message
