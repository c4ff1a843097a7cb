"""What a robot publishes besides its samples: contacts, diagnostics, operations, and lines of its log.

Any program can publish on these topics, so each message is checked strictly, and messages that are not the robot's are
ignored. Texts are shown as plain text, in one line of limited length.
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
"""Most messages of one topic that are taken in one batch; of more, DDS drops the oldest."""
LONGEST = 100_000
"""Longest message [bytes] that is read."""
LONGEST_LINE = 500
"""Longest line [characters] that is shown."""
_NO_RECORDING, _FAULT = "not recording", 2
"""The recorder's diagnostics: message when nothing is recorded, and level when recording has failed."""
WARNING, ERROR = 30, 40
"""Levels of rcl_interfaces/msg/Log."""
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
        self._impacts = PollingSubscription(node, WrenchStamped, "impacts", qos.profile("impacts"))
        self._diagnostics = PollingSubscription(node, DiagnosticArray, full_name("diagnostics"),
                                             qos.profile("diagnostics"))
        self._operations = PollingSubscription(node, String, f"{robot}/{OPERATIONS}", qos.profile(OPERATIONS))
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
    for data, _ in subscription.take(MOST):
        if len(data) <= LONGEST:
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
