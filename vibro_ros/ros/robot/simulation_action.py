"""The action `~/simulate_steps`: steps with a message after each, which can be cancelled."""

from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.qos import QoSProfile

from vibro_ros.ros.node.node import SteadyNode
from vibro_ros.ros.node.requests import Request
from vibro_ros.ros.robot.simulation_control import SimulationControl
from vibro_ros.ros.robot.simulation_rules import Code, RefusalError

RESULT_TIMEOUT = 60
"""How long [s] the result of a goal is kept for who asks late; each goal that was ever sent takes memory meanwhile."""

FEEDBACK_DEPTH = 1000
"""Messages that DDS keeps for who is slower than the steps, which no clock holds back."""


def offer_steps(node: SteadyNode, kind: Any, name: str, control: SimulationControl) -> None:
    """Offer the action."""
    path = node.resolve_service_name(name)
    taken: dict[bytes, Request] = {}  # by goal

    async def execute(goal: ServerGoalHandle) -> Any:
        result, key = kind.Result(), bytes(goal.goal_id.uuid)
        try:
            if goal.is_cancel_requested:
                raise RefusalError(Code.OPERATION_FAILED, "cancelled before the first step")
            taken[key] = control.begin_steps(goal.request.steps, lambda completed: tell(goal, completed))
            await control.finish_steps(taken[key])
            goal.succeed()
            result.result.result = Code.OK
        except RefusalError as refusal:
            _end(goal)
            node.refusals.refuse(path, str(refusal))
            result.result.result, result.result.error_message = refusal.code, str(refusal)
        finally:
            taken.pop(key, None)
        return result

    def tell(goal: ServerGoalHandle, completed: int) -> None:
        """Publish the feedback; in the stepping thread, which nothing that is wrong with a goal may end."""
        try:
            remaining = goal.request.steps - completed
            goal.publish_feedback(kind.Feedback(completed_steps=completed, remaining_steps=remaining))
        except Exception as error:
            node.refusals.catch(path, error)

    def cancel(goal: ServerGoalHandle) -> CancelResponse:
        if request := taken.get(bytes(goal.goal_id.uuid)):
            control.give_up(request)
        return CancelResponse.ACCEPT

    ActionServer(node, kind, name, execute, cancel_callback=cancel, result_timeout=RESULT_TIMEOUT,
                 feedback_pub_qos_profile=QoSProfile(depth=FEEDBACK_DEPTH))


def _end(goal: ServerGoalHandle) -> None:
    if goal.is_cancel_requested:
        goal.canceled()
    else:
        goal.abort()
