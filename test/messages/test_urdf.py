"""The URDF is one for ROS's own parser, and its links lie where the model has its parts."""

import itertools
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from forward_kinematics import Kinematics, homogeneous
from scipy.spatial.transform import Rotation

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.frames import joints_of
from vibro_ros.messages.urdf import robot_description

CHECK_URDF = Path(sys.executable).parent / "check_urdf"  # urdfdom's, the parser of robot_state_publisher and RViz
CHANGES = {
    "as shipped": {}, "guide downwards": {"guide.angle": 3.0}, "level guide": {"guide.angle": math.pi / 2},
    "crank as long as its rods": {"crank.radius": 0.06},
    "tiny": {"crank.radius": 1e-4, "crank.upper_rod": 2e-4, "crank.inclined_rod": 3e-4},
    "gaps": {"upper.gap": 0.05, "inclined.gap": -0.05}, "no upper mass": {"effects.upper_mass": False},
    "no masses": {"effects.upper_mass": False, "effects.inclined_mass": False},
    "no plate": {"effects.upper_contact": "none"}, "heavy": {"mass.body": 20.0, "mass.upper": 3.0}}
ANGLES = (0.7, math.pi, 123.4)
TOLERANCE = 1e-11  # m: the text has 12 digits


def changed(changes: dict):
    return load_scene("paper").with_parameters(changes)


@pytest.fixture(params=CHANGES.values(), ids=CHANGES)
def scene(request):
    return changed(request.param)


def inertias(kinematics: Kinematics):
    """Name, mass and matrix of inertia of each link that has them."""
    for link in kinematics.robot.iter("link"):
        if (inertial := link.find("inertial")) is not None:
            told = {name: float(value) for name, value in inertial.find("inertia").attrib.items()}
            x, y, z = (told[f"i{axis}{axis}"] for axis in "xyz")
            matrix = np.array([[x, told["ixy"], told["ixz"]], [told["ixy"], y, told["iyz"]],
                               [told["ixz"], told["iyz"], z]])
            yield link.get("name"), float(inertial.find("mass").get("value")), matrix


def corners_of(visual) -> np.ndarray:
    """Corners of a box about what is seen, in its link, shape (4, 8)."""
    shape = visual.find("geometry")[0]
    sizes = {"box": lambda: [float(word) / 2 for word in shape.get("size").split()],
             "cylinder": lambda: [*[float(shape.get("radius"))] * 2, float(shape.get("length")) / 2],
             "sphere": lambda: [float(shape.get("radius"))] * 3}[shape.tag]()
    place, rpy = ([float(word) for word in visual.find("origin").get(name).split()] for name in ("xyz", "rpy"))
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3))).T
    corners = np.vstack([np.array(sizes)[:, None] * signs, np.ones(8)])
    return homogeneous(place, Rotation.from_euler("xyz", rpy)) @ corners


def test_the_parser_of_ros_accepts_the_urdf(scene, tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text(robot_description(scene))
    done = subprocess.run([CHECK_URDF, file], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and "Successfully Parsed" in done.stdout, done.stdout + done.stderr
    assert "rror" not in done.stdout + done.stderr and "arning" not in done.stdout + done.stderr
    assert "root Link: base_link" in done.stdout


def test_movable_joints_are_those_of_joint_states(scene):
    kinematics = Kinematics(robot_description(scene))
    assert sorted(kinematics.moved_by_states) == sorted(joints_of(scene))
    assert {kinematics.joints[f"{side}_rod"].get("type") for side in scene.guides} <= {"floating"}


def test_masses_are_the_scenes_and_inertias_are_those_of_bodies(scene):
    bodies = list(inertias(Kinematics(robot_description(scene))))
    assert {name: mass for name, mass, _ in bodies} == {
        "body": scene["mass.body"], **{f"{side}_mass": scene[f"mass.{side}"] for side in scene.guides}}
    assert math.isclose(sum(mass for _, mass, _ in bodies), scene.total_mass, rel_tol=1e-12)
    for name, _, inertia in bodies:
        moments = np.linalg.eigvalsh(inertia)
        assert moments[0] > 0.0, name
        assert moments[2] < moments[0] + moments[1], f"{name}: no body has such moments"


def test_an_imu_that_is_on_has_a_link():
    for rate, names in ((0.0, 0), (100.0, 2)):  # of a link and of its joint
        assert robot_description(changed({"sensors.imu.rate": rate})).count('name="imu_link"') == names


@pytest.mark.parametrize("angle", ANGLES)
def test_links_lie_where_the_model_has_their_parts(scene, angle):
    kinematics = Kinematics(robot_description(scene))
    along = {"upper_mass": 0.03, "inclined_mass": 0.05, "upper_plate": 0.06, "inclined_plate": 0.07}
    positions = {**along, "crank": angle}
    hub = kinematics.in_root("crank", positions)[:3, 3]
    assert hub[0] == hub[1] == 0.0 and hub[2] > scene["crank.radius"]
    pin = kinematics.in_root("crank", positions) @ [0.0, 0.0, scene["crank.radius"], 1.0]
    expected = hub + scene["crank.radius"] * np.array([-math.sin(angle), 0.0, math.cos(angle)])
    np.testing.assert_allclose(pin[:3], expected, atol=TOLERANCE)
    for part in set(along) & set(kinematics.links):
        x, z = scene.direction(part.split("_")[0])
        matrix = kinematics.in_root(part, positions)
        np.testing.assert_allclose(matrix[:3, 3], hub + along[part] * np.array([x, 0.0, z]), atol=TOLERANCE)
        np.testing.assert_allclose(matrix[:3, 2], [x, 0.0, z], atol=TOLERANCE)  # z leads along the guide


@pytest.mark.parametrize("angle", ANGLES)
def test_nothing_of_the_robot_is_below_the_ground(scene, angle):
    kinematics = Kinematics(robot_description(scene))
    places = {f"{side}_{part}": scene[f"crank.{side}_rod"] for side in scene.guides for part in ("mass", "plate")}
    for link in kinematics.robot.iter("link"):
        name = link.get("name")
        for visual in link.iter("visual"):
            if "_rod" not in name:  # the joint states do not say where rods are; they end at the sliders
                lowest = (kinematics.in_root(name, {**places, "crank": angle}) @ corners_of(visual))[2].min()
                assert lowest > -TOLERANCE, name


def test_equal_scenes_have_equal_texts_without_negative_zeros(scene):
    text = robot_description(scene)
    assert text == robot_description(changed(dict(scene.parameters)))
    assert '"-0' not in text.replace('"-0.', "") and " -0 " not in text
