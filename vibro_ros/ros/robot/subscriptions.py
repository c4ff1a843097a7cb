"""The robot's subscriptions to commands, which the stepping thread takes from DDS itself.

The executor is not woken for a command, because its turn costs 0.15 ms of the interpreter's time and delays ticks (p99
of lateness beside 1 kHz commands: 0.3 ms so, 2 ms with a queue between the threads). DDS keeps the last ten messages of
a topic. The messages that it drops between two polls would have had no effect, because all waiting commands take effect
at the same instant, where the last one of a topic wins.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from heapq import heappop, heappush
from itertools import count
from operator import itemgetter

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.topics import COMMANDS, TOPICS, commands_in, commands_of
from vibro_ros.model.faults import Incident
from vibro_ros.model.scene import Scene
from vibro_ros.ros.node.node import PollingSubscription, message_class, qos_profile
from vibro_ros.ros.node.refusals import Throttle, peer_text
from vibro_ros.simulation.simulator import Simulator

Record = Callable[[str, int, bytes], None]
"""Function that records a message: resolved name of the topic, stamp [ns], serialised message."""
LONGEST = 1024  # longest message [bytes] that is recorded; a command has 12, one for all joints some 200
MOST_TAKEN = 100  # most messages of a topic that are taken in one poll, so that a flood does not delay a tick
MOST_LATE = 10_000  # most commands that are kept while the fault `late_commands` lasts
MOST_LOGGED_ONCE = 100  # most sentences on joints that are remembered, so that each is logged once
GRAPH_PERIOD = 1.0  # time [s] between two searches of the graph for publishers whose messages cannot arrive


class CommandSubscriptions:
    """The robot's command subscriptions; for one thread at a time.

    `topics` has the resolved name of each command's topic. `accepted` counts the commands that took effect, by name,
    `refused` those that the device refused or that could not be read, `lost` those that the fault `lost_commands`
    took, or that `late_commands` had no room for; `disturbances` are the active faults of commands, each with the stamp
    [ns] of its end.
    """

    def __init__(self, node: Node, scene: Scene):
        self._log = node.get_logger()
        self.refused, self.accepted = 0, Counter[str]()
        self.lost, self.disturbances = 0, dict[str, int]()
        self._delay, self._arrivals = 0, count()
        self._late: list[tuple[int, int, str, bytes]] = []  # a heap, ordered by the instant of effect
        self._throttles = {name: Throttle() for name in COMMANDS}
        self._logged_once: set[str] = set()
        self._subscriptions = {
            name: PollingSubscription(node, message_class(TOPICS[name].type), name, qos_profile(name))
            for name in commands_of(scene)}
        self.topics = {name: subscription.topic for name, subscription in self._subscriptions.items()}
        _warn_of_unmatched(node, {self.topics[name]: (TOPICS[name].type, subscription.profile)
                                  for name, subscription in self._subscriptions.items()})

    def apply(self, device: Simulator, stamp: int, record: Record) -> None:
        """Pass every command that has arrived to the device, at its present time, and record it, even if refused."""
        while self._late and self._late[0][0] <= stamp:
            *_, name, data = heappop(self._late)
            self._take(device, name, data, stamp, record)
        for name, data in self._arrived():
            if self.disturbances.get("lost_commands", 0) > stamp:
                self.lost += 1
            elif self.disturbances.get("late_commands", 0) > stamp:
                self._keep(stamp + self._delay, name, data)
            else:
                self._take(device, name, data, stamp, record)

    def fail(self, incident: Incident, stamp: int) -> None:
        """Begin or end a fault of commands, which makes them late or lost, at `stamp` [ns]."""
        self.disturbances[incident.fault] = stamp + round(1e9 * incident.duration)
        if incident.fault == "late_commands" and incident.duration:
            self._delay = round(1e9 * incident.value)

    def recover(self) -> None:
        """End all faults of commands, and drop the late commands that have not yet taken effect."""
        self.disturbances.clear()
        self._late.clear()

    def _keep(self, due: int, name: str, data: bytes) -> None:
        if len(self._late) == MOST_LATE:
            self.lost += 1
        else:
            heappush(self._late, (due, next(self._arrivals), name, data))

    def _take(self, device: Simulator, name: str, data: bytes, stamp: int, record: Record) -> None:
        if len(data) > LONGEST:
            self._refuse(name, f"a message of {len(data)} bytes is no {TOPICS[name].type}, and too long to be recorded")
        else:
            record(self.topics[name], stamp, data)
            self._command(device, name, data)

    def _arrived(self) -> list[tuple[str, bytes]]:
        """Return topic and bytes of the messages since the last poll, in order of arrival across topics."""
        taken = list[tuple[int, str, bytes]]()
        for name, subscription in self._subscriptions.items():
            if messages := subscription.take(MOST_TAKEN):
                taken += [(instant, name, data) for data, instant in messages]
        taken.sort(key=itemgetter(0))
        return [(name, data) for _, name, data in taken]

    def _command(self, device: Simulator, name: str, data: bytes) -> None:
        try:
            message = deserialised(data, TOPICS[name].type)  # as every reader of the bag reads it
        except ValueError:
            self._refuse(name, f"a message of {len(data)} bytes is no {TOPICS[name].type}; publish that type")
            return
        commands, faults = commands_in(name, message, device.scene)
        for fault in faults:  # of the joints that a message names, which the next one names again
            self._refuse(name, fault, once=True)
        for argument, value in commands.items():
            try:
                device.command(**{argument: value})
            except ValueError as error:  # names the parameter, `motor.speed`; a peer knows the topic
                reason = str(error)
                self._refuse(name, reason.removeprefix(f"{name.replace('_', '.')}: "))
            else:
                self.accepted[argument] += 1

    def _refuse(self, name: str, reason: str, once: bool = False) -> None:
        self.refused += 1
        if once and reason in self._logged_once:
            return
        if text := self._throttles[name].admit(f"command refused: {self.topics[name]}: {reason}"):
            self._log.warning(text)
            if once and len(self._logged_once) < MOST_LOGGED_ONCE:
                self._logged_once.add(reason)


def _warn_of_unmatched(node: Node, subscribed: Mapping[str, tuple[str, QoSProfile]]) -> None:
    """Let `node` warn of publishers that DDS silently does not match with its subscriptions.

    These are publishers of another type, and best-effort ones where the subscription is reliable; `subscribed` has type
    and quality of service of the subscriptions, by full name.
    """
    known: set[str] = set()
    throttle = Throttle()

    def name_of(publisher: TopicEndpointInfo) -> str:
        if "_BARE_DDS_APP_" in publisher.node_name:
            return "a program without ROS"
        return peer_text(f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}")

    def faults() -> Iterator[str]:
        for topic, (kind, profile) in subscribed.items():
            for publisher in node.get_publishers_info_by_topic(topic):
                if "_UNKNOWN_" in publisher.node_name:
                    continue  # DDS learns the node's name later
                if publisher.topic_type != kind:
                    yield (f"{topic}: {name_of(publisher)} publishes {peer_text(publisher.topic_type)}, which cannot "
                           f"arrive; publish {kind}")
                elif (publisher.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
                      and profile.reliability == ReliabilityPolicy.RELIABLE):
                    yield (f"{topic}: {name_of(publisher)} publishes best effort, which cannot arrive; let it publish "
                           f"reliably, or start the robot with -p qos_overrides.{topic}.subscription.reliability:="
                           "best_effort")

    def look() -> None:
        reported = known.copy()
        known.clear()
        known.update(faults())
        for fault in sorted(known - reported):
            if text := throttle.admit(fault):
                node.get_logger().warning(text)

    node.create_timer(GRAPH_PERIOD, look, clock=Clock(clock_type=ClockType.STEADY_TIME))
