"""A listener to tf: each frame in its parent, as matrices, and the tree of frames."""

from collections.abc import Iterable, Mapping

import numpy as np
from forward_kinematics import homogeneous
from scipy.spatial.transform import Rotation


def matrix_of(transform) -> np.ndarray:
    """Return a geometry_msgs/msg/Transform, of any ROS library, as a homogeneous matrix."""
    place, turn = transform.translation, transform.rotation
    assert abs(np.linalg.norm([turn.x, turn.y, turn.z, turn.w]) - 1.0) < 1e-12
    return homogeneous([place.x, place.y, place.z], Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]))


class Tree:
    """Frames by their names, from stamped transforms."""

    def __init__(self, transforms: Iterable):
        self.parents: dict[str, str] = {}
        self.in_parent: dict[str, np.ndarray] = {}
        for stamped in transforms:
            assert stamped.child_frame_id not in self.parents, f"{stamped.child_frame_id} has two parents"
            self.parents[stamped.child_frame_id] = stamped.header.frame_id
            self.in_parent[stamped.child_frame_id] = matrix_of(stamped.transform)

    def in_frame(self, frame: str, target: str) -> np.ndarray:
        """Return the pose of a frame in one of its ancestors."""
        matrix = np.eye(4)
        while frame != target:
            matrix, frame = self.in_parent[frame] @ matrix, self.parents[frame]
        return matrix


def frames_of(tree: Mapping[str, str]) -> set[str]:
    """Return every frame of a tree with its parent."""
    return {*tree, *tree.values()}
