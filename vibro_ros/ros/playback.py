"""`replay --publish`: plays the commands of a bag, or all of it, on the live graph."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.front_door import enter

    sys.exit(enter("playback"))

import argparse
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path

from rclpy.duration import Duration
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64

from vibro_ros.bag.cdr import check
from vibro_ros.bag.robot_topics import COMMANDS, robot_topics
from vibro_ros.bag.stream import BagError, BagStream, RecordedTopic
from vibro_ros.bag.unreadable import not_read
from vibro_ros.command_line import Parser
from vibro_ros.front_door import exit_code
from vibro_ros.ros import process
from vibro_ros.ros.listeners import wait_for_listeners
from vibro_ros.ros.ros_arguments import check_arguments, own_arguments
from vibro_ros.stop_signals import StopRequest

NODE_NAME = "vibro_playback"
CLOCK_PERIOD = 0.01
"""Longest time [s] between two messages on /clock."""
PATIENCE = 60.0
"""How long [s] to wait for a robot, unless the command line says."""
LAST_WORD = 0.5
"""Longest wait [s] for the acknowledgement of the last message."""


class Playback:
    """Publishes recorded messages, byte for byte, at the instants of their recorded stamps.

    Parameters
    ----------
    node : Node
        Publishes under the recorded names (which can be remapped).
    executor : Executor
        Spun while waiting.
    topics : mapping of str to RecordedTopic
        What to publish.
    motor : str
        Full name of the motor's command, or nothing.
    clock : bool
        Whether to publish recorded time on /clock.
    """

    def __init__(self, node: Node, executor: Executor, topics: Mapping[str, RecordedTopic], motor: str, clock: bool):
        self.published = 0
        self._node, self._executor, self._motor, self._moved = node, executor, motor, False
        self._publishers: dict[str, Publisher] = {
            topic: node.create_publisher(_message_class(one.type_name), topic, _reliable(one.qos_depth))
            for topic, one in topics.items()}
        self._clock = node.create_publisher(Clock, "/clock", _reliable(10)) if clock else None
        self._log = node.get_logger()

    def wait_for_robot(self, topics: Sequence[str], patience: float, stop: StopRequest) -> None:
        """Return when somebody subscribes to each of `topics`, or on `stop`; see `wait_for_listeners`."""
        wait_for_listeners(self._node, self._executor, [self._publishers[topic] for topic in topics], patience, stop)

    def play(self, stream: BagStream, rate: float, stop: StopRequest) -> None:
        """Publish every message that is one of its topic's type, `rate` times as fast as it was recorded.

        Returns at the end or on `stop`.
        """
        seen: Counter[str] = Counter()
        began = time.monotonic()
        for topic, stamp, data in stream.messages(frozenset(self._publishers)):
            due = (stamp - stream.start) * 1e-9 / rate
            self._wait_until(began, due, lambda elapsed: stream.start + round(elapsed * rate * 1e9), stop)
            if stop:
                return
            self._publish_clock(stamp)
            try:
                check(data, stream.topics[topic].type_name)
            except ValueError as error:  # what ended one robot may end another
                stream.unreadable.add(topic, seen[topic], stamp, error)
            else:
                self._publishers[topic].publish(bytes(data))
                self._moved |= topic == self._motor
                self.published += 1
            seen[topic] += 1

    def stop_motor(self) -> None:
        """Command motor speed 0 if the bag drives the motor: what an operator means who aborts."""
        if self._moved:
            self._publishers[self._motor].publish(Float64(data=0.0))
            self._log.info(f"aborted: {self._motor} 0 rad/s")

    def finish(self) -> None:
        """Give the last messages `LAST_WORD` to arrive: a publisher that goes takes undelivered ones with it."""
        deadline = time.monotonic() + LAST_WORD
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))

    def _wait_until(self, began: float, due: float, stamp_after: Callable[[float], int],
                    stop: StopRequest) -> None:
        """Wait until `due` [s] after `began`, with the clock going on."""
        longest = CLOCK_PERIOD if self._clock else process.POLL
        while not stop and (ahead := began + due - time.monotonic()) > 0.0:
            self._publish_clock(stamp_after(time.monotonic() - began))
            self._executor.spin_once(timeout_sec=min(ahead, longest))

    def _publish_clock(self, stamp: int) -> None:
        if self._clock:
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(stamp, 1_000_000_000)
            self._clock.publish(message)


def main(words: Sequence[str]) -> int:
    """Play a bag.

    Parameters
    ----------
    words : sequence of str
        The command line.

    Returns
    -------
    int
        0 when done; 1 without a robot; 2 for bad input; 128 + the signal's number when aborted.
    """
    return exit_code("replay", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(own_arguments(words))
    if options.all_topics and options.wait is not None:
        raise ValueError(f"--wait {options.wait:g}: --all-topics waits for nobody; leave one of the two out")
    check_arguments(words)
    try:
        with BagStream(options.bag) as stream:
            return _play(stream, options, words)
    except BagError as error:
        raise ValueError(str(error)) from error


def _play(stream: BagStream, options: argparse.Namespace, words: Sequence[str]) -> int:
    names = robot_topics(stream)
    commands = [names[name] for name in COMMANDS if name in names
                and names[name] in stream.topics and stream.topics[names[name]].messages]
    topics = stream.topics if options.all_topics else {topic: stream.topics[topic] for topic in commands}
    if not topics:
        raise BagError(f"{stream.folder}: holds no commands; --all-topics plays the rest")
    with StopRequest() as stop, process.node_running(NODE_NAME, words) as (node, executor):
        playback = Playback(node, executor, topics, names.get("motor_speed", ""), options.clock)
        if not options.all_topics:
            playback.wait_for_robot(commands, options.wait or 0.0, stop)
        stop.hold()  # the motor must be told to stop
        node.get_logger().info(f"playing {', '.join(topics)}")
        try:
            playback.play(stream, options.rate, stop)
        finally:
            if stop:
                playback.stop_motor()
            playback.finish()
        for line in not_read(stream.flaws):
            node.get_logger().warning(line)
        node.get_logger().info(f"{'stopped' if stop else 'done'}: {playback.published} messages")
    return 128 + stop.signal if stop else 0


def _message_class(type_name: str) -> type:
    package, _, name = type_name.partition("/msg/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError, ValueError):  # ValueError: a name that is none
        raise ValueError(f"{type_name}: no such message here; install the ROS package {package}") from None


def _reliable(depth: int) -> QoSProfile:
    return QoSProfile(depth=max(depth, 1), reliability=ReliabilityPolicy.RELIABLE)


def _positive(text: str) -> float:
    value = _number(text, "above 0")
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return value


def _not_negative(text: str) -> float:
    value = _number(text, "of at least 0")
    if value < 0.0:
        raise argparse.ArgumentTypeError(f"{text} is below 0; give a number of at least 0")
    return value


def _number(text: str, wanted: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not a number; give one {wanted}")
    return value


def _parser() -> Parser:
    parser = Parser(
        prog="replay --publish",
        description="Play a bag's commands to a live robot, at the instants at which the recorded one took them.",
        epilog="Exit code 0: played to the end; 1: no robot; 2: no bag with commands, or a bad argument; 129, 130, "
        "143: aborted by SIGHUP, SIGINT or SIGTERM, and the motor told to stop. Topics can be remapped with --ros-args "
        "-r.")
    parser.add_argument("bag", type=Path, metavar="BAG_FOLDER", help="folder of a recording, sealed")
    parser.add_argument("--all-topics", action="store_true",
                        help="play every topic instead of the commands alone, and wait for nobody")
    parser.add_argument("--rate", type=_positive, default=1.0, metavar="FACTOR",
                        help="recorded seconds per second (default: 1)")
    parser.add_argument("--clock", action="store_true", help="publish recorded time on /clock, at least at 100 Hz")
    parser.add_argument("--wait", type=_not_negative, metavar="SECONDS", help="longest time to wait "
                        "until a robot listens to every command (default: 0, which is without end)")
    return parser
