"""The robot's services: reset, pause and step, live parameters, and those of `simulation_interfaces`.

Each asks the stepping thread for an operation (`Operations.ask`) and awaits its end, so that the executor serves others
meanwhile. What of `simulation_interfaces` is not installed is left out; what a request of it means, or why it is
refused, is said by pure functions of numbers, which are those of version 2.1.0.
"""

import math
import time
from collections.abc import Awaitable, Callable, Iterable, Sequence
from concurrent.futures import TimeoutError as FutureTimeoutError
from enum import IntEnum, IntFlag
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter as ParameterOfRclpy
from std_srvs.srv import SetBool, Trigger

from vibro_ros.messages.frames import fill_header
from vibro_ros.messages.operations import FAULT, PAUSE, PUSH, RESET, RESUME, SET, STATE, STEP, Operation
from vibro_ros.model.faults import Incident
from vibro_ros.model.parameters import checked_parameters, quoted
from vibro_ros.ros.node.node import RESULT_TIMEOUT, NextTurn, SteadyNode, installed_type
from vibro_ros.ros.node.parameters import TABLE
from vibro_ros.ros.robot.operations import BETWEEN, Operations, Request
from vibro_ros.ros.robot.pacing import RobotTime
from vibro_ros.ros.robot.recording import Recording
from vibro_ros.simulation.samples import Samples

PATIENCE = 5.0
"""Longest time [s] that an answer waits for the stepping thread, which looks every 0.05 s unless it is computing."""
PACKAGE = "simulation_interfaces"
NAMES = {
    "GetSimulatorFeatures": "~/get_simulator_features",
    "ResetSimulation": "~/reset_simulation",
    "GetSimulationState": "~/get_simulation_state",
    "SetSimulationState": "~/set_simulation_state",
    "StepSimulation": "~/step_simulation",
    "SimulateSteps": "~/simulate_steps",
    "GetEntityState": "~/get_entity_state",
    "SetEntityState": "~/set_entity_state",
}
"""What is offered of that package, by type."""
ABOUT = ("vibro_ros: a step is one publish period. A reset puts the state back and lets the clock go on; there is "
         "nothing to spawn.")
OWN_PACKAGE = "vibro_ros_interfaces"
INCIDENTS = {"SetState": "~/set_state", "Push": "~/push", "InjectFault": "~/inject_fault"}
"""What is offered of the project's own package, by type."""
FEEDBACK_PERIOD = 0.02
"""Least time [s] between two messages of feedback, the last one aside: no clock holds the steps back."""

Answer = Callable[[Any, Any], Awaitable[Any]]


def offer_run_services(node: SteadyNode, operations: Operations, recording: Recording) -> None:
    """Offer `~/record`, `~/reset`, `~/pause` and `~/step`."""
    def record(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success, response.message = recording.switch(request.data)
        return response

    node.create_service(SetBool, "~/record", record)
    _offer_operations(node, operations, [
        (Trigger, "~/reset", lambda _: Operation(RESET)), (Trigger, "~/step", lambda _: Operation(STEP, steps=1)),
        (SetBool, "~/pause", lambda request: Operation(PAUSE if request.data else RESUME))])


def offer_incidents(node: SteadyNode, operations: Operations) -> None:
    """Offer `INCIDENTS`, as far as their types are installed; the log says in one line what is left out."""
    types = installed_types(OWN_PACKAGE, INCIDENTS)
    if len(types) < len(INCIDENTS):
        node.get_logger().info(f"{OWN_PACKAGE} is not installed, or old: without "
                               f"{', '.join(path for name, path in INCIDENTS.items() if name not in types)}")
    _offer_operations(node, operations, [(kind, INCIDENTS[name], _MEANT[name]) for name, kind in types.items()])


def _offer_operations(node: SteadyNode, operations: Operations,
                      offered: Iterable[tuple[type, str, Callable[[Any], Operation]]]) -> None:
    """Offer services whose requests mean an operation: types, names, and what a request means (ValueError: nothing)."""
    group = ReentrantCallbackGroup()

    def answering(meant: Callable[[Any], Operation]) -> Answer:
        async def answer(request: Any, response: Any) -> Any:
            try:
                asked = operations.ask(meant(request))
            except ValueError as error:
                response.message = str(error)
                return response
            await finished(node, asked)
            response.success, response.message = outcome(asked)
            return response

        return answer

    for kind, name, meant in offered:
        node.create_service(kind, name, answering(meant), callback_group=group)


def _state_asked(request: Any) -> Operation:
    names = list(request.names)
    if len(names) != len(request.values) or len(set(names)) != len(names):
        raise ValueError(f"names, values: {len(names)} names, {len(set(names))} of them different, and "
                         f"{len(request.values)} values; give one value for each name")
    return Operation(STATE, parameters=dict(zip(names, map(float, request.values), strict=True)))


_MEANT: dict[str, Callable[[Any], Operation]] = {
    "SetState": _state_asked,
    "Push": lambda request: Operation(PUSH, parameters={
        name: getattr(request, name) for name in ("duration", "force_x", "force_z")}),
    "InjectFault": lambda request: Operation(FAULT, parameters=Incident(**{  # an older type has fewer fields
        name: getattr(request, name) for name in request.get_fields_and_field_types()})._asdict()),
}


def follow_parameters(node: SteadyNode, operations: Operations) -> None:
    """Let the robot follow its ROS parameters from now on.

    Those of one request are checked together and change at one instant of robot time; what is refused is not stored.
    """

    def change(parameters: Sequence[ParameterOfRclpy]) -> SetParametersResult:
        values = checked_parameters({one.name: one.value for one in parameters}, TABLE)
        done, words = outcome(operations.ask(Operation(SET, parameters=values)), PATIENCE)
        return SetParametersResult(successful=done, reason="" if done else words)

    node.remove_on_set_parameters_callback(refuse_while_starting)
    node.add_on_set_parameters_callback(change)


def refuse_while_starting(parameters: Sequence[ParameterOfRclpy]) -> SetParametersResult:
    """Refuse every change of a robot that has no device yet."""
    reason = f"{parameters[0].name}: the robot is still starting; set it when it is ready"
    return SetParametersResult(successful=False, reason=reason)


async def finished(node: Node, request: Request, patience: float = PATIENCE) -> None:
    """Wait until a request is answered, or up to `patience` [s], while the executor runs other callbacks."""
    begun = time.monotonic()
    request.add_done_callback(lambda _: node.executor and node.executor.wake())
    while not request.done() and time.monotonic() < begun + patience:
        await NextTurn()


def outcome(request: Request, patience: float = 0.0) -> tuple[bool, str]:
    """Whether what was asked for is done, and the words that say so; waits up to `patience` [s]."""
    try:
        return True, request.result(patience)
    except FutureTimeoutError:
        if request.cancel():
            return False, "the simulation has not answered in time; nothing was changed"
        return False, "the simulation has not answered in time; it may still do what was asked"
    except (ValueError, RuntimeError) as error:
        return False, str(error)


MOST_STEPS = 100_000
"""Steps that one request may ask for: about 8 minutes of robot time and 0.3 GB of a bag at the default rate."""


class Code(IntEnum):
    """How a request ended; those above 100 are of SetSimulationState alone."""

    FEATURE_UNSUPPORTED = 0
    OK = 1
    NOT_FOUND = 2
    INCORRECT_STATE = 3
    OPERATION_FAILED = 4
    ALREADY_IN_TARGET_STATE = 101
    STATE_TRANSITION_ERROR = 102
    INCORRECT_TRANSITION = 103


INVALID_POSE = 101
"""The code of SetEntityState alone."""


class State(IntEnum):
    """What the simulation is doing; `STOPPED` is paused at its start."""

    STOPPED = 0
    PLAYING = 1
    PAUSED = 2
    QUITTING = 3
    NO_WORLD = 4
    LOADING_WORLD = 5


class Scope(IntFlag):
    """What a reset puts back; 0 and `ALL` are everything."""

    DEFAULT = 0
    TIME = 1
    STATE = 2
    SPAWNED = 4
    ALL = 255


class Feature(IntEnum):
    """What a simulator can do, as far as this robot can."""

    ENTITY_STATE_GETTING = 10
    ENTITY_STATE_SETTING = 11
    SIMULATION_RESET = 20
    SIMULATION_RESET_STATE = 22
    SIMULATION_STATE_GETTING = 24
    SIMULATION_STATE_SETTING = 25
    SIMULATION_STATE_PAUSE = 26
    STEP_SIMULATION_SINGLE = 31
    STEP_SIMULATION_MULTIPLE = 32
    STEP_SIMULATION_ACTION = 33


FEATURES = {
    "GetSimulatorFeatures": (),
    "ResetSimulation": (Feature.SIMULATION_RESET, Feature.SIMULATION_RESET_STATE),
    "GetSimulationState": (Feature.SIMULATION_STATE_GETTING,),
    "SetSimulationState": (Feature.SIMULATION_STATE_SETTING, Feature.SIMULATION_STATE_PAUSE),
    "StepSimulation": (Feature.STEP_SIMULATION_SINGLE, Feature.STEP_SIMULATION_MULTIPLE),
    "SimulateSteps": (Feature.STEP_SIMULATION_MULTIPLE, Feature.STEP_SIMULATION_ACTION),
    "GetEntityState": (Feature.ENTITY_STATE_GETTING,),
    "SetEntityState": (Feature.ENTITY_STATE_SETTING,),
}
"""The features that each type of service or action brings."""

TRANSITIONS: dict[State, dict[State, tuple[str, ...]]] = {
    State.STOPPED: {State.PLAYING: (RESUME,), State.QUITTING: ()},
    State.PLAYING: {State.STOPPED: (PAUSE, RESET), State.PAUSED: (PAUSE,), State.QUITTING: ()},
    State.PAUSED: {State.STOPPED: (RESET,), State.PLAYING: (RESUME,), State.QUITTING: ()},
    State.QUITTING: {},
}
"""The operations that lead from a state to another. `STOPPED` to `PAUSED` is the definition's own example of an
incorrect transition: a stopped simulation stands still already."""


class RefusalError(Exception):
    """A request is refused: `code` says why for programs, `words` for people, with the value, the limit and the remedy.
    """

    def __init__(self, code: int, words: str):
        super().__init__(words)
        self.code = code


def current_state(paused: bool, at_start: bool, quitting: bool) -> State:
    """What a robot is doing."""
    if quitting:
        return State.QUITTING
    if not paused:
        return State.PLAYING
    return State.STOPPED if at_start else State.PAUSED


def transition(current: State, wanted: int) -> tuple[str, ...]:
    """The operations that lead from the current state to the one that is wanted.

    Raises
    ------
    RefusalError
        When the number is no state, when it is a state that this robot does not know, when the robot is in it already,
        or when nothing leads there.
    """
    if wanted not in list(State):
        raise RefusalError(Code.NOT_FOUND, f"{wanted} is no state; give one of {_listed(TRANSITIONS)}")
    target = State(wanted)
    if target not in TRANSITIONS:
        raise RefusalError(Code.FEATURE_UNSUPPORTED, f"{target.name}: a robot is always in its scene; give one of "
                                                f"{_listed(TRANSITIONS)}")
    if target == current:
        raise RefusalError(Code.ALREADY_IN_TARGET_STATE, f"the robot is {current.name} already")
    if target not in TRANSITIONS[current]:
        reachable = _listed(TRANSITIONS[current]) or "none, because the robot is about to end"
        raise RefusalError(Code.INCORRECT_TRANSITION, f"nothing leads from {current.name} to {target.name}; from "
                                                 f"{current.name} these can be reached: {reachable}")
    return TRANSITIONS[current][target]


def check_scope(scope: int) -> None:
    """Refuse a reset of something that is not put back, so that nothing is put back by halves.

    Everything, which is `DEFAULT` or `ALL`, means everything that this robot can put back: its state.

    Raises
    ------
    RefusalError
        When the number has bits that are no scope, or asks by name for time or spawned entities.
    """
    if scope in (Scope.DEFAULT, Scope.ALL, Scope.STATE):
        return
    if unknown := scope & ~(Scope.TIME | Scope.STATE | Scope.SPAWNED):
        raise RefusalError(Code.NOT_FOUND, f"scope {scope}: {unknown} is no scope; give {_PUT_BACK}")
    if scope & Scope.TIME:
        raise RefusalError(Code.FEATURE_UNSUPPORTED, f"scope {scope}: robot time never runs back; give {_PUT_BACK}")
    raise RefusalError(Code.FEATURE_UNSUPPORTED, f"scope {scope}: this robot spawns nothing; give {_PUT_BACK}")


_PUT_BACK = "2 for the state, or 0 for all that can be put back"


def check_steps(steps: int) -> None:
    """Refuse a number of steps that is 0, or more than one request should take (RefusalError)."""
    if not 1 <= steps <= MOST_STEPS:
        raise RefusalError(Code.OPERATION_FAILED, f"{steps} steps; give 1 to {MOST_STEPS}, and ask again for more")


def _listed(states: Iterable[State]) -> str:
    return ", ".join(f"{state.value} ({state.name})" for state in states)


class SimulationControl:
    """The robot as a simulator: its state, and how requests of `simulation_interfaces` change it.

    All functions are for the executor's thread. `quitting` says whether somebody asked that the robot ends; `waiting`
    counts requests whose answer is awaited.
    """

    def __init__(self, node: Node, operations: Operations, robot_time: RobotTime):
        self.quitting = False
        self.waiting = 0
        self._node, self._operations, self._robot_time = node, operations, robot_time
        self._steps: Request | None = None  # the last steps that were asked for here

    @property
    def state(self) -> State:
        """What the robot is doing; steps are taken while it is paused."""
        return current_state(self._operations.paused, self._robot_time.at_start, self.quitting)

    async def change_state(self, wanted: int) -> None:
        """Bring the robot into another state; ends the steps that are being taken (RefusalError)."""
        names = transition(self.state, wanted)
        self.quitting = wanted == State.QUITTING
        if self._steps and not self._steps.done() and not self.quitting:
            self.give_up(self._steps)
            await self._finished(self._steps)
        for request in [self._operations.ask(Operation(name)) for name in names]:  # nobody's comes between them
            await self._answer(request, Code.STATE_TRANSITION_ERROR)

    async def reset(self, scope: int) -> None:
        """Put the robot back to its start; its clock goes on (RefusalError)."""
        check_scope(scope)
        self.check_idle()
        await self._answer(self._operations.ask(Operation(RESET)), Code.OPERATION_FAILED)

    @property
    def entity(self) -> str:
        """The robot's name as an entity."""
        return self._node.get_fully_qualified_name().lstrip("/")

    async def look(self) -> tuple[Any, int]:
        """The device's state now, and its stamp [ns] (RefusalError: the run has ended)."""
        asked = self._operations.ask(Operation(BETWEEN), work=lambda: self._operations.state)
        return await self._answer(asked, Code.OPERATION_FAILED), self._robot_time.stamp

    async def set_entity_state(self, given: dict[str, float]) -> None:
        """Put the robot into another state (RefusalError)."""
        await self._answer(self._operations.ask(Operation(STATE, parameters=given)), Code.OPERATION_FAILED)

    def begin_steps(self, steps: int, counted: Callable[[int], object] | None = None) -> Request:
        """Ask for samples while robot time stands still; RefusalError when they cannot be taken.

        `counted` is given the number of samples so far after each one, by the stepping thread.
        """
        check_steps(steps)
        self.check_idle()
        if not self._operations.paused:
            raise RefusalError(Code.OPERATION_FAILED, "the robot is not paused; set the state 2 (PAUSED) first")
        self._steps = self._operations.ask(Operation(STEP, steps=steps), counted)
        return self._steps

    async def finish_steps(self, request: Request) -> None:
        """Wait until the samples are taken (RefusalError: fewer were taken)."""
        words = await self._answer(request, Code.OPERATION_FAILED)
        if request.completed < request.operation.steps:
            raise RefusalError(Code.OPERATION_FAILED, words)

    def give_up(self, request: Request) -> None:
        """Take no more of the samples that were asked for; the answer says how many there were."""
        request.given_up = True
        self._operations.woken.set()

    def check_idle(self) -> None:
        """Refuse what cannot be done while steps are taken, or while the robot ends (RefusalError)."""
        if self.quitting:
            raise RefusalError(Code.INCORRECT_STATE, "the robot is about to end")
        if self._steps and not self._steps.done():
            raise RefusalError(Code.INCORRECT_STATE, f"{self._steps.operation.steps} steps are being taken, "
                                                f"{self._steps.completed} so far; wait for their end, or cancel them")

    async def _answer(self, request: Request, failure: Code) -> Any:
        """The words that answer what was asked for (RefusalError with the code of `failure`)."""
        await self._finished(request)
        try:
            return request.result()
        except (ValueError, RuntimeError) as error:
            raise RefusalError(failure, str(error)) from None

    async def _finished(self, request: Request) -> None:
        self.waiting += 1
        try:
            await finished(self._node, request, math.inf)
        finally:
            self.waiting -= 1


def fill_entity_state(message: Any, state: Samples, stamp: int, frame: str) -> None:
    """Place [m] and velocity [m/s] of the body; its accelerations are not known, which is NaN."""
    fill_header(message.header, stamp, frame)
    message.pose.position.x, message.pose.position.z = float(state.body_position), float(state.body_height)
    message.twist.linear.x = float(state.body_velocity)
    message.twist.linear.z = float(state.body_vertical_velocity)
    message.acceleration.linear.x = message.acceleration.linear.z = math.nan


def entity_state_asked(request: Any, entity: str, frame: str) -> dict[str, float]:
    """What a request of SetEntityState gives, by fields of the state; `frame` is that of the odometry.

    RefusalError for another entity or frame, where an empty one means that of the odometry, and for what no body on the
    ground's line can do. Accelerations are ignored.
    """
    check_entity(request.entity, entity)
    if request.state.header.frame_id not in ("", frame):
        raise RefusalError(Code.OPERATION_FAILED, f"header.frame_id: {quoted(request.state.header.frame_id)} is not "
                           f"known; give {frame}")
    pose, twist, given = request.state.pose, request.state.twist, dict[str, float]()
    if request.set_pose:
        turn = pose.orientation
        if pose.position.y or turn.x or turn.y or turn.z or abs(turn.w) != 1.0:
            raise RefusalError(INVALID_POSE, "pose: the body moves along x and z and does not turn; give y = 0 and the "
                               "orientation 0, 0, 0, 1")
        given |= {"body_position": pose.position.x, "body_height": pose.position.z}
    if request.set_twist:
        if any((twist.linear.y, twist.angular.x, twist.angular.y, twist.angular.z)):
            raise RefusalError(Code.OPERATION_FAILED, "twist: the body moves along x and z and does not turn; give 0")
        given |= {"body_velocity": twist.linear.x, "body_vertical_velocity": twist.linear.z}
    if not given:
        raise RefusalError(Code.OPERATION_FAILED, "nothing to set; set set_pose or set_twist")
    return given


def check_entity(asked: str, entity: str) -> None:
    """Refuse another entity than the robot (RefusalError)."""
    if asked != entity:
        raise RefusalError(Code.NOT_FOUND, f"entity: {quoted(asked)} is not here; give {entity}")


def offer_simulation(node: SteadyNode, control: SimulationControl, frame: str) -> None:
    """Offer whatever of `simulation_interfaces` has its type installed; the log says in one line what is left out.

    `frame` is that of the odometry, in which the robot's state as an entity is.
    """
    types = installed_types()
    if missing := [name for name in NAMES if name not in types]:
        lack = f"{PACKAGE} lacks {', '.join(missing)}" if types else f"{PACKAGE} is not installed"
        node.get_logger().info(f"{lack}: without {', '.join(NAMES[name] for name in missing)}")
    group = ReentrantCallbackGroup()  # who waits for steps keeps nobody from being served
    answers = _answers(control, sorted({feature for name in types for feature in FEATURES[name]}), frame)
    for name, kind in types.items():
        if name == "SimulateSteps":
            _offer_steps(node, kind, NAMES[name], control)
        else:
            node.create_service(kind, NAMES[name], answers[name], callback_group=group)


def installed_types(package: str = PACKAGE, names: Iterable[str] = tuple(NAMES)) -> dict[str, Any]:
    """The types of `names` that are installed and can be used, by their names."""
    found = {name: installed_type(package, "action" if name == "SimulateSteps" else "srv", name) for name in names}
    return {name: kind for name, kind in found.items() if kind}


def _answers(control: SimulationControl, features: list[int], frame: str) -> dict[str, Answer]:
    async def features_of(request: Any, response: Any) -> Any:
        response.features.features, response.features.custom_info = features, ABOUT
        return response

    async def entity_of(request: Any, response: Any) -> None:
        check_entity(request.entity, control.entity)
        fill_entity_state(response.state, *await control.look(), frame)

    async def state_of(request: Any, response: Any) -> Any:
        response.state.state, response.result.result = control.state, Code.OK
        return response

    def answering(perform: Callable[[Any, Any], Awaitable[None]]) -> Answer:
        async def answer(request: Any, response: Any) -> Any:
            try:
                await perform(request, response)
                response.result.result = Code.OK
            except RefusalError as refusal:
                response.result.result, response.result.error_message = refusal.code, str(refusal)
            return response

        return answer

    return {
        "GetSimulatorFeatures": features_of,
        "GetSimulationState": state_of,
        "ResetSimulation": answering(lambda request, _: control.reset(request.scope)),
        "SetSimulationState": answering(lambda request, _: control.change_state(request.state.state)),
        "GetEntityState": answering(entity_of),
        "SetEntityState": answering(lambda request, _: control.set_entity_state(
            entity_state_asked(request, control.entity, frame))),
        "StepSimulation": answering(lambda request, _: control.finish_steps(control.begin_steps(request.steps))),
    }


def _offer_steps(node: SteadyNode, kind: Any, name: str, control: SimulationControl) -> None:
    path = node.resolve_service_name(name)
    taken: dict[bytes, Request] = {}  # by goal

    async def execute(goal: ServerGoalHandle) -> Any:
        result, key = kind.Result(), bytes(goal.goal_id.uuid)
        try:
            if goal.is_cancel_requested:
                raise RefusalError(Code.OPERATION_FAILED, "cancelled before the first step")
            taken[key] = control.begin_steps(goal.request.steps, feedback_of(goal))
            await control.finish_steps(taken[key])
            goal.succeed()
            result.result.result = Code.OK
        except RefusalError as refusal:
            goal.canceled() if goal.is_cancel_requested else goal.abort()
            node.refusals.refuse(path, str(refusal))
            result.result.result, result.result.error_message = refusal.code, str(refusal)
        finally:
            taken.pop(key, None)
        return result

    def feedback_of(goal: ServerGoalHandle) -> Callable[[int], None]:
        """Publish feedback for a number of samples; in the stepping thread, which nothing wrong with a goal may end."""
        due = -math.inf

        def publish(completed: int) -> None:
            nonlocal due
            now, remaining = time.monotonic(), goal.request.steps - completed
            if now < due and remaining:
                return
            due = now + FEEDBACK_PERIOD
            try:
                goal.publish_feedback(kind.Feedback(completed_steps=completed, remaining_steps=remaining))
            except Exception as error:
                node.refusals.catch(path, error)

        return publish

    def cancel(goal: ServerGoalHandle) -> CancelResponse:
        if request := taken.get(bytes(goal.goal_id.uuid)):
            control.give_up(request)
        return CancelResponse.ACCEPT

    ActionServer(node, kind, name, execute, cancel_callback=cancel, result_timeout=RESULT_TIMEOUT)
