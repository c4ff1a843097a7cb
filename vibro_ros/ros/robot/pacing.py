"""Pacing of simulated time by the wall clock: absolute deadlines, time dropped after a stall, times of samples."""

import math
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import suppress

from vibro_ros.messages.robot_messages import stamp_at
from vibro_ros.simulation.simulator import Simulator

LONGEST_SLEEP = 0.05  # longest single sleep [s], so that a stop is noticed however distant the deadline is
MOST_LATENESSES = 100_000  # most measured latenesses that are kept, the latest ones: ten seconds at the highest rate
MOTOR_COMMANDS = ("motor_speed", "motor_voltage")  # the commands without which `command.timeout` stops the motor
SUMMARY_PERIOD = 60.0  # least time [s] between two log lines about stalls
FASTEST = 1e4
"""Crank speed [rad/s] beyond which a stall is blamed on it, because its turns then cost more than real time."""
POLICY, PRIORITY = os.SCHED_RR, 1
"""Scheduling policy of the robot, round-robin real time at the lowest priority; ros2_control uses one likewise."""
NICENESS = -10  # niceness of the robot where the system refuses the policy; it allows the niceness with `ulimit -e 30`
STARTED_AS_NICE = os.getpriority(os.PRIO_PROCESS, 0)
"""Niceness with which the process was started: a value other than 0 is the user's choice."""
PRIORITY_REMEDY = ("allow the robot a real-time priority (`ulimit -r 1`, after a line `USER - rtprio 1` in "
                   "/etc/security/limits.d/robot.conf and a new login; for a container --cap-add SYS_NICE), ")
"""Remedy for stalls of a robot that the system has refused a real-time priority."""


class Pacing:
    """Holds simulated time to `factor` times the wall clock `now` [s]; with the factor 0 it never waits.

    Deadlines are absolute, so that long sleeps do not add up to drift. A lateness of at most `max_catch_up` [wall s] is
    made up for by ticks without sleep; after a longer stall the whole lateness is dropped, so that the device never
    bursts. `missed` counts the deadlines that had passed when the wait for them began, `stalls` the times that time was
    dropped; `dropped` is the total simulated time [s] dropped.
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
        self._origin, self._begin = now(), 0.0  # an instant of the wall clock [s], and the simulated time due then [s]
        self._lateness: deque[float] = deque(maxlen=MOST_LATENESSES)

    def start(self, instant: float | None = None) -> None:
        """Set the `instant` [s] of the wall clock at which simulated time is 0; the default is now."""
        self._origin, self._begin = self._now() if instant is None else instant, 0.0

    def follow(self, simulated_time: float) -> None:
        """Let `simulated_time` [s] be due now, after a pause, so that the pause counts as no lateness."""
        self._origin, self._begin = self._now(), simulated_time

    def change_factor(self, factor: float, simulated_time: float) -> None:
        """Change the factor; `simulated_time` [s] is due now."""
        self.factor = factor
        self.follow(simulated_time)

    def take_lateness(self) -> list[float]:
        """Return the lateness [wall s] of the end of each wait since the last call; for one other thread."""
        taken, self._lateness = self._lateness, deque(maxlen=MOST_LATENESSES)
        return list(taken)

    def wait_until(self, simulated_time: float, stopped: Callable[[], bool] = lambda: False) -> float:
        """Sleep until `simulated_time` [s] is due or `stopped()`, which may also change the factor.

        Return the simulated time [s] that is dropped because the deadline passed more than `max_catch_up` ago; else 0.
        """
        if self.factor == 0.0:
            self._sleep(0.0)  # offers the interpreter lock to the executor's thread
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
        """Return the wall time [s] until `simulated_time` [s] is due."""
        ahead = (simulated_time - self._begin) / self.factor if self.factor else 0.0
        return self._origin + ahead - self._now()


class RobotTime:
    """Times of a run's samples, taken at `rate` [Hz].

    Robot time is `ticks / rate` [s], never a sum of steps, so that it does not drift, and it never goes back. The
    device's own time begins at 0 with each reset, so that a run after a reset has the same bits as after a start.
    `start` is the ROS time [ns] of robot time 0, which must be set before the first sample; `ticks` is the number of
    the last sample, from 0.
    """

    def __init__(self, rate: float, start: int = 0):
        self.start = start
        self.ticks = 0
        self._rate = rate
        self._origin = 0  # number of the sample at which the device's time was 0
        self._stamp, self._stamped = 0, (-1, 0)  # the last stamp, and what it was computed from

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
        """Time [s] of the next sample on the device's clock."""
        return (self.ticks + 1 - self._origin) / self._rate

    @property
    def at_start(self) -> bool:
        """Whether the last sample is the first one since the start or the last reset."""
        return self.ticks <= self._origin

    @property
    def stamp(self) -> int:
        """ROS time [ns] of the last sample; a tick asks for it several times."""
        if self._stamped != (self.ticks, self.start):
            self._stamp, self._stamped = stamp_at(self.start, self.time), (self.ticks, self.start)
        return self._stamp

    def stamp_of(self, time: float) -> int:
        """Return the ROS time [ns] of a `time` [s] on the device's clock."""
        return stamp_at(stamp_at(self.start, self._origin / self._rate), time)

    def restart(self) -> None:
        """Make the next sample the one at which the device's time is 0."""
        self._origin = self.ticks + 1


class CommandTimeout:
    """Detects that for `limit` [s] of robot time no command of the motor has taken effect.

    It uses robot time so that a replay finds the same instant, and a pause does not count; the start counts as a
    command. `topics` are the full names of all topics that command the motor, for `words`, the warning when the motor
    is stopped; `count` is how often that has happened.
    """

    def __init__(self, limit: float, topics: Sequence[str]):
        self.count = 0
        names = " or ".join(topics)
        self.words = (f"command.timeout: no command of the motor on {names} for {limit:g} s of robot time; the motor "
                      f"stops. Publish {names} more often, or start the robot with a longer command.timeout")
        self._limit = limit
        self._last, self._accepted = 0.0, 0

    def is_over(self, time: float, accepted: Counter[str], device: Simulator) -> bool:
        """Return whether the motor must stop at robot time `time` [s]; `accepted` counts the commands so far."""
        if (count := sum(accepted[name] for name in MOTOR_COMMANDS)) != self._accepted:
            self._last, self._accepted = time, count
        if time - self._last < self._limit or not device.commanded_motor_speed:
            return False
        self.count += 1
        return True


class StallReport:
    """Warns why simulated time was dropped: at the first stall, then in a summary at most once a minute."""

    def __init__(self, warn: Callable[[str], object], now: Callable[[], float] = time.monotonic):
        self._warn, self._now = warn, now
        self._last_report, self._began, self._busy, self._spins = -math.inf, now(), 0.0, False
        self._count, self._dropped = 0, 0.0

    def add(self, dropped: float, total: float, busy: float, ticks: int, speed: float) -> None:
        """Note a stall that dropped `dropped` [s] of simulated time; all stalls of the run dropped `total` [s].

        The run's `ticks` steps have taken `busy` [s] of wall time, without publishing; `speed` [rad/s] is the
        crank's mean one over the last of them, because a crank that spins may be slow again at its end.
        """
        now = self._now()
        self._count, self._dropped = self._count + 1, self._dropped + dropped
        spins = abs(speed) > FASTEST
        if now < self._last_report + SUMMARY_PERIOD and spins <= self._spins:
            return
        if spins:
            why = (f"because the crank spins at {speed:.3g} rad/s, and each of its turns costs as much as a slow one; "
                   "call ~/reset, or set motor_speed by ~/set_state, again if the simulation does not answer in time")
        elif busy - self._busy > 0.8 * (now - self._began):
            why = (f"because a step takes {1e3 * busy / max(ticks, 1):.2g} ms, longer than it lasts; lower "
                   "rate.real_time_factor, or choose solver.method exact")
        else:
            remedy = PRIORITY_REMEDY if os.sched_getscheduler(0) != POLICY and not STARTED_AS_NICE else ""
            why = (f"because the computer did not let the robot run in time; {remedy}leave it a core, or raise "
                   "rate.max_catch_up")
        if math.isinf(self._last_report):
            self._warn(f"stalled: {dropped:.3f} s of simulated time dropped, {why}. Stamps stay behind the wall clock "
                       "by what is dropped")
        else:
            self._warn(f"stalled {self._count} times in {now - self._last_report:.0f} s: {self._dropped:.3f} s of "
                       f"simulated time dropped, {total:.3f} s since the start, {why}")
        self._last_report, self._began, self._busy, self._spins = now, now, busy, spins
        self._count, self._dropped = 0, 0.0


def set_real_time_priority(factor: float, paused: bool) -> None:
    """Give the process real-time priority while it runs unpaused at a real-time `factor` up to 1, else take it away.

    A robot at a larger factor, or one that takes steps while paused, may use all the time of a processor. It must leave
    a share to the program that receives its samples, and to its own thread that serves requests.

    Where the system does not allow it, the process gets a high priority among ordinary ones instead, if that is
    allowed. Nothing changes if the user has chosen a niceness. All threads get the priority, and with them those that
    they start, because they share the interpreter lock: a thread that waits for a processor while it holds the lock
    would delay the others.
    """
    if STARTED_AS_NICE:
        return
    for thread in map(int, os.listdir("/proc/self/task")):
        with suppress(OSError):
            if not 0.0 < factor <= 1.0 or paused:
                os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
                os.setpriority(os.PRIO_PROCESS, thread, 0)
                continue
            try:
                os.sched_setscheduler(thread, POLICY, os.sched_param(PRIORITY))
            except PermissionError:
                os.setpriority(os.PRIO_PROCESS, thread, NICENESS)
