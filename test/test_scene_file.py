"""Scene files: what is read, and that whatever cannot be read is refused in one line."""

import json
import math

import pytest

from vibro_ros.model.parameters import SCENE_PARAMETERS
from vibro_ros.model.scene import Scene
from vibro_ros.scene_file import DEVICE_PARAMETERS, load_scene, read_parameter_file, shipped_scenes

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


def refusal(path, read=load_scene):
    with pytest.raises(ValueError, match=".") as caught:
        read(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
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


@pytest.mark.parametrize(("text", "value"), [
    ("2", 2.0), ("2.5", 2.5), ("1e3", 1e3), ("1.0e3", 1e3), ("1.e3", 1e3), (".5e1", 5.0), ("+2.5E-1", 0.25),
    ("1E+2", 100.0)])
def test_numbers_as_people_write_them(scene_file, text, value):
    assert load_scene(scene_file(below_head(f"mass.body: {text}")))["mass.body"] == value


def test_device_parameters_are_checked_and_left_aside(scene_file):
    device = {parameter.name: parameter.default for parameter in DEVICE_PARAMETERS}
    lines = [f"{name}: {json.dumps(value)}" for name, value in device.items()]
    path = scene_file(below_head("mass.body: 2.0", *lines))
    assert load_scene(path).parameters == Scene("x", {"mass.body": 2.0}).parameters
    assert read_parameter_file(path) == {"mass.body": 2.0, **device, "record.topics": ["all"]}
    assert "rate.publish" in refusal(scene_file(below_head("rate.publish: -1.0")))


@pytest.mark.parametrize("value", ["odom", "[1, 2]", "{a: b}", "true"])
def test_a_list_of_texts_that_is_none_is_refused(scene_file, value):
    said = refusal(scene_file(below_head(f"record.topics: {value}")))
    assert "record.topics" in said
    assert value == "{a: b}" or "is not a list of texts; write [one, another]" in said


def test_every_scene_parameter_can_be_given_its_default(scene_file):
    defaults = {p.name: str(p.default).lower() if isinstance(p.default, bool) else p.default for p in SCENE_PARAMETERS}
    path = scene_file(below_head(*(f"{name}: {value}" for name, value in defaults.items())))
    assert load_scene(path).parameters == Scene().parameters


@pytest.mark.parametrize(("line", "named"), [
    ("guide.angel: 1.0", ["guide.angel", "did you mean guide.angle?"]),
    ("motor.sped: 1.0", ["did you mean motor.speed?"]),
    ("rate.publsh: 1.0", ["did you mean rate.publish?"]),
    ("xyzzy: 1.0", ["xyzzy", "--help"]),
    ("1: 2", ["1", "unknown"]),
    ('"a\\nb": 1.0', ["unknown"]),
    ("mass: 1.0", ["mass", "unknown"]),
    ("mass.body: heavy", ["mass.body", "heavy", "number", "kg"]),
    ("mass.body: '1.0'", ["mass.body", "'1.0'", "number"]),
    ("mass.body: true", ["mass.body", "True", "number"]),
    ("mass.body: [1.0]", ["mass.body", "[1.0]", "number"]),
    ("mass.body:", ["mass.body", "None", "number"]),
    ("mass.body: 2020-01-01", ["mass.body", "number"]),
    ("mass.body: .nan", ["mass.body", "nan", "finite"]),
    ("mass.body: -.inf", ["mass.body", "-inf", "finite"]),
    ("mass.body: 1" + "0" * 400, ["mass.body", "finite"]),
    ("mass.body: 1" + "0" * 5000, ["cannot be read as int"]),
    ("mass.body: 0.0", ["mass.body", "0", "above 0"]),
    ("mass.body: -1.0", ["mass.body", "-1", "above 0"]),
    ("guide.angle: 3.2", ["guide.angle", "3.2", "3.14159"]),
    ("crank.radius: 0.07", ["crank.radius", "0.07", "0.06", "longer rod"]),
    ("motor.speed: 600.0", ["motor.speed", "600", "500", "motor.max_speed"]),
    ("upper.gap: 0.1", ["upper.gap", "0.1", "0.06"]),
    ("effects.adhesion: 1", ["effects.adhesion", "1", "true or false"]),
    ("effects.motor: rampp", ["effects.motor", "rampp", "ideal, ramp"]),
    ('effects.motor: "a\\nb"', ["effects.motor", "ideal, ramp"]),
    ("mass.body: 1.0\n    mass.body: 2.0", ["mass.body", "twice"]),
    ("mass.body: 1.0\n    mass: {body: 2.0}", ["mass.body", "twice"]),
    ("mass.body: !!python/object:os.system x", ["YAML"])], ids=lambda value: str(value)[:40])
def test_a_wrong_line_is_refused(scene_file, line, named):
    message = refusal(scene_file(below_head(line)))
    assert not [text for text in named if text not in message]


@pytest.mark.parametrize(("content", "named"), [
    ("", "parameter file"), ("5", "parameter file"), ("- 1", "parameter file"), ("&a [*a]", "itself"),
    ("/**:\n  mass.body: 1.0\n", "ros__parameters"), ("/**:\n  ros__parameters:\n", "ros__parameters"),
    ("mass.body: 1.0\n", "ros__parameters"), ("/**:\n  ros__parameters: {}\n  other: 1\n", "ros__parameters"),
    ("/**:\n\tros__parameters: {}", "line 2"), ("a: 1\n---\nb: 2", "YAML"), ("a: [1, 2", "YAML"),
    ("{a: 1, a: 2}", "twice"),
    (b"\xff\xfe\x00", "YAML"), ("a: \x00", "YAML"), (HEAD + "    ? [a]\n    : 1.0\n", "YAML"),
    ("/**: &x\n  ros__parameters: *x\n", "itself"), ("a: " + "{a: " * 3000 + "1" + "}" * 3000, "nested")])
def test_a_file_of_another_structure_is_refused(scene_file, content, named):
    assert named in refusal(scene_file(content))


def test_a_missing_file_or_scene_is_refused(tmp_path):
    for path in (tmp_path / "missing.yaml", tmp_path, "nosuch"):
        message = refusal(path)
        assert all(name in message for name in shipped_scenes())
    refusal(tmp_path / "missing.yaml", read_parameter_file)
    refusal(tmp_path, read_parameter_file)


def test_the_order_of_lines_does_not_matter(scene_file):
    """A radius that only the longer rods of a later line allow."""
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
