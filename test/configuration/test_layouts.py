"""The shipped layouts name topics and fields that the robot has."""

import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import yaml
from rosbags.interfaces import Nodetype

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.codec import jazzy_types
from vibro_ros.messages.frames import JOINTS, joints_of
from vibro_ros.messages.topics import ROBOT_TOPICS, full_name
from vibro_ros.messages.urdf import robot_joints

FOLDER = Path(__file__).resolve().parents[2] / "config" / "layouts"
TOPICS = {f"/{full_name(name).lstrip('/')}": kind for name, kind in ROBOT_TOPICS.items()}
FRAMES = {"odom", "base_link", *(joint.child for joint in robot_joints(load_scene("device")))}
SHOWN_BY = {"RobotModel": "std_msgs/msg/String", "Odometry": "nav_msgs/msg/Odometry",
            "Wrench": "geometry_msgs/msg/WrenchStamped"}  # what RViz's displays subscribe to


def assert_number(type_name: str, path: list[str]) -> None:
    """Check that a path of fields, with an index for each list, leads to a number."""
    name, *rest = path
    field, index = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", name).groups()
    kind, what = dict(jazzy_types().fielddefs[type_name][1])[field]
    assert (kind in (Nodetype.SEQUENCE, Nodetype.ARRAY)) == (index is not None), name
    if index is not None:
        kind, what = what[0]
    if kind is Nodetype.NAME:
        assert_number(what, rest)
    else:
        assert rest == [] and what[0] == "float64"


def parts(document: object) -> Iterator[dict]:
    """Yield every mapping of a document, at any depth."""
    if isinstance(document, dict):
        yield document
    for entry in document.values() if isinstance(document, dict) else document if isinstance(document, list) else ():
        yield from parts(entry)


def foxglove() -> dict:
    return json.loads((FOLDER / "foxglove.json").read_text())


def test_rviz_shows_topics_of_the_types_that_its_displays_take():
    manager = yaml.safe_load((FOLDER / "robot.rviz").read_text())["Visualization Manager"]
    shown = {}
    for display in manager["Displays"]:
        topic = display.get("Topic") or display.get("Description Topic")
        if topic:
            shown[topic["Value"]] = TOPICS[topic["Value"]]
            assert shown[topic["Value"]] == SHOWN_BY[display["Class"].partition("/")[2]]
            lasting = topic["Value"] in ("/robot_description", "/tf_static")
            assert topic["Durability Policy"] == ("Transient Local" if lasting else "Volatile")
    assert {"/robot_description", "/impacts", "/ground_contact"} <= set(shown)
    assert {manager["Global Options"]["Fixed Frame"], manager["Views"]["Current"]["Target Frame"]} <= FRAMES


def test_foxglove_plots_numbers_and_shows_the_robot():
    paths = [path["value"] for part in parts(foxglove()) for path in part.get("paths", ())]
    assert len(paths) > 10
    for path in paths:
        topic, *fields = path.split(".")
        assert_number(TOPICS[topic], fields)
    scene = foxglove()["configById"]["3D!robot"]
    assert set(scene["topics"]) <= set(TOPICS) and scene["topics"]["/robot_description"]["visible"]
    assert {scene["followTf"], *(layer["frameId"] for layer in scene["layers"].values())} <= FRAMES


def test_foxglove_uses_the_names_of_the_joints():
    joints = joints_of(load_scene("device"))
    labels = {int(index): path["label"].split()[0] for part in parts(foxglove()) for path in part.get("paths", ())
              for index in re.findall(r"position\[(\d+)\]", path["value"])}
    assert labels == {index: joints[index] for index in range(1, len(joints))}


def test_plotjuggler_plots_numbers_by_its_own_names_for_them():
    curves = [curve.get("name") for curve in ElementTree.parse(FOLDER / "plotjuggler.xml").iter("curve")]
    assert len(curves) == len(set(curves)) > 10
    for curve in curves:
        topic, *fields = curve[1:].split("/")
        if topic == "joint_states":  # PlotJuggler takes joints by their names
            assert fields[0] in JOINTS and fields[1] in ("position", "velocity", "effort") and len(fields) == 2
        else:
            assert_number(TOPICS[f"/{topic}"], fields)
