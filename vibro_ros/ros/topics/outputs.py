"""What the robot publishes: the same bytes to ROS and to the bag, filled in place where a topic has every sample."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message

from vibro_ros.bag.recorder import Together
from vibro_ros.messages.fields import joints_of
from vibro_ros.messages.frames import NONE, Frames
from vibro_ros.messages.topics import ROBOT_TOPICS, TF_TOPICS, published_name
from vibro_ros.model.scene import Scene
from vibro_ros.ros.node import qos
from vibro_ros.ros.topics import messages
from vibro_ros.ros.topics.raw_publisher import RawPublisher
from vibro_ros.ros.topics.sheet import Sheet, checked_template
from vibro_ros.ros.topics.template import Make, plain_bytes
from vibro_ros.simulation.samples import CRANK_ANGLE, FIELDS, Samples

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
    "robot_description": qos.LASTING,
    "tf": qos.TRANSFORMS,
    "tf_static": qos.LASTING,
}
"""Quality of service of each topic; `ROBOT_TOPICS` has the types."""


class Outputs:
    """The robot's publishers.

    Parameters
    ----------
    node : Node
        Publishes under the node's names.
    scene : Scene
        Says which masses there are.
    prefix : str
        Begins the name of every frame in the messages.
    transforms : str
        What of the frames is published, of `messages.frames`. Where the type of their messages is missing, there are
        none, and the log says so.

    Attributes
    ----------
    publishers : dict of str to Publisher
        By the robot's own names of the topics.
    frames : Frames or None
        Those that are published.
    """

    def __init__(self, node: Node, scene: Scene, prefix: str = "", transforms: str = NONE):
        self.frames = _frames(node, scene, prefix, transforms)
        self.publishers: dict[str, Publisher] = {
            topic: node.create_publisher(messages.message_class(ROBOT_TOPICS[topic]), published_name(topic), profile)
            for topic, profile in PUBLISHED.items() if topic not in _left_out(self.frames)
        }
        self._prefix, names = prefix, self.topics
        self._description = serialize_message(messages.robot_description(scene))
        made = sample_makers(scene, prefix)
        made |= {"tf": partial(_transforms, self.frames)} if self.frames else {}
        self._numbers = np.zeros(len(FIELDS) + (len(self.frames.turns(0.0)) if self.frames else 0))
        templates = {topic: checked_template(make, ROBOT_TOPICS[topic], len(self._numbers), node.get_logger().warning)
                     for topic, make in made.items()}
        filled = {topic: template for topic, template in templates.items() if template}
        self._sheet = Sheet([*filled.values()])
        self._filled = [RawPublisher(self.publishers[topic], data)
                        for topic, data in zip(filled, self._sheet.messages, strict=True)]
        self._together = Together([(names[topic], *place)
                                   for topic, place in zip(filled, self._sheet.places, strict=True)])
        self._made = [(self.publishers[topic], names[topic], make) for topic, make in made.items()
                      if topic not in filled]
        self._impacts = self.publishers["impacts"], names["impacts"]
        self._impact_sheets = dict(self._sheets_of_impacts(node))

    def _sheets_of_impacts(self, node: Node) -> Iterator[tuple[str, tuple[Sheet, RawPublisher]]]:
        """A message of each plate's impacts, of which the peak force is the only number."""
        for kind in messages.PLATES:
            template = checked_template(partial(_impact, self._prefix, kind), ROBOT_TOPICS["impacts"], 1,
                                        node.get_logger().warning)
            if template:
                sheet = Sheet([template])
                yield kind, (sheet, RawPublisher(self.publishers["impacts"], sheet.messages[0]))

    @property
    def topics(self) -> dict[str, str]:
        """Resolved name of each topic."""
        return {name: publisher.topic_name for name, publisher in self.publishers.items()}

    def begin(self, stamp: int) -> list[tuple[str, bytes]]:
        """Publish what is said once, at ROS time `stamp` [ns]; resolved names and messages, for a bag's files."""
        said = {"robot_description": self._description}
        if self.frames and self.frames.fixed:
            said["tf_static"] = plain_bytes(messages.fixed_transforms(self.frames, stamp), ROBOT_TOPICS["tf_static"])
        for topic, data in said.items():
            self.publishers[topic].publish(data)
        return [(self.publishers[topic].topic_name, data) for topic, data in said.items()]

    def publish(self, values: np.ndarray, events: np.ndarray, stamp: int, stamp_of: Callable[[float], int],
                record: Record) -> None:
        """Publish and record a sample, and the contacts that ended since the one before it.

        Everything is recorded at the sample's instant, so that the bag is in time order; an impact's header has
        the first instant of contact.

        Parameters
        ----------
        values : ndarray, shape (fields,)
            The sample: `Simulator.values`.
        events : ndarray, shape (n,)
            Events of `Simulator.take_events`.
        stamp : int
            ROS time [ns] of the sample.
        stamp_of : callable
            ROS time [ns] of a time [s] by the device's clock.
        record : callable
            The bag.
        """
        numbers = self._numbers_of(values)
        self._sheet.fill(numbers, stamp)
        for raw in self._filled:
            raw.publish()
        record(self._together, stamp, self._sheet.copy())
        for publisher, name, make in self._made:
            _publish_made(publisher, name, make(numbers.tolist(), stamp), stamp, record)
        for time, kind, _, peak_force, _ in events.tolist():
            if kind in messages.PLATES:
                self._publish_impact(kind, peak_force, stamp_of(time), stamp, record)

    def _numbers_of(self, values: np.ndarray) -> np.ndarray:
        """The sample's values, and what of tf is no field of it."""
        if self.frames is None:
            return values
        self._numbers[:len(FIELDS)] = values
        self._numbers[len(FIELDS):] = self.frames.turns(values.item(CRANK_ANGLE))
        return self._numbers

    def _publish_impact(self, kind: str, peak_force: float, began: int, stamp: int, record: Record) -> None:
        if kind not in self._impact_sheets:
            _publish_made(*self._impacts, _impact(self._prefix, kind, [peak_force], began), stamp, record)
            return
        sheet, raw = self._impact_sheets[kind]
        sheet.fill(np.array([peak_force]), began)
        raw.publish()
        record(self._impacts[1], stamp, sheet.messages[0].tobytes())


def sample_makers(scene: Scene, prefix: str) -> dict[str, Make]:
    """`makers` whose messages are made of the values of a sample's fields."""
    return {topic: partial(_made, make) for topic, make in makers(scene, prefix).items()}


def _impact(prefix: str, kind: str, numbers: Sequence[float], stamp: int) -> Any:
    """The message of a contact of this kind, from its peak force."""
    return messages.impact({"kind": kind, "peak_force": numbers[0]}, stamp, prefix)


def _made(make: MakeOfSample, numbers: Sequence[float], stamp: int) -> Any:
    """The message of a sample, from the values of its fields, which other numbers may follow."""
    return make(Samples(*numbers[:len(FIELDS)]), stamp)


def _transforms(frames: Frames, numbers: Sequence[float], stamp: int) -> Any:
    """Where the frames are, from the values of a sample's fields and `Frames.turns`."""
    return messages.transforms(frames, Samples(*numbers[:len(FIELDS)]), numbers[len(FIELDS):], stamp)


def _frames(node: Node, scene: Scene, prefix: str, published: str) -> Frames | None:
    if published == NONE:
        return None
    try:
        messages.message_class(ROBOT_TOPICS["tf"])
    except ValueError as error:
        node.get_logger().info(f"no tf: {error}")
        return None
    return Frames(scene, prefix, published)


def _left_out(frames: Frames | None) -> tuple[str, ...]:
    """The topics that a robot with these frames does not have."""
    if frames is None:
        return TF_TOPICS
    return () if frames.fixed else ("tf_static",)


def _publish_made(publisher: Publisher, name: str, message: Any, stamp: int, record: Record) -> None:
    data = serialize_message(message)
    publisher.publish(data)
    record(name, stamp, data)


def makers(scene: Scene, prefix: str) -> Mapping[str, MakeOfSample]:
    """What makes the message of each topic that has every sample, in the order in which they are published."""
    joints = joints_of(scene)
    return {
        "odom": partial(messages.odometry, prefix=prefix),
        "joint_states": lambda state, stamp: messages.joint_states(state, joints, stamp, prefix),
        "ground_contact": partial(messages.ground_contact, prefix=prefix),
        "motor_power": lambda state, stamp: messages.motor_power(state),
    }
