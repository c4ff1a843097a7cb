"""One run of the robot: the device behind one lock, stepped by its own thread in real time.

Between two ticks the device's time is the last sample's instant. So a thread that takes the lock acts at that instant,
and its operation is published and recorded with that stamp, after all commands that had arrived before. Services act at
once, in the executor's thread, and a replay finds the same instants. Only a request for steps waits for its answer.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import String

from vibro_ros.messages.codec import new_message, serialised
from vibro_ros.messages.operations import (
    FAULT,
    PAUSE,
    PUSH,
    RESET,
    RESUME,
    SET,
    STATE,
    STEP,
    TIMEOUT,
    Operation,
    perform,
)
from vibro_ros.messages.topics import CHECKPOINT, OPERATIONS, TOPICS, full_name
from vibro_ros.model.faults import COMMANDS, FAULTS, checked_incident
from vibro_ros.model.parameters import Value
from vibro_ros.ros.node import qos
from vibro_ros.ros.robot.lock_step import LockStep
from vibro_ros.ros.robot.pacing import (
    LONGEST_SLEEP,
    CommandTimeout,
    Pacing,
    RobotTime,
    StallReport,
    set_real_time_priority,
)
from vibro_ros.ros.robot.publishers import RobotPublishers
from vibro_ros.ros.robot.recording import Recording
from vibro_ros.ros.robot.subscriptions import CommandSubscriptions
from vibro_ros.sensors.device import SensedSimulator
from vibro_ros.simulation.samples import CRANK_ANGLE, FIELDS, MOTOR_SPEED, NORMAL_FORCE, Samples
from vibro_ros.simulation.simulator import Simulator

FACTOR = "rate.real_time_factor"
"""The one parameter of the node that may change while it runs."""
ENDED = "the simulation has ended"
BUSY = "the simulation has not answered in time; nothing was changed"
LOCK_TIMEOUT = 0.5
"""Longest time [s] that a service waits for the device, so that the main thread still notices signals."""
MOST_KEPT = 10_000
"""Most samples that are kept for diagnostics: one second at the highest `rate.publish`."""
BAG_PERIOD = 0.001
"""Wait [s] for the disk between two checks, when samples are faster than the disk."""
MOST_TURNS = 100.0
"""Most turns of the crank between two checks whether the run must end; they cost some milliseconds."""


class Steps(Future):
    """A request for `asked` samples while the robot is paused; a future whose result is the answer in words.

    `counted` is called after each sample with the number of samples so far, in the stepping thread. `completed` is the
    number of samples taken so far.
    """

    def __init__(self, asked: int, counted: Callable[[int], object] | None):
        super().__init__()
        self.asked, self.completed, self.counted = asked, 0, counted


class Run:
    """One run of the robot; a context manager within which a thread steps the device.

    Parameters
    ----------
    node : Node
    device : Simulator
        Used only while `lock` is held.
    robot_time : RobotTime
    pacing : Pacing
    commands : CommandSubscriptions
    publishers : RobotPublishers
    recording : Recording
    paused : bool
        Whether robot time stands still at first.
    timeout : CommandTimeout, optional
    lock_step : LockStep, optional
        Nodes that must be ready before robot time goes on.
    publish_clock : callable, optional
        Publishes robot time; None where the robot publishes no /clock.
    stop_requested : callable
        Returns whether a signal has come; called within a tick that takes long.

    Attributes
    ----------
    lock : threading.Condition
        Notified when something has changed for a stepping thread that waits.
    paused : bool
        Whether robot time stands still.
    changed : dict of str to value
        Parameters that were changed since the start.
    error : Exception or None
        The error that ended the run.
    quitting : bool
        Whether the robot must end, or is ending.
    waiting : int
        Number of requests for steps that wait for their answer.
    busy : float
        Total wall time [s] of all ticks, without publishing.
    ticks_without_normal_force : int
        Number of samples at which N by eq. (6) was not above 0, or the body was in the air.
    """

    def __init__(self, node: Node, device: Simulator, robot_time: RobotTime, pacing: Pacing,
                 commands: CommandSubscriptions, publishers: RobotPublishers, recording: Recording,
                 paused: bool = False, timeout: CommandTimeout | None = None, lock_step: LockStep | None = None,
                 publish_clock: Callable[[], None] | None = None, stop_requested: Callable[[], bool] = lambda: False):
        self.device, self.robot_time, self.pacing, self.commands = device, robot_time, pacing, commands
        self.publishers, self.recording, self.timeout, self.paused = publishers, recording, timeout, paused
        self.lock = threading.Condition()
        self.changed: dict[str, Value] = {}
        self.error: Exception | None = None
        self.quitting, self.waiting = False, 0
        self.busy, self.ticks_without_normal_force = 0.0, 0
        self._node, self._lock_step, self._publish_clock, self._stop_requested = (
            node, lock_step, publish_clock, stop_requested)
        self._publisher = node.create_publisher(String, full_name(OPERATIONS), qos.profile(OPERATIONS))
        self.topic = self._publisher.topic_name
        self._steps: Steps | None = None
        self._resumes = False  # resume when the nodes of the lock-step have answered
        self._samples: deque[np.ndarray] = deque(maxlen=MOST_KEPT)
        self._keeps_samples = device.scene.body_hops or device.scene.has_rotor  # for `validity_of`
        self._facts = device.statistics, device.disturbances
        self._speed = 0.0  # of the crank now [rad/s]
        self._mean_speed = 0.0  # of the crank over the last tick [rad/s]: its turns are what a tick costs
        self._stalls = StallReport(node.get_logger().warning)
        self._stopped = threading.Event()
        self._begin: float | None = None
        self._thread = threading.Thread(target=self._step_until_stopped, name="stepping")
        if lock_step:
            lock_step.when_answered = self._notify
        self._handlers = {RESET: self._reset, PAUSE: self._pause, RESUME: self._resume, SET: self._set,
                          STATE: self._disturb, PUSH: self._disturb, FAULT: self._fail}

    def start(self, begin: float) -> "Run":
        """Set the instant `begin` [s] of the pacing's clock that is robot time 0; returns this run, to be entered."""
        self._begin = begin
        return self

    def __enter__(self) -> "Run":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._notify()
        self._thread.join()

    # Called by services, in the executor's thread.

    def perform(self, operation: Operation) -> str:
        """Perform an operation now, after all commands that have arrived, and return the answer in words.

        ValueError when the device refuses it; nothing is changed then. RuntimeError when the run has ended, or the
        operation ends it, or the lock is not free within `LOCK_TIMEOUT`.
        """
        with self._locked():
            words = self._handlers[operation.name](operation)
            self.lock.notify()
            return words

    def begin_steps(self, steps: int, counted: Callable[[int], object] | None = None) -> Steps:
        """Let the paused robot take `steps` samples, as fast as the computer and the recording allow.

        ValueError when the robot is not paused, or takes steps already; RuntimeError as `perform`.
        """
        with self._locked():
            if not self.paused:
                raise ValueError("the robot is not paused; call ~/pause with true first")
            if self._steps:
                raise ValueError(f"{self._steps.asked} steps are being taken, {self._steps.completed} so far; wait "
                                 "for their end, or cancel them")
            self._perform_and_record(Operation(STEP, steps=steps))
            self._steps = Steps(steps, counted)
            self.lock.notify()
            return self._steps

    def end_steps(self) -> None:
        """End the present steps early, if there are any; their answer says how many samples were taken."""
        with self.lock:
            if steps := self._steps:
                self._steps = None
                self._answer(steps)

    @property
    def steps(self) -> Steps | None:
        """The steps that are being taken, or None."""
        return self._steps

    def look(self) -> tuple[Samples, int]:
        """Return the device's state and its stamp [ns] (RuntimeError as `perform`)."""
        with self._locked():
            return self.device.state, self.robot_time.stamp

    def device_facts(self) -> tuple[dict[str, Any], dict[str, float]]:
        """Return the device's statistics and active disturbances; those of the last call while a tick takes long."""
        if self.lock.acquire(timeout=LOCK_TIMEOUT):
            self._facts = self.device.statistics, self.device.disturbances
            self.lock.release()
        return self._facts

    def take_samples(self) -> np.ndarray:
        """Return the samples since the last call, at most `MOST_KEPT`, shape (n, fields); for one other thread."""
        taken, self._samples = self._samples, deque(maxlen=MOST_KEPT)
        return np.array(list(taken)).reshape(-1, len(FIELDS))

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Context that holds the lock, after all arrived commands; any error other than ValueError ends the run."""
        if not self.lock.acquire(timeout=LOCK_TIMEOUT):
            raise RuntimeError(BUSY)
        try:
            if self._stopped.is_set():
                raise RuntimeError(ENDED)
            try:
                self._take_commands()
                yield
            except ValueError:
                raise
            except Exception as error:
                self._fail_with(error)
                raise RuntimeError(str(error)) from error
        finally:
            self.lock.release()

    # The stepping thread.

    def _step_until_stopped(self) -> None:
        try:
            self.pacing.start(self._begin)
            with self.lock:
                self._publish()
            while self._wait():
                with self.lock:
                    self._take_commands()
                    if not self._must_wait():
                        self._tick()
        except Exception as error:  # the main thread reports it, after it has sealed the bag
            self._fail_with(error)
        finally:
            with self.lock:
                self._stopped.set()
                if steps := self._steps:
                    self._steps = None
                    steps.set_exception(RuntimeError(ENDED))
                    self._wake()

    def _fail_with(self, error: Exception) -> None:
        self.error = self.error or error
        self._stopped.set()

    def _wait(self) -> bool:
        """Wait until the next sample is due; return False at the end of the run.

        A wait longer than `LONGEST_SLEEP` passes arriving commands to the device; otherwise the tick does.
        """
        while not self._stopped.is_set():
            with self.lock:
                if self._resumes and self._lock_step and self._lock_step.all_answered:
                    self._take_commands()
                    self._resume_time()
                if self._must_wait():
                    self._take_commands()
                    if not self.lock.wait(LONGEST_SLEEP) and self._publish_clock:
                        self._publish_clock()  # again, for new subscribers
                    continue
            if (self.paused or not self.pacing.factor) and self.recording.is_backlogged:  # let the disk catch up
                self._stopped.wait(BAG_PERIOD)
            elif self.paused:
                return True
            else:
                if dropped := self.pacing.wait_until(self.robot_time.due, self._interrupted):
                    self._stalls.add(dropped, self.pacing.dropped, self.busy, self.robot_time.ticks,
                                     self._mean_speed)
                return not self._stopped.is_set()
        return False

    def _interrupted(self) -> bool:
        """Pass arrived commands to the device; return whether the wait for the next sample is over."""
        with self.lock:
            self._take_commands()
            return self._stopped.is_set() or self._must_wait()

    def _must_wait(self) -> bool:
        """Return whether no sample may be taken now, because of a pause or the lock-step."""
        return (self.paused and not self._steps) or bool(self._lock_step and not self._lock_step.all_answered)

    def _tick(self) -> None:
        """Take the next sample."""
        begun, start, angle = time.perf_counter(), self.device.time, self.device.values.item(CRANK_ANGLE)
        if not self._advance(self.robot_time.due_of_device):
            return
        self.robot_time.ticks += 1
        self.busy += time.perf_counter() - begun
        values = self._publish()
        self._mean_speed = (values.item(CRANK_ANGLE) - angle) / ((self.device.time - start) or 1.0)  # 0 s: of a reset
        self.ticks_without_normal_force += values.item(NORMAL_FORCE) <= 0.0
        if self._keeps_samples:
            self._samples.append(values.copy())
        if steps := self._steps:
            steps.completed += 1
            if steps.counted:
                steps.counted(steps.completed)
            if steps.completed == steps.asked:
                self.end_steps()

    def _advance(self, until: float) -> bool:
        """Advance the device to a time [s], in parts if its crank spins so fast that a tick would take seconds.

        Returns False when a signal has come before the end.
        """
        while (part := 2.0 * math.pi * MOST_TURNS / max(abs(self._speed), 1.0)) < until - self.device.time:
            if self._stopped.is_set() or self._stop_requested():
                self._stopped.set()
                return False
            self.device.advance_to(self.device.time + part)
            self._speed = self.device.values.item(MOTOR_SPEED)
        self.device.advance_to(until)
        return True

    def _publish(self) -> np.ndarray:
        device, values = self.device, self.device.values
        self._speed = values.item(MOTOR_SPEED)
        measurements = device.take_measurements() if isinstance(device, SensedSimulator) else ()
        self.publishers.publish(values, device.take_events(), self.robot_time, self.recording.record, measurements)
        self.recording.checkpoint(self.robot_time.stamp, self._checkpoint)
        if self._publish_clock:
            self._publish_clock()
        if self._lock_step:
            self._lock_step.ask()
        return values

    def _checkpoint(self) -> Iterator[tuple[str, bytes]]:
        """Yield topic and bytes of the parameters that changed since the start, and of the device's whole state."""
        if self.changed:
            yield self.topic, _operation_message(Operation(SET, parameters=self.changed))
        state = new_message(TOPICS[CHECKPOINT].type)
        state.data = np.array(self.device.checkpoint())
        yield self.recording.checkpoint_topic, serialised(state, TOPICS[CHECKPOINT].type)

    def _take_commands(self) -> None:
        """Pass arrived commands to the device, and stop the motor if its command has timed out."""
        self.commands.apply(self.device, self.robot_time.stamp, self.recording.record)
        if self.timeout and self.timeout.is_over(self.robot_time.time, self.commands.accepted, self.device):
            self._perform_and_record(Operation(TIMEOUT))
            self._node.get_logger().warning(self.timeout.words)

    # Operations, with the lock held.

    def _perform_and_record(self, operation: Operation) -> None:
        """Perform an operation (ValueError if refused), then publish and record it."""
        perform(operation, self.device)
        data = _operation_message(operation)
        self._publisher.publish(data)
        self.recording.record(self.topic, self.robot_time.stamp, data)

    def _reset(self, operation: Operation) -> str:
        self._perform_and_record(operation)
        self.commands.recover()
        self.robot_time.restart()
        words = ("reset: the robot stands at its start; robot time goes on, and the sample at "
                 f"{self.robot_time.due:.9g} s of robot time shows the start")
        if self.paused and not self._steps:  # so that peers see the start, although the robot is paused
            self._tick()
        return words

    def _pause(self, operation: Operation) -> str:
        self._resumes = False
        if not self.paused:
            self._perform_and_record(operation)
            self.paused = True
            set_real_time_priority(self.pacing.factor, self.paused)
        return (f"paused at {self.robot_time.time:.9g} s of robot time; meanwhile stamps fall behind the wall clock, "
                "unless clock.publish gives all nodes robot time")

    def _resume(self, operation: Operation) -> str:
        if self.paused and self._lock_step:
            self._lock_step.ask()
            self._resumes = True
            return "running, as soon as the nodes of clock.lock_step are ready"
        if self.paused:
            self._resume_time()
        return "running"

    def _resume_time(self) -> None:
        """Resume robot time."""
        self._resumes = False
        self.end_steps()
        self._perform_and_record(Operation(RESUME))
        self.paused = False
        set_real_time_priority(self.pacing.factor, self.paused)
        self.pacing.follow(self.robot_time.time)

    def _set(self, operation: Operation) -> str:
        self._perform_and_record(operation)
        self.changed |= operation.parameters
        if FACTOR in operation.parameters:
            self.pacing.change_factor(operation.parameters[FACTOR], self.robot_time.time)
            set_real_time_priority(self.pacing.factor, self.paused)
        return "set"

    def _disturb(self, operation: Operation) -> str:
        self._perform_and_record(operation)
        if operation.parameters.get("duration") == 0.0:
            return f"duration 0: no {operation.name} begins, and one that lasted has ended"
        return "done"

    def _fail(self, operation: Operation) -> str:
        words, incident = self._disturb(operation), checked_incident(**operation.parameters)
        if FAULTS[incident.fault].befalls == COMMANDS:
            self.commands.fail(incident, self.robot_time.stamp)
        return words

    def _answer(self, steps: Steps) -> None:
        steps.set_result(f"stepped {steps.completed} of {steps.asked} periods, to {self.robot_time.time:.9g} s of "
                         "robot time")
        self._wake()

    def _wake(self) -> None:
        """Wake the executor because a future is done; else it would notice half a second later."""
        if self._node.executor:
            self._node.executor.wake()

    def _notify(self) -> None:
        """Wake the stepping thread, if it waits."""
        if self.lock.acquire(timeout=LOCK_TIMEOUT):
            self.lock.notify()
            self.lock.release()


def _operation_message(operation: Operation) -> bytes:
    message = new_message(TOPICS[OPERATIONS].type)
    message.data = str(operation)
    return serialised(message, TOPICS[OPERATIONS].type)
