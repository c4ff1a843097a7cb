"""What the robot listens to: commands, kept in order until the device takes them, and with them what is asked of it."""

from collections import Counter, deque
from collections.abc import Callable
from functools import partial

from rclpy.node import Node
from rclpy.subscription import Subscription
from std_msgs.msg import Float64

from vibro_ros.bag.cdr import deserialised
from vibro_ros.messages.topics import COMMAND_UNITS, INPUTS, OPERATIONS, ROBOT_TOPICS
from vibro_ros.ros.node import qos
from vibro_ros.ros.node.gathering import Gathering
from vibro_ros.ros.node.refusals import Refusals
from vibro_ros.ros.node.requests import Request
from vibro_ros.ros.node.throttle import Throttle
from vibro_ros.ros.topics.outputs import Record
from vibro_ros.ros.topics.strangers import Strangers
from vibro_ros.ros.topics.waiting import MOST_WAITING, Waiting
from vibro_ros.simulation.simulator import Simulator

LONGEST = 1024
"""Bytes of the longest message that is kept and recorded; a command has 12, and what waits is counted in messages."""


class Inputs:
    """The robot's command subscriptions.

    The executor's thread keeps what arrives; the stepping thread hands it to the device, one after the
    other in the order of arrival.

    Parameters
    ----------
    node : Node
        Listens under the node's names; logs refusals.

    Attributes
    ----------
    topics : dict of str to str
        Resolved name of each command's topic.
    waiting : Waiting
        What has arrived; other threads put their operations into it, too.
    accepted : Counter
        Commands that took effect, by name.
    """

    def __init__(self, node: Node):
        self._log, self._too_long = node.get_logger(), Refusals(node.get_logger)
        self._refused = 0
        self.waiting, self.accepted = Waiting(INPUTS), Counter[str]()
        self._throttles = {name: Throttle() for name in COMMAND_UNITS}
        self._drops = Throttle()
        self._told = 0
        gathering = Gathering(self._receive)
        self.subscriptions: dict[str, Subscription] = {
            name: node.create_subscription(Float64, name, partial(gathering.take, name), qos.COMMANDS, raw=True)
            for name in COMMAND_UNITS
        }
        gathering.subscriptions = self.subscriptions
        self.topics = {name: subscription.topic_name for name, subscription in self.subscriptions.items()}
        self._strangers = Strangers(node, {topic: ROBOT_TOPICS[name] for name, topic in self.topics.items()})

    @property
    def refused(self) -> int:
        """Commands that the device refused, or that were no number."""
        return self._refused + self._too_long.count

    @property
    def dropped(self) -> int:
        """Commands that newer ones displaced before the device took them, see `Waiting`; they are not recorded."""
        return self.waiting.dropped

    def apply(self, device: Simulator, stamp: int, record: Record,
              perform: Callable[[Request], object] = lambda request: None) -> None:
        """Give the device, at its present time, every command that has arrived; record each, the refused ones too.

        Operations that were asked for between them are handed to `perform` in their turn. What stands behind something
        that cannot be done waits on, because whoever asked for it is still to be answered.
        """
        taken = deque(self.waiting.take())
        try:
            while taken:
                name, item = taken.popleft()
                if name == OPERATIONS:
                    perform(item)
                else:
                    self._command(device, name, stamp, item, record)
        finally:
            for name, item in taken:
                self.waiting.add(name, item)
        if self.dropped > self._told:
            self._say_dropped()

    def _command(self, device: Simulator, name: str, stamp: int, data: bytes, record: Record) -> None:
        record(self.topics[name], stamp, data)
        try:
            device.command(**{name: self._value(name, data)})
        except ValueError as error:
            self._refuse(name, error)
        else:
            self.accepted[name] += 1

    def _receive(self, name: str, data: bytes) -> None:
        if len(data) > LONGEST:
            self._too_long.refuse(self.topics[name], f"a message of {len(data)} bytes is no {ROBOT_TOPICS[name]}, and "
                                  "too long to be recorded")
        else:
            self.waiting.add(name, data)

    def _value(self, name: str, data: bytes) -> float:
        """The number in a message, as whoever reads the bag will read it (ValueError when it cannot be read)."""
        try:
            return deserialised(data, ROBOT_TOPICS[name]).data
        except ValueError:
            raise ValueError(f"{self.topics[name]}: a message of {len(data)} bytes is no "
                             f"{ROBOT_TOPICS[name]}; publish that type") from None

    def _refuse(self, name: str, error: ValueError) -> None:
        self._refused += 1
        text = self._throttles[name].admit(f"command refused: {error}")
        if text:
            self._log.warning(text)

    def _say_dropped(self) -> None:
        self._told = self.dropped
        text = self._drops.admit(f"{self._told} commands dropped: more than {MOST_WAITING} of a topic came within a "
                                 "tick, of which the last ones count")
        if text:
            self._log.warning(text)
