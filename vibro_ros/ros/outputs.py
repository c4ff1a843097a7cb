"""What the robot publishes: the same bytes to ROS and to the bag, filled in place where a topic has every sample."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message

from vibro_ros.messages.fields import joints_of
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.model.scene import Scene
from vibro_ros.ros import messages, qos
from vibro_ros.ros.template import Make, Serialise, serialiser
from vibro_ros.simulation.samples import Samples

Record = Callable[[str, int, bytes], None]
"""Takes a topic's resolved name, a stamp [ns] and the serialised message."""

PUBLISHED = {
    "odom": qos.SAMPLES,
    "joint_states": qos.SAMPLES,
    "ground_contact": qos.SAMPLES,
    "impacts": qos.IMPACTS,
    "motor_power": qos.SAMPLES,
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
    """

    def __init__(self, node: Node, scene: Scene, prefix: str = ""):
        self.publishers: dict[str, Publisher] = {
            topic: node.create_publisher(messages.message_class(ROBOT_TOPICS[topic]), topic, profile)
            for topic, profile in PUBLISHED.items()
        }
        self._prefix = prefix
        self._sampled = [self._sampled_topic(topic, make, node) for topic, make in makers(scene, prefix).items()]
        self._impacts = self.publishers["impacts"], self.topics["impacts"]

    def _sampled_topic(self, topic: str, make: Make, node: Node) -> tuple[Publisher, str, Serialise]:
        """A topic that has every sample: publisher, resolved name and what makes its bytes."""
        name = self.topics[topic]
        return self.publishers[topic], name, serialiser(
            make, ROBOT_TOPICS[topic], lambda reason: node.get_logger().warning(f"{name}: {reason}"))

    @property
    def topics(self) -> dict[str, str]:
        """Resolved name of each topic."""
        return {name: publisher.topic_name for name, publisher in self.publishers.items()}

    def publish(self, state: Samples, events: np.ndarray, stamp_of: Callable[[float], int], record: Record) -> None:
        """Publish and record a sample, and the contacts that ended since the one before it.

        Everything is recorded at the sample's instant, so that the bag is in time order; an impact's header has
        the first instant of contact.

        Parameters
        ----------
        state : Samples
            The sample.
        events : ndarray, shape (n,)
            Events of `Simulator.take_events`.
        stamp_of : callable
            ROS time [ns] of a simulated time [s].
        record : callable
            The bag.
        """
        stamp = stamp_of(state.time)
        for publisher, name, serialise in self._sampled:
            data = serialise(state, stamp)
            publisher.publish(data)
            record(name, stamp, data)
        publisher, name = self._impacts
        for event in events:
            if event["kind"] in messages.PLATES:
                data = serialize_message(messages.impact(event, stamp_of(float(event["time"])), self._prefix))
                publisher.publish(data)
                record(name, stamp, data)


def makers(scene: Scene, prefix: str) -> Mapping[str, Make]:
    """What makes the message of each topic that has every sample, in the order in which they are published."""
    joints = joints_of(scene)
    return {
        "odom": partial(messages.odometry, prefix=prefix),
        "joint_states": lambda state, stamp: messages.joint_states(state, joints, stamp, prefix),
        "ground_contact": partial(messages.ground_contact, prefix=prefix),
        "motor_power": lambda state, stamp: messages.motor_power(state),
    }
