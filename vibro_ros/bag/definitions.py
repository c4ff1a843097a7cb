"""What a bag says of its topics: names, types, definitions, quality of service."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from vibro_ros.bag.metadata import TopicInformation, reliable_qos


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    Attributes
    ----------
    name : str
        Fully resolved name, such as ``/odom``.
    type_name : str
        ROS type, such as ``nav_msgs/msg/Odometry``; any type of ROS 2 Jazzy's common interfaces.
    qos_depth : int
        History depth that the publisher offers.
    lasting : bool
        Whether late subscribers get what was published before (transient local).
    """

    name: str
    type_name: str
    qos_depth: int
    lasting: bool = False


@dataclass(frozen=True)
class Definition:
    """A topic with all that a bag's file holds of it; `text` is the message definition (ros2msg)."""

    information: TopicInformation
    text: str


@cache
def jazzy_types() -> Typestore:
    """Message definitions of ROS 2 Jazzy, loaded once (about 60 ms)."""
    return get_typestore(Stores.ROS2_JAZZY)


def defined(topics: Sequence[Topic]) -> list[Definition]:
    """The definitions of `topics`.

    Raises
    ------
    ValueError
        For an unknown message type or a topic given twice.
    """
    names = [topic.name for topic in topics]
    for topic in topics:
        if topic.type_name not in jazzy_types().fielddefs:
            raise ValueError(f"{topic.name}: unknown message type {topic.type_name!r}; give one of ROS 2 Jazzy's")
        if names.count(topic.name) > 1:
            raise ValueError(f"{topic.name}: given twice; a topic is recorded once")
    return [_definition(topic) for topic in topics]


def _definition(topic: Topic) -> Definition:
    text, _ = jazzy_types().generate_msgdef(topic.type_name, ros_version=2)
    return Definition(TopicInformation(topic.name, topic.type_name, [reliable_qos(topic.qos_depth, topic.lasting)],
                                       jazzy_types().hash_rihs01(topic.type_name)), text)
