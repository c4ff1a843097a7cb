"""The robot's topics, names, types and units of commands; and operations, which are asked of a run besides commands.

ROS, bags and documents take them from here. The robot publishes and records each operation that it performs as a text:
the operation's name and, where it has any, what belongs to it as JSON, such as ``step 10`` or
``set {"ground.friction": 0.1}``.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from vibro_ros.model.parameters import BY_NAME, Value

if TYPE_CHECKING:  # bags take topics from here and need no device
    from vibro_ros.simulation.simulator import Simulator

COMMAND_UNITS = {"motor_speed": "rad/s", "upper_gap": "m", "inclined_gap": "m"}
"""Unit of each command; the names are topics and arguments of `Simulator.command`."""

ROBOT_TOPICS = {
    "odom": "nav_msgs/msg/Odometry",
    "joint_states": "sensor_msgs/msg/JointState",
    "ground_contact": "geometry_msgs/msg/WrenchStamped",
    "impacts": "geometry_msgs/msg/WrenchStamped",
    "motor_power": "std_msgs/msg/Float64",
    "robot_description": "std_msgs/msg/String",
    "tf": "tf2_msgs/msg/TFMessage",
    "tf_static": "tf2_msgs/msg/TFMessage",
    **dict.fromkeys(COMMAND_UNITS, "std_msgs/msg/Float64"),
}
"""Type of each topic; a topic in a bag that ends like one of these and has another type is somebody else's."""

VARIANCES = ("odom.pose_covariance_diagonal", "odom.twist_covariance_diagonal")
"""Parameters of the node with the variances in `odom`."""

TF_TOPICS = ("tf", "tf_static")
"""Topics that all robots of a graph share, outside of namespaces, and that need a package which may be missing."""

LASTING = ("robot_description", "tf_static")
"""Topics on which one message says all: late subscribers get it, and each file of a bag begins with it."""

CHECKPOINT = "checkpoint"
CHECKPOINT_TYPE = "std_msgs/msg/Float64MultiArray"
"""Only in bags that may lack a run's beginning: `Simulator.checkpoint` after a sample and before its commands."""

OPERATIONS = "operations"
OPERATIONS_TYPE = "std_msgs/msg/String"
"""What was done to the run besides commands, as `Operation` has it; under the node's own name, as the checkpoint."""

INPUTS = (*COMMAND_UNITS, OPERATIONS)
"""What decides the run, and does not follow from it."""

RESET, PAUSE, RESUME, STEP, SET, TIMEOUT = "reset", "pause", "resume", "step", "set", "timeout"
NAMES = (RESET, PAUSE, RESUME, STEP, SET, TIMEOUT)


def published_name(topic: str) -> str:
    """The name under which the robot publishes one of its topics, before namespace and remapping."""
    return f"/{topic}" if topic in TF_TOPICS else topic


@dataclass(frozen=True)
class Operation:
    """One operation.

    Attributes
    ----------
    name : str
        `RESET`: back to the start. `PAUSE`, `RESUME`: robot time stands still, goes on. `STEP`: so many samples while
        robot time stands still. `SET`: other parameters. `TIMEOUT`: the motor stops, because no command came.
    steps : int
        Samples of `STEP`.
    parameters : mapping of str to value
        Of `SET`.
    """

    name: str
    steps: int = 0
    parameters: Mapping[str, Value] = field(default_factory=dict)

    def __str__(self) -> str:
        rest = {STEP: str(self.steps), SET: json.dumps(dict(self.parameters))}.get(self.name)
        return self.name if rest is None else f"{self.name} {rest}"


def read_operation(text: str) -> Operation:
    """The operation that a recorded text names.

    Raises
    ------
    ValueError
        For any other text.
    """
    name, _, rest = text.partition(" ")
    try:
        if name not in NAMES or (name not in (STEP, SET) and rest):
            raise ValueError("no such operation")
        steps = int(rest) if name == STEP else 0
        parameters = json.loads(rest) if name == SET else {}
        if not isinstance(parameters, dict):
            raise ValueError("no mapping of parameters")
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{text[:60]!r} is no operation of the robot: {error}") from None
    return Operation(name, steps, parameters)


def perform(operation: Operation, device: "Simulator") -> None:
    """Do to the device what the operation does to it; pauses and steps do nothing, because samples are counted.

    Raises
    ------
    ValueError
        For parameters that the device refuses; nothing is changed then.
    SimulationError
        When the run cannot go on.
    """
    if operation.name == RESET:
        device.reset()
    elif operation.name == TIMEOUT:
        device.command(motor_speed=0.0)
    elif of_scene := {name: value for name, value in operation.parameters.items() if name in BY_NAME}:
        device.set_parameters(of_scene)
