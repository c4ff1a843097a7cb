"""The robot's topics in a bag, under the names that remapping and namespaces gave them."""

import json

from vibro_ros.bag.stream import BagError, BagStream
from vibro_ros.messages.topics import CHECKPOINT, CHECKPOINT_TYPE, OPERATIONS, OPERATIONS_TYPE, ROBOT_TOPICS

_TYPES = {**ROBOT_TOPICS, CHECKPOINT: CHECKPOINT_TYPE, OPERATIONS: OPERATIONS_TYPE}


def robot_topics(stream: BagStream) -> dict[str, str]:
    """Full names of the robot's topics, by its own names for them: as the bag's custom data tell, else by last parts.

    Raises
    ------
    BagError
        When a topic that the bag tells has another type, and when two robots are in a bag that tells nothing.
    """
    try:
        told = json.loads(stream.metadata.get("topics", "{}"))
        found = {name: str(told[name]) for name in _TYPES if name in told}
    except (ValueError, TypeError, RecursionError) as error:
        raise BagError(f"{stream.folder}: its custom data `topics` cannot be read: {error}") from error
    for name, topic in found.items():
        recorded = stream.topics.get(topic)
        if recorded and recorded.type_name != _TYPES[name]:
            raise BagError(f"{stream.folder}: {topic} is {recorded.type_name}, not the robot's {_TYPES[name]}")
    return found or _by_last_part(stream)


def _by_last_part(stream: BagStream) -> dict[str, str]:
    found: dict[str, str] = {}
    for topic, recorded in stream.topics.items():
        name = topic.rpartition("/")[2]
        if ROBOT_TOPICS.get(name) == recorded.type_name:
            if name in found:
                raise BagError(f"{stream.folder}: {name} is ambiguous: {found[name]} and {topic}")
            found[name] = topic
    return found
