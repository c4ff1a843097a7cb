"""The node's parameters as ROS tools see them."""

import pytest
from asking import known_client
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters

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
