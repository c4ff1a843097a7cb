"""Parameters that peers change while the robot runs: checked together, then changed at one instant of robot time."""

from collections.abc import Sequence

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter as ParameterOfRclpy

from vibro_ros.messages.operations import SET, Operation
from vibro_ros.model.parameters import checked_parameters
from vibro_ros.ros.node.node import SteadyNode
from vibro_ros.ros.node.parameters import TABLE
from vibro_ros.ros.robot.operations import Operations
from vibro_ros.ros.robot.run_services import PATIENCE, outcome


def follow_parameters(node: SteadyNode, operations: Operations) -> None:
    """Let the robot follow its ROS parameters from now on; what it refuses is not stored."""

    def change(parameters: Sequence[ParameterOfRclpy]) -> SetParametersResult:
        values = checked_parameters({one.name: one.value for one in parameters}, TABLE)
        done, words = outcome(operations.ask(Operation(SET, parameters=values)), PATIENCE)
        return SetParametersResult(successful=done, reason="" if done else words)

    node.remove_on_set_parameters_callback(refuse_while_starting)
    node.add_on_set_parameters_callback(change)


def refuse_while_starting(parameters: Sequence[ParameterOfRclpy]) -> SetParametersResult:
    """Refuse every change of a robot that has no device yet."""
    reason = f"{parameters[0].name}: the robot is still starting; set it when it is ready"
    return SetParametersResult(successful=False, reason=reason)
