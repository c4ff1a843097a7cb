"""What a load does to the robot: `python -m tools.load`.

Real robots with their recording, each a process of its own, and a probe in this one: a peer that commands the first
robot and hears all. Each robot runs with an ideal motor and stands still before each command, so that its body sticks
to the ground and the first message that shows another position or velocity is the command's first effect. Rates are
ratios to the rate that was asked for, and delays are counted in publish periods, so that both mean the same on every
machine.
"""

import argparse
import random
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64
from tqdm import tqdm

from tools.child import Child
from vibro_ros.ros.node import qos
from vibro_ros.ros.topics.subscriptions import Gathering

SPEED = 400.0
"""Speed [rad/s] of a command: within one period the crank turns so far that the springs tear the body off."""
PUSH = 0.03
"""Time [s] from such a command to the one that stops the motor."""
CALM = 5
"""Messages with equal position and without velocity after which the body stands still."""
DEPTH = 1000
"""Messages that a subscription keeps: what a loaded machine delays is not to be lost."""


@dataclass(frozen=True)
class Load:
    """What a robot has to bear.

    `robots` are in one graph, each in a namespace of its own; the first one is commanded, the others run at 100 rad/s.
    Each publishes at `rate` [Hz], and so many `listeners` subscribe to the `odom` of each. `flood` is the rate [Hz] at
    which the first robot's last command is repeated; 0: not at all.
    """

    robots: int = 1
    rate: float = 200.0
    listeners: int = 1
    flood: float = 0.0


LOADS = {
    "one listener": Load(),
    "flood": Load(flood=5000.0),
    "listeners": Load(listeners=20),
    "robots": Load(robots=10, rate=50.0),
}
"""Each load by its name; the first one is what the others are compared with."""
CRUISE = 100.0  # rad/s
_POLL = 0.1  # s


@dataclass(frozen=True)
class Outcome:
    """What was seen of a load.

    `rates` are the messages per second that each subscription has heard, as part of the rate asked for; `lost` counts
    those, by the stamps around them, that it has not. `growth` is that of each robot's memory [MB]; `delays` last from
    command to first effect, in publish periods; `flooded` are the commands per second that were sent.
    """

    rates: Sequence[float]
    lost: int
    growth: Sequence[float]
    delays: Sequence[float]
    flooded: float


class Listening:
    """What has come to a subscription to a robot's `odom`; for the executor's thread.

    `first` and `last` are when a message came: the monotonic clock [s], and the message's stamp [ns].
    """

    def __init__(self) -> None:
        self.heard = 0
        self.first = self.last = (0.0, 0)

    def restart(self) -> None:
        """Forget what has come."""
        self.heard = 0

    def hear(self, data: bytes) -> None:
        """Count a message."""
        now = time.monotonic()
        self.last = now, 10**9 * int.from_bytes(data[4:8], "little") + int.from_bytes(data[8:12], "little")
        if not self.heard:
            self.first = self.last
        self.heard += 1


class Effects:
    """How long commands take from their publisher's call to the first message of `odom` that shows them: delays [s]."""

    def __init__(self) -> None:
        self.delays: list[float] = []
        self._sent: float | None = None
        self._pose = (0.0, 0.0)
        self._calm = 0

    @property
    def ready(self) -> bool:
        """Whether the body stands still and no command waits for its effect."""
        return not self.waits and self._calm >= CALM

    @property
    def waits(self) -> bool:
        """Whether a command waits for its effect."""
        return self._sent is not None

    def expect(self, sent: float) -> None:
        """Say when [s] a command is sent; to be called before, while `ready`."""
        self._sent = sent

    def hear(self, data: bytes) -> None:
        """Look whether a message shows an effect."""
        now, message = time.monotonic(), deserialize_message(data, Odometry)
        pose = message.pose.pose.position.x, message.twist.twist.linear.x
        moves = pose != self._pose or pose[1] != 0.0
        if moves and self._sent is not None:
            self.delays.append(now - self._sent)
            self._sent = None
        self._calm = 0 if moves else self._calm + 1
        self._pose = pose


class Commanding:
    """A thread that starts and stops a motor at random instants, and repeats its last command at a rate; a context.

    `effects` hears of each start; `flood` is the rate [Hz], where 0 sends each command once.
    """

    def __init__(self, publisher: Publisher, effects: Effects, flood: float):
        self._publisher, self._effects, self._flood = publisher, effects, flood
        self.sent = 0
        self._over = False
        self._chance = random.Random(1)
        self._thread = threading.Thread(target=self._run, name="commanding")

    def __enter__(self) -> "Commanding":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over = True
        self._thread.join()

    def _run(self) -> None:
        while not self._over:
            self._keep(0.0, self._chance.uniform(0.1, 0.2))
            if self._effects.ready:
                self._effects.expect(time.monotonic())
                self._keep(SPEED, PUSH)
                while self._effects.waits and not self._over:
                    self._keep(SPEED, PUSH)

    def _keep(self, speed: float, duration: float) -> None:
        """Command a speed [rad/s], and let nothing else be sent for `duration` [s]."""
        message, begun, sent = serialize_message(Float64(data=speed)), time.monotonic(), 0
        while (passed := time.monotonic() - begun) < duration and not self._over:
            for _ in range(sent, max(1, int(passed * self._flood))):
                self._publisher.publish(message)
                sent += 1
            time.sleep(min(duration - passed, 1.0 / self._flood if self._flood else 0.05))
        self.sent += sent


class Probe:
    """Listens to robots, by so many subscriptions to the `odom` of each, and commands the first of them."""

    def __init__(self, node: Node, namespaces: Sequence[str], listeners: int):
        self.effects = Effects()
        self.listening = [Listening() for _ in range(len(namespaces) * listeners)]
        self.publishers = [node.create_publisher(Float64, f"{space}/motor_speed", qos.COMMANDS) for space in namespaces]
        spaces = [namespaces[0], *[space for space in namespaces for _ in range(listeners)]]
        self._hearers: list[Effects | Listening] = [self.effects, *self.listening]
        gathering = Gathering(self._hear)  # else the executor's turns would delay what is measured
        gathering.subscriptions = {
            number: node.create_subscription(Odometry, f"{space}/odom", partial(gathering.take, number),
                                             QoSProfile(depth=DEPTH), raw=True)
            for number, space in enumerate(spaces)}

    def _hear(self, number: int, data: bytes) -> None:
        self._hearers[number].hear(data)

    @property
    def connected(self) -> bool:
        """Whether every robot hears the probe and is heard by all of its subscriptions."""
        return (all(publisher.get_subscription_count() for publisher in self.publishers)
                and all(one.heard for one in self.listening))


def measure(load: Load, settling: float, duration: float) -> Outcome:
    """Start the robots, wait until their memory has settled [s], and watch them for a duration [s]."""
    spaces = [f"/r{number}" for number in range(load.robots)]
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        robots = []
        for space in spaces:
            robots.append(stack.enter_context(Child(*_words(space, load.rate, folder), shown=False)))
            robots[-1].wait_for("ready")
        node = Node("load")
        stack.callback(node.destroy_node)
        executor = SingleThreadedExecutor()
        stack.callback(executor.shutdown)
        executor.add_node(node)
        return _watch(load, Probe(node, spaces, load.listeners), executor, robots, (settling, duration))


def _watch(load: Load, probe: Probe, executor: SingleThreadedExecutor, robots: Sequence[Child],
           times: tuple[float, float]) -> Outcome:
    settling, duration = times
    while not probe.connected:
        executor.spin_once(timeout_sec=_POLL)
    for publisher in probe.publishers[1:]:
        publisher.publish(Float64(data=CRUISE))
    with Commanding(probe.publishers[0], probe.effects, load.flood) as commanding:
        _spin(executor, settling)
        memory, sent, subscriptions = [robot.memory for robot in robots], commanding.sent, probe.listening
        for one in subscriptions:
            one.restart()
        probe.effects.delays.clear()
        _spin(executor, duration)
        growth = [robot.memory - before for robot, before in zip(robots, memory, strict=True)]
        sent = commanding.sent - sent
    return Outcome([rate_of(one) / load.rate for one in subscriptions],
                   sum(lost_by(one, load.rate) for one in subscriptions), growth,
                   [delay * load.rate for delay in probe.effects.delays], sent / duration)


def rate_of(one: Listening) -> float:
    """Messages per second [Hz] that a subscription has heard."""
    return (one.heard - 1) / (one.last[0] - one.first[0])


def lost_by(one: Listening, rate: float) -> int:
    """Messages that a subscription has not heard of those between its first and its last, stamped at `rate` [Hz]."""
    return round((one.last[1] - one.first[1]) * 1e-9 * rate) + 1 - one.heard


def _spin(executor: SingleThreadedExecutor, duration: float) -> None:
    until = time.monotonic() + duration
    while time.monotonic() < until:
        executor.spin_once(timeout_sec=_POLL)


def _words(space: str, rate: float, folder: str) -> list[str]:
    """The command of a robot."""
    settings = {"record.directory": f"'{folder}'", "rate.publish": rate, "effects.motor": "ideal"}
    return ["vibro_ros.ros.robot.robot", "--ros-args", "-r", f"__ns:={space}",
            *(word for name, value in settings.items() for word in ("-p", f"{name}:={value}"))]


def table(found: Mapping[str, Outcome]) -> str:
    """The worst of each as Markdown."""
    rows = ["| load | rate asked for = 1 | messages lost | memory growth | commands | from command to effect, p50 | "
            "p99 | longest | commands watched |", "|---" * 9 + "|"]
    for name, one in found.items():
        worst = max(one.rates, key=lambda rate: abs(rate - 1.0))
        p50, p99, longest = np.quantile(one.delays, (0.5, 0.99, 1.0))
        rows.append(f"| {name} | {worst:.4f} | {one.lost} | {max(one.growth):.2f} MB | {one.flooded:.0f}/s | "
                    f"{p50:.2f} periods | {p99:.2f} | {longest:.2f} | {len(one.delays)} |")
    return "\n".join(rows)


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("loads", nargs="*", choices=[[], *LOADS], metavar="LOAD", help=f"of {', '.join(LOADS)}")
    parser.add_argument("--duration", type=float, default=60.0, help="of each measurement [s] (default %(default)g)")
    parser.add_argument("--settling", type=float, default=10.0,
                        help="until a robot's memory holds all that it needs [s] (default %(default)g)")
    options = parser.parse_args(words)
    rclpy.init(args=[])
    found = {}
    for name in tqdm(options.loads or LOADS, unit="load", disable=None):
        found[name] = measure(LOADS[name], options.settling, options.duration)
    print(table(found))
    rclpy.try_shutdown()
    return 0



if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
