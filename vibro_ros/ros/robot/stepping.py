"""The thread that steps the device in real time, and the parts of a run that it works with."""

import math
import threading
import time
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

from vibro_ros.ros.robot.lock_step import LockStep
from vibro_ros.ros.robot.operations import Operations
from vibro_ros.ros.robot.pacing import LONGEST_SLEEP, Pacing, RobotTime
from vibro_ros.ros.robot.recording import Recording
from vibro_ros.ros.robot.services import SimulationControl
from vibro_ros.ros.topics.publishers import RobotPublishers
from vibro_ros.ros.topics.subscriptions import CommandSubscriptions
from vibro_ros.sensors.device import SensedSimulator
from vibro_ros.simulation.samples import FIELDS, NORMAL_FORCE
from vibro_ros.simulation.simulator import Simulator

WATCHED = ("motor_speed", "motor_voltage")
"""The command without which `command.timeout` stops the motor."""
OVER = "the simulation has ended"
SUMMARY = 60.0
"""Least time [s] between two lines that tell of stalls."""
MOST_KEPT = 10_000
"""Samples that are kept for diagnostics: a second's at the highest `rate.publish`."""
FOR_BAG = 0.001
"""Wait [s] of samples that are faster than the disk, until they look again."""


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

    def begin(self) -> None:
        """Count from robot time 0."""
        self._last = 0.0

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
        self._said, self._began, self._busy = -math.inf, now(), 0.0
        self._count, self._dropped = 0, 0.0

    def add(self, dropped: float, total: float, busy: float, ticks: int) -> None:
        """Take note of a stall that cost `dropped` [s] of simulated time; all stalls of the run have cost `total` [s].

        The run's `ticks` steps have taken `busy` [s] of wall time, without publishing.
        """
        now = self._now()
        self._count, self._dropped = self._count + 1, self._dropped + dropped
        if now < self._said + SUMMARY:
            return
        if busy - self._busy > 0.8 * (now - self._began):
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
        self._said, self._began, self._busy = now, now, busy
        self._count, self._dropped = 0, 0.0


@dataclass(frozen=True)
class Run:
    """One run of the robot; once it runs, `device` is used by the stepping thread alone.

    `clock` publishes robot time; None where the robot publishes no /clock.
    """

    device: Simulator
    robot_time: RobotTime
    pacing: Pacing
    subscriptions: CommandSubscriptions
    publishers: RobotPublishers
    operations: Operations
    recording: Recording
    control: SimulationControl
    timeout: CommandTimeout | None = None
    clock: Callable[[], None] | None = None
    lock_step: LockStep | None = None


class Stepping:
    """Advances the device tick by tick in its own thread, takes what has arrived before and publishes after each.

    A context manager: the thread runs inside, and has ended outside. `begin` is the instant [s] of robot time 0 by the
    pacing's clock; now unless given. Stamps never run backwards, and fall behind the wall clock by the time that was
    dropped and by pauses.

    `error` is what ended the thread before it was asked to; `busy` the wall time [s] that steps took, without
    publishing; `unloaded` counts the steps after which the ground carried nothing: N by eq. (6) was not above 0, or
    the body was in the air.
    """

    def __init__(self, run: Run, log: RcutilsLogger, begin: float | None = None):
        self.error: Exception | None = None
        self.busy = 0.0
        self.unloaded = 0
        self._run, self._log, self._begin = run, log, begin
        self._kept: deque[np.ndarray] = deque(maxlen=MOST_KEPT)
        scene = run.device.scene
        self._looked_at = scene.body_hops or scene.has_rotor  # by `validity_of`
        self._stalls = StallReport(log.warning)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._step_until_stopped, name="stepping")

    def __enter__(self) -> "Stepping":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._run.operations.woken.set()
        self._thread.join()

    def take_samples(self) -> np.ndarray:
        """The samples since the last call, the latest `MOST_KEPT`, shape (n, fields); for one other thread."""
        taken, self._kept = self._kept, deque(maxlen=MOST_KEPT)
        return np.array(list(taken)).reshape(-1, len(FIELDS))

    def _step_until_stopped(self) -> None:
        try:
            self._run.pacing.start(self._begin)
            self._publish()
            while self._wait():
                begun = time.perf_counter()
                self._run.device.advance_to(self._run.robot_time.due_of_device)
                self._run.robot_time.ticks += 1
                self.busy += time.perf_counter() - begun
                values = self._publish()
                self.unloaded += values.item(NORMAL_FORCE) <= 0.0
                if self._looked_at:
                    self._kept.append(values.copy())
                self._run.operations.count_sample()
        except Exception as error:  # the main thread says it, after it has sealed the bag
            self.error = error
        finally:
            self._run.operations.end(OVER)

    def _wait(self) -> bool:
        """Wait until the next sample may be taken, while what arrives is given to the device; False at the end."""
        run = self._run
        while not self._stopped.is_set():
            if self._is_held():
                if not run.operations.woken.wait(LONGEST_SLEEP) and run.clock:
                    run.clock()  # again, for nodes that have just begun to listen
                run.operations.woken.clear()
            elif self._waits_for_bag():
                self._stopped.wait(FOR_BAG)
            elif not run.operations.paused:
                if dropped := run.pacing.wait_until(run.robot_time.due, self._interrupted):
                    self._stalls.add(dropped, run.pacing.dropped, self.busy, run.robot_time.ticks)
            self._take()
            if not self._is_held() and not self._waits_for_bag():
                return not self._stopped.is_set()
        return False

    def _interrupted(self) -> bool:
        """Take what has arrived; whether the wait for the next sample is over."""
        self._take()
        return self._stopped.is_set() or self._run.operations.held

    def _is_held(self) -> bool:
        return self._run.operations.held or bool(self._run.lock_step and not self._run.lock_step.settled)

    def _waits_for_bag(self) -> bool:
        """Whether the disk is to come first, because no clock asks for the next sample."""
        run = self._run
        return (run.operations.paused or not run.pacing.factor) and run.recording.crowded

    def _take(self) -> None:
        """Give the device what has arrived, and look after a motor that nobody commands."""
        run = self._run
        resumes = run.operations.may_resume
        run.subscriptions.apply(run.device, run.robot_time.stamp, run.recording.record, run.operations.perform)
        if resumes and run.operations.may_resume:
            run.operations.resume()
        if run.timeout and run.timeout.is_over(run.robot_time.time, run.subscriptions.accepted, run.device):
            run.operations.stop_motor()
            self._log.warning(run.timeout.words)

    def _publish(self) -> np.ndarray:
        run, device, values = self._run, self._run.device, self._run.device.values
        measurements = device.take_measurements() if isinstance(device, SensedSimulator) else ()
        run.publishers.publish(values, device.take_events(), run.robot_time.stamp, run.robot_time.stamp_of,
                               run.recording.record, measurements)
        run.recording.checkpoint(run.robot_time.stamp, self._checkpoint)
        if run.clock:
            run.clock()
        if run.lock_step:
            run.lock_step.ask()
        return values

    def _checkpoint(self) -> Iterator[tuple[str, bytes]]:
        """The device's whole state, and before it the parameters that changed; the bag seldom asks for them."""
        run = self._run
        if changes := run.operations.changes():
            yield run.operations.topic, changes
        state = Float64MultiArray(data=array("d", run.device.checkpoint()))
        yield run.recording.checkpoint_topic, serialize_message(state)
