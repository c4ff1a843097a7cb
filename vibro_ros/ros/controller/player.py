"""Playing messages to a robot in time: waiting for it, keeping time, and telling the motor to stop on an abort."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence

from rclpy.duration import Duration
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64

from vibro_ros.process.stop_signals import StopRequest
from vibro_ros.ros.controller.timeline import Timeline, WallTime
from vibro_ros.ros.node import process
from vibro_ros.ros.node.listeners import deaf, wait_for_listeners

LAST_WORD = 0.5
"""Longest wait [s] for the robot to acknowledge the last message; Fast DDS asks for that every 3 s only."""

ROUNDING = 5e-10
"""Time [s] by which an instant that was summed in floating point may lie beyond the nanosecond that is meant."""

Moments = Iterable[tuple[float, Callable[[], None]]]
"""Instants [s] from the start, ascending, and what is to be done then; the next is asked for when that is done."""


class Player:
    """Publishes to a robot in time.

    Parameters
    ----------
    node : Node
        Publishes, and logs.
    executor : Executor
        Spun while waiting.
    publishers : mapping of str to Publisher
        By the names that `send` is given.
    needed : sequence of str
        Those of them that a robot must listen to.
    motor : str
        That of the motor's command; empty if there is none.
    meanwhile : callable
        Called with the time [s] since the start while nothing is due, each `period` [s] at least; before each instant
        only with times before it.
    period : float
        Longest wall time [s] between two looks at the time.
    prepare : callable
        Called with the stop request when a robot listens, before time begins to count.
    timeline : Timeline
        The time that instants count in. Whatever is due is done after the callback that brings the time, before the
        executor runs another: a simulator that waits for this node's answer in lock-step relies on it.
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
            done = self._play(moments, stop)
        finally:
            if stop or not done:
                self._stop_motor()
            self._finish()
        return stop.exit_code

    def send(self, name: str, message: object) -> None:
        """Publish a message, or its serialised bytes."""
        self._publishers[name].publish(message)
        self._moved |= name == self._motor

    def _play(self, moments: Moments, stop: StopRequest) -> bool:
        """Do everything at its time; whether it was all done before a `stop`."""
        self._timeline.begin()
        for instant, act in moments:
            self._wait_until(instant, stop)
            if stop:
                return False
            act()
        return True

    def _wait_until(self, instant: float, stop: StopRequest) -> None:
        """Return at `instant` or on `stop`; `meanwhile` is told of no time beyond it, so that time never goes back."""
        while not stop and (elapsed := self._timeline.elapsed()) < instant - ROUNDING:
            self._meanwhile(elapsed)
            self._executor.spin_once(timeout_sec=self._timeline.longest_wait(instant - elapsed, self._period))
            if gone := deaf(self._needed):
                raise RuntimeError(f"the robot is gone: nobody listens to {', '.join(gone)} any more")

    def _stop_motor(self) -> None:
        """Command motor speed 0 if the motor was commanded: what an operator means who aborts."""
        if self._moved:
            self.send(self._motor, Float64(data=0.0))
            self._node.get_logger().info(f"aborted: {self._motor} 0 rad/s")

    def _finish(self) -> None:
        """Give the last messages `LAST_WORD` to arrive: a publisher that goes takes undelivered ones with it."""
        deadline = time.monotonic() + LAST_WORD
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))
