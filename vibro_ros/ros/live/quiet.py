"""Subscriptions that nothing wakes for: their messages wait in DDS until somebody looks.

An executor's turn costs 0.15 to 0.5 ms. A node that shows 30 pictures a second has no use for a turn for each of 3000
messages a second; taken together, a message costs some microseconds.
"""

from collections.abc import Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription


class _Nobody(CallbackGroup):
    """Lets the executor run nothing, so that it does not wait for it either."""

    def can_execute(self, entity: object) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: object) -> bool:
        """Never."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Nothing to do."""


class QuietSubscription:
    """A topic whose messages are taken as bytes when somebody asks.

    Parameters
    ----------
    node : Node
        Subscribes.
    kind : type
        Of the messages.
    topic : str
        As for `Node.create_subscription`.
    profile : QoSProfile
        Whose depth says how many messages wait at most.

    Attributes
    ----------
    topic : str
        The full name.
    """

    def __init__(self, node: Node, kind: type, topic: str, profile: QoSProfile):
        self._subscription: Subscription = node.create_subscription(kind, topic, _unused, profile,
                                                                    callback_group=_Nobody(), raw=True)
        self.topic: str = self._subscription.topic_name

    def take(self, most: int) -> Sequence[tuple[bytes, int | None]]:
        """At most so many messages, in the order in which they came: bytes, and the number that their publisher gave.

        A publisher counts its messages from 1. Where the middleware does not tell, the number is None.
        """
        found: list[tuple[bytes, int | None]] = []
        handle, kind = self._subscription.handle, self._subscription.msg_type
        with handle:
            while len(found) < most and (taken := handle.take_message(kind, True)):
                found.append((taken[0], taken[1].get("publication_sequence_number")))
        return found


def _unused(_: Any) -> None:
    """No executor runs it."""
