"""The thread that steps the device in real time."""

import threading
import time
from collections.abc import Callable

import numpy as np
from rclpy.impl.rcutils_logger import RcutilsLogger

from vibro_ros.messages.fields import stamp_at
from vibro_ros.ros.inputs import Inputs
from vibro_ros.ros.outputs import Outputs, Record
from vibro_ros.ros.pacing import Pacing
from vibro_ros.ros.throttle import Throttle
from vibro_ros.simulation.samples import NORMAL_FORCE
from vibro_ros.simulation.simulator import Simulator

Checkpoint = Callable[[int, Callable[[], np.ndarray]], None]


class Stepping:
    """Advances the device tick by tick in its own thread, takes commands before and publishes after each.

    A context manager: the thread runs inside, and has ended outside.

    Simulated time is `tick / rate` [s], never a sum of steps, so it does not drift. Stamps are `start` plus
    simulated time: they never run backwards, and fall behind the wall clock by the time that was dropped.

    Parameters
    ----------
    device : Simulator
        Used by the thread alone once it runs.
    inputs, outputs : Inputs, Outputs
        The robot's topics.
    record : callable
        The bag.
    pacing : Pacing
        The wall clock.
    rate : float
        Ticks per simulated second [Hz].
    start : int
        ROS time [ns] of simulated time 0.
    log : logger
        Where stalls are reported.
    checkpoint : callable, optional
        Told the stamp [ns] of each sample when it is out, before its commands, and how to get the device's whole state.
    begin : float, optional
        Instant [s] of `start` by the pacing's clock; now unless given.

    Attributes
    ----------
    error : Exception or None
        What ended the thread before it was asked to.
    ticks : int
        Steps taken.
    busy : float
        Wall time [s] that they took, without publishing.
    unloaded : int
        Steps after which the ground carried nothing: N by eq. (6) was not above 0, or the body was in the air.
    """

    def __init__(self, device: Simulator, inputs: Inputs, outputs: Outputs, record: Record, pacing: Pacing,
                 rate: float, start: int, log: RcutilsLogger, checkpoint: Checkpoint | None = None,
                 begin: float | None = None):
        self.error: Exception | None = None
        self.ticks = 0
        self.busy = 0.0
        self.unloaded = 0
        self._device, self._inputs, self._outputs, self._record = device, inputs, outputs, record
        self._pacing, self._rate, self._zero, self._log = pacing, rate, start, log
        self._checkpoint, self._begin = checkpoint, begin
        self._throttle = Throttle()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="stepping")

    def __enter__(self) -> "Stepping":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            self._step()
        except Exception as error:  # the main thread says it, after it has sealed the bag
            self.error = error

    def _step(self) -> None:
        self._pacing.start(self._begin)
        self._publish()
        while self._wait_for((self.ticks + 1) / self._rate):
            begun = time.perf_counter()
            self._inputs.apply(self._device, self._stamp_of, self._record)
            self._device.advance_to((self.ticks + 1) / self._rate)
            self.busy += time.perf_counter() - begun
            self.unloaded += self._publish().item(NORMAL_FORCE) <= 0.0
            self.ticks += 1

    def _wait_for(self, due: float) -> bool:
        """Sleep until the simulated time `due` [s]; False when the thread is to end."""
        dropped = self._pacing.wait_until(due, self._stopped.is_set)
        if dropped:
            self._report_stall(dropped)
        return not self._stopped.is_set()

    def _report_stall(self, dropped: float) -> None:
        text = self._throttle.admit(
            f"stalled: {dropped:.3f} s of simulated time dropped, {self._pacing.dropped:.3f} s in all")
        if text:
            self._log.warning(text)

    def _publish(self) -> np.ndarray:
        """Publish and record the sample of this instant, and return its values."""
        values = self._device.values
        self._outputs.publish(values, self._device.take_events(), self._stamp_of, self._record)
        if self._checkpoint:
            self._checkpoint(self._stamp_of(self._device.time), self._device.checkpoint)
        return values

    def _stamp_of(self, time: float) -> int:
        return stamp_at(self._zero, time)
