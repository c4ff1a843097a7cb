"""A peer that commands a robot and hears it: how long a command takes to show in `odom`, and what arrives at all.

The robot runs with an ideal motor and stands still before each command, so that its body sticks to the ground and the
first message that shows another position or velocity is the command's first effect.
"""

import random
import threading
import time
from collections.abc import Sequence
from functools import partial

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64

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


class Listening:
    """What has come to a subscription to a robot's `odom`; for the executor's thread.

    Attributes
    ----------
    heard : int
        Messages.
    first, last : tuple of float and int
        When the first and the last message came: the monotonic clock [s], and the message's stamp [ns].
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
    """How long commands take from their publisher's call to the first message of `odom` that shows them.

    Attributes
    ----------
    delays : list of float
        One [s] for each command.
    """

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

    Parameters
    ----------
    publisher : Publisher
        Of the robot's `motor_speed`.
    effects : Effects
        Hears of each start.
    flood : float
        Rate [Hz] at which the last command is repeated; 0 sends each command once.
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
    """Listens to robots and commands the first of them.

    Parameters
    ----------
    node : Node
        Everything belongs to it.
    namespaces : sequence of str
        Of the robots.
    listeners : int
        Subscriptions to each robot's `odom`.
    """

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
