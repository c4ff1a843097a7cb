"""The robot's subscriptions: commands, queued with what services ask for until the stepping thread takes them.

The executor's thread takes the bytes of `motor_speed`, `upper_gap`, `inclined_gap` and `joint_commands` (`Gathering`)
and puts them into `Queue`; the stepping thread takes all of it before its next sample, records each message and gives
its numbers to the device (`CommandSubscriptions.apply`).
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from heapq import heappop, heappush
from itertools import chain, count
from operator import itemgetter
from threading import Lock
from typing import Any, Generic, TypeVar

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.topics import (
    COMMANDS,
    INPUTS,
    OPERATIONS,
    ROBOT_TOPICS,
    commands_in,
    commands_of,
)
from vibro_ros.model.faults import Incident
from vibro_ros.model.scene import Scene
from vibro_ros.ros.node import qos
from vibro_ros.ros.node.refusals import Refusals, Throttle, peer_text
from vibro_ros.ros.topics.publishers import Record, message_class
from vibro_ros.simulation.simulator import Simulator

LONGEST = 1024
"""Bytes of the longest message that is queued and recorded, because the queue is counted in messages; a command has 12,
one for all joints some 200."""
MOST_WAITING = 100
"""Commands of one topic that wait. A command costs the device 30 to 70 us, so that those of all topics together
delay a tick by 40 ms at most, less than half of what `rate.max_catch_up` makes good by default."""
MOST_LATE = 10_000
"""Commands that are kept while the fault `late_commands` lasts."""
REST = 0.001
"""Time [s] from one gathering to the next: DDS keeps the last ten messages of a topic, so none is lost up to 10 kHz."""
LOOKS = 1.0
"""Time [s] between two looks at the graph for publishers of another type."""

Name = TypeVar("Name")


class CommandSubscriptions:
    """The robot's command subscriptions.

    `topics` has the resolved name of each command's topic. Other threads put their operations into the `queue`, too.
    `accepted` counts the commands that took effect, by name, `lost` those that the fault `lost_commands` took;
    `influences` are faults of commands that last, and the instants at which they end, as stamps [ns].
    """

    def __init__(self, node: Node, scene: Scene):
        self._log, self._too_long = node.get_logger(), Refusals(node.get_logger)
        self._refused = self._reported = 0
        self.queue, self.accepted = Queue(INPUTS), Counter[str]()
        self.lost, self.influences = 0, dict[str, int]()
        self._delay, self._arrivals = 0, count()
        self._late: list[tuple[int, int, str, bytes]] = []  # a heap by the instants of effect
        self._throttles = {name: Throttle() for name in (*COMMANDS, "dropped")}
        gathering = Gathering(self._receive)
        self.subscriptions: dict[str, Subscription] = {
            name: node.create_subscription(message_class(ROBOT_TOPICS[name]), name, partial(gathering.take, name),
                                           qos.profile(name), raw=True)
            for name in commands_of(scene)
        }
        gathering.subscriptions = self.subscriptions
        self.topics = {name: subscription.topic_name for name, subscription in self.subscriptions.items()}
        _warn_of_deaf_ears(node, {self.topics[name]: (ROBOT_TOPICS[name], subscription.qos_profile)
                                  for name, subscription in self.subscriptions.items()})

    @property
    def refused(self) -> int:
        """Commands that the device refused, or that were no number."""
        return self._refused + self._too_long.count

    @property
    def dropped(self) -> int:
        """Commands that newer ones displaced before the device took them, see `Queue`; they are not recorded."""
        return self.queue.dropped

    def apply(self, device: Simulator, stamp: int, record: Record,
              perform: Callable[[Any], object] = lambda request: None) -> None:
        """Give the device, at its present time, every command that has arrived; record each, the refused ones too.

        Operations that were asked for between them are handed to `perform` in their turn. What stands behind something
        that cannot be done waits on, because whoever asked for it is still to be answered.
        """
        while self._late and self._late[0][0] <= stamp:
            *_, name, item = heappop(self._late)
            self._take(device, name, item, stamp, record)
        taken = deque(self.queue.take())
        try:
            while taken:
                name, item = taken.popleft()
                if name == OPERATIONS:
                    perform(item)
                elif self.influences.get("lost_commands", 0) > stamp:
                    self.lost += 1
                elif self.influences.get("late_commands", 0) > stamp:
                    self._keep(stamp + self._delay, name, item)
                else:
                    self._take(device, name, item, stamp, record)
        finally:
            for name, item in taken:
                self.queue.add(name, item)
        if self.dropped > self._reported:
            self._reported = self.dropped
            self._warn("dropped", f"{self.dropped} commands dropped: more than {MOST_WAITING} of a topic came within a "
                                  "tick, of which the last ones count")

    def fail(self, incident: Incident, stamp: int) -> None:
        """Let commands be late or get lost from `stamp` [ns] on."""
        self.influences[incident.fault] = stamp + round(1e9 * incident.duration)
        if incident.fault == "late_commands" and incident.duration:
            self._delay = round(1e9 * incident.value)

    def recover(self) -> None:
        """End all faults; commands that are still to come are dropped."""
        self.influences.clear()
        self._late.clear()

    def _keep(self, due: int, name: str, data: bytes) -> None:
        if len(self._late) == MOST_LATE:
            self.queue.dropped += 1
        else:
            heappush(self._late, (due, next(self._arrivals), name, data))

    def _take(self, device: Simulator, name: str, data: bytes, stamp: int, record: Record) -> None:
        record(self.topics[name], stamp, data)
        self._command(device, name, data)

    def _receive(self, name: str, data: bytes) -> None:
        if len(data) > LONGEST:
            self._too_long.refuse(self.topics[name], f"a message of {len(data)} bytes is no {ROBOT_TOPICS[name]}, and "
                                  "too long to be recorded")
        else:
            self.queue.add(name, data)

    def _command(self, device: Simulator, name: str, data: bytes) -> None:
        try:
            message = deserialised(data, ROBOT_TOPICS[name])  # as every reader of the bag reads it
        except ValueError:
            self._refuse(name, f"a message of {len(data)} bytes is no {ROBOT_TOPICS[name]}; publish that type")
            return
        given, faults = commands_in(name, message, device.scene)
        for fault in faults:
            self._refuse(name, fault)
        for argument, value in given.items():
            try:
                device.command(**{argument: value})
            except ValueError as error:  # names the parameter, `motor.speed`; a peer knows the topic
                reason = str(error)
                self._refuse(name, reason.removeprefix(f"{name.replace('_', '.')}: "))
            else:
                self.accepted[argument] += 1

    def _refuse(self, name: str, reason: str) -> None:
        self._refused += 1
        self._warn(name, f"command refused: {self.topics[name]}: {reason}")

    def _warn(self, name: str, text: str) -> None:
        if admitted := self._throttles[name].admit(text):
            self._log.warning(admitted)


class Queue:
    """A bounded line for each name, `most` long, in one order of arrival; one thread adds, another takes.

    Where a line is full the new command displaces its oldest, and `dropped` counts it. All that wait take effect at the
    same instant, one after the other, and of one topic the last one stands: so it is the last that must not be lost,
    neither to older ones nor to a flood on another topic.
    """

    def __init__(self, names: Iterable[str], most: int = MOST_WAITING):
        self.dropped = 0
        self._most = most
        self._arrivals = count()
        self._lock = Lock()
        self._lines: dict[str, deque[tuple[int, str, Any]]] = {name: deque() for name in names}

    def is_full(self, name: str) -> bool:
        """Whether the next one would displace the oldest of its line."""
        return len(self._lines[name]) >= self._most

    def add(self, name: str, data: Any) -> None:
        """Put a message, or an operation that was asked for, at the end of its line."""
        line = self._lines[name]
        with self._lock:
            if len(line) == self._most:
                line.popleft()
                self.dropped += 1
            line.append((next(self._arrivals), name, data))

    def take(self) -> list[tuple[str, Any]]:
        """Everything that waits, with its line's name, in the order of arrival."""
        if not any(self._lines.values()):  # as before most ticks; what comes at this moment waits for the next one
            return []
        with self._lock:
            taken = sorted(chain.from_iterable(self._lines.values()), key=itemgetter(0))
            for line in self._lines.values():
                line.clear()
        return [(name, data) for _, name, data in taken]


class Gathering(Generic[Name]):
    """A callback of raw subscriptions that takes what waits in all of them; for one executor's thread.

    `receive` takes a subscription's name and the bytes of a message; `subscriptions` is to be set before the first.

    An executor's turn costs 0.15 ms and a message taken beside it 0.01 ms. By turns alone, a flood of commands at
    5 kHz took three quarters of the interpreter's time from the thread that steps the device.
    """

    def __init__(self, receive: Callable[[Name, bytes], None]):
        self._receive = receive
        self._last = float("-inf")
        self.subscriptions: Mapping[Name, Subscription] = {}

    def take(self, name: Name, data: bytes) -> None:
        """Hand on a message that has come to the subscription `name`, and all that wait behind it and beside it."""
        if (rest := self._last + REST - time.monotonic()) > 0.0:
            time.sleep(rest)
        self._receive(name, data)
        for other, subscription in self.subscriptions.items():
            with subscription.handle:  # as rclpy's executor does; without `take_message` each message takes a turn
                take = getattr(subscription.handle, "take_message", None)
                while take and (taken := take(subscription.msg_type, subscription.raw)):
                    self._receive(other, taken[0])
        self._last = time.monotonic()


def _warn_of_deaf_ears(node: Node, heard: Mapping[str, tuple[str, QoSProfile]]) -> None:
    """Let `node` warn of publishers that its topics (full names) cannot hear, because DDS keeps them apart in silence:
    those of another type, and best-effort ones where the subscription is reliable."""
    known: set[str] = set()
    throttle = Throttle()

    def name_of(one: TopicEndpointInfo) -> str:
        if "_BARE_DDS_APP_" in one.node_name:
            return "a program without ROS"
        return peer_text(f"{one.node_namespace.rstrip('/')}/{one.node_name}")

    def faults() -> Iterator[str]:
        for topic, (kind, profile) in heard.items():
            for one in node.get_publishers_info_by_topic(topic):
                if "_UNKNOWN_" in one.node_name:
                    continue  # DDS learns the node's name later
                if one.topic_type != kind:
                    yield (f"{topic}: {name_of(one)} publishes {peer_text(one.topic_type)}, which cannot arrive; "
                           f"publish {kind}")
                elif (one.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
                      and profile.reliability == ReliabilityPolicy.RELIABLE):
                    yield (f"{topic}: {name_of(one)} publishes best effort, which cannot arrive; let it publish "
                           f"reliably, or start the robot with -p qos_overrides.{topic}.subscription.reliability:="
                           "best_effort")

    def look() -> None:
        before = known.copy()
        known.clear()
        known.update(faults())
        for fault in sorted(known - before):
            if text := throttle.admit(fault):
                node.get_logger().warning(text)

    node.create_timer(LOOKS, look, clock=Clock(clock_type=ClockType.STEADY_TIME))
