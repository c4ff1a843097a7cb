"""Waiting for ROS time to begin, where `use_sim_time` leaves it to a peer."""

import time
from collections.abc import Callable

from rclpy.executors import Executor
from rclpy.node import Node

from vibro_ros.ros.node.process import spin_until

CLOCK = "/clock"
REMINDER = 2.0
"""Time [s] between two lines that say what is waited for."""


def wait_for_time(node: Node, executor: Executor, stopped: Callable[[], bool]) -> None:
    """Return once `node` has ROS time, or when `stopped`; say what is waited for.

    Without `use_sim_time` that is at once. With it time begins when a message on /clock says one above 0, which
    stands for "not set" in ROS. A signal that raises ends the wait, too.
    """
    clock, began = node.get_clock(), time.monotonic()

    def over() -> bool:
        return stopped() or not clock.ros_time_is_active or clock.now().nanoseconds > 0

    while not over():
        waited = time.monotonic() - began
        node.get_logger().info(_awaited(node, waited))
        due = began + waited + REMINDER
        spin_until(executor, lambda: over() or time.monotonic() > due)  # noqa: B023 (called within this turn)


def _awaited(node: Node, waited: float) -> str:
    topic = node.resolve_topic_name(CLOCK)
    lack = "its time is 0 so far" if node.count_publishers(topic) else "nobody publishes it"
    return (f"use_sim_time: waiting for the first time on {topic} ({waited:.0f} s; {lack}); start a simulator that "
            "publishes it, or start this node without use_sim_time")
