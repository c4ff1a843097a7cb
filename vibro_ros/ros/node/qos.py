"""Quality of service of the robot's topics, and the parameters `qos_overrides` that change it."""

from collections.abc import Iterable

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from vibro_ros.messages.topics import TOPICS

OVERRIDES = "qos_overrides"
POLICIES = {"reliability": ("reliable", "best_effort"), "history": ("keep_last", "keep_all"), "depth": ()}
"""The policies that a user may override, and their values; a depth is a number."""
DEEPEST = 100_000  # largest depth [messages] that a user may give


def profile(topic: str) -> QoSProfile:
    """Return the quality of service of one of the robot's topics, a key of `TOPICS`."""
    depth, reliable, transient_local = TOPICS[topic].quality
    return QoSProfile(
        depth=depth, reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if transient_local else DurabilityPolicy.VOLATILE)


def check_overrides(node: Node, publishers: Iterable[str], subscriptions: Iterable[str]) -> None:
    """Refuse each `qos_overrides` parameter that would have no effect or has a bad value; make the others read-only.

    `publishers` and `subscriptions` are the node's topics, before namespace and remapping. ValueError names the
    parameter, the limit and the remedy.
    """
    topics = {"publisher": [node.resolve_topic_name(name) for name in publishers],
              "subscription": [node.resolve_topic_name(name) for name in subscriptions]}
    for name, parameter in node.get_parameters_by_prefix(OVERRIDES).items():
        shown, value = f"{OVERRIDES}.{name}", parameter.value
        topic, kind, policy = ("", "", *name.rsplit(".", 2))[-3:]
        if kind not in topics or topic not in topics[kind]:
            known = ", ".join(sorted(topics.get(kind, [])))
            raise ValueError(f"{shown}: this node has no {kind} {topic}; give one of {known}" if known else
                             f"{shown}: not understood; write {OVERRIDES}./TOPIC.publisher.POLICY or "
                             f"{OVERRIDES}./TOPIC.subscription.POLICY")
        if policy not in POLICIES:
            raise ValueError(f"{shown}: {policy} cannot be overridden here; give one of {', '.join(POLICIES)}")
        if policy == "depth":
            if type(value) is not int or not 1 <= value <= DEEPEST:
                raise ValueError(f"{shown}: {value!r} is no depth; give a whole number from 1 to {DEEPEST}")
        elif value not in POLICIES[policy]:
            raise ValueError(f"{shown}: {value!r} is unknown; choose one of {', '.join(POLICIES[policy])}")
        node.set_descriptor(shown, ParameterDescriptor(
            description=f"{policy} of the {kind} {topic}", read_only=True, type=parameter.type_.value))
