"""A script's entries as moments of a `Player`: commands in time, and feedback on odometry."""

import math
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from itertools import count

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64

from vibro_ros.ros.controller.feedback import RATE, Pursuit
from vibro_ros.ros.controller.goals import GoalError
from vibro_ros.ros.controller.motion_watch import STAY
from vibro_ros.ros.controller.player import Moments
from vibro_ros.ros.controller.script import MOTOR, Script, Segment
from vibro_ros.ros.controller.track import Track

ODOM = "odom"
ODOMETRY_DEPTH = 1000
"""Samples that may wait for the next command: a second's at 1 kHz."""


class Odometer:
    """Hears `odom`, and hands its samples to a track.

    With `use_sim_time` only samples older than ROS time are handed over. In lock-step these are there for certain,
    while of the sample and the clock of one instant either may come first: what is commanded would depend on that.

    Parameters
    ----------
    node : Node
        Listens, from now on.
    """

    def __init__(self, node: Node):
        self.track = Track()
        self._clock = node.get_clock()
        self._waiting: deque[tuple[int, float]] = deque(maxlen=ODOMETRY_DEPTH)
        node.create_subscription(Odometry, ODOM, self._hear, QoSProfile(depth=ODOMETRY_DEPTH))

    def _hear(self, message: Odometry) -> None:
        stamp = message.header.stamp
        self._waiting.append((stamp.sec * 1_000_000_000 + stamp.nanosec, message.pose.pose.position.x))

    def read(self, time: float) -> Track:
        """The track with all samples that count at `time` [s] of the script."""
        limit = self._clock.now().nanoseconds if self._clock.ros_time_is_active else math.inf
        while self._waiting and self._waiting[0][0] < limit:
            self.track.add(*self._waiting.popleft(), time)
        return self.track


class ScriptPlayer:
    """The commands of a script, each sent when its value changes.

    Parameters
    ----------
    script : Script
        What to play.
    reach : float
        Mean speed [m/s] that the robot holds at most; its sign is that of the way it goes.
    odometer : Odometer or None
        For the goals of the script, if it has any.
    send : callable
        Publishes a message under a command's name.
    say : callable
        Is told what comes, and what came of it.
    advise : callable
        Is told, before they are sent, the number of the entry, all commands that stand then, and those that stand
        `STAY` later; NaN for a motor speed that feedback has given.
    """

    def __init__(self, script: Script, reach: float, odometer: Odometer | None,
                 send: Callable[[str, Float64], None], say: Callable[[str], object],
                 advise: Callable[[str, Mapping[str, float], Mapping[str, float]], object]):
        self._script, self._reach, self._odometer = script, reach, odometer
        self._send, self._say, self._advise = send, say, advise
        self._sent: dict[str, float] = {}
        self._segment: Segment | None = None
        self._saved = 0.0

    def moments(self, rate: float) -> Moments:
        """Yield when to send, and what sends then: `rate` [Hz] times a second along ramps, and at the script's end.

        What follows a position that was reached sooner than it might have been comes so much sooner.
        """
        for segment in self._script.segments:
            for instant in segment.instants(rate):
                yield instant - self._saved, partial(self._send_changes, instant)
            if segment.goal:
                yield from self._pursue(segment)
        end = self._script.duration
        yield end - self._saved, partial(self._send_changes, end)

    def _send_changes(self, instant: float) -> None:
        """Send what changes at an `instant` [s] of the script, counted as if nothing had been saved."""
        segment = self._script.segment_at(instant)
        if segment and segment is not self._segment:
            self._begin(segment)
        commands = self._script.command_at(instant)
        if segment:
            unknown = {MOTOR: math.nan} if self._script.goals else {}
            later = self._script.command_at(instant + STAY)
            self._advise(f"entry {segment.entry}", {**unknown, **commands}, {**unknown, **later})
        for name, value in commands.items():
            self._send_change(name, value)

    def _begin(self, segment: Segment) -> None:
        """Say what comes, and send anew what the entry gives: somebody else may have commanded meanwhile."""
        self._segment = segment
        self._say(segment.describe())
        for name in segment.given:
            self._sent.pop(name, None)

    def _send_change(self, name: str, value: float) -> None:
        if self._sent.get(name) != value:
            self._send(name, Float64(data=value))
            self._sent[name] = value

    def _pursue(self, segment: Segment) -> Moments:
        """Yield the steps of feedback until its goal is reached, and count what time that saves."""
        odometer = self._odometer
        assert segment.goal and odometer
        began = segment.start - self._saved
        pursuit = Pursuit(segment.goal, began, segment.duration, self._reach, odometer.track)
        for step in count():
            instant = began + step / RATE
            yield instant, partial(self._step, odometer, pursuit, segment, instant)
            if pursuit.over:
                self._saved += max(0.0, segment.duration - step / RATE)
                return

    def _step(self, odometer: Odometer, pursuit: Pursuit, segment: Segment, instant: float) -> None:
        try:
            odometer.read(instant)
            speed = pursuit.motor_speed(instant)
        except GoalError as error:
            raise RuntimeError(f"entry {segment.entry}: {error}") from error
        for words in pursuit.take_words():
            self._say(f"entry {segment.entry}: {words}")
        if speed is not None:
            self._send_change(MOTOR, speed)
