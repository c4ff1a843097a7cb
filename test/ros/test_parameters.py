"""The node's parameters as ROS tools see them, through the services that `ros2 param` calls, and
through parameter files.

The command line itself is not on PyPI. It makes numbers of words by its own rules: 300 becomes an integer, and 1e-6,
which YAML 1.1 does not take for a number, a text.
"""

from pathlib import Path

import pytest
import rclpy
import yaml
from asking import answer_of
from observation import bags, stop
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter, get_parameter_value, parameter_dict_from_yaml_file, parameter_value_to_python

import vibro_ros
from vibro_ros.bag.reader import read_bag
from vibro_ros.configuration.parameter_file import merged, own_parameters, sections
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS, load_scene
from vibro_ros.model.parameters import SCENE_PARAMETERS
from vibro_ros.ros.node import robot_parameters
from vibro_ros.ros.node.arguments import folder_of
from vibro_ros.ros.node.robot_parameters import settings_of

TABLE = (*DEVICE_PARAMETERS, *SCENE_PARAMETERS)


NODE = "/vibro_robot"


class Parameters:
    """`ros2 param` for one node."""

    def __init__(self, bench):
        self._bench = bench

    def dump(self) -> dict[str, object]:
        """Return every parameter's value by its name."""
        names = self._ask(ListParameters, "list_parameters").result.names
        values = self._ask(GetParameters, "get_parameters", names=names).values
        return {name: parameter_value_to_python(value) for name, value in zip(names, values, strict=True)}

    def describe(self, names: list[str]) -> list:
        return self._ask(DescribeParameters, "describe_parameters", names=names).descriptors

    def set(self, name: str, words: str) -> tuple[bool, str]:
        """Set a parameter to the text that a user typed; returns whether it was set, and why not."""
        (answer,) = self._set([Parameter(name=name, value=None).to_parameter_msg()], get_parameter_value(words))
        return answer.successful, answer.reason

    def load(self, path: Path) -> list[str]:
        """Load parameters of a file; returns why some were not set."""
        wanted = parameter_dict_from_yaml_file(str(path), True, target_nodes=[NODE])
        return [answer.reason for answer in self._set([*wanted.values()]) if not answer.successful]

    def _set(self, parameters: list, value=None) -> list:
        if value:
            parameters[0].value = value
        return self._ask(SetParameters, "set_parameters", parameters=parameters).results

    def _ask(self, kind: type, name: str, **fields):
        return answer_of(self._bench, kind, f"{NODE}/{name}", **fields)


@pytest.fixture
def parameters(bench) -> Parameters:
    return Parameters(bench)


def written(values: dict[str, object], path: Path) -> Path:
    """Return parameters in the form of a file by `ros2 param dump`: nested by the dots of the names."""
    nested: dict = {}
    for name, value in values.items():
        *groups, last = name.split(".")
        place = nested
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = value
    path.write_text(yaml.dump({NODE: {"ros__parameters": nested}}, default_flow_style=False))
    return path


REFUSED = (
    ("motor.max_speed", "fast", "motor.max_speed: 'fast' is not a number; give a number above 0 to 10000 rad/s"),
    ("motor.max_speed", "-300", "motor.max_speed: -300 is out of range; give a number above 0 to 10000 rad/s"),
    ("motor.max_speed", "1e400", "motor.max_speed: inf is not finite; give a number above 0 to 10000 rad/s"),
    ("motor.max_speed", "[1.0]", "motor.max_speed: [1.0] is not a number; give a number above 0 to 10000 rad/s"),
    ("mass.body", "2.0", "mass.body: read-only while the node runs; start it with -p mass.body:=VALUE"),
    ("mass.boddy", "2.0", "mass.boddy: unknown parameter; did you mean mass.body?"),
)


def test_wrong_parameters_are_refused_with_the_remedy_and_every_parameter_is_described(start, parameters):
    """The robot is started with another scene, an integer where a floating-point number is required, and a changed
    default.
    """
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false", "-p", "mass.body:=3", "-p", "scene:=damped")
    robot.wait_for("ready")
    for name, words, reason in REFUSED:
        assert parameters.set(name, words) == (False, reason)
    values = parameters.dump()
    scene = load_scene("damped").with_parameters({"mass.body": 3.0})
    expected = {parameter.name: parameter.default for parameter in DEVICE_PARAMETERS} | dict(scene.parameters)
    expected |= {"record.enabled": False, "scene": "damped"}
    for parameter, shown in zip(TABLE, parameters.describe([parameter.name for parameter in TABLE]), strict=True):
        value = values[parameter.name]
        assert (tuple(value) if isinstance(value, list) else value) == expected[parameter.name]
        assert type(expected[parameter.name]) is type(parameter.default)
        assert shown.read_only is not parameter.while_running
        assert parameter.description in shown.description and parameter.unit in shown.description
        assert all(choice in shown.additional_constraints for choice in parameter.choices)
    for descriptor in parameters.describe([*values]):
        assert descriptor.type and len(descriptor.description) > 10, descriptor.name
    (speed,) = parameters.describe(["motor.max_speed"])
    assert speed.description.endswith("[rad/s]") and not speed.read_only
    assert (speed.floating_point_range[0].to_value, speed.additional_constraints) == (10_000.0, "above 0")
    stop(robot)


def test_a_parameter_file_gives_the_same_robot_by_every_route_and_a_dump_is_accepted(start, parameters, tmp_path):
    """The file is given by `--params-file`, by the parameter `scene` and to `load_scene`; a dump, which also has
    rclpy's own parameters, is accepted.
    """
    (tmp_path / "lab").mkdir()
    mine = tmp_path / "lab" / "mine.yaml"
    (tmp_path / "lab" / "base.yaml").write_text(
        "/**: {ros__parameters: {scene: unilateral, guide.angle: 1.2, gravity: 1.6}}\n")
    mine.write_text("vibro_controller: {ros__parameters: {rate: 20.0}}\n"
                    "/**: {ros__parameters: {scene: base.yaml, gravity: 3.7}}\n")
    roads = {"load_scene": load_scene(mine).parameters}
    first = start("robot", "--ros-args", "--params-file", "lab/mine.yaml", "-p", "record.topics:=[odom]")
    first.wait_for("ready:")
    roads["--params-file"] = parameters.dump()
    roads["load_scene of a dump"] = load_scene(written(roads["--params-file"], tmp_path / "dump.yaml")).parameters
    assert parameters.set("motor.max_speed", "300") == (True, "")
    assert parameters.set("motor.time_constant", "1e-3") == (True, "")
    dumped = parameters.dump()
    assert (dumped["motor.max_speed"], dumped["motor.time_constant"]) == (300.0, 1e-3)
    file = written(dumped, tmp_path / "dump.yaml")
    assert parameters.load(file) == []
    assert parameters.dump() == dumped
    stop(first)
    assert "refused: " not in first.text
    assert set(read_bag(bags(tmp_path)[0]).topics) == {"/odom"}
    for road in (("--params-file", str(file)), ("-p", "scene:=lab/mine.yaml")):
        robot = start("robot", "--ros-args", *road)
        robot.wait_for("ready:")
        if str(file) in road:
            assert parameters.dump() == dumped
        else:
            roads[road] = parameters.dump()
        stop(robot)
    expected = {**load_scene("unilateral").parameters, "guide.angle": 1.2, "gravity": 3.7}
    for road, values in roads.items():
        assert {parameter.name: values[parameter.name] for parameter in SCENE_PARAMETERS} == expected, road


NODE_IN_LAB = "/lab/vibro_robot"


def section(pattern: str, *lines: str) -> str:
    return f"{pattern}:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in lines)


def own_parameters_by_rcl(words: list[str], domain_id: int) -> dict[str, object]:
    context = Context()
    rclpy.init(context=context, domain_id=domain_id, args=["--ros-args", "-r", "__ns:=/lab", *words])
    node = Node("vibro_robot", context=context, automatically_declare_parameters_from_overrides=True)
    given = {name: parameter.value for name, parameter in node.get_parameters_by_prefix("").items()}
    node.destroy_node()
    rclpy.shutdown(context=context)
    return own_parameters(given)


@pytest.mark.parametrize("text", [
    section("/**", "a: 1", "b: 1") + section(NODE_IN_LAB, "a: 2"),
    section(NODE_IN_LAB, "a: 2") + section("/**", "a: 1", "b: 1"),
    section("/lab/*", "a: 1") + section("/*/vibro_robot", "a: 2") + section("/**/vibro_robot", "a: 3"),
    section("/**/vibro_robot", "a: 3") + section("/lab/*", "a: 1") + section("/hall/*", "a: 2"),
    section("lab/vibro_robot", "a: 2") + section("/**", "a: 1") + section("/lab/vibro_robot", "a: 3"),
    section("vibro_controller", "rate: 2") + section("/**", "a: {b: 1, c: {d: 2}}", "e.f: 3"),
    "/lab:\n  vibro_robot:\n    ros__parameters: {a: 1}\n  other:\n    ros__parameters: {a: 2}\n",
    "lab/:\n  vibro_robot:\n    ros__parameters: {a: 1}\n", "/*:\n  '*':\n    ros__parameters: {a: 1}\n",
    section("/**", "a: 1e-3", "b: .5", "c: 0x10", "d: 010", "e: true", "f: text", "g: [p, q]", "h: 'yes'", "i: -0.0",
            "j: 1.0e+3", "k: +2", "l: 1.", "m: ~/x", "n: off"),
    "/lab/:\n  '**':\n    ros__parameters: {}\n  '*':\n    ros__parameters: {a: 1}\n",
    '{"/**": {"ros__parameters": {"a": 1}}}', section("vibro_robot", "a: 1"), section("/lab", "a: 1"),
    section("/lab/**", "a: 1") + section("/vibro_robot", "b: 1") + section("/*", "c: 1"),
    section("/**", "a: !!str 1", "b: !!float 1", "c: !!python/name:os.abort ''", "d: !!set {e: 1}"),
    section("/**", "a: !!python/object/apply:os.abort [p, q]", "b: !!python/tuple\n    - 1.0\n    - 2.0"),
    section("/**", "a: 1") + section("/hall/*", "a: 2") + section("/**", "b: 3", "c: [1.0, 2.0]"),
    "/**:\n  other:\n    ros__parameters: {a: 1}\n" + "/**:\n  vibro_robot:\n    ros__parameters: {a: 2}\n",
    section("/**", "a: 1") + "/**:\n  vibro_robot:\n    ros__parameters: {a: 2}\n" + section("/lab/*", "a: 3"),
    section("/**", "a: {b: 1}", "c: 2", "a: {d: 3}") + section("/hall/*", "e: [[1]]", "f: []"),
    "/lab:\n  '**': {ros__parameters: {a: 1}}\n/lab:\n  '**': {ros__parameters: {b: 2}}\n",
    "/**:\n  vibro_robot: {ros__parameters: {a: 1}}\n  ros__parameters: {b: 2}\n",
    section("/lab/*/vibro_robot", "a: 1") + section("vibro_robt", "b: 1") + section(f"{NODE_IN_LAB}/**/x", "c: 1"),
], ids=range(24))
def test_rcl_reads_the_same_from_a_file(text, tmp_path, domain_id):
    file = tmp_path / "file.yaml"
    file.write_text(text)
    assert merged(sections(file), NODE_IN_LAB) == own_parameters_by_rcl(["--params-file", str(file)], domain_id)


@pytest.mark.parametrize("text", [
    section("/**", "a:"), section("/**", "a: {}"), section("/**", "a: &x 1", "b: *x"), "/**:\n  ros__parameters:\n",
    section("/**", "a: [0.5, 1]"), section("/hall/*", "a: [1, b]"), section("/**", "a: [true, 1]"),
    section("/**", "a: [x, 1e-3]"), "/lab:\n  /**:\n    ros__parameters: {a: 1}\n",
    "/**:\n  ros__parameters: {a: 1}\n  vibro_robot:\n    ros__parameters: {b: 1}\n",
    section("/**", "a: 1") + "  b: 1\n", "- a\n", "a: [1\n", section("/**", "a: b: c"),
], ids=range(14))
def test_files_that_rcl_refuses_are_refused_by_every_route(text, tmp_path, domain_id):
    file = tmp_path / "file.yaml"
    file.write_text(text)
    with pytest.raises(ValueError, match=str(file)):
        sections(file)
    with pytest.raises((RuntimeError, ValueError)):
        own_parameters_by_rcl(["--params-file", str(file)], domain_id)


@pytest.mark.parametrize("order", [
    "1 2", "2 1", "12", "21", "1 p", "p 1", "2 p", "21 p", "p 12", "2 p 2", "1 q", "q p", "3 p", "1 r", "none"])
def test_rcl_takes_the_value_from_the_same_place(order, tmp_path, domain_id, monkeypatch):
    """Each file is alone in its folder, whose name is the value; `-p` has the value `.`."""
    monkeypatch.chdir(tmp_path)
    sections_of = {"1": "/**", "2": NODE_IN_LAB, "3": "/hall/*"}
    overrides = {"p": "scene:=.", "q": "vibro_robot:scene:=.", "r": "gravity:=9.81"}
    words = []
    for name in order.split() if order != "none" else []:
        if name in overrides:
            words += ["-p", overrides[name]]
            continue
        (tmp_path / name).mkdir(exist_ok=True)
        file = tmp_path / name / "file.yaml"
        file.write_text("".join(section(sections_of[letter], f"scene: '{name}'") for letter in name))
        words += ["--params-file", f"{name}/file.yaml"]
    given = own_parameters_by_rcl(words, domain_id)
    assert str(folder_of("scene", ["--ros-args", *words], NODE_IN_LAB)) == given.get("scene", ".")


NAMES = robot_parameters._NAMES
DEVICE = vibro_ros.load_scene("device")


def values(**changes: object) -> list[ParameterValue]:
    given = {**DEVICE.parameters, "scene": "/somewhere/mine.yaml", "frame_prefix": "r1/", "command.timeout": 0.5,
             **changes}
    return [Parameter(name, value=given[name]).get_parameter_value() if given[name] is not None else ParameterValue()
            for name in NAMES]


def test_the_scene_is_what_the_parameters_say():
    settings = settings_of(values(**{"guide.angle": 1.2}))
    assert settings.scene == vibro_ros.Scene("mine", {**DEVICE.parameters, "guide.angle": 1.2})
    assert (settings.prefix, settings.command_timeout) == ("r1/", 0.5)


@pytest.mark.parametrize(("changes", "words"), [
    ({"guide.angle": 40.0}, "guide.angle: 40 is out of range"),
    ({"guide.angle": float("nan")}, "guide.angle: nan is not finite"),
    ({"guide.angle": "steep"}, "guide.angle: 'steep' is not a number"),
    ({"crank.radius": 0.9}, "crank"),
    ({"mass.body": None}, "mass.body: None is not a number"),
    ({"effects.motor": "x" * 1000}, "effects.motor: a text of 1000 characters"),
    ({"frame_prefix": "x" * 1000}, "frame_prefix: a text of 1000 characters"),
    ({"frame_prefix": 3}, "frame_prefix: 3 is not a text"),
    ({"scene": None}, "scene: None is not a text"),
])
def test_values_that_no_robot_has_are_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        settings_of(values(**changes))


def test_an_answer_of_another_length_or_type_is_refused():
    with pytest.raises(ValueError, match="its parameters are not those of this version's robots; name one"):
        settings_of(values()[1:])
    strange = values()
    strange[3] = ParameterValue(type=77)
    with pytest.raises(ValueError, match="unexpected parameter type 77"):
        settings_of(strange)
