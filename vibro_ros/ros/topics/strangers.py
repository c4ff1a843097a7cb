"""Publishers whose messages cannot arrive, because they publish another type on a topic that a node listens to."""

from collections.abc import Mapping

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from vibro_ros.ros.node.refusals import peer_text
from vibro_ros.ros.node.throttle import Throttle

PERIOD = 1.0
"""Time [s] between two looks at the graph."""


class Strangers:
    """Says on the node's log who publishes another type: DDS keeps the two apart without a word.

    Of a publisher with another quality of service rclpy itself says so.

    Parameters
    ----------
    node : Node
        Looks, in its executor's thread.
    types : mapping of str to str
        Type of each topic, by its full name.
    """

    def __init__(self, node: Node, types: Mapping[str, str]):
        self._node, self._types = node, types
        self._known: set[tuple[str, str, str]] = set()
        self._throttle = Throttle()
        node.create_timer(PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _look(self) -> None:
        before, self._known = self._known, {
            (topic, f"{one.node_namespace.rstrip('/')}/{one.node_name}", one.topic_type)
            for topic, kind in self._types.items() for one in self._node.get_publishers_info_by_topic(topic)
            if one.topic_type != kind}
        for topic, node, kind in sorted(self._known - before):
            if text := self._throttle.admit(f"{topic}: {peer_text(node)} publishes {peer_text(kind)}, which cannot "
                                            f"arrive; publish {self._types[topic]}"):
                self._node.get_logger().warning(text)
