"""The ROS 2 shell around the device: the only package that imports rclpy.

In come commands, requests and parameters from ROS peers and from pages in the browser; out go the robot's messages,
bags, answers and the live page. `node` is the base of all nodes. `robot` is the robot executable: read it first, from
`robot/robot.py` and `robot/run.py` on. `controller` is the executable that commands a robot by a script or by goals,
and `live` shows a live robot in the browser. What a message means is defined in the room `messages`.

The names below are the frame of a ROS node, public as those of `vibro_ros` are: another package's node is made of them.
"""

from importlib import import_module

TYPE_CHECKING = False
if TYPE_CHECKING:
    from vibro_ros.ros.node.arguments import (
        check_addressed,
        check_arguments,
        check_names,
        folder_of,
        own_arguments,
    )
    from vibro_ros.ros.node.node import GuardedNode, PollingSubscription, check_qos_overrides, qos_profile
    from vibro_ros.ros.node.parameters import declare, parameter_lines, take_overrides
    from vibro_ros.ros.node.process import CLOCK, node_running, spin_until, wait_for_time

__all__ = ["CLOCK", "GuardedNode", "PollingSubscription", "check_addressed", "check_arguments", "check_names",
           "check_qos_overrides", "declare", "folder_of", "node_running", "own_arguments", "parameter_lines",
           "qos_profile", "spin_until", "take_overrides", "wait_for_time"]

_HOMES = {  # as in `vibro_ros`
    # a node from its command line to its clean end
    "GuardedNode": "node", "CLOCK": "process", "node_running": "process", "spin_until": "process",
    "wait_for_time": "process",
    # its arguments and parameters
    "check_addressed": "arguments", "check_arguments": "arguments", "check_names": "arguments",
    "folder_of": "arguments", "own_arguments": "arguments", "declare": "parameters", "parameter_lines": "parameters",
    "take_overrides": "parameters",
    # its topics
    "PollingSubscription": "node", "check_qos_overrides": "node", "qos_profile": "node",
}


def __getattr__(name: str) -> object:
    """Import a public name at its first use."""
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.node.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
