"""Playing messages to a robot in time: waiting for it, keeping time, and stopping the motor on an abort."""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence

from rclpy.duration import Duration
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64

from vibro_ros.configuration.scene_file import NODE_NAME
from vibro_ros.process.entry_point import StopRequest
from vibro_ros.ros.node import process
from vibro_ros.ros.node.node import SteadyNode
from vibro_ros.ros.node.process import CLOCK

LAST_WORD = 0.5
"""Longest wait [s] for the robot to acknowledge the last message; Fast DDS asks for that every 3 s only."""
ROUNDING = 5e-10
"""Time [s] by which an instant that was summed in floating point may lie beyond the nanosecond that is meant."""
Moments = Iterable[tuple[float, Callable[[], None]]]
"""Instants [s] from the start, ascending, and what is to be done then; the next is asked for when that is done."""
REPORTS = 10.0
"""Time [s] between two lines that say what is waited for."""
STANDSTILL = 2.0
"""Wall time [s] without progress of ROS time after which the log says so, once a standstill."""


class WallTime:
    """Seconds of the monotonic clock since `begin`."""

    def begin(self) -> None:
        """Make this instant time 0."""
        self._began = time.monotonic()

    def elapsed(self) -> float:
        """Time [s] since `begin`."""
        return time.monotonic() - self._began

    def longest_wait(self, remaining: float, period: float) -> float:
        """Wall time [s], at most `period`, after which to look again when `remaining` [s] are left."""
        return min(remaining, period)


class RosTime:
    """Seconds of ROS time since the time that the node had at `begin`, or since the first one that it hears after it.

    ROS time changes only while the node's executor runs a callback, so who looks after each callback misses none. A
    clock that says 0 has begun. A clock that stands still is a paused simulation.
    """

    def __init__(self, node: SteadyNode):
        self._node = node
        self._first: int | None = None
        self._latest = 0
        self._progress, self._said = time.monotonic(), False

    def begin(self) -> None:
        """Make the present ROS time, or the first that is heard if none was, time 0."""
        self._first, self._latest = None, 0
        self._progress, self._said = time.monotonic(), False
        self.elapsed()

    def elapsed(self) -> float:
        """ROS time [s] since time 0; before all times as long as none was heard.

        A script that began earlier would begin at whatever time of a running simulation comes first, which differs
        from run to run.

        Raises
        ------
        RuntimeError
            When ROS time jumped back.
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
            self._latest, self._progress, self._said = now, time.monotonic(), False
        else:
            self._say_standstill()
        return (now - self._first) / 1e9

    def longest_wait(self, remaining: float, period: float) -> float:
        """`period` [s]: how much wall time `remaining` [s] of ROS time takes is for the clock's publisher to say."""
        return period

    def _say_standstill(self) -> None:
        if self._said or time.monotonic() - self._progress < STANDSTILL:
            return
        self._said = True
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


def timeline(node: SteadyNode) -> Timeline:
    """The time in which `node` plays."""
    return RosTime(node) if node.get_clock().ros_time_is_active else WallTime()


class Player:
    """Publishes to a robot in time.

    Of `publishers`, by the names that `send` is given, a robot must listen to the `needed` ones; `motor` is that of the
    motor's command, empty if there is none. While nothing is due, `meanwhile` is called with the time [s] since the
    start, each `period` [s] of wall time at least; before each instant only with times before it. `prepare` is called
    with the stop request when a robot listens, before time begins to count.

    Whatever is due by `timeline` is done after the callback that brings the time, before the executor runs another: a
    simulator that waits for this node's answer in lock-step relies on it.
    """

    def __init__(self, node: Node, executor: Executor, publishers: Mapping[str, Publisher], needed: Sequence[str],
                 motor: str, meanwhile: Callable[[float], None] = lambda elapsed: None, period: float = process.POLL,
                 prepare: Callable[[StopRequest], None] = lambda stop: None, timeline: Timeline | None = None):
        self._node, self._executor, self._publishers = node, executor, publishers
        self._needed = [publishers[name] for name in needed]
        self._motor, self._moved = motor, False
        self._meanwhile, self._period, self._timeline = meanwhile, period, timeline or WallTime()
        self._prepare = prepare

    def run(self, moments: Moments, patience: float, stop: StopRequest) -> int:
        """Wait for a robot, up to `patience` [s] or, if 0, without end; then play `moments`.

        Returns
        -------
        int
            0 at the end; 128 + the signal's number if it was aborted, and the motor was told to stop.

        Raises
        ------
        RuntimeError
            Without a robot, or as `prepare` raises it; and, with the motor told to stop, when the robot goes away or
            time jumps back.
        """
        if self._needed:
            wait_for_listeners(self._node, self._executor, self._needed, patience, stop)
        self._prepare(stop)
        stop.hold()  # the motor must be told to stop
        done = False
        try:
            self._timeline.begin()
            for instant, act in moments:
                self._wait_until(instant, stop)
                if stop:
                    break
                act()
            done = True
        finally:
            if self._moved and (stop or not done):  # a stopped motor is what an operator means who aborts
                self.send(self._motor, Float64(data=0.0))
                self._node.get_logger().info(f"aborted: {self._publishers[self._motor].topic_name} 0 rad/s")
            deadline = time.monotonic() + LAST_WORD  # a publisher that goes takes undelivered messages with it
            for publisher in self._publishers.values():
                publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))
        return stop.exit_code

    def send(self, name: str, message: object) -> None:
        """Publish a message, or its serialised bytes."""
        self._publishers[name].publish(message)
        self._moved |= name == self._motor

    def _wait_until(self, instant: float, stop: StopRequest) -> None:
        """Return at `instant` or on `stop`; `meanwhile` gets no time beyond it, so that time never goes back."""
        while not stop and (elapsed := self._timeline.elapsed()) < instant - ROUNDING:
            self._meanwhile(elapsed)
            self._executor.spin_once(timeout_sec=self._timeline.longest_wait(instant - elapsed, self._period))
            if gone := deaf(self._needed):
                raise RuntimeError(f"the robot is gone: nobody listens to {', '.join(gone)} any more")

def deaf(publishers: Sequence[Publisher]) -> list[str]:
    """Topics of `publishers` that nobody subscribes to."""
    return [publisher.topic_name for publisher in publishers if publisher.get_subscription_count() == 0]


def wait_for_listeners(node: Node, executor: Executor, publishers: Sequence[Publisher], patience: float,
                       stop: StopRequest) -> None:
    """Return when somebody subscribes to every one of `publishers`, or on `stop`.

    A robot subscribes when it can obey, not before: what is sent to one that compiles would be applied in a burst.
    RuntimeError after `patience` [s]; 0 waits without end, and says every `REPORTS` what for.
    """
    begun, log = time.monotonic(), node.get_logger()
    limit = f"up to {patience:g} s " if patience else ""
    log.info(f"waiting {limit}for a robot on {', '.join(publisher.topic_name for publisher in publishers)}")
    due = REPORTS

    def over() -> bool:
        nonlocal due
        topics, waited = deaf(publishers), time.monotonic() - begun
        if topics and not stop and waited >= due:
            due += REPORTS
            log.info(f"waiting for {waited:.0f} s: nobody listens to {', '.join(topics)}; {_remedy(node)}")
        return bool(stop or not topics or (patience and waited > patience))

    process.spin_until(executor, over)
    if (topics := deaf(publishers)) and not stop:
        raise RuntimeError(f"no robot listens to {', '.join(topics)} after {patience:g} s; {_remedy(node)}")


def _remedy(node: Node) -> str:
    """What a user can do; a robot that is there and does not listen is starting, or is another's."""
    robots = sorted(f"{space.rstrip('/')}/{name}" for name, space in node.get_node_names_and_namespaces()
                    if name == NODE_NAME)  # unless it is remapped
    if robots:
        return (f"{', '.join(robots)} is there and does not: it compiles at its first start, or has another namespace "
                "or other topics")
    return "start one (ros2 run vibro_ros robot), in the same ROS domain and namespace"
