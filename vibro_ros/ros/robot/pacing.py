"""Simulated time against the wall clock: absolute deadlines, time dropped after a stall, and the times of samples."""

import math
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from vibro_ros.messages.robot_messages import stamp_at
from vibro_ros.simulation.simulator import Simulator

LONGEST_SLEEP = 0.05
"""Longest single sleep [s], so that a stop is noticed however far away the deadline is."""
MOST_LATENESSES = 100_000
"""Latenesses that wait for somebody to take them, the last ones: ten seconds at the highest rate."""
WATCHED = ("motor_speed", "motor_voltage")
"""The commands without which `command.timeout` stops the motor."""
SUMMARY_PERIOD = 60.0
"""Least time [s] between two lines that tell of stalls."""
FASTEST = 1e4
"""Speed of the crank [rad/s] beyond which a stall is its doing: its turns cost more than real time from there on."""
POLICY, PRIORITY = os.SCHED_RR, 1
"""Real time, in turn with others of that kind, and the lowest of its priorities. ros2_control asks for one likewise."""


class Pacing:
    """Holds simulated time to `factor` times the wall clock `now` [s]; 0 never waits.

    Deadlines are absolute, so sleeping too long once does not add up to drift. A lateness of at most `max_catch_up`
    [wall s] is made good by ticks without sleep; after a longer stall the whole lateness is dropped, so that the
    device never bursts. `missed` counts how often the next deadline had passed before anybody waited for it, `stalls`
    how often time was dropped; `dropped` is the simulated time [s] that this cost in all.
    """

    def __init__(
        self,
        factor: float,
        max_catch_up: float,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        self.missed = 0
        self.stalls = 0
        self.dropped = 0.0
        self.factor = factor
        self._max_catch_up = max_catch_up
        self._now = now
        self._sleep = sleep
        self._origin, self._begin = now(), 0.0  # [s] by the wall clock, and the simulated time of that instant
        self._lateness: deque[float] = deque(maxlen=MOST_LATENESSES)

    def start(self, instant: float | None = None) -> None:
        """Let simulated time 0 be an `instant` [s] of the wall clock; now unless given."""
        self._origin, self._begin = self._now() if instant is None else instant, 0.0

    def follow(self, simulated_time: float) -> None:
        """Let `simulated_time` [s] be now, after a pause: time that was not asked for is not late."""
        self._origin, self._begin = self._now(), simulated_time

    def change_factor(self, factor: float, simulated_time: float) -> None:
        """Go on at another factor from `simulated_time` [s], which is now."""
        self.factor = factor
        self.follow(simulated_time)

    def take_lateness(self) -> list[float]:
        """How much too late [wall s] each wait since the last call has ended; for one other thread."""
        taken, self._lateness = self._lateness, deque(maxlen=MOST_LATENESSES)
        return list(taken)

    def wait_until(self, simulated_time: float, stopped: Callable[[], bool] = lambda: False) -> float:
        """Sleep until `simulated_time` [s] is due, or `stopped` says so, which may also change the factor.

        Returns
        -------
        float
            Simulated time [s] dropped because the deadline passed more than `max_catch_up` ago; else 0.
        """
        if self.factor == 0.0:
            self._sleep(0.0)  # lets the executor's thread in
            return 0.0
        self.missed += self._ahead(simulated_time) < 0.0
        while (ahead := self._ahead(simulated_time)) > 0.0:
            self._sleep(min(ahead, LONGEST_SLEEP))
            if ahead > LONGEST_SLEEP and stopped():
                return 0.0
        self._lateness.append(-ahead)
        if -ahead <= self._max_catch_up:
            return 0.0
        self._origin -= ahead
        self.stalls += 1
        self.dropped += -ahead * self.factor
        return -ahead * self.factor

    def _ahead(self, simulated_time: float) -> float:
        """Wall time [s] until `simulated_time` [s] is due."""
        ahead = (simulated_time - self._begin) / self.factor if self.factor else 0.0
        return self._origin + ahead - self._now()


class RobotTime:
    """Times of a run's samples, of which there are `rate` [Hz].

    Robot time is `ticks / rate` [s], never a sum of steps, so it does not drift, and nothing turns it back. The
    device's own time begins at 0 with each reset, so that what follows a reset has the bits of what follows a start.
    `start` is the ROS time [ns] of robot time 0, to be set before the first sample if it is not known earlier; `ticks`
    is the number of the last sample, from 0.
    """

    def __init__(self, rate: float, start: int = 0):
        self.start = start
        self.ticks = 0
        self._rate = rate
        self._origin = 0  # the sample at which the device's time was 0

    @property
    def time(self) -> float:
        """Robot time [s] of the last sample."""
        return self.ticks / self._rate

    @property
    def due(self) -> float:
        """Robot time [s] of the next sample."""
        return (self.ticks + 1) / self._rate

    @property
    def due_of_device(self) -> float:
        """Time [s] of the next sample by the device's clock."""
        return (self.ticks + 1 - self._origin) / self._rate

    @property
    def at_start(self) -> bool:
        """Whether nothing has moved since the start or the last reset: no sample came after its first."""
        return self.ticks <= self._origin

    @property
    def stamp(self) -> int:
        """ROS time [ns] of the last sample."""
        return stamp_at(self.start, self.time)

    def stamp_of(self, time: float) -> int:
        """ROS time [ns] of a `time` [s] of the device's clock."""
        return stamp_at(stamp_at(self.start, self._origin / self._rate), time)

    def restart(self) -> None:
        """Let the device's time be 0 at the next sample."""
        self._origin = self.ticks + 1


class CommandTimeout:
    """When more than `limit` [s] of robot time has passed since the last command of the motor's speed that took effect.

    Robot time, because then a replay finds the same instant, and a pause does not count; the start counts as a command.
    `topics` are the full names of all topics that command it, for the `words` that are said when the motor is stopped,
    `count` times so far.
    """

    def __init__(self, limit: float, topics: Sequence[str]):
        self.count = 0
        names = " or ".join(topics)
        self.words = (f"command.timeout: no command of the motor on {names} for {limit:g} s of robot time; the motor "
                      f"stops. Publish {names} more often, or start the robot with a longer command.timeout")
        self._limit = limit
        self._last, self._accepted = 0.0, 0

    def is_over(self, time: float, accepted: Counter[str], device: Simulator) -> bool:
        """Whether the motor is to stop at robot time `time` [s], where so many commands were `accepted`."""
        if (count := sum(accepted[name] for name in WATCHED)) != self._accepted:
            self._last, self._accepted = time, count
        if time - self._last < self._limit or not device.commanded_motor_speed:
            return False
        self.count += 1
        return True


class StallReport:
    """Says why simulated time was dropped: when stalls begin, then in a summary once a minute at most."""

    def __init__(self, warn: Callable[[str], object], now: Callable[[], float] = time.monotonic):
        self._warn, self._now = warn, now
        self._said, self._began, self._busy, self._spins = -math.inf, now(), 0.0, False
        self._count, self._dropped = 0, 0.0

    def add(self, dropped: float, total: float, busy: float, ticks: int, speed: float) -> None:
        """Take note of a stall that cost `dropped` [s] of simulated time; all stalls of the run have cost `total` [s].

        The run's `ticks` steps have taken `busy` [s] of wall time, without publishing; the crank turns at `speed`
        [rad/s].
        """
        now = self._now()
        self._count, self._dropped = self._count + 1, self._dropped + dropped
        spins = abs(speed) > FASTEST
        if now < self._said + SUMMARY_PERIOD and spins <= self._spins:
            return
        if spins:
            why = (f"because the crank spins at {speed:.3g} rad/s, and each of its turns costs as much as a slow one; "
                   "call ~/reset, or set motor_speed by ~/set_state")
        elif busy - self._busy > 0.8 * (now - self._began):
            why = (f"because a step takes {1e3 * busy / max(ticks, 1):.2g} ms, longer than it lasts; lower "
                   "rate.real_time_factor, or choose solver.method exact")
        else:
            why = ("because the computer did not let the robot run in time; leave it a core, or raise "
                   "rate.max_catch_up")
        if math.isinf(self._said):
            self._warn(f"stalled: {dropped:.3f} s of simulated time dropped, {why}. Stamps stay behind the wall clock "
                       "by what is dropped")
        else:
            self._warn(f"stalled {self._count} times in {now - self._said:.0f} s: {self._dropped:.3f} s of simulated "
                       f"time dropped, {total:.3f} s since the start, {why}")
        self._said, self._began, self._busy, self._spins = now, now, busy, spins
        self._count, self._dropped = 0, 0.0


def set_real_time_priority(factor: float, paused: bool) -> None:
    """Go before other programs while the robot keeps time at a real-time `factor` up to 1, and only then.

    A robot that is to be faster may take all the time of a processor, as does one that takes steps while it is paused.
    It is to leave their share to the program that hears its samples, and to its own thread that serves requests.

    Nothing changes where the system does not allow it, nor for a user who has chosen a niceness. It concerns all
    threads, and those that they begin, because they share the interpreter's lock: one that waits for a processor while
    it holds the lock would delay the others.
    """
    with suppress(OSError):
        if os.getpriority(os.PRIO_PROCESS, 0) == 0:
            policy, priority = (POLICY, PRIORITY) if 0.0 < factor <= 1.0 and not paused else (os.SCHED_OTHER, 0)
            for thread in Path("/proc/self/task").iterdir():
                os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))
