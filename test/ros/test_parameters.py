"""The node's parameters as ROS tools see them, and what `ros2 param` does through the services that it calls.

The command line itself is not on PyPI. It makes numbers of words by its own rules: 300 becomes an integer, and 1e-6,
which YAML 1.1 does not take for a number, a text.
"""

from pathlib import Path

import pytest
import yaml
from asking import answer_of
from observation import bags, stop
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter, get_parameter_value, parameter_dict_from_yaml_file, parameter_value_to_python

from vibro_ros.bag.reader import read_bag
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS, load_scene
from vibro_ros.model.parameters import SCENE_PARAMETERS

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


def test_what_somebody_types_is_refused_in_words_that_help_and_every_parameter_is_described(start, parameters):
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


def test_one_file_is_one_robot_by_every_road_and_a_dump_is_taken_back(start, parameters, tmp_path):
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
