"""The thread that steps the device in real time."""

import threading
import time

import numpy as np
from rclpy.impl.rcutils_logger import RcutilsLogger

from vibro_ros.ros.node.throttle import Throttle
from vibro_ros.ros.robot.pacing import LONGEST_SLEEP
from vibro_ros.ros.robot.run import Run
from vibro_ros.simulation.samples import NORMAL_FORCE

OVER = "the simulation has ended"
FOR_BAG = 0.001
"""Wait [s] of samples that are faster than the disk, until they look again."""


class Stepping:
    """Advances the device tick by tick in its own thread, takes what has arrived before and publishes after each.

    A context manager: the thread runs inside, and has ended outside.

    Stamps never run backwards, and fall behind the wall clock by the time that was dropped and by pauses.

    Parameters
    ----------
    run : Run
        What is stepped, and with whom it talks.
    log : logger
        Where stalls are reported.
    begin : float, optional
        Instant [s] of robot time 0 by the pacing's clock; now unless given.

    Attributes
    ----------
    error : Exception or None
        What ended the thread before it was asked to.
    busy : float
        Wall time [s] that steps took, without publishing.
    unloaded : int
        Steps after which the ground carried nothing: N by eq. (6) was not above 0, or the body was in the air.
    """

    def __init__(self, run: Run, log: RcutilsLogger, begin: float | None = None):
        self.error: Exception | None = None
        self.busy = 0.0
        self.unloaded = 0
        self._run, self._log, self._begin = run, log, begin
        self._throttle = Throttle()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._step_until_stopped, name="stepping")

    def __enter__(self) -> "Stepping":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._run.operations.woken.set()
        self._thread.join()

    @property
    def ticks(self) -> int:
        """Steps taken."""
        return self._run.robot_time.ticks

    def _step_until_stopped(self) -> None:
        try:
            self._step()
        except Exception as error:  # the main thread says it, after it has sealed the bag
            self.error = error
        finally:
            self._run.operations.end(OVER)

    def _step(self) -> None:
        self._run.pacing.start(self._begin)
        self._publish()
        while self._wait():
            begun = time.perf_counter()
            self._run.device.advance_to(self._run.robot_time.due_of_device)
            self._run.robot_time.ticks += 1
            self.busy += time.perf_counter() - begun
            self.unloaded += self._publish().item(NORMAL_FORCE) <= 0.0
            self._run.operations.count_sample()

    def _wait(self) -> bool:
        """Wait until the next sample may be taken, while what arrives is given to the device; False at the end."""
        while not self._stopped.is_set():
            if self._is_held():
                self._stand_still()
            elif self._waits_for_bag():
                self._stopped.wait(FOR_BAG)
            elif not self._run.operations.paused:
                dropped = self._run.pacing.wait_until(self._run.robot_time.due, self._interrupted)
                if dropped:
                    self._report_stall(dropped)
            self._take()
            if not self._is_held() and not self._waits_for_bag():
                return not self._stopped.is_set()
        return False

    def _stand_still(self) -> None:
        """Wait a little for somebody to ask for something; who comes meanwhile is told what time it is."""
        if not self._run.operations.woken.wait(LONGEST_SLEEP) and self._run.clock:
            self._run.clock()
        self._run.operations.woken.clear()

    def _interrupted(self) -> bool:
        """Take what has arrived; whether the wait for the next sample is over."""
        self._take()
        return self._stopped.is_set() or self._run.operations.held

    def _is_held(self) -> bool:
        return self._run.operations.held or bool(self._run.lock_step and not self._run.lock_step.settled)

    def _waits_for_bag(self) -> bool:
        """Whether the disk is to come first, because no clock asks for the next sample."""
        run = self._run
        return (run.operations.paused or not run.pacing.follows_clock) and run.recording.crowded

    def _take(self) -> None:
        """Give the device what has arrived, and look after a motor that nobody commands."""
        run = self._run
        resumes = run.operations.may_resume
        run.inputs.apply(run.device, run.robot_time.stamp, run.recording.record, run.operations.perform)
        if resumes and run.operations.may_resume:
            run.operations.resume()
        if run.timeout and run.timeout.is_over(run.robot_time.time, run.inputs.accepted, run.device):
            run.operations.stop_motor()
            self._log.warning(run.timeout.words)

    def _report_stall(self, dropped: float) -> None:
        text = self._throttle.admit(
            f"stalled: {dropped:.3f} s of simulated time dropped, {self._run.pacing.dropped:.3f} s in all")
        if text:
            self._log.warning(text)

    def _publish(self) -> np.ndarray:
        """Publish and record the sample of this instant, and return its values."""
        run, values = self._run, self._run.device.values
        run.outputs.publish(values, run.device.take_events(), run.robot_time.stamp, run.robot_time.stamp_of,
                            run.recording.record)
        run.keep_checkpoint()
        if run.clock:
            run.clock()
        if run.lock_step:
            run.lock_step.ask()
        return values
