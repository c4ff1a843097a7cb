"""The scene of a robot as its parameters give it, or no scene if no robot of this version answers."""

import pytest
from rcl_interfaces.msg import ParameterValue
from rclpy.parameter import Parameter

import vibro_ros
from vibro_ros.ros.node import robot_parameters
from vibro_ros.ros.node.robot_parameters import settings_of

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
