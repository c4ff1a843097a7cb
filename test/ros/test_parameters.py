"""The node's parameters as ROS tools see them, and what `ros2 param` does through the services that it calls.

The command line itself is not on PyPI. It makes numbers of words by its own rules: 300 becomes an integer, and 1e-6,
which YAML 1.1 does not take for a number, a text.
"""

from pathlib import Path

import pytest
import yaml
from asking import answer_of, known_client
from observation import stop
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter, get_parameter_value, parameter_dict_from_yaml_file, parameter_value_to_python

from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS, load_scene
from vibro_ros.model.parameters import SCENE_PARAMETERS
from vibro_ros.ros.node.parameters import descriptor

KINDS = {
    bool: (ParameterType.PARAMETER_BOOL, "bool_value"),
    str: (ParameterType.PARAMETER_STRING, "string_value"),
    float: (ParameterType.PARAMETER_DOUBLE, "double_value"),
    tuple: (ParameterType.PARAMETER_STRING_ARRAY, "string_array_value"),
}
TABLE = (*DEVICE_PARAMETERS, *SCENE_PARAMETERS)


@pytest.fixture
def ask(start, bench):
    """Call a parameter service of a robot with one integer, one file and one override more than its defaults."""
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false", "-p", "mass.body:=2", "-p", "scene:=damped")

    def call(kind, name: str, **fields):
        future = known_client(bench, kind, name).call_async(kind.Request(**fields))
        bench.spin_until(future.done, f"answer of {name}")
        return future.result()

    robot.wait_for("ready")
    return call


def test_every_parameter_is_there_with_range_description_and_value(ask):
    names = [parameter.name for parameter in TABLE]
    assert set(names) <= set(ask(ListParameters, "list_parameters").result.names)
    described = ask(DescribeParameters, "describe_parameters", names=names).descriptors
    values = ask(GetParameters, "get_parameters", names=names).values
    scene = load_scene("damped").with_parameters({"mass.body": 2.0})
    expected = {parameter.name: parameter.default for parameter in DEVICE_PARAMETERS} | dict(scene.parameters)
    expected |= {"record.enabled": False, "scene": "damped"}
    for parameter, told, value in zip(TABLE, described, values, strict=True):
        assert told.read_only is not parameter.while_running
        assert parameter.description in told.description
        assert parameter.unit in told.description
        assert all(choice in told.additional_constraints for choice in parameter.choices)
        kind, field = KINDS[type(parameter.default)]
        assert (told.type, value.type) == (kind, kind), parameter.name
        shown = getattr(value, field)
        assert (tuple(shown) if kind == ParameterType.PARAMETER_STRING_ARRAY else shown) == expected[parameter.name]


def test_a_range_is_the_tables():
    (speed,) = (parameter for parameter in SCENE_PARAMETERS if parameter.name == "motor.speed")
    (span,) = descriptor(speed).floating_point_range
    assert (span.from_value, span.to_value, span.step) == (0.0, 1e4, 0.0)


NODE = "/vibro_robot"


class Parameters:
    """`ros2 param` for one node."""

    def __init__(self, bench):
        self._bench = bench

    def dump(self) -> dict[str, object]:
        """Every parameter's value by its name."""
        names = self._ask(ListParameters, "list_parameters").result.names
        values = self._ask(GetParameters, "get_parameters", names=names).values
        return {name: parameter_value_to_python(value) for name, value in zip(names, values, strict=True)}

    def describe(self, names: list[str]) -> list:
        return self._ask(DescribeParameters, "describe_parameters", names=names).descriptors

    def set(self, name: str, words: str) -> tuple[bool, str]:
        """Whether a parameter was set to what somebody has typed, and why not."""
        (answer,) = self._set([Parameter(name=name, value=None).to_parameter_msg()], get_parameter_value(words))
        return answer.successful, answer.reason

    def load(self, path: Path) -> list[str]:
        """Why parameters of a file were not set."""
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
    """A file as `ros2 param dump` writes it: nested by the dots of the names."""
    nested: dict = {}
    for name, value in values.items():
        *groups, last = name.split(".")
        place = nested
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = value
    path.write_text(yaml.dump({NODE: {"ros__parameters": nested}}, default_flow_style=False))
    return path


def test_a_dump_is_taken_back_and_starts_the_same_robot(start, parameters, tmp_path):
    """The first robot was changed while it ran; its dump holds rclpy's own parameters as well."""
    first = start("robot", "--ros-args", "-p", "guide.angle:=1.2", "-p", "record.topics:=[odom]")
    first.wait_for("ready")
    assert parameters.set("motor.max_speed", "300") == (True, "")
    assert parameters.set("motor.time_constant", "1e-3") == (True, "")
    dumped = parameters.dump()
    assert (dumped["motor.max_speed"], dumped["motor.time_constant"]) == (300.0, 1e-3)
    file = written(dumped, tmp_path / "dump.yaml")
    assert parameters.load(file) == []
    assert parameters.dump() == dumped
    stop(first)
    assert "refused: " not in first.text
    second = start("robot", "--ros-args", "--params-file", str(file))
    second.wait_for("ready")
    assert parameters.dump() == dumped
    stop(second)


REFUSED = (
    ("motor.max_speed", "fast", "motor.max_speed: 'fast' is not a number; give a number above 0 to 10000 rad/s"),
    ("motor.max_speed", "-300", "motor.max_speed: -300 is out of range; give a number above 0 to 10000 rad/s"),
    ("motor.max_speed", "1e400", "motor.max_speed: inf is not finite; give a number above 0 to 10000 rad/s"),
    ("motor.max_speed", "[1.0]", "motor.max_speed: [1.0] is not a number; give a number above 0 to 10000 rad/s"),
    ("mass.body", "2.0", "mass.body: read-only while the node runs; start it with -p mass.body:=VALUE"),
    ("mass.boddy", "2.0", "mass.boddy: unknown parameter; `ros2 param list` shows what there is"),
)


def test_what_somebody_types_is_refused_in_words_that_help_and_every_parameter_is_described(robot, parameters):
    for name, words, reason in REFUSED:
        assert parameters.set(name, words) == (False, reason)
    for one in parameters.describe([*parameters.dump()]):
        assert len(one.description) > 10, one.name
        assert one.type, one.name
    (speed,) = parameters.describe(["motor.max_speed"])
    assert speed.description.endswith("[rad/s]") and not speed.read_only
    assert (speed.floating_point_range[0].to_value, speed.additional_constraints) == (10_000.0, "above 0")


@pytest.fixture
def robot(start):
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false")
    robot.wait_for("ready")
    return robot
