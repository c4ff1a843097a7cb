"""`replay --publish`: plays the commands of a bag, or all of it, on the live graph."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("playback"))

import argparse
import math
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from vibro_ros.bag.stream import BagError, BagStream, not_read, robot_topics
from vibro_ros.messages.codec import check
from vibro_ros.messages.topics import COMMANDS
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import Parser, exit_code
from vibro_ros.process.stop_signals import StopRequest
from vibro_ros.ros.controller.player import Moments, Player
from vibro_ros.ros.node import process
from vibro_ros.ros.node.arguments import check_arguments, own_arguments
from vibro_ros.ros.topics.publishers import message_class

NODE_NAME = "vibro_playback"
CLOCK_PERIOD = 0.01
"""Longest time [s] between two messages on /clock."""


class RecordedMessages:
    """Recorded messages, published byte for byte at `rate` recorded seconds per second, and recorded time on /clock."""

    def __init__(self, stream: BagStream, topics: Sequence[str], rate: float, clock: Publisher | None):
        self.published = 0
        self._stream, self._topics, self._rate, self._clock = stream, topics, rate, clock
        self._seen: Counter[str] = Counter()

    def moments(self, send: Callable[[str, bytes], None]) -> Moments:
        """Yield when each message is due, and what publishes it by `send`."""
        for topic, stamp, data in self._stream.messages(frozenset(self._topics)):
            yield (stamp - self._stream.start) * 1e-9 / self._rate, partial(self._publish, send, topic, stamp, data)

    def publish_clock_after(self, elapsed: float) -> None:
        """Publish recorded time, `elapsed` [s] after the start, if a clock is played."""
        self._publish_clock(self._stream.start + round(elapsed * self._rate * 1e9))

    def _publish(self, send: Callable[[str, bytes], None], topic: str, stamp: int, data: bytes) -> None:
        """Publish one message if it is of its topic's type: what ended one robot may end another."""
        self._publish_clock(stamp)
        try:
            check(data, self._stream.topics[topic].type_name)
        except ValueError as error:
            self._stream.unreadable.add(topic, self._seen[topic], stamp, error)
        else:
            send(topic, bytes(data))
            self.published += 1
        self._seen[topic] += 1

    def _publish_clock(self, stamp: int) -> None:
        if self._clock:
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(stamp, 1_000_000_000)
            self._clock.publish(message)


def main(words: Sequence[str]) -> int:
    """Play a bag, as the command line's `words` say.

    Returns 0 when done; 1 without a robot; 2 for bad input; 128 + the signal's number when aborted.
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
        clock = node.create_publisher(Clock, "/clock", _reliable(10)) if options.clock else None
        messages = RecordedMessages(stream, tuple(topics), options.rate, clock)
        publishers = {topic: node.create_publisher(message_class(one.type_name), topic,
                                                   _reliable(one.qos_depth, one.lasting))
                      for topic, one in topics.items()}
        player = Player(node, executor, publishers, () if options.all_topics else commands,
                        names.get("motor_speed", ""), messages.publish_clock_after,
                        CLOCK_PERIOD if clock else process.POLL)
        node.get_logger().info(f"playing {', '.join(topics)}")
        code = player.run(messages.moments(player.send), options.wait or 0.0, stop)
        for line in not_read(stream.flaws):
            node.get_logger().warning(line)
        node.get_logger().info(f"{'stopped' if code else 'done'}: {messages.published} messages")
    return code


def _reliable(depth: int, lasting: bool = False) -> QoSProfile:
    durability = DurabilityPolicy.TRANSIENT_LOCAL if lasting else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=max(depth, 1), reliability=ReliabilityPolicy.RELIABLE, durability=durability)


def _number(text: str, positive: bool) -> float:
    """A number of at least 0 from the command line, or above 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value < 0.0 or (positive and value == 0.0):
        raise argparse.ArgumentTypeError(f"{text} is no number {'above 0' if positive else 'of at least 0'}; give one")
    return value


def _parser() -> Parser:
    parser = Parser(
        prog="replay --publish",
        description=EXECUTABLES["playback"].does,
        epilog="Exit code 0: played to the end; 1: no robot, or it went away; 2: no bag with commands, or a bad "
        "argument; 129, 130, 143: aborted by SIGHUP, SIGINT or SIGTERM, and the motor told to stop. Topics can be "
        "remapped with --ros-args -r.")
    parser.add_argument("bag", type=Path, metavar="BAG_FOLDER", help="folder of a recording, sealed")
    parser.add_argument("--all-topics", action="store_true",
                        help="play every topic instead of the commands alone, and wait for nobody")
    parser.add_argument("--rate", type=partial(_number, positive=True), default=1.0, metavar="FACTOR",
                        help="recorded seconds per second (default: 1)")
    parser.add_argument("--clock", action="store_true", help="publish recorded time on /clock, at least at 100 Hz")
    parser.add_argument("--wait", type=partial(_number, positive=False), metavar="SECONDS", help="longest time to wait "
                        "until a robot listens to every command (default: 0, which is without end)")
    return parser
