"""Scene files: what is read, and that whatever cannot be read is refused in one line."""

import json
import math
from pathlib import Path

import pytest

from vibro_ros.configuration.scene_file import (
    DEVICE_PARAMETERS,
    config_folder,
    load_scene,
    scene_origin,
    shipped_scenes,
)
from vibro_ros.model.parameters import SCENE_PARAMETERS
from vibro_ros.model.scene import Scene

HEAD = "/**:\n  ros__parameters:\n"


@pytest.fixture
def scene_file(tmp_path):
    def write(content):
        path = tmp_path / "mine.yaml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path
    return write


def below_head(*lines):
    return HEAD + "".join(f"    {line}\n" for line in lines)


def refusal(path, named=None):
    with pytest.raises(ValueError, match=".") as caught:
        load_scene(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(named or path) in message
    return message


def test_a_scene_by_its_path(scene_file):
    scene = load_scene(scene_file(below_head("mass.body: 2.5", "guide: {angle: 1.0}", "effects.adhesion: false",
                                             "effects.motor: ramp")))
    assert scene.name == "mine"
    assert (scene["mass.body"], scene["guide.angle"], scene["effects.adhesion"]) == (2.5, 1.0, False)
    assert scene["effects.motor"] == "ramp"
    assert scene["mass.upper"] == Scene()["mass.upper"]


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_scene_by_its_name(name):
    scene = load_scene(name)
    assert scene.name == name
    assert set(scene.parameters) == {parameter.name for parameter in SCENE_PARAMETERS}


def test_device_parameters_are_checked_and_ignored(scene_file):
    device = {parameter.name: parameter.default for parameter in DEVICE_PARAMETERS}
    lines = [f"{name}: {json.dumps(value)}" for name, value in device.items()]
    path = scene_file(below_head("mass.body: 2.0", *lines))
    assert load_scene(path).parameters == load_scene("device").with_parameters({"mass.body": 2.0}).parameters


def test_every_scene_parameter_can_be_given_its_default(scene_file):
    defaults = {p.name: str(p.default).lower() if isinstance(p.default, bool) else p.default for p in SCENE_PARAMETERS}
    path = scene_file(below_head(*(f"{name}: {value}" for name, value in defaults.items())))
    assert load_scene(path).parameters == Scene().parameters


@pytest.mark.parametrize(("line", "named"), [
    ("guide.angel: 1.0", ["guide.angel", "did you mean guide.angle?"]),
    ('"a\\nb": 1.0', ["unknown"]),
    ("mass.body: heavy", ["mass.body", "heavy", "number", "kg"]),
    ("mass.body:", ["mass.body", "no value"]),
    ("mass.body: .nan", ["mass.body", "nan", "finite"]),
    ("guide.angle: 3.2", ["guide.angle", "3.2", "3.14159"]),
    ("crank.radius: 0.07", ["crank.radius", "0.07", "0.06", "longer rod"]),
    ('effects.motor: "a\\nb"', ["effects.motor", "ideal, ramp"]),
    ("mass.body: 1.0\n    mass: {body: 2.0}", ["mass.body", "twice"]), ("rate.publish: -1.0", ["rate.publish"]),
    *((f"record.topics: {value}", ["record.topics", "is not a list of texts; write [one, another]"])
      for value in ("odom", "[1, 2]")),
    ("scene: papper", ["papper: neither a shipped scene nor a file"]), ("scene: 5", ["scene: 5"])],
    ids=lambda value: str(value)[:40])
def test_a_wrong_line_is_refused(scene_file, line, named):
    message = refusal(scene_file(below_head(line)))
    assert not [text for text in named if text not in message]


@pytest.mark.parametrize(("content", "named"), [("/**:\n\tros__parameters: {}", "line 2"), (b"\xff\xfe\x00", "YAML")])
def test_a_file_that_is_no_yaml_is_refused(scene_file, content, named):
    assert named in refusal(scene_file(content))


def test_a_long_value_or_name_makes_no_long_message(scene_file):
    for line in (f"mass.body: {'x' * 300_000}", f"effects.motor: {'x' * 300_000}", f"{'x' * 300}: 1.0"):
        assert len(refusal(scene_file(below_head(line)))) < 600


def test_a_missing_file_or_scene_is_refused(tmp_path):
    for path in (tmp_path / "missing.yaml", tmp_path, "nosuch"):
        message = refusal(path)
        assert all(name in message for name in shipped_scenes())


def test_the_order_of_lines_does_not_matter(scene_file):
    """A crank radius is accepted although only the longer rods of a later line allow it."""
    lines = ["crank.radius: 0.08", "crank.upper_rod: 0.1", "crank.inclined_rod: 0.1", "upper.gap: 0.09"]
    scenes = [load_scene(scene_file(below_head(*order))) for order in (lines, lines[::-1])]
    assert scenes[0] == scenes[1]


def test_scenes_are_immutable_values():
    scene = Scene("x", {"mass.body": 2.0})
    with pytest.raises(TypeError):
        scene.parameters["mass.body"] = 3.0
    other = scene.with_parameters({"mass.body": 3.0})
    assert (scene["mass.body"], other["mass.body"]) == (2.0, 3.0)
    assert scene == Scene("x", {"mass.body": 2.0}) and hash(scene) == hash(Scene("x", {"mass.body": 2.0}))
    with pytest.raises(ValueError, match="mass.body"):
        scene["mass.bodi"]
    assert scene["guide.angle"] == math.radians(50.0)


def test_a_scene_based_on_a_scene_is_that_scene_with_changes(tmp_path):
    (tmp_path / "lab").mkdir()
    (tmp_path / "steep.yaml").write_text(below_head("scene: lab/heavy.yaml", "guide.angle: 1.2"))
    (tmp_path / "lab" / "heavy.yaml").write_text(below_head("scene: device", "mass.body: 2.0", "guide.angle: 1.0"))
    steep = load_scene(tmp_path / "steep.yaml")
    assert steep.name == "steep"
    assert steep.parameters == load_scene("device").with_parameters({"mass.body": 2.0, "guide.angle": 1.2}).parameters
    assert load_scene(tmp_path / "lab" / "heavy.yaml")["guide.angle"] == 1.0


def test_the_robots_usual_settings_are_the_nodes_default_scene():
    assert load_scene(config_folder() / "robot.yaml").parameters == load_scene("device").parameters


def test_a_scene_based_on_itself_is_refused(tmp_path):
    (tmp_path / "here").mkdir()
    for name, base in (("a", "b.yaml"), ("b", "../here/a.yaml"), ("self", "./self.yaml")):
        (tmp_path / "here" / f"{name}.yaml").write_text(below_head(f"scene: {base}"))
    for first in ("a", "self"):
        message = refusal(tmp_path / "here" / f"{first}.yaml", named=tmp_path / "here")
        assert ".yaml: as a scene it is a change of itself; let its `scene` be one of" in message


def test_an_error_in_a_base_scene_names_the_file_of_that_scene(scene_file, tmp_path):
    (tmp_path / "other.yaml").write_text(below_head("mass.body: -1.0"))
    assert "mass.body: -1 is out of range" in refusal(scene_file(below_head("scene: other.yaml")), "other.yaml")


def test_parameters_of_every_ros_node_are_ignored(scene_file):
    """`ros2 param dump` writes parameters that every node has, such as `use_sim_time`; they are not parameters of a
    scene.
    """
    path = scene_file("/vibro_robot:\n  ros__parameters:\n    mass:\n      body: 2.0\n    scene: device\n"
                      "    start_type_description_service: true\n    use_sim_time: false\n"
                      "    qos_overrides:\n      /clock:\n        subscription:\n          depth: 1\n")
    assert load_scene(path).parameters == load_scene("device").with_parameters({"mass.body": 2.0}).parameters


def test_sections_of_other_nodes_are_ignored(scene_file):
    path = scene_file("/vibro_controller:\n  ros__parameters: {rate: 20.0}\n"
                      "/lab:\n  vibro_robot:\n    ros__parameters: {mass.body: 2.0}\n"
                      "/*/other:\n  ros__parameters: {mass.body: 3.0}\n")
    assert load_scene(path)["mass.body"] == 2.0
    with pytest.raises(ValueError, match="none for this node; address them to /vibro_robot or to"):
        load_scene(path, node="/vibro_robot")


def test_a_file_for_several_robots_needs_the_name_of_one_of_them(scene_file):
    path = scene_file("/left/vibro_robot:\n  ros__parameters: {mass.body: 2.0}\n"
                      "/right/vibro_robot:\n  ros__parameters: {mass.body: 3.0}\n")
    assert "/left/vibro_robot, /right/vibro_robot; name one of them" in refusal(path)
    assert load_scene(path, node="/right/vibro_robot")["mass.body"] == 3.0


def test_a_scenes_origin_is_the_same_from_every_working_directory(tmp_path, monkeypatch):
    (tmp_path / "mine.yaml").write_text(below_head("mass.body: 2.0"))
    assert scene_origin("paper", tmp_path) == "paper"
    assert scene_origin("mine.yaml", tmp_path) == str(tmp_path / "mine.yaml")
    monkeypatch.chdir(tmp_path)
    assert scene_origin("mine.yaml", Path()) == str(tmp_path / "mine.yaml")
    with pytest.raises(ValueError, match="neither a shipped scene nor a file"):
        scene_origin("other.yaml", tmp_path)
