"""One live robot as the view sees it: its scene, its samples since it began, and in words why there are none."""

import time
from collections import deque
from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from vibro_ros.messages.topics import OPERATIONS, TOPICS
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.ros.live.samples import NUMBERED, Decoder, Joining, Rows
from vibro_ros.ros.node.node import GuardedNode, PollingSubscription
from vibro_ros.ros.node.refusals import peer_text
from vibro_ros.ros.node.robot_parameters import SceneReader, Settings
from vibro_ros.simulation.samples import FIELDS, TIME
from vibro_ros.view.drawing import voltage

SAMPLES = QoSProfile(depth=2000, reliability=ReliabilityPolicy.RELIABLE)
"""Deep, so that none is lost between two looks, or while something else takes long: 2 s at 1 kHz."""
MOST = 500
"""Messages of one topic that are taken at once, 15,000 a second; those of a flood wait, and DDS drops the oldest."""
SILENCE = 3.0
"""Time [s] without a sample and without diagnostics, which come each second, after which a robot is not heard."""
READ_AGAIN = 2.0
"""Time [s] after which the parameters are asked for once more where they do not explain what is published."""
LONGEST_RUN = 10**17
"""Nanoseconds that a robot may have run, three years: of later times a float does not hold the nanoseconds."""
FIRST = 1.5
"""Time [s] that the first sample may take; of a robot that has said something by then and sent none, time stands still.
"""
RIVALRY = 2.0
"""Time [s] within which a publisher begins to count from 1 again once at most; a robot needs about a second to start.
"""
MOST_NAMED = 5
"""Other robots that are named."""
_KINDS = {"odom": Odometry, "joint_states": JointState, "ground_contact": WrenchStamped,
          **dict.fromkeys(NUMBERED, Float64)}
_VOLTAGE, *_OF_VOLTAGE = (FIELDS.index(name) for name in (
    "motor_voltage", "motor_current", "electrical_power", "motor_speed"))


class LiveRobot:
    """Follows one robot, whose node has the full name `robot`, through its starts and ends.

    The node counts and says what it refuses. `settings` is what is known of the robot that publishes now, `origin` the
    stamp [ns] of robot time 0, or of the first sample that was seen if the robot does not say it, and `silences` counts
    how often it was heard again after a silence, perhaps as another robot.
    """

    def __init__(self, node: GuardedNode, robot: str):
        self.settings: Settings | None = None
        self.origin: int | None = None
        self._start: int | None = None  # what the robot has said of robot time 0
        self.silences = 0
        self._node, self._robot = node, robot
        self._topics = {topic: PollingSubscription(node, kind, topic, SAMPLES) for topic, kind in _KINDS.items()}
        self._runs, self._joining = Runs(), Joining()
        self._decoder: Decoder | None = None
        self._fault, self._publishers = "", frozenset[bytes]()
        self._others: list[str] = []
        self._heard = self._row_heard = self._read_at = float("-inf")
        self._unread = self._doubtful = False
        self._last = -1
        self.reader = SceneReader(node, robot, self._take_settings)  # last: then the robot knows the other clients

    def poll(self) -> np.ndarray:
        """Rows of `FIELDS` that have come since the last call, `time` counted from `origin` [s]; shape (n, fields)."""
        if self.settings is None and not (self._fault or self.reader.reading):
            self.reader.read()
        self.reader.tick()
        taken = {topic: [(data, number) for data, _, number in one.take(MOST)] for topic, one in self._topics.items()}
        if self.settings is None or self._decoder is None:
            return np.empty((0, len(FIELDS)))
        readings = {}
        for topic in self._decoder.columns:
            messages = taken[topic]
            found = [self._decoder.read(topic, *message) for message in messages]
            readings[topic] = [reading for reading in found if reading]
            if left := len(messages) - len(readings[topic]):
                self._unread = True
                self._node.refusals.refuse(self._topics[topic].topic, f"{left} messages that are no samples of "
                                           f"{self._robot}: torn, not finite, or of other frames or joints")
        rows = self._joining.join(readings, self._decoder.columns)
        if self.settings.scene.has_rotor:
            rows.values[:, _VOLTAGE] = voltage(self.settings.scene, *rows.values[:, _OF_VOLTAGE].T)
        return self._taken(rows)

    def hear(self, start: int | None) -> None:
        """Take note that the robot has said something, and the stamp [ns] of its time 0 if that was among it.

        After a silence it may be another robot, and is shown when it has told who it is.
        """
        now = time.monotonic()
        if float("-inf") < self._heard < now - SILENCE:
            self._doubtful = True
            self.silences += 1
            self.reader.read()
        self._heard = now
        self._start = start if start is not None else self._start

    def look(self) -> None:
        """Look who publishes, and ask again where that has changed or is not explained; to be called now and then."""
        found = frozenset(bytes(one.endpoint_gid)
                          for one in self._node.get_publishers_info_by_topic(self._topics["odom"].topic))
        now = time.monotonic()
        unexplained = (self._fault or self._unread) and now > max(self._read_at, self._row_heard) + READ_AGAIN
        if found - self._publishers or (unexplained and not self.reader.reading):
            self.reader.read()
        if self._publishers and not found:  # it has gone, and who comes next is to be asked what it is
            self.settings, self.origin, self._start, self._fault = None, None, None, ""
        self._publishers, self._unread = found, False
        self._others = [] if self.settings else self._robots_seen()

    @property
    def absence(self) -> str:
        """Why there is nothing to show, in words; empty if there is."""
        now = time.monotonic()
        if self._runs.rivals:
            return (f"two robots publish on {self._topics['odom'].topic}; give one of them a namespace, such as "
                    "--ros-args -r __ns:=/r1")
        if self._fault:
            return f"{self._robot} cannot be shown: {self._fault}"
        is_missing = self.settings is None and not self.reader.sees_robot
        if not self._publishers and (is_missing or self.settings) or (is_missing and self._others):
            return self._nobody()
        silent = now > self._heard + SILENCE
        if self.settings is None or (self._doubtful and not silent):
            return f"{self._robot} is there; waiting for its parameters"
        if self.origin is None and silent:
            return f"{self._robot} is starting; the first start compiles for half a minute"
        if self.origin is None and now < self._read_at + FIRST:
            return f"{self._robot} is there; waiting for its first sample"
        if silent:
            return f"{self._robot} has not been heard for {SILENCE:g} s; it was killed, or something keeps it"
        return ""

    def _robots_seen(self) -> list[str]:
        """Full names of other robots' nodes in this domain: those that publish what is done to their runs."""
        last = f"/{OPERATIONS}"
        names = [topic.removesuffix(last) for topic, types in self._node.get_topic_names_and_types()
                 if topic.endswith(last) and TOPICS[OPERATIONS].type in types and self._node.count_publishers(topic)]
        return sorted(peer_text(name) for name in names if name != self._robot)

    def _nobody(self) -> str:
        """That the robot is not there, who is, and what can be done."""
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

    def _taken(self, rows: Rows) -> np.ndarray:
        """The rows of the present run, by its own clock."""
        nothing, rivals = rows.values[:0], self._runs.rivals
        restarted = self._runs.restarted(rows.counts)
        if restarted:
            self.origin = self._start = None
        if not self._runs.rivals and (restarted or rivals):  # who is heard from now on is to be asked what it is
            self.settings = None
        if not len(rows.stamps) or self._runs.rivals or self.settings is None:
            return nothing
        self.hear(None)
        if self._doubtful:
            return nothing
        self._row_heard = time.monotonic()
        if self.origin is None:
            if self._start is None and self._row_heard < self._read_at + FIRST:  # it says it each second
                return nothing
            first = int(rows.stamps[0])
            is_start = self._start is not None and 0 <= first - self._start < LONGEST_RUN
            self.origin, self._last = self._start if is_start else first, -1
        later = rows.stamps > np.maximum.accumulate(np.concatenate([[self._last], rows.stamps[:-1]]))
        if not later.all():
            self._node.refusals.refuse(self._topics["odom"].topic, f"{(~later).sum()} samples with stamps that go back")
        if not later.any():
            return nothing
        values = rows.values[later]
        values[:, TIME] = (rows.stamps[later] - self.origin) * 1e-9
        self._last = int(rows.stamps[later][-1])
        return values

    def _take_settings(self, found: Settings | str) -> None:
        """Take what was read; samples of another machine than before are those of another run."""
        self._read_at, self._doubtful = time.monotonic(), False
        self._fault = found if isinstance(found, str) else ""
        settings = None if isinstance(found, str) else found
        if self.settings is None or settings is None or self.settings.prefix != settings.prefix or any(
                value != settings.scene[name] and not BY_NAME[name].while_running
                for name, value in self.settings.scene.parameters.items()):
            self.origin, self._joining, self._last = None, Joining(), -1
        self.settings = settings
        self._decoder = Decoder(settings.scene, settings.prefix) if settings else None


class Runs:
    """Tells the samples of one run from those of the next, and one robot from two, by the clock `now` [s].

    A robot that is restarted counts its messages from 1. Two robots that publish on the same topics make the count
    go back again and again.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic):
        self._now, self._last = now, -1
        self._setbacks: deque[float] = deque(maxlen=2)

    @property
    def rivals(self) -> bool:
        """Whether two robots have been heard lately."""
        return len(self._setbacks) == 2 and (self._setbacks[1] - self._setbacks[0] < RIVALRY
                                             and self._now() - self._setbacks[1] < RIVALRY)

    def restarted(self, counts: np.ndarray) -> bool:
        """Take note of what came; whether another run has begun with it."""
        if not len(counts):
            return False
        setbacks = np.flatnonzero(np.diff(np.concatenate([[self._last], counts])) <= 0)
        self._last = int(counts[-1])
        self._setbacks.extend([self._now()] * min(len(setbacks), 2))
        return len(setbacks) > 0
