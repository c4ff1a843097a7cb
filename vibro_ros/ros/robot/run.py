"""One run of the robot: the device behind one lock, stepped by its own thread in real time.

Between two ticks the device's time is the last sample's instant. So a thread that takes the lock acts at that instant,
and its operation is published and recorded with that stamp, after all commands that had arrived before. Services act at
once, in the executor's thread, and a replay finds the same instants. Only a request for steps waits for its answer.

`RobotRun.state` is one value, which only a thread that holds the lock changes:

    RUNNING    pause: PAUSED
    PAUSED     resume: RUNNING or, with nodes of `clock.lock_step`, RESUMING; a request for n steps: Steps(n)
    RESUMING   the nodes have answered: RUNNING; pause: PAUSED
    Steps(n)   n samples are taken, or the steps are cancelled: PAUSED; resume: as in PAUSED

Robot time goes on in RUNNING alone; in Steps(n) samples are taken as fast as the computer and the recording allow. The
run can end in every state.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import Enum, auto
from types import MappingProxyType
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as ParameterOfRclpy
from rclpy.publisher import Publisher
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from vibro_ros.messages.codec import new_message, serialised
from vibro_ros.messages.frames import NONE
from vibro_ros.messages.operations import FAULT, PAUSE, RESET, RESUME, SET, STEP, TIMEOUT, Operation, perform
from vibro_ros.messages.robot_messages import RobotMessages
from vibro_ros.messages.topics import CHECKPOINT, JOINT_COMMANDS, OPERATIONS, SAMPLES, TOPICS, full_name
from vibro_ros.model.faults import COMMANDS, FAULTS, Incident, check_lasting, checked_incident
from vibro_ros.model.parameters import Value
from vibro_ros.model.scene import Scene
from vibro_ros.ros.node.node import message_class, qos_profile
from vibro_ros.ros.node.process import CLOCK, waker
from vibro_ros.ros.robot.lock_step import LockStep, checked_nodes
from vibro_ros.ros.robot.pacing import (
    LONGEST_SLEEP,
    CommandTimeout,
    Pacing,
    RobotTime,
    StallReport,
    set_real_time_priority,
)
from vibro_ros.ros.robot.recording import Recording
from vibro_ros.ros.robot.subscriptions import CommandSubscriptions, Record
from vibro_ros.sensors.device import Measurement, SensedSimulator
from vibro_ros.simulation.samples import CRANK_ANGLE, FIELDS, MOTOR_SPEED, NORMAL_FORCE, Samples
from vibro_ros.simulation.simulator import Simulator

FACTOR = "rate.real_time_factor"  # the one parameter of the node that may change while it runs
ENDED = "the simulation has ended"
BUSY = "the simulation has not answered in time; nothing was changed"
LOCK_TIMEOUT = 0.5
"""Longest time [s] that a service waits for the device, so that the main thread still notices signals."""
MOST_KEPT = 10_000  # most samples that are kept for diagnostics: one second at the highest `rate.publish`
BAG_PERIOD = 0.001  # wait [s] for the disk between two checks, when samples are faster than the disk
MOST_TURNS = 100.0  # most turns of the crank between two checks whether the run must end; they cost some milliseconds


class RobotPublishers:
    """Publishes the robot's messages; `publishers` and their resolved names `topics` have the keys of `TOPICS`.

    The parameters are those of `RobotMessages`, except `control`: whether `robot_description` has the block by which
    ros2_control commands the robot. If the type of `tf` is not installed, there are no transforms; the log says so.

    Publishing bytes costs a tenth of publishing a message object: 1.4 us a topic instead of 13. `publish_raw` of
    rclpy's handle is public but not documented; test_publishers.py fails with an explanation when it changes. A handle
    must not be used while its node is destroyed, which happens after the run has ended.
    """

    def __init__(self, node: Node, scene: Scene, prefix: str = "", transforms: str = NONE,
                 variances: Sequence[Sequence[float]] = ((), ()), control: bool = False):
        if transforms != NONE:
            try:
                message_class(TOPICS["tf"].type)
            except ValueError as error:
                node.get_logger().info(f"no tf: {error}")
                transforms = NONE
        of_joints = ("joint_commands", "joint_states") if control else ()
        self._messages = RobotMessages(scene, prefix, transforms, variances,
                                       {name: node.resolve_topic_name(name) for name in of_joints})
        self.publishers: dict[str, Publisher] = {
            name: node.create_publisher(message_class(TOPICS[name].type), full_name(name), qos_profile(name))
            for name in self._messages.topics}
        self._samples = node.create_publisher(message_class(TOPICS[SAMPLES].type), full_name(SAMPLES),
                                              qos_profile(SAMPLES))
        self.topics = {name: publisher.topic_name for name, publisher in self.publishers.items()}
        self._raw_publishers = {name: (publisher.handle.publish_raw, self.topics[name])
                                for name, publisher in self.publishers.items()}
        self._listeners = self._samples.handle.get_subscription_count

    def begin(self, stamp: int) -> list[tuple[str, bytes]]:
        """Publish the messages that are published once, at ROS time `stamp` [ns].

        Returns resolved topic name and bytes of each, for the beginning of every file of a bag.
        """
        once = list(self._messages.once(stamp))
        for name, data in once:
            self.publishers[name].publish(data)
        return [(self.topics[name], data) for name, data in once]

    def publish(self, values: np.ndarray, events: np.ndarray, robot_time: RobotTime, record: Record,
                measurements: Sequence[Measurement] = ()) -> None:
        """Publish and record a sample, the contacts that ended since the previous one, and the measurements.

        `values`, `events` and `measurements` are those of `RobotMessages.of_sample`. Everything is recorded at the
        sample's instant, so that the bag is in time order; impacts and measurements have their own instant in the
        header.
        """
        stamp = robot_time.stamp
        for name, data in self._messages.of_sample(values, events, measurements, stamp, robot_time.stamp_of):
            publish, topic = self._raw_publishers[name]
            publish(data)
            record(topic, stamp, data)
        if self._listeners():
            self._samples.publish(self._messages.whole_sample(values, robot_time.start, robot_time.time))


class RunState(Enum):
    """What a run does while it takes no steps; the table of transitions is at the head of this file."""

    RUNNING = auto()
    PAUSED = auto()
    RESUMING = auto()


class Steps(Future):
    """The state of a paused run that takes `asked` samples; a future whose result is the answer in words.

    `on_step` is called after each sample with the number of samples so far, in the stepping thread. `completed` is the
    number of samples taken so far.
    """

    def __init__(self, asked: int, on_step: Callable[[int], object] | None):
        super().__init__()
        self.asked, self.completed, self.on_step = asked, 0, on_step


class RobotRun:
    """One run of the robot; a context manager within which a thread steps the device.

    `settings` are the node's parameters. `device` is used only while `lock` is held. `stop_requested` returns whether a
    signal has come; it is called within a tick that takes long.
    """

    def __init__(self, node: Node, device: Simulator, settings: Mapping[str, Value], publishers: RobotPublishers,
                 recording: Recording, stop_requested: Callable[[], bool] = lambda: False):
        self.device, self.publishers, self.recording = device, publishers, recording
        self.robot_time = RobotTime(settings["rate.publish"])
        self.pacing = Pacing(settings["rate.real_time_factor"], settings["rate.max_catch_up"])
        self.commands = CommandSubscriptions(node, device.scene)  # commands are heard from now on
        self.lock = threading.Condition()  # notified when something has changed for a stepping thread that waits
        self.state: RunState | Steps = RunState.PAUSED if settings["rate.start_paused"] else RunState.RUNNING
        self.error: Exception | None = None  # the error that ended the run
        self.waiting = 0  # requests for steps whose answers have not been sent
        self.busy = 0.0  # total wall time [s] of all ticks, without publishing
        self.ticks_without_normal_force = 0  # samples at which N by eq. (6) was not above 0, or the body in the air
        self.timeout: CommandTimeout | None = None
        if settings["command.timeout"]:
            motor = device.scene.motor_command  # joints are commanded by speed, never by voltage
            names = [motor, *[JOINT_COMMANDS] * (motor == "motor_speed")]
            self.timeout = CommandTimeout(settings["command.timeout"], [self.commands.topics[name] for name in names])
        nodes = checked_nodes(node, settings["clock.lock_step"])
        self._lock_step = LockStep(node, nodes, self._notify) if nodes else None
        self._clock = (node.create_publisher(Clock, CLOCK, qos_profile("clock")) if settings["clock.publish"] else None)
        self._node, self._stop_requested, self._wake = node, stop_requested, waker(node)
        self._publisher = node.create_publisher(String, full_name(OPERATIONS), qos_profile(OPERATIONS))
        self.topic = self._publisher.topic_name
        self._samples: deque[np.ndarray] = deque(maxlen=MOST_KEPT)
        self._keeps_samples = device.scene.body_hops or device.scene.has_rotor  # for `validity_of`
        self._facts = device.statistics, device.disturbances
        self._speed = 0.0  # of the crank now [rad/s]
        self._mean_speed = 0.0  # of the crank over the last tick [rad/s]: its turns are what a tick costs
        self._stalls = StallReport(node.get_logger().warning)
        self._end = threading.Event()  # set, in any thread, when no more samples may be taken
        self._begin: float | None = None
        self._thread = threading.Thread(target=self._step_until_ended, name="stepping")

    def start(self, begin: float) -> "RobotRun":
        """Set the instant `begin` [s] of the pacing's clock that is robot time 0; returns this run, to be entered."""
        self._begin = begin
        return self

    def __enter__(self) -> "RobotRun":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        self._thread.join()

    @property
    def paused(self) -> bool:
        """Whether robot time stands still."""
        return self.state is not RunState.RUNNING

    @property
    def steps(self) -> Steps | None:
        """The steps that are being taken, or None."""
        return self.state if isinstance(self.state, Steps) else None

    @property
    def is_ending(self) -> bool:
        """Whether the robot must end, or is ending."""
        return self._end.is_set()

    def end(self) -> None:
        """End the run, even amid a tick that takes long."""
        self._end.set()
        self._notify()

    # Operations of services, in the executor's thread. Each acts after all commands that have arrived, and returns the
    # answer in words. ValueError when the device refuses it; nothing is changed then. RuntimeError when the run has
    # ended, or the operation ends it, or the lock is not free within `LOCK_TIMEOUT`.

    def reset(self, given: Mapping[str, Value] = MappingProxyType({})) -> str:
        """Put the device back to its start, or into a `given` state at time 0."""
        with self._locked():
            self._perform(Operation(RESET, parameters=given))
            self.commands.recover()
            self.robot_time.restart()
            words = ("reset: the robot stands at its start; robot time goes on, and the sample at "
                     f"{self.robot_time.due:.9g} s of robot time shows the start")
            if self.paused and not self.steps:  # so that peers see the start, although the robot is paused
                self._tick()
            return words

    def pause(self) -> str:
        """Let robot time stand still; steps that are being taken go on."""
        with self._locked():
            if self.state is RunState.RUNNING:
                self._perform(Operation(PAUSE))
            if not self.steps:
                self._enter(RunState.PAUSED)
            return (f"paused at {self.robot_time.time:.9g} s of robot time; meanwhile stamps fall behind the wall "
                    "clock, unless clock.publish gives all nodes robot time")

    def resume(self) -> str:
        """Let robot time go on, as soon as the nodes of `clock.lock_step` are ready."""
        with self._locked():
            if self.paused and self._lock_step:
                self._lock_step.ask()
                self._enter(RunState.RESUMING)
                return "running, as soon as the nodes of clock.lock_step are ready"
            if self.paused:
                self._let_time_go_on()
            return "running"

    def begin_steps(self, count: int, on_step: Callable[[int], object] | None = None) -> Steps:
        """Let the paused robot take `count` samples."""
        with self._locked():
            if self.state in (RunState.RUNNING, RunState.RESUMING):
                raise ValueError("the robot is not paused; call ~/pause with true first")
            if steps := self.steps:
                raise ValueError(f"{steps.asked} steps are being taken, {steps.completed} so far; wait for their end, "
                                 "or cancel them")
            self._perform(Operation(STEP, steps=count))
            steps = Steps(count, on_step)
            self._enter(steps)
            return steps

    def end_steps(self) -> None:
        """End the present steps early, if there are any; their answer says how many samples were taken."""
        with self.lock:
            if self.steps:
                self._enter(RunState.PAUSED)

    def set_parameters(self, parameters: Sequence[ParameterOfRclpy]) -> SetParametersResult:
        """Change parameters at one instant of robot time, all of them or none; the node answers with the result."""
        try:
            values = {parameter.name: parameter.value for parameter in parameters}  # checked by `set_refusal`
            with self._locked():
                self._perform(Operation(SET, parameters=values))
                if FACTOR in values:
                    self.pacing.change_factor(values[FACTOR], self.robot_time.time)
                    set_real_time_priority(self.pacing.factor, self.paused)
        except (ValueError, RuntimeError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def disturb(self, operation: Operation) -> str:
        """Push the body, set its state, or begin or end a fault of the device."""
        with self._locked():
            self._perform(operation)
            return f"the {operation.name} has ended" if operation.parameters.get("duration") == 0.0 else "done"

    def fail(self, incident: Incident) -> str:
        """Begin or end a fault, also one of the commands."""
        operation, incident = Operation(FAULT, parameters=incident._asdict()), checked_incident(*incident)
        if FAULTS[incident.fault].affects != COMMANDS:
            return self.disturb(operation)
        with self._locked():
            check_lasting(incident.fault, "", incident.duration, [
                fault for fault, until in self.commands.disturbances.items() if until > self.robot_time.stamp])
            self._perform(operation)
            self.commands.fail(incident, self.robot_time.stamp)
            return "the fault has ended" if incident.duration == 0.0 else "done"

    def stamped_state(self) -> tuple[Samples, int]:
        """Return the device's state and its stamp [ns]."""
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
            if self._end.is_set():
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
            self.lock.notify()
            self.lock.release()

    # With the lock held.

    def _enter(self, state: RunState | Steps, error: Exception | None = None) -> None:
        """Enter a state: the one place where it changes. Steps that end so are answered, with an `error` if given."""
        previous, self.state = self.state, state
        if state is RunState.RUNNING:
            self.pacing.follow(self.robot_time.time)
        if RunState.RUNNING in (previous, state):
            set_real_time_priority(self.pacing.factor, self.paused)
        if isinstance(previous, Steps):
            if error:
                previous.set_exception(error)
            else:
                previous.set_result(f"stepped {previous.completed} of {previous.asked} periods, to "
                                    f"{self.robot_time.time:.9g} s of robot time")
            self._wake()

    def _let_time_go_on(self) -> None:
        self._perform(Operation(RESUME))
        self._enter(RunState.RUNNING)

    def _perform(self, operation: Operation) -> None:
        """Perform an operation on the device (ValueError if refused), then publish and record it."""
        perform(operation, self.device)
        data = _message_of(OPERATIONS, str(operation))
        self._publisher.publish(data)
        self.recording.record(self.topic, self.robot_time.stamp, data)

    def _take_commands(self) -> None:
        """Pass arrived commands to the device, and stop the motor if its command has timed out."""
        self.commands.apply(self.device, self.robot_time.stamp, self.recording.record)
        if self.timeout and self.timeout.is_over(self.robot_time.time, self.commands.accepted, self.device):
            self._perform(Operation(TIMEOUT))
            self._node.get_logger().warning(self.timeout.words)

    # The stepping thread.

    def _step_until_ended(self) -> None:
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
                self._end.set()
                if self.steps:
                    self._enter(RunState.PAUSED, RuntimeError(ENDED))
            self._wake()

    def _fail_with(self, error: Exception) -> None:
        self.error = self.error or error
        self._end.set()

    def _wait(self) -> bool:
        """Wait until the next sample is due; return False at the end of the run.

        A wait longer than `LONGEST_SLEEP` passes arriving commands to the device; otherwise the tick does.
        """
        while not self._end.is_set():
            with self.lock:
                if self.state is RunState.RESUMING and self._lock_step and self._lock_step.all_answered:
                    self._take_commands()
                    self._let_time_go_on()
                if self._must_wait():
                    self._take_commands()
                    if not self.lock.wait(LONGEST_SLEEP):
                        self._publish_clock()  # again, for new subscribers
                    continue
            if (self.paused or not self.pacing.factor) and self.recording.is_backlogged:  # let the disk catch up
                self._end.wait(BAG_PERIOD)
            elif self.paused:
                return True
            else:
                if dropped := self.pacing.wait_until(self.robot_time.due, self._interrupted):
                    self._stalls.add(dropped, self.pacing.dropped, self.busy, self.robot_time.ticks,
                                     self._mean_speed)
                return not self._end.is_set()
        return False

    def _interrupted(self) -> bool:
        """Pass arrived commands to the device; return whether the wait for the next sample is over."""
        with self.lock:
            self._take_commands()
            return self._end.is_set() or self._must_wait()

    def _must_wait(self) -> bool:
        """Return whether no sample may be taken now, because of a pause or the lock-step."""
        return (self.paused and not self.steps) or bool(self._lock_step and not self._lock_step.all_answered)

    def _tick(self) -> None:
        """Advance the device to the next sample, and publish it."""
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
        if steps := self.steps:
            steps.completed += 1
            if steps.on_step:
                steps.on_step(steps.completed)
            if steps.completed == steps.asked:
                self._enter(RunState.PAUSED)

    def _advance(self, until: float) -> bool:
        """Advance the device to a time [s], in parts if its crank spins so fast that a tick would take seconds.

        Returns False when a signal has come before the end.
        """
        while (part := 2.0 * math.pi * MOST_TURNS / max(abs(self._speed), 1.0)) < until - self.device.time:
            if self._end.is_set() or self._stop_requested():
                self._end.set()
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
        self.recording.checkpoint(self.robot_time, lambda: _message_of(CHECKPOINT, device.checkpoint()))
        self._publish_clock()
        if self._lock_step:
            self._lock_step.ask()
        return values

    def _publish_clock(self) -> None:
        """Publish robot time, if /clock is wanted; after each sample, so that every sample arrives before its time."""
        if self._clock:
            seconds, nanoseconds = divmod(self.robot_time.stamp, 1_000_000_000)
            self._clock.publish(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))

    def _notify(self) -> None:
        """Wake the stepping thread, if it waits."""
        if self.lock.acquire(timeout=LOCK_TIMEOUT):
            self.lock.notify()
            self.lock.release()


def _message_of(topic: str, data: str | np.ndarray) -> bytes:
    """Return a serialised message of a topic whose messages have only `data`."""
    message = new_message(TOPICS[topic].type)
    message.data = data
    return serialised(message, TOPICS[topic].type)
