"""Commands of a live robot: publishes the pages' commands, and follows those of all programs to know the latest ones.

A page is a dead man's switch: if a page has commanded the motor, it stops when no page is open any more.
"""

import time
from collections import deque
from collections.abc import Callable, Sequence

from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Float64

from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.operations import RESET, TIMEOUT, Operation
from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.model.scene import Scene
from vibro_ros.ros.node.node import PollingSubscription, qos_profile

SPEED = "motor_speed"
MOST_TAKEN = 200  # most messages of one topic that are taken in one batch
RETURN_TIMEOUT = 3.0  # time [s] that a page gets to come back after it was reloaded or lost its connection
REPEATS = 3  # number of times that the motor's command is sent in one `command.timeout`, so that one or two may be lost
STOP_ATTEMPTS = 8
STOP_INTERVAL = Duration(nanoseconds=500_000_000)
"""The last command is sent so often, at this interval, until the robot has received it: Fast DDS repeats a lost
message, or asks for a lost acknowledgement, only after 3 s by itself, but with each further message at once. Four
seconds in all, because `ros2 launch` kills a program 5 s after its SIGTERM."""


class PageCommands:
    """Publishes and follows the commands of one robot, in the executor's thread, by the clock `now` [s].

    `in_force` has the commands [SI] of this run that are in effect, by topic; a command that was not sent, or is not
    known, is missing. `of_page` is whether a page's command keeps the motor turning.
    """

    def __init__(self, node: Node, now: Callable[[], float] = time.monotonic):
        self.in_force: dict[str, float] = {}
        self.of_page = False
        self._topics = {name: PollingSubscription(node, Float64, name, qos_profile(name)) for name in COMMAND_UNITS}
        self._publishers = {name: node.create_publisher(Float64, name, qos_profile(name)) for name in COMMAND_UNITS}
        self._sent = deque[float](maxlen=MOST_TAKEN)  # speeds sent by pages, not yet received back
        self._now = now
        self._page_seen_at = self._repeated_at = now()

    def send(self, name: str, value: float, answer: Callable[[bool, str], object]) -> None:
        """Publish a command unchecked: the robot knows its limits and reports a refusal."""
        publisher = self._publishers[name]
        if publisher.get_subscription_count() <= 1:  # the view itself is one subscriber
            answer(False, f"nobody listens to {publisher.topic_name}; is the robot running?")
            return
        self._publish(name, value)
        answer(True, f"{name} {value:g} {COMMAND_UNITS[name]} sent")

    def take(self, scene: Scene | None, operations: Sequence[Operation]) -> None:
        """Take the commands since the last call, and apply the effect of `operations` on them.

        Without a `scene` there is no robot, and all commands are forgotten.
        """
        for name, topic in self._topics.items():
            for data, _ in topic.take(MOST_TAKEN):
                if scene is None or (value := _valid(scene, name, data)) is None:
                    continue
                self.in_force[name] = value
                if name == SPEED:
                    is_own = value in self._sent
                    self.of_page = is_own and value != 0.0
                    while is_own and self._sent.popleft() != value:  # earlier values were refused or lost
                        pass
        names = {operation.name for operation in operations}
        if scene is None or RESET in names:
            self.in_force, self.of_page = {}, False
        elif TIMEOUT in names:  # or of a later command: then the samples show its effect
            self.in_force.pop(SPEED, None)
            self.of_page = False

    def stop_if_alone(self, pages: int, timeout: float) -> bool:
        """Keep the motor turning while pages are open, and stop it when none is left.

        Returns whether the motor was stopped now. `timeout` [s] is the robot's `command.timeout`, 0 if it has none.
        """
        now = self._now()
        if pages:
            self._page_seen_at = now
        if not self.of_page:
            return False
        if now > self._page_seen_at + RETURN_TIMEOUT:
            self._publish(SPEED, 0.0)
            self.of_page = False
            return True
        if timeout and now > self._repeated_at + timeout / REPEATS:
            self._repeated_at = now
            self._publish(SPEED, self.in_force[SPEED])
        return False

    def end(self) -> str:
        """Stop a motor that a page keeps turning, because the view ends; return in words what was done, if anything."""
        if not self.of_page:
            return ""
        for _ in range(STOP_ATTEMPTS):
            self._publish(SPEED, 0.0)
            if self._publishers[SPEED].wait_for_all_acked(STOP_INTERVAL):
                return "sent motor_speed 0"
        return "sent motor_speed 0, but it was not received; the motor may run on"

    def _publish(self, name: str, value: float) -> None:
        if name == SPEED:
            self._sent.append(value)
        self._publishers[name].publish(Float64(data=value))


def _valid(scene: Scene, name: str, data: bytes) -> float | None:
    """Return the command in a message; None if the robot refuses it."""
    try:
        value = float(deserialised(data, "std_msgs/msg/Float64").data)
        return scene.checked_command(name, value)
    except ValueError:
        return None
