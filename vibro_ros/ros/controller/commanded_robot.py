"""The robot that receives the commands: its name, parameters and limits, its odometry, and its faults.

The robot's parameters are read before the first command. Of its limits only `motor.max_speed` can change while the
robot runs, and the robot never lowers it below the commanded speed. So a command within the limits known here is
accepted, and a command that was sent and exceeds a limit that the robot announces later was refused.
"""

import math
import re
import time
from collections import Counter, deque
from contextlib import suppress
from dataclasses import replace
from functools import partial

from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_parameter_events
from rclpy.task import Future

from vibro_ros.messages.codec import deserialised
from vibro_ros.model.faults import Incident
from vibro_ros.process.entry_point import StopRequest
from vibro_ros.ros.controller.feedback import MeanPosition
from vibro_ros.ros.controller.script import MOTOR
from vibro_ros.ros.node import process
from vibro_ros.ros.node.node import PollingSubscription, installed_type
from vibro_ros.ros.node.robot_parameters import SceneReader, Settings

PARAMETERS_TIMEOUT = 5.0  # longest wait [s] for the robot's parameters before the first command
ANSWERS_TIMEOUT = 1.0
"""Time [s] after which the wait ends if no subscriber of the commands is a robot, or if one is and others do not
answer."""
LOOK_PERIOD = 0.2  # time [s] between two searches for subscribers of the commands
MOST_ASKED = 16  # most subscribers of the commands that are asked for their parameters
LONGEST_NAME = 200  # longest full name of a node [characters]
OWN_TYPES = "vibro_ros_interfaces"  # package with the type of the service for faults
LIVE_LIMIT = "motor.max_speed"
ODOM = "odom"
ODOMETRY_DEPTH = 1000  # most samples of odometry that wait for the next step of feedback: 1 s at 1 kHz


class CommandedRobot:
    """Finds the one robot among the subscribers of `publisher`, a publisher of commands.

    `name` is the robot's full name, empty until it is known; `settings` are its present parameters; `sent_speed` is the
    motor speed [rad/s] that was sent last.
    """

    def __init__(self, node: Node, publisher: Publisher):
        self.name = self._refused = ""
        self.settings: Settings | None = None
        self.sent_speed: float | None = None
        self._node, self._publisher = node, publisher
        self._readers: dict[str, SceneReader] = {}
        self._subscribers, self._robots = Counter[str](), set[str]()
        self._asked_at, self._last_look = time.monotonic(), 0.0
        node.create_subscription(ParameterEvent, "/parameter_events", self._follow_limit, qos_profile_parameter_events)

    def tick(self) -> None:
        """Search for subscribers and ask them for their parameters, if that is due; to be called often.

        RuntimeError when the robot has refused the motor speed that was sent last, or two robots receive the commands.
        """
        if self._refused:
            raise RuntimeError(self._refused)
        now = time.monotonic()
        if now < self._last_look + LOOK_PERIOD:
            return
        self._last_look = now
        self._subscribers = Counter(f"{info.node_namespace.rstrip('/')}/{info.node_name}"
                                for info in self._node.get_subscriptions_info_by_topic(self._publisher.topic_name))
        robots = [name for name, count in self._subscribers.items() if name in self._robots for _ in range(count)]
        if len(robots) > 1:
            raise RuntimeError(f"{len(robots)} robots hear {self._publisher.topic_name}: {', '.join(sorted(robots))}; "
                               "leave one of them, or give each a namespace (-r __ns:=/r1), and the controller that of "
                               "its robot; a killed robot counts for another 20 s")
        for name in self._subscribers:
            if name not in self._readers and len(self._readers) < MOST_ASKED and _can_be_asked(name):
                self._readers[name] = SceneReader(self._node, name, partial(self._take, name))
        for reader in self._readers.values():
            reader.tick()

    def wait(self, stop: StopRequest) -> None:
        """Return when the robot is known, when no subscriber is a robot of this package, or on `stop`."""
        self._asked_at = time.monotonic()

        def over() -> bool:
            self.tick()
            return bool(stop or self._answered)

        process.spin_until(self._node, over)
        if not (stop or self.settings):
            self._node.get_logger().info(f"{self} does not say its limits: what it refuses shows in its log only")

    @property
    def _answered(self) -> bool:
        """Whether the robot is known, or the wait for it is over."""
        waited = time.monotonic() - self._asked_at
        reading = not self._readers or any(reader.reading for name, reader in self._readers.items()
                                           if name in self._subscribers)
        if self.settings:
            return waited > ANSWERS_TIMEOUT or not reading
        return waited > (PARAMETERS_TIMEOUT if reading else ANSWERS_TIMEOUT)

    def __str__(self) -> str:
        return self.name or ", ".join(self._readers) or "the robot"

    @property
    def timeout(self) -> float:
        """The robot's `command.timeout` [s]; 0 if it has none, or is not known."""
        return self.settings.command_timeout if self.settings else 0.0

    def refusal(self, command: str, value: float) -> str:
        """Return why the robot would refuse a command of `COMMAND_UNITS` with this value; empty if it accepts it."""
        if not self.settings:
            return ""
        try:
            self.settings.scene.checked_command(command, value)
        except ValueError as error:
            reason = str(error).partition(": ")[2]  # the scene names the parameter
            return f"{self._node.resolve_topic_name(command)}: {reason}; {self.name} refuses it"
        return ""

    def note(self, command: str, value: float) -> None:
        """Check a command and note that it is sent (RuntimeError when the robot would refuse it)."""
        if reason := self.refusal(command, value):
            raise RuntimeError(reason)
        if command == MOTOR:
            self.sent_speed = value

    def _take(self, name: str, answer: Settings | str) -> None:
        """Take a node's answer: its settings, or the reason in words why it is no robot, such as for a recorder."""
        if isinstance(answer, Settings):
            self._robots.add(name)
            self._last_look = 0.0
            if not self.settings:
                self.name, self.settings = name, answer

    def _follow_limit(self, event: ParameterEvent) -> None:
        """Follow changes of `LIVE_LIMIT`, the one limit that may change while the robot runs."""
        if not self.settings or event.node != self.name:
            return
        for parameter in event.changed_parameters:
            if parameter.name == LIVE_LIMIT:
                with suppress(ValueError, RuntimeError):  # from another program with the robot's name
                    change = {LIVE_LIMIT: parameter_value_to_python(parameter.value)}
                    self.settings = replace(self.settings, scene=self.settings.scene.with_parameters(change))
        if self.sent_speed is not None:
            self._refused = self.refusal(MOTOR, self.sent_speed)


class OdometrySubscription:
    """Takes `odom` from DDS at each step of feedback, and adds its samples to a `MeanPosition`.

    With a callback for each sample, the executor fell behind on a busy machine, and positions were old.

    With `use_sim_time` only samples older than ROS time are added. In lock-step they have arrived for certain, while
    the sample and the clock of the same instant arrive in any order, on which the commands would depend.
    """

    def __init__(self, node: Node):
        self.mean = MeanPosition()
        self._clock = node.get_clock()
        self._waiting: deque[tuple[int, float]] = deque(maxlen=ODOMETRY_DEPTH)
        self._samples = PollingSubscription(node, Odometry, ODOM, QoSProfile(depth=ODOMETRY_DEPTH))

    def read(self, time: float) -> MeanPosition:
        """Return the mean with all samples that have arrived at `time` [s] of the script."""
        limit = self._clock.now().nanoseconds if self._clock.ros_time_is_active else math.inf
        for data, _ in self._samples.take(ODOMETRY_DEPTH):
            with suppress(ValueError):  # malformed message of a peer
                message = deserialised(data, "nav_msgs/msg/Odometry")
                stamp = message.header.stamp
                self._waiting.append((stamp.sec * 1_000_000_000 + stamp.nanosec, message.pose.pose.position.x))
        while self._waiting and self._waiting[0][0] < limit:
            self.mean.add(*self._waiting.popleft(), time)
        return self.mean


class FaultService:
    """Client of the robot's service `inject_fault`; ValueError if the service's type is not installed."""

    def __init__(self, node: Node, robot: CommandedRobot):
        self._kind = installed_type(OWN_TYPES, "srv", "InjectFault")
        if not self._kind:
            raise ValueError(f"fault: {OWN_TYPES} is not installed, or old; `make setup` builds it where there is a "
                             "C++ compiler, and colcon from the folder interfaces")
        self._node, self._robot = node, robot
        self._requests: list[tuple[str, Future]] = []

    def wait(self, stop: StopRequest) -> None:
        """Return when the robot offers the service, or on `stop` (RuntimeError if it does not offer it in time)."""
        name, begun = f"{self._robot.name}/inject_fault", time.monotonic()
        self._client = self._node.create_client(self._kind, name)
        process.spin_until(self._node, lambda: bool(stop or self._client.service_is_ready()
                                                  or time.monotonic() > begun + PARAMETERS_TIMEOUT))
        if not (stop or self._client.service_is_ready()):
            raise RuntimeError(f"{self._robot} offers no {name}; a robot with the types of {OWN_TYPES} does")

    def begin(self, entry: str, incident: Incident) -> None:
        """Request the fault of a script's entry."""
        self._requests.append((entry, self._client.call_async(self._kind.Request(**incident._asdict()))))

    def check(self) -> None:
        """Raise a RuntimeError if the robot has refused a fault."""
        for entry, future in [request for request in self._requests if request[1].done()]:
            self._requests.remove((entry, future))
            if not future.result().success:
                raise RuntimeError(f"entry {entry}: {self._robot} refuses the fault: {future.result().message}")


def _can_be_asked(name: str) -> bool:
    """Return whether a node's name is valid for service names; DDS shows a name not yet known with a leading _."""
    return bool(re.fullmatch(r"(/[A-Za-z][A-Za-z0-9_]*)+", name)) and "__" not in name and len(name) < LONGEST_NAME
