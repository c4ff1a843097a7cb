"""How a node's process gets its node, how its loop runs, and how it waits for simulated time.

SIGINT, SIGTERM and SIGHUP are taken by `entry_point` instead of by rclpy: rclpy's handlers shut the context down under
the threads that still publish, and a wait without end may then never return. A signal is a request that the loop polls,
so that it can say a last word (seal the bag, stop the motor) while ROS is still up.
"""

import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from warnings import catch_warnings, simplefilter

import rclpy
from rclpy.exceptions import InvalidNamespaceException, InvalidNodeNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.signals import SignalHandlerOptions

from vibro_ros.ros.node.node import GuardedNode

REMEDIES = {
    "security libraries": "ROS 2 from apt has them, its wheels from PyPI do not; without them, unset "
                          "ROS_SECURITY_ENABLE",
    "parameter override": "write name:=value, such as motor.speed:=100.0",
    "remap": "write old:=new, such as odom:=/lab/odom or __ns:=/r1; names are of letters, digits and _, not beginning "
             "with a digit",
    "namespace": "give one such as /r1, of letters, digits and _, no part beginning with a digit",
}
"""What a user can do, by words of rcl's refusal."""
POLL = 0.05
"""Longest wait [s] of the executor before the loop looks whether it should end."""
CLOCK = "/clock"
REMINDER = 2.0
"""Time [s] between two lines that say what is waited for."""


@contextmanager
def node_running(name: str, words: Sequence[str]) -> Iterator[GuardedNode]:
    """A node with an executor, from `rclpy.init` to the clean end.

    The node takes every parameter override that it is given, so that misspelt ones can be found.

    Raises
    ------
    ValueError
        For ROS arguments, a node name or a namespace that ROS refuses.
    """
    set_logger_level("rcl", LoggingSeverity.FATAL)  # else rcl says first, in other words, what the error says
    fault = _log_folder_fault()
    no_file = ("--ros-args", "--disable-external-lib-logs", "--") if fault else ()
    try:
        rclpy.init(args=[*no_file, *words], signal_handler_options=SignalHandlerOptions.NO)
        with catch_warnings():
            simplefilter("ignore", RuntimeWarning)  # of rclpy about a node that it refuses
            node = GuardedNode(name)
    except Exception as error:
        rclpy.try_shutdown()
        if not isinstance(error, RuntimeError | InvalidNodeNameException | InvalidNamespaceException):
            raise
        text = str(error).removeprefix("failed to initialize rcl: ")
        sentence = text.split(", at /")[0].split(". Error: ")[0].splitlines()[0]  # without the places in rcl's source
        said = "; ".join([sentence, *(remedy for about, remedy in REMEDIES.items() if about in sentence)])
        raise ValueError(f"ROS refuses the arguments: {said}") from error
    finally:
        set_logger_level("rcl", LoggingSeverity.UNSET)
    if fault:
        node.get_logger().warning(f"ROS writes no log file: {fault}; set ROS_LOG_DIR to a folder that can be written")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        yield node
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def spin_once(node: GuardedNode, timeout: float) -> None:
    """Wait up to `timeout` [s] for one callback, and run it; what it raises is counted and said."""
    try:
        node.executor.spin_once(timeout_sec=timeout)
    except Exception as error:  # of the callback, or of rclpy while it takes a message or a request
        node.refusals.catch("a callback", error)


def spin_until(node: GuardedNode, done: Callable[[], bool], poll: float = POLL) -> None:
    """Run callbacks until `done`, which is looked at after each one, and at least every `poll` [s].

    A signal is noticed at the next look. Each look costs half a millisecond, in which rclpy collects all that it waits
    for.
    """
    while not done():
        spin_once(node, poll)


def wait_for_time(node: GuardedNode, stopped: Callable[[], bool]) -> None:
    """Return once `node` has ROS time, or when `stopped`; say what is waited for.

    Without `use_sim_time` that is at once. With it time begins when a message on /clock says one above 0, which
    stands for "not set" in ROS. A signal that raises ends the wait, too.
    """
    clock, began, topic = node.get_clock(), time.monotonic(), node.resolve_topic_name(CLOCK)

    def over() -> bool:
        return stopped() or not clock.ros_time_is_active or clock.now().nanoseconds > 0

    while not over():
        waited = time.monotonic() - began
        lack = "its time is 0 so far" if node.count_publishers(topic) else "nobody publishes it"
        node.get_logger().info(
            f"use_sim_time: waiting for the first time on {topic} ({waited:.0f} s; {lack}); start a simulator that "
            "publishes it, or start this node without use_sim_time")
        due = began + waited + REMINDER
        spin_until(node, lambda: over() or time.monotonic() > due)  # noqa: B023 (called within this turn)


def _log_folder_fault() -> str:
    """Why ROS cannot write its log file, without which it refuses every node; empty when it can."""
    home = os.environ.get("HOME")
    root = os.environ.get("ROS_HOME") or (home and os.path.join(home, ".ros"))
    folder = os.environ.get("ROS_LOG_DIR") or (root and os.path.join(root, "log"))
    if not folder:
        return "HOME is not set"
    try:
        folder = os.path.expanduser(folder)
        os.makedirs(folder, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        return f"{folder}: {error.strerror}"
    return ""
