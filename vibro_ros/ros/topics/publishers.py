"""What the robot publishes: the same bytes to ROS and to the bag, filled in place where a topic has every sample.

`messages.fields` says what is in a message; here it gets rclpy's classes, publishers and bytes. A `stamp` is ROS time
[ns], a `prefix` begins every frame's name.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from importlib import import_module
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message

from vibro_ros.bag.recorder import Together
from vibro_ros.messages import fields
from vibro_ros.messages.fields import NONE, PLATES, Frames, joints_of
from vibro_ros.messages.topics import (
    OF_DC_MOTOR,
    PUBLISHED_TYPES,
    ROBOT_TOPICS,
    SENSOR_TOPICS,
    SENSOR_TYPES,
    TF_TOPICS,
    published_name,
)
from vibro_ros.model.scene import Scene
from vibro_ros.ros.node import qos
from vibro_ros.ros.topics.templates import Make, Sheet, checked_template, plain_bytes
from vibro_ros.sensors.device import KINDS, Measurement, sensors_on
from vibro_ros.simulation.samples import CRANK_ANGLE, FIELDS, Samples

Variances = Sequence[Sequence[float]]
MakeOfSample = Callable[[Samples, int], Any]
"""Makes the message of a sample and a stamp [ns]."""
Record = Callable[[str | Together, int, bytes], None]
"""Takes a topic's resolved name, a stamp [ns] and the serialised message; or several messages that come together."""

PUBLISHED = {
    "odom": qos.SAMPLES,
    "joint_states": qos.SAMPLES,
    "ground_contact": qos.SAMPLES,
    "impacts": qos.IMPACTS,
    "motor_power": qos.SAMPLES,
    "motor_current": qos.SAMPLES,
    "electrical_power": qos.SAMPLES,
    "robot_description": qos.LASTING,
    "tf": qos.TRANSFORMS,
    "tf_static": qos.LASTING,
}
"""Quality of service of each topic; `ROBOT_TOPICS` has the types."""

PROFILES = {**PUBLISHED, **dict.fromkeys(SENSOR_TYPES, qos.SENSORS)}
"""The same, and of the topics of sensors."""

_SINGLE = {"current"}  # sensors whose message has numbers of 4 bytes, which no `Sheet` fills


class RobotPublishers:
    """The robot's publishers; `publishers` has them by the robot's own names of the topics.

    `prefix` begins the name of every frame in the messages. `transforms` says what of the frames is published, of
    `messages.frames`; where the type of their messages is missing, there are none, and the log says so. `variances` are
    those of the pose and of the twist in `odom`, as `messages.fields.fill_odometry` takes them. `control` says whether
    `robot_description` tells ros2_control how to command the robot.
    """

    def __init__(self, node: Node, scene: Scene, prefix: str = "", transforms: str = NONE,
                 variances: Variances = ((), ()), control: bool = False):
        if transforms != NONE:
            try:
                message_class(ROBOT_TOPICS["tf"])
            except ValueError as error:
                node.get_logger().info(f"no tf: {error}")
                transforms = NONE
        self._prefix, self._transforms, self._variances = prefix, transforms, variances
        self.frames = self._frames_of(scene)
        left_out: tuple[str, ...] = TF_TOPICS if self.frames is None else () if self.frames.fixed else ("tf_static",)
        left_out += () if scene.has_rotor else OF_DC_MOTOR
        sensors = sensors_on(scene)
        topics = (*(topic for topic in PUBLISHED if topic not in left_out), *(SENSOR_TOPICS[name] for name in sensors))
        self.publishers: dict[str, Publisher] = {
            topic: node.create_publisher(message_class(PUBLISHED_TYPES[topic]), published_name(topic), PROFILES[topic])
            for topic in topics}
        self._warn, self._about = node.get_logger().warning, {
            name: node.resolve_topic_name(name) for name in ("joint_commands", "joint_states")} if control else {}
        self.show(scene)

    def _frames_of(self, scene: Scene) -> Frames | None:
        return Frames(scene, self._prefix, self._transforms) if self._transforms != NONE else None

    def show(self, scene: Scene) -> None:
        """Publish the robot of another scene from now on, which has the same topics and joints."""
        prefix, names, warn, self.frames = self._prefix, self.topics, self._warn, self._frames_of(scene)
        self._description = serialize_message(filled("robot_description", fields.fill_robot_description, scene,
                                                     self._about))
        made = sample_makers(scene, prefix, self._variances)
        made |= {"tf": partial(_transforms, self.frames)} if self.frames else {}
        self._numbers = np.zeros(len(FIELDS) + (len(self.frames.turns(0.0)) if self.frames else 0))
        checked = {topic: checked_template(make, ROBOT_TOPICS[topic], len(self._numbers), warn)
                   for topic, make in made.items()}
        templates = {topic: template for topic, template in checked.items() if template}
        self._sheet = Sheet([*templates.values()])
        self._filled = [(self.publishers[topic], message)
                        for topic, message in zip(templates, self._sheet.messages, strict=True)]
        self._together = Together([(names[topic], *place)
                                   for topic, place in zip(templates, self._sheet.places, strict=True)])
        self._made = [(topic, make) for topic, make in made.items() if topic not in templates]
        self._impact_sheets: dict[str, Sheet] = {}
        for kind in PLATES:
            if template := checked_template(partial(_impact, prefix, kind), ROBOT_TOPICS["impacts"], 1, warn):
                self._impact_sheets[kind] = Sheet([template])
        self._sensor_sheets: dict[str, Sheet] = {}
        for name in set(sensors_on(scene)) - _SINGLE:
            if template := checked_template(partial(_measurement, prefix, name), SENSOR_TYPES[SENSOR_TOPICS[name]],
                                            KINDS[name].numbers, warn):
                self._sensor_sheets[name] = Sheet([template])

    @property
    def topics(self) -> dict[str, str]:
        """Resolved name of each topic."""
        return {name: publisher.topic_name for name, publisher in self.publishers.items()}

    def begin(self, stamp: int) -> list[tuple[str, bytes]]:
        """Publish what is said once, at ROS time `stamp` [ns]; resolved names and messages, for a bag's files."""
        lasting = {"robot_description": self._description}
        if self.frames and self.frames.fixed:
            message = message_class(ROBOT_TOPICS["tf_static"])(transforms=[TransformStamped()
                                                                           for _ in self.frames.fixed])
            self.frames.fill_fixed(message.transforms, stamp)
            lasting["tf_static"] = plain_bytes(message, ROBOT_TOPICS["tf_static"])
        for topic, data in lasting.items():
            self.publishers[topic].publish(data)
        return [(self.publishers[topic].topic_name, data) for topic, data in lasting.items()]

    def publish(self, values: np.ndarray, events: np.ndarray, stamp: int, stamp_of: Callable[[float], int],
                record: Record, measurements: Sequence[Measurement] = ()) -> None:
        """Publish and record a sample, and the contacts that ended since the one before it, and the measurements.

        `values` are `Simulator.values`, `events` those of `Simulator.take_events`, `measurements` those of
        `SensedSimulator.take_measurements`; `stamp` is the sample's ROS time [ns], `stamp_of` that of a time [s] by
        the device's clock. Everything is recorded at the sample's instant, so that the bag is in time order; an
        impact's header has the first instant of contact, a measurement's the instant at which it was measured.
        """
        numbers = values
        if self.frames is not None:
            numbers = self._numbers
            numbers[:len(FIELDS)] = values
            numbers[len(FIELDS):] = self.frames.turns(values.item(CRANK_ANGLE))
        self._sheet.fill(numbers, stamp)
        for publisher, message in self._filled:
            publisher.publish(message.tobytes())
        record(self._together, stamp, self._sheet.copy())
        for topic, make in self._made:
            self._publish(topic, serialize_message(make(numbers.tolist(), stamp)), stamp, record)
        for time, kind, _, peak_force, _ in events.tolist():
            if kind not in PLATES:
                continue
            if sheet := self._impact_sheets.get(kind):
                sheet.fill(np.array([peak_force]), stamp_of(time))
                data = sheet.messages[0].tobytes()
            else:
                data = serialize_message(_impact(self._prefix, kind, [peak_force], stamp_of(time)))
            self._publish("impacts", data, stamp, record)
        for name, time, read in measurements:
            if sheet := self._sensor_sheets.get(name):
                sheet.fill(read, stamp_of(time))
                data = sheet.messages[0].tobytes()
            else:
                data = serialize_message(_measurement(self._prefix, name, read.tolist(), stamp_of(time)))
            self._publish(SENSOR_TOPICS[name], data, stamp, record)

    def _publish(self, topic: str, data: bytes, stamp: int, record: Record) -> None:
        publisher = self.publishers[topic]
        publisher.publish(data)
        record(publisher.topic_name, stamp, data)


def makers(scene: Scene, prefix: str, variances: Variances = ((), ())) -> Mapping[str, MakeOfSample]:
    """What makes the message of each topic that has every sample, in the order in which they are published."""
    joints = joints_of(scene)
    of_every: dict[str, MakeOfSample] = {
        "odom": lambda state, stamp: filled("odom", fields.fill_odometry, state, stamp, prefix, variances),
        "joint_states": lambda state, stamp: filled("joint_states", fields.fill_joint_states, state, joints, stamp,
                                                    prefix),
        "ground_contact": lambda state, stamp: filled("ground_contact", fields.fill_ground_contact, state, stamp,
                                                      prefix),
        "motor_power": lambda state, stamp: filled("motor_power", fields.fill_motor_power, state),
    }
    return of_every if not scene.has_rotor else of_every | {
        "motor_current": lambda state, stamp: filled("motor_current", fields.fill_motor_current, state),
        "electrical_power": lambda state, stamp: filled("electrical_power", fields.fill_electrical_power, state),
    }


def sample_makers(scene: Scene, prefix: str, variances: Variances = ((), ())) -> dict[str, Make]:
    """`makers` whose messages are made of the values of a sample's fields."""
    return {topic: partial(_made, make) for topic, make in makers(scene, prefix, variances).items()}


def filled(topic: str, fill: Callable[..., None], *about: Any) -> Any:
    """The message of a topic, filled by a function of `messages.fields`."""
    message = message_class(PUBLISHED_TYPES[topic])()
    fill(message, *about)
    return message


def transforms(frames: Frames, state: Samples, turns: Sequence[float], stamp: int) -> Any:
    """Where the robot's frames are, a tf2_msgs/msg/TFMessage; `turns` are those of `Frames`."""
    message = message_class(ROBOT_TOPICS["tf"])(transforms=[TransformStamped() for _ in range(1 + len(frames.moving))])
    frames.fill(message.transforms, state, turns, stamp)
    return message


@cache
def message_class(type_name: str) -> type:
    """The class of a type such as ``nav_msgs/msg/Odometry``.

    Raises
    ------
    ValueError
        If no package here has it; the message names the package to install.
    """
    package, _, name = type_name.partition("/msg/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError, ValueError):  # ValueError: an empty name
        raise ValueError(f"{type_name}: no such message here; install the ROS package {package}") from None


def _made(make: MakeOfSample, numbers: Sequence[float], stamp: int) -> Any:
    """The message of a sample, from the values of its fields, which other numbers may follow."""
    return make(Samples(*numbers[:len(FIELDS)]), stamp)


def _transforms(frames: Frames, numbers: Sequence[float], stamp: int) -> Any:
    """Where the frames are, from the values of a sample's fields and `Frames.turns`."""
    return transforms(frames, Samples(*numbers[:len(FIELDS)]), numbers[len(FIELDS):], stamp)


def _impact(prefix: str, kind: str, numbers: Sequence[float], stamp: int) -> Any:
    return filled("impacts", fields.fill_impact, {"kind": kind, "peak_force": numbers[0]}, stamp, prefix)


def _measurement(prefix: str, name: str, numbers: Sequence[float], stamp: int) -> Any:
    return filled(SENSOR_TOPICS[name], fields.MEASUREMENTS[name], numbers, stamp, prefix)
