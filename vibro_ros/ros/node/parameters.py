"""ROS parameters derived from the package's parameter tables."""

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rcl_interfaces.msg import Parameter as ParameterMessage
from rclpy.node import Node
from rclpy.parameter import Parameter as ParameterOfRclpy

from vibro_ros.configuration.parameter_file import own_parameters
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.model.parameters import SCENE_PARAMETERS, Parameter, Value, checked_parameters, nearest
from vibro_ros.process.files import one_line
from vibro_ros.ros.node.refusals import peer_text

TABLE = (*DEVICE_PARAMETERS, *SCENE_PARAMETERS)  # table of all parameters of the robot
_TYPES = frozenset(kind.value for kind in ParameterOfRclpy.Type)
_MAY_BE_NUMBERS = (ParameterOfRclpy.Type.INTEGER, ParameterOfRclpy.Type.STRING)


def take_overrides(node: Node) -> dict[str, object]:
    """Return every parameter override that `node` was given, and undeclare all of them.

    rclpy ignores an override whose parameter is never declared; a misspelt name is found only by taking them all. The
    node must declare parameters from overrides automatically.
    """
    given = {name: parameter.value for name, parameter in node.get_parameters_by_prefix("").items()}
    overrides = own_parameters(given)
    for name in overrides:
        node.undeclare_parameter(name)
    return overrides


def declare(node: Node, table: Iterable[Parameter], values: Mapping[str, Value]) -> None:
    """Declare every parameter of `table` on `node`, with its checked value in `values`, even if it is declared."""
    for parameter in table:
        if node.has_parameter(parameter.name):  # rclpy keeps the descriptor that it hands out
            node.describe_parameter(parameter.name).read_only = False
            node.undeclare_parameter(parameter.name)
        node.declare_parameter(parameter.name, values[parameter.name], descriptor(parameter), ignore_override=True)


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Return a new descriptor of a parameter (new, because `declare_parameter` changes the one it is given)."""
    ranges, largest = [], sys.float_info.max
    if isinstance(parameter.default, float) and not _unlimited(parameter):
        low, high = max(parameter.minimum, -largest), min(parameter.maximum, largest)
        ranges = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    return ParameterDescriptor(
        name=parameter.name,
        description=f"{parameter.description} [{parameter.unit}]" if parameter.unit else parameter.description,
        additional_constraints=constraints(parameter),
        read_only=not parameter.while_running,
        floating_point_range=ranges,
    )


def constraints(parameter: Parameter) -> str:
    """Return in words the constraints that a range cannot express."""
    if parameter.choices:
        return f"one of {', '.join(parameter.choices)}"
    if parameter.smallest:
        return f"0, or at least {parameter.smallest:g}"
    return "above 0" if parameter.positive else ""


def set_refusal(node: Node, asked: ParameterMessage) -> str:
    """Return why a parameter cannot be set as `asked`; empty if it can be, or has this value already."""
    shown = peer_text(asked.name)
    if not node.has_parameter(asked.name):
        question = nearest(asked.name, node.get_parameters_by_prefix(""))
        return f"{shown}: unknown parameter; {question or '`--help` of the executable lists what there is'}"
    if asked.value.type not in _TYPES:
        return f"{shown}: type {asked.value.type} does not exist; rcl_interfaces/msg/ParameterType lists the types"
    change = change_of(node, asked)
    if not change:
        return ""
    if node.describe_parameter(asked.name).read_only:
        return f"{shown}: read-only while the node runs; start it with -p {shown}:=VALUE"
    try:
        checked_parameters({asked.name: _plain(change.value)}, TABLE)
    except ValueError as error:
        return one_line(error)
    return ""


def change_of(node: Node, asked: ParameterMessage) -> ParameterOfRclpy | None:
    """Return the change that a peer has `asked` for; None if the parameter has this value already.

    An integer or a text for a parameter of type double is converted: `ros2 param set` sends 300 as an integer and 1e-6
    as a text, and so does `ros2 param load` with the files of `ros2 param dump`. The robot reads both as numbers in
    files and on its command line, too.
    """
    present, wanted = node.get_parameter(asked.name), ParameterOfRclpy.from_parameter_msg(asked)
    if present.type_ is ParameterOfRclpy.Type.DOUBLE and wanted.type_ in _MAY_BE_NUMBERS:
        with suppress(ValueError, OverflowError):  # a text that is no number is refused as it is
            wanted = ParameterOfRclpy(asked.name, ParameterOfRclpy.Type.DOUBLE, float(wanted.value))
    return None if (present.type_, _plain(present.value)) == (wanted.type_, _plain(wanted.value)) else wanted


def _plain(value: Any) -> Any:
    """Return a value in a form that can be compared: rclpy represents lists as lists, tuples or arrays."""
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else value


def parameter_lines(table: Iterable[Parameter], values: Mapping[str, Value]) -> str:
    """Return the help text of --help: for each parameter of `table` a line with name, value in `values`, meaning."""
    lines = []
    for parameter in table:
        value, unit = json.dumps(values[parameter.name], ensure_ascii=False), f" {parameter.unit}".rstrip()
        lines.append(f"  {parameter.name} = {value}{unit}: {parameter.description}{_limits(parameter)}")
    return "\n".join(lines)


def _unlimited(parameter: Parameter) -> bool:
    return math.isinf(parameter.minimum) and math.isinf(parameter.maximum)


def _limits(parameter: Parameter) -> str:
    words = [constraints(parameter)] if constraints(parameter) else []
    if isinstance(parameter.default, float) or parameter.is_numbers and not _unlimited(parameter):
        words.append(f"{parameter.minimum:g} to {parameter.maximum:g}")
    return f" ({', '.join(words)})" if words else ""
