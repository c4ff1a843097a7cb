"""tf has the robot's parts where the model has them, at any crank angle and for any robot."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from forward_kinematics import Kinematics
from tree_of_frames import Tree

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.codec import new_message
from vibro_ros.messages.frames import ONLY_BASE, Frames
from vibro_ros.messages.urdf import robot_description
from vibro_ros.model.scene import Scene
from vibro_ros.model.slider import Slider
from vibro_ros.simulation.samples import FIELDS

STATE = {name: 0.01 * (i + 1) for i, name in enumerate(FIELDS)}
CHANGES = {"as shipped": {}, "steep": {"guide.angle": 1.5, "crank.inclined_rod": 0.09},
           "crank as long as its rods": {"crank.radius": 0.06}, "no upper mass": {"effects.upper_mass": False},
           "no plates": {"effects.upper_contact": "none", "effects.inclined_contact": "none"},
           "no masses": {"effects.upper_mass": False, "effects.inclined_mass": False}}
ANGLES = (0.0, 1.0, math.pi, 1e4, -7.0)
TOLERANCE = 1e-11  # m: the URDF's text has 12 digits; the sine of 1e4 rad is known to 1e-12


@pytest.fixture(params=CHANGES.values(), ids=CHANGES)
def scene(request):
    return load_scene("device").with_parameters(request.param)


def transforms(state: SimpleNamespace, scene: Scene, *names: str) -> tuple[list, list]:
    """Moving and fixed transforms, as messages of rosbags."""
    frames = Frames(scene, new_message("builtin_interfaces/msg/Time"), *names)
    values = [getattr(state, name) for name in FIELDS]
    frames.fill(values, frames.turns(values))
    return frames.moving, frames.fixed


def state_at(angle: float) -> SimpleNamespace:
    return SimpleNamespace(**{**STATE, "crank_angle": angle})


def positions(state: SimpleNamespace) -> dict[str, float]:
    return {"crank": state.crank_angle, "upper_mass": state.upper_position, "inclined_mass": state.inclined_position,
            "upper_plate": state.upper_plate_position, "inclined_plate": state.inclined_plate_position}


@pytest.mark.parametrize("angle", ANGLES)
def test_every_link_of_the_urdf_is_where_its_joints_bring_it(scene, angle):
    state, kinematics = state_at(angle), Kinematics(robot_description(scene))
    moving, fixed = transforms(state, scene)
    tree = Tree([*moving, *fixed])
    assert {*tree.parents} == {*kinematics.links}
    for link in kinematics.links:
        if link != kinematics.root:
            assert tree.parents[link] == kinematics.parents[link].find("parent").get("link")
        if not link.endswith("_rod"):
            np.testing.assert_allclose(tree.in_frame(link, "base_link"), kinematics.in_root(link, positions(state)),
                                       atol=TOLERANCE, err_msg=link)
    assert tree.in_frame("base_link", "odom")[:3, 3].tolist() == [state.body_position, 0.0, state.body_height]


@pytest.mark.parametrize("angle", ANGLES)
def test_rods_lead_from_the_pin_to_the_sliders_of_the_model(scene, angle):
    moving, fixed = transforms(state_at(angle), scene)
    tree = Tree([*moving, *fixed])
    pin = tree.in_frame("crank", "base_link") @ [0.0, 0.0, scene["crank.radius"], 1.0]
    for side in scene.guides:
        rod = scene[f"crank.{side}_rod"]
        slider = Slider(scene["crank.radius"], rod, scene.guide_angle(side)).position(angle)
        matrix = tree.in_frame(f"{side}_rod", "base_link")
        np.testing.assert_allclose(matrix[:, 3], pin, atol=TOLERANCE)
        expected = tree.in_frame(f"{side}_guide", "base_link") @ [0.0, 0.0, slider, 1.0]
        np.testing.assert_allclose(matrix @ [0.0, 0.0, rod, 1.0], expected, atol=TOLERANCE)


def test_rods_of_the_urdf_stand_as_tf_has_them_while_the_crank_is_at_0(scene):
    moving, _ = transforms(state_at(0.0), scene)
    kinematics = Kinematics(robot_description(scene))
    tree = Tree(moving)
    for side in scene.guides:
        np.testing.assert_allclose(tree.in_parent[f"{side}_rod"], kinematics.in_parent(f"{side}_rod", {}),
                                   atol=TOLERANCE)


def test_a_prefix_begins_every_frame(scene):
    moving, fixed = transforms(state_at(0.5), scene, "r1/")
    plain = [transform for some in transforms(state_at(0.5), scene) for transform in some]
    assert [(transform.header.frame_id, transform.child_frame_id) for transform in (*moving, *fixed)] == [
        (f"r1/{transform.header.frame_id}", f"r1/{transform.child_frame_id}") for transform in plain]


def test_the_base_alone_is_one_transform(scene):
    moving, fixed = transforms(state_at(1.0), scene, "", ONLY_BASE)
    assert [(transform.header.frame_id, transform.child_frame_id) for transform in moving] == [("odom", "base_link")]
    assert fixed == []
