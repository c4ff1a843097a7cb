"""Play a script to a robot: wait for the robot, keep time, and stop the motor on an abort."""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from heapq import merge
from itertools import count

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64

from vibro_ros.configuration.scene_file import NODE_NAME
from vibro_ros.process.entry_point import StopRequest
from vibro_ros.ros.controller.commanded_robot import CommandedRobot, FaultService, OdometrySubscription
from vibro_ros.ros.controller.feedback import RATE, GoalError, GoalTracking
from vibro_ros.ros.controller.script import MOTOR, Script, Segment
from vibro_ros.ros.node import process
from vibro_ros.ros.node.node import GuardedNode
from vibro_ros.ros.node.process import CLOCK

ACKNOWLEDGE_TIMEOUT = 0.5
"""Longest wait [s] for the robot to acknowledge the last message; Fast DDS asks for that every 3 s only."""
REPETITIONS = 3  # number of times that the motor's command is sent within the robot's `command.timeout`
ROUNDING = 5e-10  # tolerance [s] of instants, which are sums of rounded numbers while ROS time has whole nanoseconds
Schedule = Iterable[tuple[float, Callable[[], None]]]
"""Instants [s] from the start, ascending, each with an action; the next is taken when the action is done."""
REPORT_PERIOD = 10.0  # time [s] between two log lines about the wait for a robot
STANDSTILL_PERIOD = 2.0
"""Wall time [s] without progress of ROS time after which the log says so, once for each standstill."""


class WallTime:
    """Time in seconds of the monotonic clock since `begin`."""

    def begin(self) -> None:
        """Make this instant time 0."""
        self._began = time.monotonic()

    def elapsed(self) -> float:
        """Time [s] since `begin`."""
        return time.monotonic() - self._began

    def longest_wait(self, remaining: float, period: float) -> float:
        """Return the wall time [s], at most `period`, after which to check again when `remaining` [s] are left."""
        return min(remaining, period)


class RosTime:
    """ROS time in seconds since `begin`, or since the first time received on /clock after it.

    ROS time changes only while the node's executor runs a callback, so a check after each callback misses no change. A
    clock at 0 has begun. A clock that stands still is a paused simulation.
    """

    def __init__(self, node: GuardedNode):
        self._node = node
        self._first: int | None = None
        self._latest = 0
        self._progress, self._standstill_logged = time.monotonic(), False

    def begin(self) -> None:
        """Make the present ROS time time 0, or the first one received if there is none yet."""
        self._first, self._latest = None, 0
        self._progress, self._standstill_logged = time.monotonic(), False
        self.elapsed()

    def elapsed(self) -> float:
        """Return the ROS time [s] since time 0; minus infinity until the first time is received on /clock.

        A script that began before that would begin at the first time that arrives from a running simulation, which
        differs from run to run. RuntimeError when ROS time jumped back.
        """
        if not self._node.clock_heard:
            self._say_standstill()
            return -math.inf
        now = self._node.get_clock().now().nanoseconds
        if self._first is None:
            self._first = self._latest = now
        if now < self._latest:
            raise RuntimeError(
                f"{self._topic()} jumped back from {self._latest / 1e9:.9g} to {now / 1e9:.9g} s: a reset simulation, "
                "or two clocks at once; leave one publisher there, and play the script again")
        if now > self._latest:
            self._latest, self._progress, self._standstill_logged = now, time.monotonic(), False
        else:
            self._say_standstill()
        return (now - self._first) / 1e9

    def longest_wait(self, remaining: float, period: float) -> float:
        """Return `period` [s], because it is unknown how much wall time `remaining` [s] of ROS time takes."""
        return period

    def _say_standstill(self) -> None:
        if self._standstill_logged or time.monotonic() - self._progress < STANDSTILL_PERIOD:
            return
        self._standstill_logged = True
        if self._node.clock_heard:
            text = f"ROS time stands still at {self._latest / 1e9:.9g} s: the simulation is paused, or gone"
        elif self._node.count_publishers(self._topic()):
            text = f"use_sim_time: no time on {self._topic()} so far: the simulation is paused"
        else:
            text = (f"use_sim_time: nobody publishes {self._topic()}; start a simulator that does, or this node "
                    "without use_sim_time")
        self._node.get_logger().info(f"{text}; the script waits for {self._topic()}")

    def _topic(self) -> str:
        return self._node.resolve_topic_name(CLOCK)


Timeline = WallTime | RosTime


def timeline(node: GuardedNode) -> Timeline:
    """Return the clock of a node's script: ROS time if the node uses simulated time, else wall time."""
    return RosTime(node) if node.get_clock().ros_time_is_active else WallTime()


class Player:
    """Publishes commands to a robot by a schedule.

    `publishers` are the publishers of the commands, by name; a robot must subscribe to each. While nothing is due,
    `meanwhile` is called with the time [s] since the start, at least each `period` [s] of wall time, and never with a
    time beyond the next instant. `prepare` is called when a robot subscribes, before time begins to count.

    An action that is due is done right after the callback that brings the time, before the executor runs another one: a
    simulator that waits for this node's answer in lock-step relies on it.
    """

    def __init__(self, node: GuardedNode, publishers: Mapping[str, Publisher],
                 meanwhile: Callable[[float], None] = lambda elapsed: None,
                 prepare: Callable[[], None] = lambda: None, period: float = process.POLL):
        self._node, self._publishers = node, publishers
        self._motor_commanded, self._meanwhile, self._prepare, self._period = False, meanwhile, prepare, period
        self._timeline = timeline(node)

    def run(self, schedule: Schedule, patience: float, stop: StopRequest) -> int:
        """Wait for a robot, up to `patience` [s], or for ever if 0; then play the schedule.

        Return 0 at the end, and 128 + the signal's number if a signal aborted it, and the motor was stopped.
        RuntimeError without a robot, or when `prepare` raises it; and, after the motor was stopped, when the robot goes
        away or time jumps back.
        """
        if self._publishers:
            wait_for_listeners(self._node, [*self._publishers.values()], patience, stop)
        if not stop:
            self._prepare()
        stop.hold()  # the motor must be told to stop
        done = False
        try:
            self._timeline.begin()
            for instant, act in schedule:
                self._wait_until(instant, stop)
                if stop:
                    break
                act()
            done = True
        finally:
            if self._motor_commanded and (stop or not done):  # an operator who aborts wants the motor to stop
                self.send(MOTOR, 0.0)
                self._node.get_logger().info(f"aborted: {self._publishers[MOTOR].topic_name} 0 rad/s")
            deadline = time.monotonic() + ACKNOWLEDGE_TIMEOUT  # messages not yet received are lost with their publisher
            for publisher in self._publishers.values():
                publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))
        return stop.exit_code

    def send(self, name: str, value: float) -> None:
        """Publish the value of a command."""
        self._publishers[name].publish(Float64(data=value))
        self._motor_commanded |= name == MOTOR

    def _wait_until(self, instant: float, stop: StopRequest) -> None:
        """Return at `instant` or on `stop`; `meanwhile` gets no later time, so that its time never goes back."""
        while not stop and (elapsed := self._timeline.elapsed()) < instant - ROUNDING:
            self._meanwhile(elapsed)
            process.spin_once(self._node, self._timeline.longest_wait(instant - elapsed, self._period))
            if gone := topics_without_subscribers([*self._publishers.values()]):
                raise RuntimeError(f"the robot is gone: nobody listens to {', '.join(gone)} any more")


def topics_without_subscribers(publishers: Sequence[Publisher]) -> list[str]:
    """Return the topics of `publishers` without a subscriber."""
    return [publisher.topic_name for publisher in publishers if publisher.get_subscription_count() == 0]


def wait_for_listeners(node: GuardedNode, publishers: Sequence[Publisher], patience: float, stop: StopRequest) -> None:
    """Return when every one of `publishers` has a subscriber, or on `stop`.

    A robot subscribes only when it is ready to obey, because commands sent while it starts would be applied in a
    burst. RuntimeError after `patience` [s]; 0 waits for ever, with a log line every `REPORT_PERIOD`.
    """
    begun, log = time.monotonic(), node.get_logger()
    limit = f"up to {patience:g} s " if patience else ""
    log.info(f"waiting {limit}for a robot on {', '.join(publisher.topic_name for publisher in publishers)}")
    due = REPORT_PERIOD

    def over() -> bool:
        nonlocal due
        topics, waited = topics_without_subscribers(publishers), time.monotonic() - begun
        if topics and not stop and waited >= due:
            due += REPORT_PERIOD
            log.info(f"waiting for {waited:.0f} s: nobody listens to {', '.join(topics)}; {_remedy(node)}")
        return bool(stop or not topics or (patience and waited > patience))

    process.spin_until(node, over)
    if (topics := topics_without_subscribers(publishers)) and not stop:
        raise RuntimeError(f"no robot listens to {', '.join(topics)} after {patience:g} s; {_remedy(node)}")


def _remedy(node: Node) -> str:
    """Return a remedy for the user; a robot that is there without subscribing is starting, or has other topics."""
    robots = sorted(f"{space.rstrip('/')}/{name}" for name, space in node.get_node_names_and_namespaces()
                    if name == NODE_NAME)  # unless it is remapped
    if robots:
        return (f"{', '.join(robots)} is there and does not: it is starting, or has another namespace or other "
                "topics")
    return "start one (ros2 run vibro_ros robot), in the same ROS domain and namespace"


class ScriptSchedule:
    """Schedule of a script: passes each command to `send` when its value changes.

    `reach` is the largest mean speed [m/s] that the robot holds, with the sign of its direction. `say` is called with
    each entry and its outcome in words.
    """

    def __init__(self, script: Script, reach: float, odometer: OdometrySubscription | None,
                 send: Callable[[str, float], None], say: Callable[[str], object], robot: CommandedRobot,
                 faults: FaultService | None = None):
        self._script, self._reach, self._odometer = script, reach, odometer
        self._send, self._say, self._robot, self._faults = send, say, robot, faults
        self._sent = dict[str, float]()
        self._segment: Segment | None = None
        self._time_saved = 0.0

    def instants(self, rate: float) -> Schedule:
        """Yield each instant at which to send, with its action: `rate` [Hz] times a second along ramps, and at the end.

        If a position is reached before its longest time, all that follows comes earlier by the time saved.
        """
        for segment in self._script.segments:
            for instant in merge(segment.instants(rate), self._repetitions(segment)):
                yield instant - self._time_saved, partial(self._send_changes, instant)
            if segment.goal:
                yield from self._goal_instants(segment)
        end = self._script.duration
        yield end - self._time_saved, partial(self._send_changes, end)

    def _repetitions(self, segment: Segment) -> Iterator[float]:
        """Yield the instants [s] at which to repeat the motor's command, for a robot with a `command.timeout`."""
        if self._robot.timeout and MOTOR in segment.ramps:
            period = self._robot.timeout / REPETITIONS
            for step in count(1):
                if (instant := segment.start + step * period) >= segment.end:
                    return
                yield instant

    def _send_changes(self, instant: float) -> None:
        """Send the changes at an `instant` [s] of the script, as if every goal took its longest time."""
        segment = self._script.segment_at(instant)
        if segment and segment is not self._segment:
            self._segment = segment
            self._say(segment.describe())
            for name in segment.given:  # sent again: another program may have sent commands meanwhile
                self._sent.pop(name, None)
            if segment.incident and self._faults:
                self._faults.begin(segment.entry, segment.incident)
        for name, value in self._script.command_at(instant).items():
            self._send_change(name, value)

    def _send_change(self, name: str, value: float) -> None:
        if self._sent.get(name) != value or (name == MOTOR and self._robot.timeout):
            self._send(name, value)
            self._sent[name] = value

    def _goal_instants(self, segment: Segment) -> Schedule:
        """Yield the steps of feedback until the segment's goal is reached, and add up the time that is saved."""
        odometer = self._odometer
        assert segment.goal and odometer
        began = segment.start - self._time_saved
        tracking = GoalTracking(segment.goal, began, segment.duration, self._reach, odometer.mean)
        for step in count():
            instant = began + step / RATE
            yield instant, partial(self._step, odometer, tracking, segment, instant)
            if tracking.over:
                self._time_saved += max(0.0, segment.duration - step / RATE)
                return

    def _step(self, odometer: OdometrySubscription, tracking: GoalTracking, segment: Segment, instant: float) -> None:
        try:
            odometer.read(instant)
            speed = tracking.motor_speed(instant)
        except GoalError as error:
            raise RuntimeError(f"entry {segment.entry}: {error}") from error
        for words in tracking.take_words():
            self._say(f"entry {segment.entry}: {words}")
        if speed is not None:
            self._send_change(MOTOR, speed)
