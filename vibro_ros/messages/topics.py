"""The robot's topics, names, types and units of commands; and operations, which are asked of a run besides commands.

ROS, bags and documents take them from here. The robot publishes and records each operation that it performs as a text:
the operation's name and, where it has any, what belongs to it as JSON, such as ``step 10`` or
``set {"ground.friction": 0.1}``.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from vibro_ros.messages.joint_commands import joint_commands
from vibro_ros.model import faults
from vibro_ros.model.faults import FAULTS, Incident, checked_incident
from vibro_ros.model.parameters import BY_NAME, Value
from vibro_ros.model.scene import Scene

if TYPE_CHECKING:  # bags take topics from here and need no device
    from vibro_ros.simulation.simulator import Simulator

COMMAND_UNITS = {"motor_speed": "rad/s", "upper_gap": "m", "inclined_gap": "m", "motor_voltage": "V"}
"""Unit of each command; the names are topics and arguments of `Simulator.command`."""

JOINT_COMMANDS = "joint_commands"
"""The same commands for the joints in one message, see `joint_commands`."""

COMMANDS = (*COMMAND_UNITS, JOINT_COMMANDS)
"""Topics that the robot listens to."""

OF_DC_MOTOR = ("motor_voltage", "motor_current", "electrical_power")
"""Topics that only a robot with a dc motor has."""

ROBOT_TOPICS = {
    "odom": "nav_msgs/msg/Odometry",
    "joint_states": "sensor_msgs/msg/JointState",
    "ground_contact": "geometry_msgs/msg/WrenchStamped",
    "impacts": "geometry_msgs/msg/WrenchStamped",
    "motor_power": "std_msgs/msg/Float64",
    "motor_current": "std_msgs/msg/Float64",
    "electrical_power": "std_msgs/msg/Float64",
    "robot_description": "std_msgs/msg/String",
    "tf": "tf2_msgs/msg/TFMessage",
    "tf_static": "tf2_msgs/msg/TFMessage",
    **dict.fromkeys(COMMAND_UNITS, "std_msgs/msg/Float64"),
    JOINT_COMMANDS: "sensor_msgs/msg/JointState",
}
"""Type of each topic; a topic in a bag that ends like one of these and has another type is somebody else's."""

SENSOR_TOPICS = {"imu": "imu/data_raw", "encoder": "encoder", "current": "battery", "tracking": "tracking"}
"""Topic of each sensor of `sensors.device`; a robot has those of the sensors that are on."""

SENSOR_TYPES = {
    "imu/data_raw": "sensor_msgs/msg/Imu",
    "encoder": "sensor_msgs/msg/JointState",
    "battery": "sensor_msgs/msg/BatteryState",
    "tracking": "geometry_msgs/msg/PoseWithCovarianceStamped",
}
"""Type of each topic of a sensor."""

PUBLISHED_TYPES = {**ROBOT_TOPICS, **SENSOR_TYPES}

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

INPUTS = (*COMMANDS, OPERATIONS)
"""What decides the run, and does not follow from it."""

RESET, PAUSE, RESUME, STEP, SET, TIMEOUT = "reset", "pause", "resume", "step", "set", "timeout"
STATE, PUSH, FAULT = "state", "push", "fault"
ARGUMENTS: Mapping[str, frozenset[str]] = {
    SET: frozenset(), STATE: frozenset(), PUSH: frozenset(("duration", "force_x", "force_z")),
    FAULT: frozenset(Incident._fields)}
"""Operations to which a mapping belongs, with the names that it must have; none where the device says which."""
NAMES = (RESET, PAUSE, RESUME, STEP, TIMEOUT, *ARGUMENTS)


def commands_in(name: str, message: Any, scene: Scene) -> tuple[dict[str, float], list[str]]:
    """What a message on one of `COMMANDS` commands, as arguments of `Simulator.command`, and what is wrong with it."""
    return joint_commands(message, scene) if name == JOINT_COMMANDS else ({name: message.data}, [])


def commands_of(scene: Scene) -> tuple[str, ...]:
    """The commands that the robot of a scene listens to."""
    return tuple(name for name in COMMANDS if scene.has_rotor or name not in OF_DC_MOTOR)


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
        `STATE`: another state (`Simulator.set_state`). `PUSH`: a push of the body (`Simulator.push`). `FAULT`: a fault
        begins, or ends (`model.faults`).
    steps : int
        Samples of `STEP`.
    parameters : mapping of str to value
        Of those of `ARGUMENTS`.
    """

    name: str
    steps: int = 0
    parameters: Mapping[str, Value] = field(default_factory=dict)

    def __str__(self) -> str:
        if self.name in ARGUMENTS:
            return f"{self.name} {json.dumps(dict(self.parameters))}"
        return f"{self.name} {self.steps}" if self.name == STEP else self.name


def read_operation(text: str) -> Operation:
    """The operation that a recorded text names.

    Raises
    ------
    ValueError
        For any other text.
    """
    name, _, rest = text.partition(" ")
    try:
        if name not in NAMES or (name not in (STEP, *ARGUMENTS) and rest):
            raise ValueError("no such operation")
        steps = int(rest) if name == STEP else 0
        parameters = json.loads(rest) if name in ARGUMENTS else {}
        if not isinstance(parameters, dict):
            raise ValueError("no mapping of parameters")
        if name == FAULT:  # which earlier versions recorded without a place
            parameters = Incident._field_defaults | parameters
        if (needed := ARGUMENTS.get(name)) and needed != set(parameters):
            raise ValueError(f"it needs {', '.join(sorted(needed))}")
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{text[:60]!r} is no operation of the robot: {error}") from None
    return Operation(name, steps, parameters)


def perform(operation: Operation, device: "Simulator") -> None:
    """Do to the device what the operation does to it; pauses and steps do nothing, because samples are counted.

    Raises
    ------
    ValueError
        For what the device refuses; nothing is changed then.
    SimulationError
        When the run cannot go on.
    """
    if operation.name == RESET:
        device.reset()
    elif operation.name == TIMEOUT:
        device.command(**{device.scene.motor_command: 0.0})
    elif operation.name == STATE:
        device.set_state(**operation.parameters)
    elif operation.name == PUSH:
        device.push(**operation.parameters)
    elif operation.name == FAULT:
        incident = checked_incident(**operation.parameters)
        if FAULTS[incident.fault].befalls != faults.COMMANDS:  # what becomes of commands, their record tells
            device.fail(*incident)
    elif of_scene := {name: value for name, value in operation.parameters.items() if name in BY_NAME}:
        device.set_parameters(of_scene)
