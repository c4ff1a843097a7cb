"""A process that serves the built types over DDS, until it is killed: /tf, a service and an action."""

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.action import ActionServer
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import Result
from simulation_interfaces.srv import StepSimulation
from tf2_msgs.msg import TFMessage


def answer(request, response):
    response.result = Result(result=Result.RESULT_OK, error_message=f"{request.steps} steps")
    return response


def simulate(goal):
    goal.publish_feedback(SimulateSteps.Feedback(completed_steps=1, remaining_steps=goal.request.steps - 1))
    goal.succeed()
    return SimulateSteps.Result(result=Result(result=Result.RESULT_OPERATION_FAILED, error_message="µ"))


rclpy.init()
node = rclpy.create_node("peer_of_types")
node.create_service(StepSimulation, "step", answer)
ActionServer(node, SimulateSteps, "simulate", simulate)
publisher = node.create_publisher(TFMessage, "/tf", 10)
transform = TransformStamped(child_frame_id="base_link")
transform.transform.translation.x = 1.25
node.create_timer(0.05, lambda: publisher.publish(TFMessage(transforms=[transform, transform])))
rclpy.spin(node)
