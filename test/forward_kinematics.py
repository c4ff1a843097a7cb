"""Forward kinematics of a URDF, from its text alone: an independent reading with which tf and the model are compared.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

MOVED_BY_STATES = ("continuous", "prismatic", "revolute")


class Kinematics:
    """Places of the links of a URDF, as homogeneous matrices in the frame of its root."""

    def __init__(self, urdf: str):
        self.robot = ElementTree.fromstring(urdf)
        self.joints = {joint.get("name"): joint for joint in self.robot.iter("joint")}
        self.links = [link.get("name") for link in self.robot.iter("link")]
        self.parents = {joint.find("child").get("link"): joint for joint in self.joints.values()}
        (self.root,) = set(self.links) - set(self.parents)

    @property
    def moved_by_states(self) -> list[str]:
        """Names of the joints whose positions a robot_state_publisher takes from joint_states."""
        return [name for name, joint in self.joints.items() if joint.get("type") in MOVED_BY_STATES]

    def in_parent(self, link: str, positions: Mapping[str, float]) -> np.ndarray:
        """Return the pose of a link in its parent link."""
        joint = self.parents[link]
        place, rpy = ([float(word) for word in joint.find("origin").get(name).split()] for name in ("xyz", "rpy"))
        matrix = homogeneous(place, Rotation.from_euler("xyz", rpy))
        if joint.get("type") not in MOVED_BY_STATES:
            return matrix
        axis = np.array([float(word) for word in joint.find("axis").get("xyz").split()])
        way = positions[joint.get("name")] * axis
        slides = joint.get("type") == "prismatic"
        return matrix @ (homogeneous(way, Rotation.identity()) if slides else homogeneous(
            np.zeros(3), Rotation.from_rotvec(way)))

    def in_root(self, link: str, positions: Mapping[str, float]) -> np.ndarray:
        """Return the pose of a link in the root."""
        matrix = np.eye(4)
        while link != self.root:
            matrix = self.in_parent(link, positions) @ matrix
            link = self.parents[link].find("parent").get("link")
        return matrix


def homogeneous(place, rotation: Rotation) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), place
    return matrix
