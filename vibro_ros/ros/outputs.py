"""What the robot publishes: serialised once, the same bytes to ROS and to the bag."""

from collections.abc import Callable

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message

from vibro_ros.messages.fields import joints_of
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.model.scene import Scene
from vibro_ros.ros import messages, qos
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
        self._joints, self._prefix = joints_of(scene), prefix

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
        stamp, prefix = stamp_of(state.time), self._prefix
        for topic, message in (
            ("odom", messages.odometry(state, stamp, prefix)),
            ("joint_states", messages.joint_states(state, self._joints, stamp, prefix)),
            ("ground_contact", messages.ground_contact(state, stamp, prefix)),
            ("motor_power", messages.motor_power(state)),
            *(("impacts", messages.impact(event, stamp_of(float(event["time"])), prefix))
              for event in events if event["kind"] in messages.PLATES),
        ):
            data = serialize_message(message)
            self.publishers[topic].publish(data)
            record(self.publishers[topic].topic_name, stamp, data)
