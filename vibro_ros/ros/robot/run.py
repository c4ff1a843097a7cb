"""The parts of a robot that runs, and how they are put together."""

from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from vibro_ros.model.parameters import Value
from vibro_ros.ros.node.node import SteadyNode
from vibro_ros.ros.robot.clock import clock_publisher
from vibro_ros.ros.robot.command_timeout import CommandTimeout
from vibro_ros.ros.robot.live_parameters import follow_parameters
from vibro_ros.ros.robot.lock_step import LockStep, checked_nodes
from vibro_ros.ros.robot.operations import Operations
from vibro_ros.ros.robot.pacing import Pacing
from vibro_ros.ros.robot.recording import Recording
from vibro_ros.ros.robot.robot_time import RobotTime
from vibro_ros.ros.robot.run_services import offer_run_services
from vibro_ros.ros.robot.simulation_control import SimulationControl
from vibro_ros.ros.robot.simulation_services import offer_simulation
from vibro_ros.ros.topics.inputs import Inputs
from vibro_ros.ros.topics.outputs import Outputs
from vibro_ros.simulation.simulator import Simulator


@dataclass(frozen=True)
class Run:
    """One run of the robot.

    Attributes
    ----------
    device : Simulator
        Used by the stepping thread alone once it runs.
    robot_time : RobotTime
        Which sample is the last, and when that is.
    pacing : Pacing
        What holds robot time to the wall clock.
    inputs, outputs : Inputs, Outputs
        The robot's topics.
    operations : Operations
        Pauses, steps and the like.
    recording : Recording
        The bags.
    control : SimulationControl
        Answers the requests of simulation_interfaces.
    timeout : CommandTimeout or None
        Says when the motor is to stop for want of commands.
    clock : callable or None
        Publishes robot time.
    lock_step : LockStep or None
        Says when the next sample may be taken.
    """

    device: Simulator
    robot_time: RobotTime
    pacing: Pacing
    inputs: Inputs
    outputs: Outputs
    operations: Operations
    recording: Recording
    control: SimulationControl
    timeout: CommandTimeout | None = None
    clock: Callable[[], None] | None = None
    lock_step: LockStep | None = None

    def keep_checkpoint(self) -> None:
        """Offer the bag, which seldom wants it, the device's whole state, and first the parameters that changed."""
        self.recording.checkpoint(self.robot_time.stamp, self._checkpoint)

    def _checkpoint(self) -> Iterator[tuple[str, bytes]]:
        if changes := self.operations.changes():
            yield self.operations.topic, changes
        state = Float64MultiArray(data=array("d", self.device.checkpoint()))
        yield self.recording.checkpoint_topic, serialize_message(state)


def new_run(node: SteadyNode, settings: Mapping[str, Value], device: Simulator, outputs: Outputs, recording: Recording
            ) -> Run:
    """The run of a `device`, which listens to commands and requests from now on, and is stepped by `Stepping`."""
    pacing = Pacing(settings["rate.real_time_factor"], settings["rate.max_catch_up"])
    robot_time, inputs = RobotTime(settings["rate.publish"]), Inputs(node)
    nodes = checked_nodes(node, settings["clock.lock_step"])
    lock_step = LockStep(node, nodes) if nodes else None
    operations = Operations(node, device, pacing, robot_time, inputs.waiting, recording.record, lock_step,
                            settings["rate.start_paused"])
    node.create_service(SetBool, "~/record", lambda request, answer: _switch(recording, request, answer))
    offer_run_services(node, operations)
    follow_parameters(node, operations)
    control = SimulationControl(node, operations, robot_time)
    offer_simulation(node, control)
    return Run(device, robot_time, pacing, inputs, outputs, operations, recording, control,
               timeout=CommandTimeout(settings["command.timeout"]) if settings["command.timeout"] else None,
               clock=clock_publisher(node, robot_time) if settings["clock.publish"] else None, lock_step=lock_step)


def _switch(recording: Recording, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
    """Answer the service `~/record`."""
    answer.success, answer.message = recording.switch(request.data)
    return answer
