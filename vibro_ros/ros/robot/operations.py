"""Reset, pause, step and other parameters: asked for by any thread, performed by the stepping thread."""

from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from threading import Event

from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import String

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
from vibro_ros.messages.topics import OPERATIONS, full_name
from vibro_ros.model.faults import COMMANDS, FAULTS, checked_incident
from vibro_ros.model.parameters import Value
from vibro_ros.ros.node import qos
from vibro_ros.ros.robot.lock_step import LockStep
from vibro_ros.ros.robot.pacing import Pacing, RobotTime, take_priority
from vibro_ros.ros.topics.publishers import Record
from vibro_ros.ros.topics.subscriptions import MOST_WAITING, CommandSubscriptions
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator

FACTOR = "rate.real_time_factor"
"""The one parameter of the node that may change while it runs."""

BETWEEN = "between"
"""A function, called between two samples; its answer is what the function returns. It is not recorded."""


class Request(Future):
    """An operation that was asked for: a future of the words that answer it; ValueError where it is refused.

    `counted` is given the number of samples of a `step` so far, after each one, by the thread that takes them. `work`
    is the function of `BETWEEN`. `completed` are the samples that a `step` has taken so far; `given_up` says that the
    asker wants no more of them.
    """

    def __init__(self, operation: Operation, counted: Callable[[int], object] | None = None,
                 work: Callable[[], object] | None = None):
        super().__init__()
        self.operation, self.work = operation, work
        self.completed = 0
        self.given_up = False
        self._counted = counted

    def count(self) -> None:
        """Take note that another sample is out."""
        self.completed += 1
        if self._counted:
            self._counted(self.completed)

class Operations:
    """The operations of one run; each that is performed is published and recorded.

    `ask`, `end` and the attributes are for any thread, the other functions for the stepping thread. Operations and
    commands wait in the queue of `subscriptions`, in one order of arrival; the nodes of `lock_step` must be ready
    before robot time goes on after a pause. `paused` says whether robot time stands still, `changed` which parameters
    were changed since the start; `topic` is the resolved name. `woken` is set when somebody asks for something, for a
    stepping thread that has nothing to do.
    """

    def __init__(self, node: Node, device: Simulator, pacing: Pacing, robot_time: RobotTime,
                 subscriptions: CommandSubscriptions, record: Record, lock_step: LockStep | None = None,
                 paused: bool = False):
        self.paused = paused
        self.changed: dict[str, Value] = {}
        self.woken = lock_step.answered if lock_step else Event()
        self._publisher = node.create_publisher(String, full_name(OPERATIONS), qos.profile(OPERATIONS))
        self.topic = self._publisher.topic_name
        self._device, self._pacing, self._robot_time = device, pacing, robot_time
        self._subscriptions, self._queue = subscriptions, subscriptions.queue
        self._record, self._lock_step = record, lock_step
        self._counted: Request | None = None  # the one that waits for samples
        self._left = 0  # samples that may be taken while paused
        self._resuming = False  # as soon as the nodes of the lock-step have answered
        self._ended = ""
        self._does = {RESET: self._reset, PAUSE: self._pause, RESUME: self._resume, STEP: self._step, SET: self._set,
                      STATE: self._let, PUSH: self._let, FAULT: self._fail, BETWEEN: self._between}

    @property
    def held(self) -> bool:
        """Whether no sample may be taken now."""
        if self._counted and self._counted.given_up:
            self._end_steps()
        return self.paused and self._left == 0

    @property
    def state(self) -> Samples:
        """The device's state now; for the stepping thread."""
        return self._device.state

    @property
    def may_resume(self) -> bool:
        """Whether robot time is to go on, once what has arrived so far is taken."""
        return self._resuming and bool(self._lock_step and self._lock_step.settled)

    def ask(self, operation: Operation, counted: Callable[[int], object] | None = None,
            work: Callable[[], object] | None = None) -> Request:
        """Ask for an operation, which follows all that was asked and commanded before; the others as in `Request`."""
        request = Request(operation, counted, work)
        if self._queue.is_full(OPERATIONS):
            request.set_exception(ValueError(f"{MOST_WAITING} operations wait already; ask again later"))
            return request
        self._queue.add(OPERATIONS, request)
        self.woken.set()
        if self._ended:
            self.end(self._ended)
        return request

    def end(self, reason: str) -> None:
        """Refuse what waits, and whatever is asked from now on, because the run is over."""
        self._ended = reason
        for request in [self._counted, *(item for name, item in self._queue.take() if name == OPERATIONS)]:
            if request and not request.done():
                with suppress(InvalidStateError):  # whoever asked has just given up
                    request.set_exception(RuntimeError(reason))

    def perform(self, request: Request) -> None:
        """Do what was asked for, unless the request was cancelled; answer it, unless samples are to be taken first.

        Raises
        ------
        SimulationError
            When the run cannot go on; the request is answered with the same words.
        """
        if not request.set_running_or_notify_cancel():
            return
        try:
            self._does[request.operation.name](request)
        except ValueError as error:
            request.set_exception(error)
        except Exception as error:
            request.set_exception(RuntimeError(str(error)))
            raise

    def stop_motor(self) -> None:
        """Stop the motor, because no command has come for too long."""
        self._done(Operation(TIMEOUT))

    def count_sample(self) -> None:
        """Take note that a sample is out."""
        if self._left:
            self._left -= 1
            if self._counted:
                self._counted.count()
            if not self._left:
                self._end_steps()

    def changes(self) -> bytes:
        """What was changed since the start, as the operation that changes it, serialised; empty without any."""
        return _serialised(Operation(SET, parameters=self.changed)) if self.changed else b""

    def _reset(self, request: Request) -> None:
        self._done(request.operation)
        self._subscriptions.recover()
        self._robot_time.restart()
        answer = f"reset: the sample at {self._robot_time.due:.9g} s of robot time is the start"
        if self.paused and not self._left:  # a sample takes a period of robot time, and the start is to be seen
            self._counted, self._left, self._answer = request, 1, answer
        else:
            request.set_result(answer)

    def _pause(self, request: Request) -> None:
        self._resuming = False
        if not self.paused:
            self._done(request.operation)
            self.paused = True
            take_priority(self._pacing.factor, self.paused)
        request.set_result(f"paused at {self._robot_time.time:.9g} s of robot time; meanwhile stamps fall behind the "
                           "wall clock, unless clock.publish gives all nodes robot time")

    def _resume(self, request: Request) -> None:
        if self.paused and self._lock_step:
            self._lock_step.ask()
            self._resuming = True
            request.set_result("running, as soon as the nodes of clock.lock_step are ready")
            return
        if self.paused:
            self.resume()
        request.set_result("running")

    def resume(self) -> None:
        """Let robot time go on."""
        self._left, self._resuming = 0, False
        self._end_steps()
        self._done(Operation(RESUME))
        self.paused = False
        take_priority(self._pacing.factor, self.paused)
        self._pacing.follow(self._robot_time.time)

    def _step(self, request: Request) -> None:
        if not self.paused:
            raise ValueError("the robot is not paused; call ~/pause with true first")
        if self._left:
            raise ValueError(f"{self._left} steps that were asked for before are still to be taken; ask again later")
        self._done(request.operation)
        self._counted, self._left, self._answer = request, request.operation.steps, ""

    def _set(self, request: Request) -> None:
        parameters = request.operation.parameters
        self._done(request.operation)
        self.changed |= parameters
        if FACTOR in parameters:
            self._pacing.change_factor(parameters[FACTOR], self._robot_time.time)
            take_priority(self._pacing.factor, self.paused)
        request.set_result("set")

    def _let(self, request: Request) -> None:
        self._done(request.operation)
        ends = request.operation.parameters.get("duration") == 0.0
        request.set_result(f"duration 0: no {request.operation.name} begins, and one that lasted has ended" if ends
                           else "done")

    def _fail(self, request: Request) -> None:
        self._let(request)
        incident = checked_incident(**request.operation.parameters)
        if FAULTS[incident.fault].befalls == COMMANDS:
            self._subscriptions.fail(incident, self._robot_time.stamp)

    def _between(self, request: Request) -> None:
        request.set_result(request.work() if request.work else None)

    def _done(self, operation: Operation) -> None:
        """Perform an operation (ValueError: refused), publish and record it."""
        perform(operation, self._device)
        data = _serialised(operation)
        self._publisher.publish(data)
        self._record(self.topic, self._robot_time.stamp, data)

    def _end_steps(self) -> None:
        """Answer the request that waited for samples, as many as there were."""
        request, self._counted, self._left = self._counted, None, 0
        if request:
            request.set_result(self._answer or f"stepped {request.completed} of {request.operation.steps} periods, to "
                                               f"{self._robot_time.time:.9g} s of robot time")


def _serialised(operation: Operation) -> bytes:
    return serialize_message(String(data=str(operation)))
