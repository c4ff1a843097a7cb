"""ROS time: the computer's clock, or with `use_sim_time` what a peer says on /clock."""

import time
from collections.abc import Callable

from rclpy.executors import Executor
from rclpy.node import Node

from vibro_ros.ros.process import spin_until

CLOCK = "/clock"
REMINDER = 2.0
"""Time [s] between two lines that say what is waited for."""
FRESH = 0.1
"""Longest wait [s] for one more message on /clock; ten of the slowest that simulators publish."""


def ros_time(node: Node, executor: Executor, stopped: Callable[[], bool]) -> int:
    """ROS time now [ns].

    With `use_sim_time` it is that of the latest message on /clock. Until a first one gives a time above 0, which means
    "not set" in ROS, this waits and says so; a signal that raises ends the wait, and so does `stopped`.
    """
    clock = node.get_clock()
    if clock.ros_time_is_active:
        _wait_for_clock(node, executor, stopped)
        heard, deadline = clock.now(), time.monotonic() + FRESH  # what came meanwhile waits to be taken
        spin_until(executor, lambda: stopped() or clock.now() != heard or time.monotonic() > deadline)
    return clock.now().nanoseconds


def _wait_for_clock(node: Node, executor: Executor, stopped: Callable[[], bool]) -> None:
    clock, began = node.get_clock(), time.monotonic()

    def over() -> bool:
        return stopped() or clock.now().nanoseconds > 0

    while not over():
        waited = time.monotonic() - began
        node.get_logger().info(_awaited(node, waited))
        spin_until(executor, lambda until=began + waited + REMINDER: over() or time.monotonic() > until)


def _awaited(node: Node, waited: float) -> str:
    topic = node.resolve_topic_name(CLOCK)
    publishers = node.count_publishers(topic)
    lack = "its time is 0 so far" if publishers else "nobody publishes it"
    return (f"use_sim_time: waiting for the first time on {topic} ({waited:.0f} s; {lack}); start a simulator that "
            "publishes it, or start this node without use_sim_time")
