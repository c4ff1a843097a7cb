"""How a node's process gets its node, and how its loop runs.

SIGINT, SIGTERM and SIGHUP are taken by `front_door` instead of by rclpy: rclpy's handlers shut the context down under
the threads that still publish, and a wait without end may then never return. A signal is a request that the loop polls,
so that it can say a last word (seal the bag, stop the motor) while ROS is still up.
"""

import os
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Thread
from warnings import catch_warnings, simplefilter

import rclpy
from rclpy.exceptions import InvalidNamespaceException, InvalidNodeNameException
from rclpy.executors import Executor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.signals import SignalHandlerOptions

from vibro_ros.ros.node.executor import SteadyExecutor
from vibro_ros.ros.node.node import SteadyNode

SECURE = "ROS 2 from apt has them, its wheels from PyPI do not; without them, unset ROS_SECURITY_ENABLE"
"""What a user can do where ROS is to be secured and cannot."""
POLL = 0.05
"""Longest wait [s] of the executor before the loop looks whether it should end."""


@contextmanager
def node_running(name: str, words: Sequence[str]) -> Iterator[tuple[SteadyNode, Executor]]:
    """A node and its executor, from `rclpy.init` to the clean end.

    The node takes every parameter override that it is given, so that misspelt ones can be found. Neither of the two
    ends by what peers send.

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
            node = SteadyNode(name)
    except (RuntimeError, InvalidNodeNameException, InvalidNamespaceException) as error:
        rclpy.try_shutdown()
        raise ValueError(f"ROS refuses the arguments: {_first_sentence(error)}") from error
    finally:
        set_logger_level("rcl", LoggingSeverity.UNSET)
    if fault:
        node.get_logger().warning(f"ROS writes no log file: {fault}; set ROS_LOG_DIR to a folder that can be written")
    executor = SteadyExecutor(node.refusals)
    executor.add_node(node)
    try:
        with _woken_by_signals(executor):
            yield node, executor
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


@contextmanager
def _woken_by_signals(executor: Executor) -> Iterator[None]:
    """Let every signal end the executor's wait: only then does Python run what the signal is to do.

    A loop need not look often whether a signal came. Each look costs half a millisecond, because rclpy collects anew
    all that it waits for.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    thread = Thread(target=_wake_for_signals, args=(executor, reading), name="signals")
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(writing)  # which ends the thread
        thread.join()
        os.close(reading)


def _wake_for_signals(executor: Executor, reading: int) -> None:
    while os.read(reading, 1):
        executor.create_task(lambda: None)


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


def spin_until(executor: Executor, done: Callable[[], bool], poll: float = POLL) -> None:
    """Run callbacks until `done`, which is looked at after each one and each signal, and at least every `poll` [s]."""
    while not done():
        executor.spin_once(timeout_sec=poll)


def _first_sentence(error: Exception) -> str:
    """The part of an rcl message that a user can act on: without the places in rcl's source."""
    text = str(error).removeprefix("failed to initialize rcl: ")
    sentence = text.split(", at /")[0].splitlines()[0]
    return f"{sentence}; {SECURE}" if "security libraries" in sentence else sentence
