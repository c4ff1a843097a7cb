"""What a robot says of itself beside its samples: contacts, diagnostics, operations, and lines of its log.

All of it comes on topics on which anybody may publish anything, so each message is read strictly, and what is not the
robot's is left alone. Texts are shown as texts, on one line, and not too long.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.operations import PAUSE, RESUME, Operation, read_operation
from vibro_ros.messages.robot_messages import PLATES
from vibro_ros.messages.topics import OPERATIONS, TOPICS, full_name
from vibro_ros.process.files import one_line
from vibro_ros.ros.live.robot import SECOND
from vibro_ros.ros.node import qos
from vibro_ros.ros.node.node import PollingSubscription

MOST = 200
"""Messages of one topic that are looked at in one batch; those of a flood wait, and DDS drops the oldest."""
LONGEST = 100_000
"""Bytes of the longest message that is read."""
LONGEST_LINE = 500
"""Characters of a line that is shown."""
_NO_RECORDING, _FAULT = "not recording", 2
"""What the robot says when it records nothing, and the level of diagnostics at which it cannot."""
WARNING, ERROR = 30, 40
"""Levels of rcl_interfaces/msg/Log."""
_LOG = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)


class Impact(NamedTuple):
    """One contact: stamp of its first instant [ns], side of the mass, peak force [N]."""

    stamp: int
    side: str
    peak_force: float


class RobotStatus:
    """Listens to the robot whose node has the full name `robot`; `status` has the fields of the frame of that name."""

    def __init__(self, node: Node, robot: str):
        self._robot, self._logger = robot, robot.strip("/").replace("/", ".")
        self._log = PollingSubscription(node, Log, "/rosout", _LOG)
        self._impacts = PollingSubscription(node, WrenchStamped, "impacts", qos.profile("impacts"))
        self._diagnostics = PollingSubscription(node, DiagnosticArray, full_name("diagnostics"),
                                             qos.profile("diagnostics"))
        self._operations = PollingSubscription(node, String, f"{robot}/{OPERATIONS}", qos.profile(OPERATIONS))
        self._frames: dict[str, str] = {}
        self.status: dict[str, Any] = {}

    def begin(self, prefix: str) -> None:
        """Listen to a robot whose frames' names begin so."""
        self._frames = {prefix + frame: frame.partition("_")[0] for frame in PLATES.values()}
        self.status = {}

    def impacts(self) -> list[Impact]:
        """Contacts that have come since the last call."""
        found = []
        for message in _read(self._impacts, TOPICS["impacts"].type):
            stamp, side = message.header.stamp, self._frames.get(message.header.frame_id)
            force = message.wrench.force.z
            if side and math.isfinite(force) and stamp.sec >= 0 and 0 <= stamp.nanosec < SECOND:
                found.append(Impact(stamp.sec * SECOND + stamp.nanosec, side, float(force)))
        return found

    def operations(self) -> list[Operation]:
        """What was done to the run since the last call; whether it is paused goes into the status."""
        found = []
        for message in _read(self._operations, TOPICS[OPERATIONS].type):
            try:
                found.append(read_operation(message.data))
            except ValueError:
                continue
            if found[-1].name in (PAUSE, RESUME) and self.status:
                self.status["paused"] = found[-1].name == PAUSE
        return found

    def diagnostics(self) -> bool:
        """Whether the robot has said anything of itself since the last call, which then is the status."""
        heard = False
        for message in _read(self._diagnostics, "diagnostic_msgs/msg/DiagnosticArray"):
            for one in message.status:
                if one.hardware_id == self._robot:
                    self._take(one)
                    heard = True
        return heard

    def log(self) -> list[tuple[str, str]]:
        """Level and words of the robot's warnings and errors since the last call."""
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
    """Messages that have come and are of their type."""
    found = []
    for data, _ in subscription.take(MOST):
        if len(data) <= LONGEST:
            try:
                found.append(deserialised(data, type_name))
            except ValueError:
                continue
    return found


def _number(values: Mapping[str, str], name: str) -> float:
    """A number that the robot has said as text; 0 for what is none."""
    try:
        number = float(values.get(name, ""))
    except ValueError:
        return 0.0
    return number if math.isfinite(number) else 0.0
