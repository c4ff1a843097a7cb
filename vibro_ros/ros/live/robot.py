"""A live robot as the view receives it: its scene, its samples and status, and why there are none.

Samples wait in DDS until the view polls: an executor's turn costs 0.15 to 0.5 ms, too much for each of 1000 messages a
second when the page shows 30 pictures a second; taken in batches, a message costs some 30 us. Any program can publish
on the topics, so each message is checked strictly, and messages that are not the robot's are ignored. Texts are shown
as plain text, in one line of limited length.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, String

from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.operations import PAUSE, RESUME, Operation, read_operation
from vibro_ros.messages.robot_messages import PLATES, SAMPLE_LABELS
from vibro_ros.messages.topics import OPERATIONS, SAMPLES, TOPICS, full_name
from vibro_ros.process.files import one_line
from vibro_ros.ros.node.node import GuardedNode, PollingSubscription, qos_profile
from vibro_ros.ros.node.refusals import peer_text
from vibro_ros.ros.node.robot_parameters import SceneReader, Settings
from vibro_ros.simulation.samples import FIELDS, TIME

SECOND = 1_000_000_000  # nanoseconds in a second
MOST_SAMPLES = 500  # most samples taken in one batch, 15,000 a second; DDS drops the oldest of more samples
LONGEST = 10_000  # longest message [bytes] that is read; a sample has about a thousand
LONGEST_RUN = 1e8  # longest robot time [s], three years; later times do not have nanoseconds as a float
SILENCE_TIMEOUT = 3.0
"""Time [s] without samples and diagnostics, which come each second, after which a robot counts as silent."""
READ_PERIOD = 2.0  # time [s] after which a robot is asked again for its parameters, if they were invalid
FIRST_SAMPLE_TIMEOUT = 1.5
"""Time [s] in which the first sample must arrive; a robot that publishes diagnostics and no sample is paused."""
RIVALRY_PERIOD = 2.0
"""Time [s] in which the run changes at most once, unless there are two robots: a robot needs about 1 s to start."""
MOST_NAMED = 5  # most other robots that are named in a message
_LABEL = ",".join(SAMPLE_LABELS)
_NO_ROWS = np.empty((0, len(FIELDS)))


class LiveRobot:
    """Follows one robot, whose node has the full name `robot`, through its starts and ends.

    The node counts and logs refused messages. `settings` are those of the robot that publishes now, `origin` is the
    stamp [ns] of its robot time 0, and `silences` counts how often it came back after a silence, perhaps as another
    robot.
    """

    def __init__(self, node: GuardedNode, robot: str):
        self.settings: Settings | None = None
        self.origin: int | None = None
        self.silences = 0
        self._node, self._robot, self._runs = node, robot, Runs()
        self._samples = PollingSubscription(node, Float64MultiArray, f"{robot}/{SAMPLES}", qos_profile(SAMPLES))
        self._fault, self._publishers = "", frozenset[bytes]()
        self._others: list[str] = []
        self._last_received = self._read_at = float("-inf")
        self.reader = SceneReader(node, robot, self._take_settings)  # last: the robot then knows the other clients

    def poll(self) -> np.ndarray:
        """Return the samples since the last call, with robot time [s] as `time`; shape (n, len(FIELDS))."""
        if self.settings is None and not (self._fault or self.reader.reading):
            self.reader.read()
        self.reader.tick()
        messages = self._samples.take(MOST_SAMPLES)
        if self.settings is None:
            return _NO_ROWS
        samples = [read for data, _ in messages if (read := read_sample(data))]
        if refused := len(messages) - len(samples):
            self._node.refusals.refuse(self._samples.topic, f"{refused} messages that are no samples of a robot of "
                                       "this version")
        return self._of_this_run([start for start, _ in samples], np.array([row for _, row in samples]))

    def hear(self) -> None:
        """Note that a message of the robot was received.

        After a silence it may be another robot, so that its parameters are read again before it is shown.
        """
        now = time.monotonic()
        if float("-inf") < self._last_received < now - SILENCE_TIMEOUT:
            self.silences += 1
            self.settings = self.origin = None
            self.reader.read()
        self._last_received = now

    def look(self) -> None:
        """Look up who publishes samples, and read the parameters again after a change or a fault; called often."""
        publishers = frozenset(bytes(publisher.endpoint_gid)
                          for publisher in self._node.get_publishers_info_by_topic(self._samples.topic))
        ask_again = self._fault and not self.reader.reading and time.monotonic() > self._read_at + READ_PERIOD
        if publishers - self._publishers or ask_again:
            self.reader.read()
        if self._publishers and not publishers:  # the robot has gone; the next one must give its parameters
            self.settings, self.origin, self._fault = None, None, ""
        self._publishers = publishers
        self._others = [] if self.settings else self._robots_seen()

    @property
    def absence(self) -> str:
        """Reason in words why there is nothing to show; empty if there is something."""
        now = time.monotonic()
        if self._runs.rivals:
            return (f"two robots publish on {self._samples.topic}; give one of them a namespace, such as "
                    "--ros-args -r __ns:=/r1")
        if self._fault:
            return f"{self._robot} cannot be shown: {self._fault}"
        is_missing = self.settings is None and not self.reader.sees_robot
        if not self._publishers and (is_missing or self.settings) or (is_missing and self._others):
            return self._why_absent()
        silent = now > self._last_received + SILENCE_TIMEOUT
        if self.settings is None:
            return f"{self._robot} is there; waiting for its parameters"
        if self.origin is None and silent:
            return f"{self._robot} is starting"
        if self.origin is None and now < self._read_at + FIRST_SAMPLE_TIMEOUT:
            return f"{self._robot} is there; waiting for its first sample"
        if silent:
            return f"{self._robot} has not been heard for {SILENCE_TIMEOUT:g} s; it was killed, or something keeps it"
        return ""

    def _robots_seen(self) -> list[str]:
        """Return the full names of other robots' nodes in this domain: the nodes that publish operations."""
        last = f"/{OPERATIONS}"
        names = [topic.removesuffix(last) for topic, types in self._node.get_topic_names_and_types()
                 if topic.endswith(last) and TOPICS[OPERATIONS].type in types and self._node.count_publishers(topic)]
        return sorted(peer_text(name) for name in names if name != self._robot)

    def _why_absent(self) -> str:
        """Return in words that the robot is not there, which other robots are, and the remedy."""
        domain = f"in ROS domain {self._node.context.get_domain_id()}"
        if not self._others:
            return (f"no robot {self._robot}, nor another one, {domain}; start one there (ros2 run vibro_ros robot), "
                    "or the view in the domain of yours (ROS_DOMAIN_ID)")
        more = f" and {len(self._others) - MOST_NAMED} more" if len(self._others) > MOST_NAMED else ""
        first = self._others[0]
        space = first.rpartition("/")[0] or "/"
        remap = f" --ros-args -r __ns:={space}" if space != self._node.get_namespace() else ""
        return (f"no robot {self._robot} {domain}, but {', '.join(self._others[:MOST_NAMED])}{more}; to show the "
                f"first: view --robot {first}{remap}")

    def _of_this_run(self, starts: list[int], rows: np.ndarray) -> np.ndarray:
        """Return the rows if they belong to the present run of a known robot; else none."""
        rivals = self._runs.rivals
        restarted = self._runs.restarted(starts, [row[TIME] for row in rows])
        if not self._runs.rivals and (restarted or rivals):  # another run: its robot must give its parameters
            self.settings = self.origin = None
        if starts and not self._runs.rivals:
            self.hear()
            if self.settings is not None:
                self.origin = starts[-1]
                return rows
        return _NO_ROWS

    def _take_settings(self, answer: Settings | str) -> None:
        """Take the settings, or the reason why there are none, from the reader."""
        self._read_at = time.monotonic()
        self._fault = answer if isinstance(answer, str) else ""
        self.settings = None if isinstance(answer, str) else answer


def read_sample(data: bytes) -> tuple[int, np.ndarray] | None:
    """Return the ROS time [ns] of robot time 0 and the `FIELDS` of a message on `~/samples`; None if it is none."""
    try:
        message = deserialised(data if len(data) <= LONGEST else b"", TOPICS[SAMPLES].type)
    except ValueError:
        return None
    if [dimension.label for dimension in message.layout.dim] != [_LABEL] or len(message.data) != len(SAMPLE_LABELS):
        return None
    (seconds, nanoseconds), values = message.data[:2], message.data[2:]
    if not (np.isfinite(values).all() and 0.0 <= values[TIME] < LONGEST_RUN
            and 0.0 <= seconds < 2**31 and 0.0 <= nanoseconds < SECOND):
        return None
    return int(seconds) * SECOND + int(nanoseconds), values


class Runs:
    """Detects a new run, and two robots that publish on the same topic, by the clock `now` [s].

    Robot time never goes back, so a different start or an earlier time means another run. With two robots, the run
    seems to change again and again.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic):
        self._now = now
        self._last: tuple[int, float] | None = None
        self._changes: deque[float] = deque(maxlen=2)

    @property
    def rivals(self) -> bool:
        """Whether two robots have published lately."""
        return len(self._changes) == 2 and (self._changes[1] - self._changes[0] < RIVALRY_PERIOD
                                            and self._now() - self._changes[1] < RIVALRY_PERIOD)

    def restarted(self, starts: Sequence[int], times: Sequence[float]) -> bool:
        """Note the starts [ns] and times [s] of samples; return whether another run has begun with one of them."""
        has_restarted = False
        for start, time_of_sample in zip(starts, times, strict=True):
            last, self._last = self._last, (start, time_of_sample)
            if last and not (start == last[0] and time_of_sample > last[1]):
                self._changes.append(self._now())
                has_restarted = True
        return has_restarted


MOST_REPORTS = 200  # most messages of one topic that are taken in one batch; DDS drops the oldest of more messages
LONGEST_REPORT = 100_000  # longest message [bytes] that is read
LONGEST_LINE = 500  # longest line [characters] that is shown
_NO_RECORDING, _FAULT = "not recording", 2
"""The recorder's diagnostics: message when nothing is recorded, and level when recording has failed."""
WARNING, ERROR = 30, 40  # levels of rcl_interfaces/msg/Log
_LOG = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)


class ReportedImpact(NamedTuple):
    """One contact: stamp of its first instant [ns], side of the mass, peak force [N]."""

    stamp: int
    side: str
    peak_force: float


class RobotStatus:
    """Subscribes to the status of the robot whose node has the full name `robot`.

    `status` has fields of the frame "status" that pages get; it is empty before the first diagnostics.
    """

    def __init__(self, node: Node, robot: str):
        self._robot, self._logger = robot, robot.strip("/").replace("/", ".")
        self._log = PollingSubscription(node, Log, "/rosout", _LOG)
        self._impacts = PollingSubscription(node, WrenchStamped, "impacts", qos_profile("impacts"))
        self._diagnostics = PollingSubscription(node, DiagnosticArray, full_name("diagnostics"),
                                                qos_profile("diagnostics"))
        self._operations = PollingSubscription(node, String, f"{robot}/{OPERATIONS}", qos_profile(OPERATIONS))
        self._frames: dict[str, str] = {}
        self.status: dict[str, Any] = {}

    def begin(self, prefix: str) -> None:
        """Begin with a robot whose frames' names have this prefix, and forget the status."""
        self._frames = {prefix + frame: frame.partition("_")[0] for frame in PLATES.values()}
        self.status = {}

    def impacts(self) -> list[ReportedImpact]:
        """Return the contacts received since the last call."""
        contacts = []
        for message in _read(self._impacts, TOPICS["impacts"].type):
            stamp, side = message.header.stamp, self._frames.get(message.header.frame_id)
            force = message.wrench.force.z
            if side and math.isfinite(force) and stamp.sec >= 0 and 0 <= stamp.nanosec < SECOND:
                contacts.append(ReportedImpact(stamp.sec * SECOND + stamp.nanosec, side, float(force)))
        return contacts

    def operations(self) -> list[Operation]:
        """Return the operations since the last call; a pause or its end is noted in `status`."""
        operations = []
        for message in _read(self._operations, TOPICS[OPERATIONS].type):
            try:
                operations.append(read_operation(message.data))
            except ValueError:
                continue
            if operations[-1].name in (PAUSE, RESUME) and self.status:
                self.status["paused"] = operations[-1].name == PAUSE
        return operations

    def diagnostics(self) -> bool:
        """Update `status` from the diagnostics since the last call; return whether there were any."""
        received = False
        for message in _read(self._diagnostics, "diagnostic_msgs/msg/DiagnosticArray"):
            for status in message.status:
                if status.hardware_id == self._robot:
                    self._take(status)
                    received = True
        return received

    def log(self) -> list[tuple[str, str]]:
        """Return level and text of the robot's warnings and errors since the last call."""
        return [("error" if message.level >= ERROR else "warning", one_line(message.msg, LONGEST_LINE))
                for message in _read(self._log, "rcl_interfaces/msg/Log")
                if message.name == self._logger and message.level >= WARNING]

    def _take(self, status: Any) -> None:
        values = {pair.key: pair.value for pair in status.values}
        part = status.name.rpartition(": ")[2]
        if part == "recorder":
            records = status.message != _NO_RECORDING and status.level < _FAULT
            self.status["recording"] = one_line(status.message, LONGEST_LINE) if records else ""
        if part != "simulation":
            return
        dropped, simulated = (_number(values, name) for name in ("dropped time [s]", "simulated time [s]"))
        self.status |= {
            "real_time_factor": _number(values, "real-time factor"),
            "dropped_share": dropped / (dropped + simulated) if dropped > 0.0 and simulated >= 0.0 else 0.0,
            "refused": round(min(_number(values, "rejected commands"), 1e15)),
        }
        if status.message in ("paused", "running"):
            self.status["paused"] = status.message == "paused"
        self.status.setdefault("paused", self.status["real_time_factor"] == 0.0)


def _read(subscription: PollingSubscription, type_name: str) -> list[Any]:
    """Take the messages that have arrived, and return those that can be read."""
    messages = []
    for data, _ in subscription.take(MOST_REPORTS):
        if len(data) <= LONGEST_REPORT:
            try:
                messages.append(deserialised(data, type_name))
            except ValueError:
                continue
    return messages


def _number(values: Mapping[str, str], name: str) -> float:
    """Return a number that diagnostics have as text; 0 if it is missing or not a finite number."""
    try:
        number = float(values.get(name, ""))
    except ValueError:
        return 0.0
    return number if math.isfinite(number) else 0.0
