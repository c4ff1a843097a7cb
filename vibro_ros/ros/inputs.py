"""What the robot listens to: commands, kept in order until the device takes them."""

from collections import deque
from collections.abc import Callable
from functools import partial

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import Float64

from vibro_ros.ros import qos
from vibro_ros.ros.commands import COMMAND_UNITS
from vibro_ros.ros.outputs import Record
from vibro_ros.ros.throttle import Throttle
from vibro_ros.simulator import Simulator


class Inputs:
    """The robot's command subscriptions.

    The executor's thread appends what arrives; the stepping thread hands it to the device, one after the
    other in the order of arrival.

    Parameters
    ----------
    node : Node
        Listens under the node's names; logs refusals.

    Attributes
    ----------
    refused : int
        Commands that the device refused.
    """

    def __init__(self, node: Node):
        self.refused = 0
        self._log = node.get_logger()
        self._waiting: deque[tuple[str, bytes]] = deque()
        self._throttles = {name: Throttle() for name in COMMAND_UNITS}
        self.subscriptions: dict[str, Subscription] = {
            name: node.create_subscription(Float64, name, partial(self._receive, name), qos.COMMANDS, raw=True)
            for name in COMMAND_UNITS
        }

    @property
    def topics(self) -> dict[str, str]:
        """Resolved name of each command's topic."""
        return {name: subscription.topic_name for name, subscription in self.subscriptions.items()}

    def apply(self, device: Simulator, stamp_of: Callable[[float], int], record: Record) -> None:
        """Give the device, at its current time, every command that has arrived; record each, the refused ones too."""
        while self._waiting:
            name, data = self._waiting.popleft()
            record(self.subscriptions[name].topic_name, stamp_of(device.time), data)
            try:
                device.command(**{name: deserialize_message(data, Float64).data})
            except ValueError as error:
                self._refuse(name, error)

    def _receive(self, name: str, data: bytes) -> None:
        self._waiting.append((name, data))

    def _refuse(self, name: str, error: ValueError) -> None:
        self.refused += 1
        text = self._throttles[name].admit(f"command refused: {error}")
        if text:
            self._log.warning(text)
