"""Start and end of a node's process, its loop, and the wait for simulated time.

SIGINT, SIGTERM and SIGHUP are handled by `entry_point`, not by rclpy: rclpy's handlers shut down the context while
threads still publish, and a wait without a timeout may then never return. A signal is a request that the loop polls, so
that the node can still seal the bag and stop the motor while ROS is up; each signal ends the wait of that loop.
"""

import os
import re
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from threading import Thread
from typing import TypeVar
from warnings import catch_warnings, simplefilter

import rclpy
from rclpy.exceptions import InvalidNamespaceException, InvalidNodeNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from vibro_ros.ros.node.arguments import with_user_paths
from vibro_ros.ros.node.node import GuardedNode

Result = TypeVar("Result")

REMEDIES = {
    "of same type": "write every number of a list with a point, such as [1.0, 2.5]",
    "security libraries": "ROS 2 from apt has them, its wheels from PyPI do not; without them, unset "
                          "ROS_SECURITY_ENABLE",
    "parameter override": "write name:=value, such as motor.speed:=100.0",
    "remap": "write old:=new, such as odom:=/lab/odom or __ns:=/r1; names are of letters, digits and _, not beginning "
             "with a digit",
    "namespace": "give one such as /r1, of letters, digits and _, no part beginning with a digit",
}
"""Remedy for the user, by words that occur in rcl's error message; the first that fits is given."""
LAST_DOMAIN = 232  # largest ROS domain: from the next one on, the ports that DDSI-RTPS computes are above 65535
POLL = 0.05  # longest wait [s] of the executor before the loop checks whether it should end
CLOCK = "/clock"
REMINDER = 2.0  # time [s] between two log lines about a wait


@contextmanager
def node_running(name: str, words: Sequence[str]) -> Iterator[GuardedNode]:
    """Context with a node and its executor, from `rclpy.init` to a clean shutdown.

    The node declares every parameter override that it is given, so that misspelt ones can be found. ValueError for ROS
    arguments, a node name, a namespace or an environment that ROS refuses.
    """
    node = _new_node(name, words)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        with _woken_by_signals(node):
            yield node
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


def _new_node(name: str, words: Sequence[str]) -> GuardedNode:
    """Initialise ROS and return the node, whose log gets what the middleware has printed (ValueError if refused)."""
    if fault := _domain_fault():
        raise ValueError(fault)
    log_fault = _log_folder_fault()
    no_log_file = ("--ros-args", "--disable-external-lib-logs", "--") if log_fault else ()
    # The types' code would load ROS's generator with two parsers, of which a node needs nothing: 45 ms and 8 MB. The
    # generator's package goes on without it, as where these parsers are not installed.
    sys.modules.setdefault("rosidl_generator_py.generate_py_impl", None)  # type: ignore[arg-type]  # as Python documents
    refusal = None
    with _captured_output() as printed:
        try:
            set_logger_level("rcl", LoggingSeverity.FATAL)  # else rcl logs the error that is raised here, too
            rclpy.init(args=[*no_log_file, *with_user_paths(words)], signal_handler_options=SignalHandlerOptions.NO)
            with catch_warnings():
                simplefilter("ignore", RuntimeWarning)  # rclpy warns of a node that it refuses
                node = GuardedNode(name)
        except Exception as error:
            rclpy.try_shutdown()
            if not isinstance(error, RuntimeError | InvalidNodeNameException | InvalidNamespaceException):
                raise
            refusal = error
        finally:
            with suppress(RuntimeError):  # where rcutils has no log at all
                set_logger_level("rcl", LoggingSeverity.UNSET)
    if refusal:
        raise ValueError(f"ROS refuses the arguments: {_reason_of(refusal, printed)}") from refusal
    for line in printed:
        node.get_logger().warning(f"the middleware says: {line}")
    if log_fault:
        node.get_logger().warning(f"ROS writes no log file: {log_fault}; set ROS_LOG_DIR to a folder that can be "
                                  "written")
    return node


def waker(node: Node) -> Callable[[], None]:
    """Return a function that ends the executor's wait, from any thread, so that `spin_until` looks again."""
    turn = node.create_guard_condition(lambda: None)

    def wake() -> None:
        if node.context.ok():
            turn.trigger()

    return wake


@contextmanager
def _woken_by_signals(node: GuardedNode) -> Iterator[None]:
    """Context in which a signal ends the executor's wait, because Python handles signals in the main thread alone."""
    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    wake = waker(node)

    def listen() -> None:
        while receiver.recv(1):
            wake()

    thread = Thread(target=listen, name="signals", daemon=True)
    thread.start()
    earlier_descriptor = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(earlier_descriptor)
        sender.shutdown(socket.SHUT_WR)  # ends the thread even if a child process has inherited the socket
        thread.join()
        sender.close()
        receiver.close()


def in_thread(work: Callable[[], Result], ended: Callable[[], object]) -> "Future[Result]":
    """Return the future of a piece of work in a thread of its own: callbacks run and signals are heard meanwhile.

    `ended` is called when the work has ended, such as what `waker` returns: else the loop would notice it only after
    up to `POLL`. The process does not wait for the thread, as it would for one of a ThreadPoolExecutor.
    """
    future: Future[Result] = Future()
    future.add_done_callback(lambda _: ended())

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:  # the main thread raises it
            future.set_exception(error)

    Thread(target=run, name="work", daemon=True).start()
    return future


def spin_once(node: GuardedNode, timeout: float) -> None:
    """Wait up to `timeout` [s] for one callback, and run it; an exception is counted and logged."""
    try:
        node.executor.spin_once(timeout_sec=timeout)
    except Exception as error:  # of the callback, or of rclpy while it takes a message or a request
        node.refusals.catch("a callback", error)


def spin_until(node: GuardedNode, done: Callable[[], bool], poll: float = POLL) -> None:
    """Run callbacks until `done()`, which is called after each one, and at least every `poll` [s].

    A signal is noticed at the next call. Each turn costs half a millisecond, in which rclpy collects all that it waits
    for.
    """
    while not done():
        spin_once(node, poll)


def wait_for_time(node: GuardedNode, stopped: Callable[[], bool]) -> None:
    """Return once `node` has ROS time, or when `stopped()`; the log says what is waited for.

    Without `use_sim_time` this returns at once. With it, time begins with a message on /clock above 0, because 0 means
    "not set" in ROS. A signal that raises an exception ends the wait, too.
    """
    clock, topic, began = node.get_clock(), node.resolve_topic_name(CLOCK), time.monotonic()

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


def _domain_fault() -> str:
    """Return why ROS_DOMAIN_ID lets no node start, in words with the remedy; empty if it does.

    The middleware would print lines of its own about it, and go on without some of its endpoints.
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "").strip()
    if not domain or domain.isdecimal() and int(domain) <= LAST_DOMAIN:
        return ""
    return f"ROS_DOMAIN_ID={domain}: no ROS domain; set it to a whole number from 0 to {LAST_DOMAIN}, or unset it"


@contextmanager
def _captured_output() -> Iterator[list[str]]:
    """Context that captures stdout and stderr; after it the list has the sentences of the C libraries of ROS.

    The libraries write errors in colours, with times and places in their sources, some of them several times. The list
    has each sentence once, without these.
    """
    printed: list[str] = []
    sys.stdout.flush()
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        screens = [os.dup(stream) for stream in (1, 2)]
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
        try:
            yield printed
        finally:
            for stream, screen in zip((1, 2), screens, strict=True):
                os.dup2(screen, stream)
                os.close(screen)
            file.seek(0)
            lines = (_sentence(line) for line in file.read().decode(errors="replace").splitlines())
            printed += dict.fromkeys(filter(None, lines))


def _sentence(line: str) -> str:
    """Return the sentence of a log line of Fast DDS, rmw or rcutils; empty for a line of another form."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", line)
    match = re.match(r"[-0-9:. ]*(?:\[[^]]*\][: ]*)+(.+?)(?: -> Function .*|, at /.*)?$", plain)
    return match[1] if match else ""


def _reason_of(error: Exception, printed: Sequence[str]) -> str:
    """Return rcl's own reason, which stands after "Error:", without the places in its source, and the remedy.

    A reason that counts the tokens of an argument, by rcl's numbers for their kinds, is left out.
    """
    text = re.sub(r",? at /\S+:\d+", "", str(error).removeprefix("failed to initialize rcl: ")).splitlines()[0]
    failure, _, cause = text.partition(". Error: ")
    reason = failure if not cause or "lexeme" in cause or "token" in cause else f"{failure}: {cause}"
    return "; ".join([reason, *printed, *[remedy for about, remedy in REMEDIES.items() if about in reason][:1]])


def _log_folder_fault() -> str:
    """Return why ROS cannot write its log file, without which it refuses every node; empty if it can."""
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
