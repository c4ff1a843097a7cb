"""The time in which a script is played: the wall clock's or, with `use_sim_time`, that of /clock."""

import math
import time

from vibro_ros.ros.node.node import SteadyNode
from vibro_ros.ros.node.ros_time import CLOCK

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

    Parameters
    ----------
    node : SteadyNode
        With `use_sim_time`.
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
                f"{self._topic()} jumped back from {_seconds(self._latest)} to {_seconds(now)} s: a reset simulation, "
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
            text = f"ROS time stands still at {_seconds(self._latest)} s: the simulation is paused, or gone"
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


def _seconds(nanoseconds: int) -> str:
    return f"{nanoseconds / 1e9:.9g}"
