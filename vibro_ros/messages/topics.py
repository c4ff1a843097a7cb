"""The robot's topics, one row each.

Publishers, subscriptions, topics of a bag, `qos_overrides`, messages, replay and the table of docs/guide/node.md follow
from `TOPICS`. A new topic is one more row, if its numbers are fields of `simulation.samples.Samples`.
"""

import math
from collections import Counter
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from vibro_ros.messages.frames import ALL, JOINTS, NONE, ODOM, ONLY_BASE
from vibro_ros.messages.urdf import BASE, COMMANDED, IMU
from vibro_ros.model.parameters import quoted
from vibro_ros.model.scene import Scene

COMMAND, SAMPLE, EVENT, ONCE, NODE, BAG = "command", "sample", "event", "once", "node", "bag"
"""When a message comes: whenever a peer sends a command; with each sample; after an event; once; when the node, not the
device, has something to say; never, because the topic is in bags only."""

NUMBER, NUMBERS, WRENCH = "std_msgs/msg/Float64", "std_msgs/msg/Float64MultiArray", "geometry_msgs/msg/WrenchStamped"

_NOTHING: Mapping[str, Any] = MappingProxyType({})


class Quality(NamedTuple):
    """Quality of service of a topic; programs of users rely on it."""

    depth: int = 10
    reliable: bool = True
    transient_local: bool = False


class Topic(NamedTuple):
    """One topic. Paths lead to a field of the message, such as ``pose.pose.position.x``."""

    type: str  # ROS type of its messages
    when: str  # when a message comes: `COMMAND`, `SAMPLE`, `EVENT`, `ONCE`, `NODE` or `BAG`
    meaning: str  # what the messages say, with units, in Markdown for docs/guide/node.md
    quality: Quality = Quality()
    unit: str = ""  # of a command that is a number; empty for other topics
    frame: str = ""  # in the header; empty where the message has no header, or its frame varies
    numbers: Mapping[str, str] = _NOTHING  # by path, the field of a sample that fills it; `-` before it negates it
    constants: Mapping[str, Any] = _NOTHING  # by path, the constant value
    transforms: tuple[str, ...] = (NONE, ONLY_BASE, ALL)  # values of `tf.publish` with which a robot has the topic
    of_dc_motor: bool = False  # whether only a robot with a dc motor has the topic
    sensor: str = ""  # sensor of `sensors.device` whose measurements it has; a robot without the sensor lacks it
    name: str = ""  # before namespace and remapping, if it differs from the key in `TOPICS`

    def exists(self, scene: Scene, transforms: str = ALL) -> bool:
        """Return whether the robot of a scene has the topic; `transforms` is the value of `tf.publish`."""
        return (transforms in self.transforms and (scene.has_rotor or not self.of_dc_motor)
                and (not self.sensor or scene[f"sensors.{self.sensor}.rate"] > 0.0))


def _command(unit: str, meaning: str, **more: Any) -> Topic:
    return Topic(NUMBER, COMMAND, meaning, unit=unit, **more)


def _sensor(sensor: str, kind: str, meaning: str, frame: str, **more: Any) -> Topic:
    """Return a sensor's topic; its depth is 100 because a fast sensor measures many times between two samples."""
    return Topic(kind, EVENT, meaning, Quality(100), frame=frame, sensor=sensor, **more)


_UPRIGHT = {"pose.pose.orientation.w": 1.0}

TOPICS: Mapping[str, Topic] = {
    "motor_speed": _command("rad/s", "commanded crank speed [rad/s], within ± `motor.max_speed`; below 0 backwards"),
    "upper_gap": _command("m", "commanded gap of the upper plate [m], within ± the rod's length"),
    "inclined_gap": _command("m", "commanded gap of the inclined plate [m], within ± the rod's length"),
    "motor_voltage": _command("V", "with a dc motor whose `motor.control` is `voltage`: commanded voltage [V], within "
                              "± `motor.supply_voltage`", of_dc_motor=True),
    "joint_commands": Topic("sensor_msgs/msg/JointState", COMMAND, "the same commands for joints, as "
                            "[ros2_control](#ros2_control) sends them: `crank` by velocity, plates by "
                            "position; best effort, so that messages of reliable publishers arrive, too",
                            Quality(reliable=False)),
    "odom": Topic("nav_msgs/msg/Odometry", SAMPLE, "position and velocity of `base_link` in `odom`, x and z of each "
                  "[m, m/s]", frame=ODOM, constants=_UPRIGHT,
                  numbers={"pose.pose.position.x": "body_position", "pose.pose.position.z": "body_height",
                           "twist.twist.linear.x": "body_velocity", "twist.twist.linear.z": "body_vertical_velocity"}),
    "joint_states": Topic("sensor_msgs/msg/JointState", SAMPLE, "the joints below, in the frame `base_link`",
                          frame=BASE),
    "ground_contact": Topic(WRENCH, SAMPLE, "force of the ground on the body [N] in the frame `base_link`: friction x "
                            "(negative: slows forward motion), normal z", frame=BASE,
                            numbers={"wrench.force.x": "-friction_force", "wrench.force.z": "normal_force"}),
    "motor_power": Topic(NUMBER, SAMPLE, "power of the motor [W], negative where the springs drive the motor",
                         numbers={"data": "motor_power"}),
    "motor_current": Topic(NUMBER, SAMPLE, "current of a dc motor [A]", numbers={"data": "motor_current"},
                           of_dc_motor=True),
    "electrical_power": Topic(NUMBER, SAMPLE, "power that a dc motor takes from its supply [W], negative where it "
                              "gives power back", numbers={"data": "electrical_power"}, of_dc_motor=True),
    "tf": Topic("tf2_msgs/msg/TFMessage", SAMPLE, "transforms of the frames that move, with every sample; "
                "[below](#frames)", Quality(100), name="/tf", transforms=(ONLY_BASE, ALL)),
    "impacts": Topic(WRENCH, EVENT, "one message for each contact, sent when the contact has ended: peak force [N] of "
                     "the mass on the plate in z, which points outwards from the crank, in the frame of the plate; the "
                     "stamp is the first instant of contact", Quality(1000)),
    "imu/data_raw": _sensor("imu", "sensor_msgs/msg/Imu", "specific force [m/s²] and angular rate [rad/s]", IMU,
                            constants={"orientation.w": 1.0}),
    "encoder": _sensor("encoder", "sensor_msgs/msg/JointState", "angle [rad] and speed [rad/s] of the crank", BASE),
    "battery": _sensor("current", "sensor_msgs/msg/BatteryState", "voltage [V] and current [A] of a dc motor's supply",
                       BASE),
    "tracking": _sensor("tracking", "geometry_msgs/msg/PoseWithCovarianceStamped", "position of the body [m] in `odom`",
                        ODOM, constants=_UPRIGHT),
    "robot_description": Topic("std_msgs/msg/String", ONCE, "the robot as URDF, sent once and to late subscribers "
                               "(transient local); [below](#the-robot-as-urdf)", Quality(1, transient_local=True)),
    "tf_static": Topic("tf2_msgs/msg/TFMessage", ONCE, "transforms of the frames that never move, sent once and to "
                       "late subscribers (transient local)", Quality(1, transient_local=True), name="/tf_static",
                       transforms=(ALL,)),
    "operations": Topic("std_msgs/msg/String", NODE, "each operation on the run: `reset`, `pause`, `resume`, `step 1`, "
                        '`set {"ground.friction": 0.1}`, `timeout`, `state {"body_velocity": 0.0}`, `push …`, '
                        "`fault …`", Quality(100), name="~/operations"),
    "samples": Topic(NUMBERS, NODE, "every quantity of each sample, while a node subscribes; never recorded. "
                     "`layout.dim[0].label` names the numbers: `start_seconds` and `start_nanoseconds`, the ROS time "
                     "of robot time 0, then the fields of a [run](python.md) from `time` on, which is robot time, so "
                     "that a reset does not turn it back. A message with another start time comes from another run; if "
                     "two start times alternate, two robots publish on the topic", Quality(1000), name="~/samples"),
    "diagnostics": Topic("diagnostic_msgs/msg/DiagnosticArray", NODE, "the robot's health, once a second of wall time; "
                         "[below](#diagnostics)", name="/diagnostics"),
    "clock": Topic("rosgraph_msgs/msg/Clock", NODE, "robot time, with `clock.publish` only", name="/clock"),
    "checkpoint": Topic(NUMBERS, BAG, "`Simulator.checkpoint` after a sample and before its commands, in bags that may "
                        "lack the run's beginning", Quality(1), name="~/checkpoint"),
}
"""The topics by the robot's own names; messages of one sample are published in this order."""

COMMAND_UNITS = {name: topic.unit for name, topic in TOPICS.items() if topic.unit}
"""Unit of each command that is a number; the names are also arguments of `Simulator.command`."""

JOINT_COMMANDS, OPERATIONS, CHECKPOINT, SAMPLES = "joint_commands", "operations", "checkpoint", "samples"

COMMANDS = tuple(name for name, topic in TOPICS.items() if topic.when == COMMAND)
"""Topics that the robot listens to."""

OF_DC_MOTOR = tuple(name for name, topic in TOPICS.items() if topic.of_dc_motor)

ROBOT_TOPICS = {name: topic.type for name, topic in TOPICS.items()
                if topic.when not in (NODE, BAG) and not topic.sensor}
"""Type of each topic by the last part of its name in a bag; a topic of another type is not the robot's."""

INPUTS = (*COMMANDS, OPERATIONS)  # topics of the inputs, from which a replay computes all other messages

SENSOR_TOPICS = {topic.sensor: name for name, topic in TOPICS.items() if topic.sensor}
"""Topic of each sensor of `sensors.device`; a robot has the topics of the sensors that are on."""

VARIANCES = ("odom.pose_covariance_diagonal", "odom.twist_covariance_diagonal")
"""The node's parameters for the variances in `odom`."""


def commands_in(name: str, message: Any, scene: Scene) -> tuple[dict[str, float], list[str]]:
    """Return the commands in a message on one of `COMMANDS`, as arguments of `Simulator.command`, and its faults."""
    return joint_commands(message, scene) if name == JOINT_COMMANDS else ({name: message.data}, [])


def commands_of(scene: Scene) -> tuple[str, ...]:
    """Return the topics of commands that the robot of a scene listens to."""
    return tuple(name for name in COMMANDS if TOPICS[name].exists(scene))


def published_by(scene: Scene, transforms: str = ALL) -> tuple[str, ...]:
    """Return the topics that follow the device of a scene; `transforms` is the value of `tf.publish`."""
    return tuple(name for name, topic in TOPICS.items()
                 if topic.when in (SAMPLE, EVENT, ONCE) and topic.exists(scene, transforms))


def full_name(topic: str) -> str:
    """Return a topic's name before namespace and remapping; `topic` is a key of `TOPICS`."""
    return TOPICS[topic].name or topic


def joint_commands(message: Any, scene: Scene) -> tuple[dict[str, float], list[str]]:
    """Return the commands in a JointState of any ROS library, as arguments of `Simulator.command`, and its faults.

    A fault is a sentence on a part of the message that commands nothing. A plate's gap is its position minus the length
    of the rod in `scene`.

    An array as long as the list of names has one number for each name, in that order. The topic-based hardware of
    ros2_control (joint_state_topic_hardware_interface) writes shorter arrays, with a number only for each joint that
    has a command interface of this kind; an array of that length belongs to those joints, in their order. A number that
    is not finite is no command, because controllers that are not active leave NaN. A message that names a joint twice
    commands nothing, because it would be ambiguous which of the two numbers holds.
    """
    names, commands, faults = list(message.name), dict[str, float](), list[str]()
    if repeated := [name for name, count in Counter(names).items() if count > 1]:
        return {}, [f"{quoted(repeated[0])} is named {names.count(repeated[0])} times; name each joint once"]
    for kind in ("position", "velocity", "effort"):
        numbers, commanded = list(getattr(message, kind)), [name for name in names if _commanded_array(name) == kind]
        if len(numbers) == len(names):
            commanded = names
        elif len(numbers) != len(commanded) and numbers:
            faults.append(f"{kind}: {len(numbers)} numbers for {len(names)} names, {len(commanded)} of them commanded "
                          "so; give one a name, or one for each joint that is commanded so")
            continue
        for name, number in zip(commanded, map(float, numbers), strict=False):
            if not math.isfinite(number):
                continue
            if _commanded_array(name) != kind:
                faults.append(f"{quoted(name)} is not commanded by {kind}; give {_COMMANDED_JOINTS}")
                continue
            argument = COMMANDED[name][1]
            rod = f"crank.{argument.removesuffix('_gap')}_rod"
            commands[argument] = number - scene[rod] if kind == "position" else number
    faults += [f"{quoted(name)} is no joint of this robot; give {_COMMANDED_JOINTS}" for name in names
               if name not in JOINTS and not any(quoted(name) in fault for fault in faults)]
    return commands, faults


_COMMANDED_JOINTS = ", ".join(f"{joint} by {array}" for joint, (array, _) in COMMANDED.items())


def _commanded_array(name: str) -> str:
    return COMMANDED.get(name, ("", ""))[0]
