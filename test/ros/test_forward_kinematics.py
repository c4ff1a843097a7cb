"""tf, URDF and joint_states of a recorded robot tell one story, by forward kinematics of the URDF's own text."""

import math

import numpy as np
import pytest
from forward_kinematics import Kinematics
from observation import bags, messages_of, stop
from tree_of_frames import Tree, frames_of

import vibro_ros
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.recordings import replay

pytest.importorskip("tf2_msgs.msg", reason="types of tf2_msgs are not built: no compiler")
TOLERANCE = 1e-11  # m and parts of a matrix: the URDF's text has 12 digits
ROBOTS = {
    "steep, other rods": {"scene": "damped", "guide.angle": 1.3, "crank.upper_rod": 0.05, "crank.inclined_rod": 0.08},
    "no contacts": {"scene": "no_impact", "motor.speed": 40.0},
    "no upper mass": {"motor.speed": 80.0, "effects.upper_mass": False},
}


def words_of(parameters: dict) -> list[str]:
    given = {name: str(value).lower() if isinstance(value, bool) else value for name, value in parameters.items()}
    return ["--ros-args", *(word for name, value in given.items() for word in ("-p", f"{name}:={value}"))]


def seconds(stamp) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


@pytest.mark.parametrize("parameters", ROBOTS.values(), ids=ROBOTS)
def test_tf_is_where_the_recorded_urdf_and_joint_states_say_it_is(start, listener, tmp_path, parameters):
    changes = {name: value for name, value in parameters.items() if name != "scene"}
    scene = load_scene(parameters.get("scene", "device")).with_parameters(changes)
    robot = start("robot", *words_of({**parameters, "rate.real_time_factor": 4.0}))
    listener.spin_for_samples(300)
    stop(robot)
    (folder,) = bags(tmp_path)
    bag = messages_of(folder)
    kinematics = Kinematics(bag["/robot_description"][0].data)
    (fixed,) = bag["/tf_static"]
    moved = list(zip(bag["/tf"], bag["/joint_states"], bag["/odom"], strict=True))
    assert len(moved) >= 300
    for transforms, states, odometry in moved[::7]:
        assert {seconds(one.header.stamp) for one in transforms.transforms} == {seconds(odometry.header.stamp)}
        tree = Tree([*transforms.transforms, *fixed.transforms])
        positions = dict(zip(states.name, states.position, strict=True))
        assert frames_of(tree.parents) == {"odom", *kinematics.links}
        place = odometry.pose.pose.position
        assert tree.in_frame("base_link", "odom")[:3, 3].tolist() == [place.x, place.y, place.z]
        for link in set(kinematics.links) - {kinematics.root}:
            if link.endswith("_rod"):
                check_rod(tree, link, scene, positions["crank"])
                continue
            np.testing.assert_allclose(tree.in_frame(link, "base_link"), kinematics.in_root(link, positions),
                                       atol=TOLERANCE, err_msg=link)
    assert {one.header.frame_id for one in bag["/impacts"]} <= set(kinematics.links)
    assert replay.main([str(folder)]) == 0


def check_rod(tree: Tree, rod: str, scene: vibro_ros.Scene, angle: float) -> None:
    """A rod leads from the crank's pin to the model's slider, which is on the guide's axis."""
    side = rod.partition("_")[0]
    guide, length = tree.in_frame(f"{side}_guide", "base_link"), scene[f"crank.{side}_rod"]
    matrix = np.linalg.inv(guide) @ tree.in_frame(rod, "base_link")
    psi, radius = angle - scene.guide_angle(side), scene["crank.radius"]
    reach = radius * math.cos(psi) + math.sqrt(length**2 - (radius * math.sin(psi)) ** 2)
    np.testing.assert_allclose(matrix @ [0.0, 0.0, length, 1.0], [0.0, 0.0, reach, 1.0], atol=TOLERANCE)
    np.testing.assert_allclose(matrix[:3, 3], [-radius * math.sin(psi), 0.0, radius * math.cos(psi)], atol=TOLERANCE)
