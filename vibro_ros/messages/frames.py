"""The robot's frames as tf's transforms, for the classes of any ROS library: where each lies at a state of the device.

Frames and signs are those of `messages.joints`. All that turns does so about y, so that two parts of a quaternion, y
and w, tell its angle. They are the only numbers here that are no field of the state: `Frames.turns` computes them.
"""

import math
from collections.abc import Sequence
from typing import Any

from vibro_ros.messages.fields import JOINTS, ODOM, fill_header
from vibro_ros.messages.joints import BASE, CONTINUOUS, FIXED, FLOATING, robot_joints, rod_angle, slider
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import Samples

NONE, ONLY_BASE, ALL = "none", "base", "all"
"""What of the tree is published: nothing; where `base_link` is in `odom`; that and every link."""


class Frames:
    """The transforms of one robot.

    Parameters
    ----------
    scene : Scene
        Says which parts there are, and their lengths.
    prefix : str
        Begins every frame's name.
    published : str
        `ONLY_BASE` or `ALL`.

    Attributes
    ----------
    fixed : tuple of Joint
        Those that never change.
    moving : tuple of Joint
        The others, below `base_link`.
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
        """Fill blank transforms, that of `base_link` in `odom` and one of each of `moving`.

        Parameters
        ----------
        transforms : sequence
            Messages of the type geometry_msgs/msg/TransformStamped, ``1 + len(moving)`` of them.
        state : Samples
            The state.
        turns : sequence of float
            `Frames.turns` of its crank's angle, dimensionless.
        stamp : int
            ROS time [ns].
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
