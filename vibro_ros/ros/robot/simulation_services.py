"""The robot as a simulator: the services and the action of `simulation_interfaces` 2.1.0, with their own constants.

Imported only where that package is installed. A request is answered by the operations of `Run`; what it means, or why
it is refused, is said by pure functions of numbers.
"""

import math
import time
from collections.abc import Awaitable, Callable, Iterable
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from simulation_interfaces.msg import Result, SimulationState, SimulatorFeatures
from simulation_interfaces.srv import ResetSimulation, SetEntityState, SetSimulationState

from vibro_ros.messages.frames import fill_header
from vibro_ros.messages.operations import PAUSE, RESET, RESUME, STATE, Operation
from vibro_ros.model.parameters import quoted
from vibro_ros.ros.node.node import RESULT_TIMEOUT, GuardedNode
from vibro_ros.ros.robot.run import Run, Steps
from vibro_ros.ros.robot.services import finished, installed_types
from vibro_ros.simulation.samples import Samples

PACKAGE = "simulation_interfaces"
ABOUT = ("vibro_ros: a step is one publish period. A reset puts the state back and lets the clock go on; there is "
         "nothing to spawn.")
OFFERED: dict[str, tuple[str, tuple[int, ...]]] = {
    "GetSimulatorFeatures": ("~/get_simulator_features", ()),
    "ResetSimulation": ("~/reset_simulation", (
        SimulatorFeatures.SIMULATION_RESET, SimulatorFeatures.SIMULATION_RESET_STATE)),
    "GetSimulationState": ("~/get_simulation_state", (SimulatorFeatures.SIMULATION_STATE_GETTING,)),
    "SetSimulationState": ("~/set_simulation_state", (
        SimulatorFeatures.SIMULATION_STATE_SETTING, SimulatorFeatures.SIMULATION_STATE_PAUSE)),
    "StepSimulation": ("~/step_simulation", (
        SimulatorFeatures.STEP_SIMULATION_SINGLE, SimulatorFeatures.STEP_SIMULATION_MULTIPLE)),
    "SimulateSteps": ("~/simulate_steps", (
        SimulatorFeatures.STEP_SIMULATION_MULTIPLE, SimulatorFeatures.STEP_SIMULATION_ACTION)),
    "GetEntityState": ("~/get_entity_state", (SimulatorFeatures.ENTITY_STATE_GETTING,)),
    "SetEntityState": ("~/set_entity_state", (SimulatorFeatures.ENTITY_STATE_SETTING,)),
}
"""By type: the name of the service or action, and the features that it brings."""
MOST_STEPS = 100_000
"""Steps that one request may ask for: about 8 minutes of robot time and 0.3 GB of a bag at the default rate."""
FEEDBACK_PERIOD = 0.02
"""Least time [s] between two messages of feedback, the last one aside: no clock holds the steps back."""

STATES = {SimulationState.STATE_STOPPED: "STOPPED", SimulationState.STATE_PLAYING: "PLAYING",
          SimulationState.STATE_PAUSED: "PAUSED", SimulationState.STATE_QUITTING: "QUITTING"}
"""States of this robot; `STOPPED` is paused at its start."""
TRANSITIONS: dict[int, dict[int, tuple[str, ...]]] = {
    SimulationState.STATE_STOPPED: {
        SimulationState.STATE_PLAYING: (RESUME,), SimulationState.STATE_QUITTING: ()},
    SimulationState.STATE_PLAYING: {
        SimulationState.STATE_STOPPED: (PAUSE, RESET), SimulationState.STATE_PAUSED: (PAUSE,),
        SimulationState.STATE_QUITTING: ()},
    SimulationState.STATE_PAUSED: {
        SimulationState.STATE_STOPPED: (RESET,), SimulationState.STATE_PLAYING: (RESUME,),
        SimulationState.STATE_QUITTING: ()},
    SimulationState.STATE_QUITTING: {},
}
"""The operations that lead from a state to another. `STOPPED` to `PAUSED` is the definition's own example of an
incorrect transition: a stopped simulation stands still already."""

Answer = Callable[[Any, Any], Awaitable[Any]]


class RefusalError(ValueError):
    """A request is refused: `code` says why for programs, `words` for people, with the value, the limit and the remedy.

    Any other ValueError or RuntimeError means the code `RESULT_OPERATION_FAILED`.
    """

    def __init__(self, code: int, words: str):
        super().__init__(words)
        self.code = code


def current_state(paused: bool, at_start: bool, quitting: bool) -> int:
    """What a robot is doing."""
    if quitting:
        return SimulationState.STATE_QUITTING
    if not paused:
        return SimulationState.STATE_PLAYING
    return SimulationState.STATE_STOPPED if at_start else SimulationState.STATE_PAUSED


def transition(current: int, wanted: int) -> tuple[str, ...]:
    """The operations that lead from the current state to the one that is wanted.

    Raises
    ------
    RefusalError
        When the number is no state, when it is a state that this robot does not know, when the robot is in it already,
        or when nothing leads there.
    """
    if wanted in (SimulationState.STATE_NO_WORLD, SimulationState.STATE_LOADING_WORLD):
        raise RefusalError(Result.RESULT_FEATURE_UNSUPPORTED, f"{wanted}: a robot is always in its scene; give one of "
                                                              f"{_listed(TRANSITIONS)}")
    if wanted not in STATES:
        raise RefusalError(Result.RESULT_NOT_FOUND, f"{wanted} is no state; give one of {_listed(TRANSITIONS)}")
    if wanted == current:
        raise RefusalError(SetSimulationState.Response.ALREADY_IN_TARGET_STATE,
                           f"the robot is {STATES[current]} already")
    if wanted not in TRANSITIONS[current]:
        reachable = _listed(TRANSITIONS[current]) or "none, because the robot is about to end"
        raise RefusalError(SetSimulationState.Response.INCORRECT_TRANSITION,
                           f"nothing leads from {STATES[current]} to {STATES[wanted]}; from {STATES[current]} these "
                           f"can be reached: {reachable}")
    return TRANSITIONS[current][wanted]


def check_scope(scope: int) -> None:
    """Refuse a reset of something that is not put back, so that nothing is put back by halves (RefusalError).

    Everything, which is `SCOPE_DEFAULT` or `SCOPE_ALL`, means everything that this robot can put back: its state.
    """
    asked = ResetSimulation.Request
    remedy = "give 2 for the state, or 0 for all that can be put back"
    if scope in (asked.SCOPE_DEFAULT, asked.SCOPE_ALL, asked.SCOPE_STATE):
        return
    if unknown := scope & ~(asked.SCOPE_TIME | asked.SCOPE_STATE | asked.SCOPE_SPAWNED):
        raise RefusalError(Result.RESULT_NOT_FOUND, f"scope {scope}: {unknown} is no scope; {remedy}")
    why = "robot time never runs back" if scope & asked.SCOPE_TIME else "this robot spawns nothing"
    raise RefusalError(Result.RESULT_FEATURE_UNSUPPORTED, f"scope {scope}: {why}; {remedy}")


def check_steps(steps: int) -> None:
    """Refuse a number of steps that is 0, or more than one request should take (ValueError)."""
    if not 1 <= steps <= MOST_STEPS:
        raise ValueError(f"{steps} steps; give 1 to {MOST_STEPS}, and ask again for more")


def _listed(states: Iterable[int]) -> str:
    return ", ".join(f"{state} ({STATES[state]})" for state in states)


def entity_state_asked(request: Any, entity: str, frame: str) -> dict[str, float]:
    """What a request of SetEntityState gives, by fields of the state; `frame` is that of the odometry.

    ValueError for another entity or frame, where an empty one means that of the odometry, and for what no body on the
    ground's line can do. Accelerations are ignored.
    """
    check_entity(request.entity, entity)
    if request.state.header.frame_id not in ("", frame):
        raise ValueError(f"header.frame_id: {quoted(request.state.header.frame_id)} is not known; give {frame}")
    pose, twist, given = request.state.pose, request.state.twist, dict[str, float]()
    if request.set_pose:
        turn = pose.orientation
        if pose.position.y or turn.x or turn.y or turn.z or abs(turn.w) != 1.0:
            raise RefusalError(SetEntityState.Response.INVALID_POSE, "pose: the body moves along x and z and does not "
                               "turn; give y = 0 and the orientation 0, 0, 0, 1")
        given |= {"body_position": pose.position.x, "body_height": pose.position.z}
    if request.set_twist:
        if any((twist.linear.y, twist.angular.x, twist.angular.y, twist.angular.z)):
            raise ValueError("twist: the body moves along x and z and does not turn; give 0")
        given |= {"body_velocity": twist.linear.x, "body_vertical_velocity": twist.linear.z}
    if not given:
        raise ValueError("nothing to set; set set_pose or set_twist")
    return given


def check_entity(asked: str, entity: str) -> None:
    """Refuse another entity than the robot (RefusalError)."""
    if asked != entity:
        raise RefusalError(Result.RESULT_NOT_FOUND, f"entity: {quoted(asked)} is not here; give {entity}")


def fill_entity_state(message: Any, state: Samples, stamp: int, frame: str) -> None:
    """Place [m] and velocity [m/s] of the body; its accelerations are not known, which is NaN."""
    fill_header(message.header, stamp, frame)
    message.pose.position.x, message.pose.position.z = float(state.body_position), float(state.body_height)
    message.twist.linear.x = float(state.body_velocity)
    message.twist.linear.z = float(state.body_vertical_velocity)
    message.acceleration.linear.x = message.acceleration.linear.z = math.nan


class SimulationServices:
    """What answers requests of `simulation_interfaces`; for the executor's thread.

    Whatever has its type installed is offered; the log says in one line what is left out. `frame` is that of the
    odometry, in which the robot's state as an entity is. `run.quitting` says whether somebody asked that the robot
    ends.
    """

    def __init__(self, node: GuardedNode, run: Run, frame: str):
        self._node, self._run, self._frame = node, run, frame
        self._entity = node.get_fully_qualified_name().lstrip("/")
        types = installed_types(PACKAGE, OFFERED)
        if missing := [name for name in OFFERED if name not in types]:
            node.get_logger().info(f"{PACKAGE} lacks {', '.join(missing)}: without "
                                   f"{', '.join(OFFERED[name][0] for name in missing)}")
        self._features = sorted({feature for name in types for feature in OFFERED[name][1]})
        answers: dict[str, Answer] = {
            "ResetSimulation": self._reset, "SetSimulationState": self._set_state, "GetEntityState": self._entity_state,
            "SetEntityState": self._set_entity_state, "StepSimulation": self._step}
        group = ReentrantCallbackGroup()  # who waits for steps keeps nobody from being served
        for name, kind in types.items():
            path = OFFERED[name][0]
            if name == "SimulateSteps":
                self._offer_steps(kind, path)
            elif name in answers:
                node.create_service(kind, path, _answering(answers[name]), callback_group=group)
            else:
                node.create_service(kind, path, self._tell_features if name == "GetSimulatorFeatures" else self._tell)

    @property
    def state(self) -> int:
        """What the robot is doing; steps are taken while it is paused."""
        return current_state(self._run.paused, self._run.robot_time.at_start, self._run.quitting)

    def _tell_features(self, request: Any, response: Any) -> Any:
        response.features.features, response.features.custom_info = self._features, ABOUT
        return response

    def _tell(self, request: Any, response: Any) -> Any:
        response.state.state, response.result.result = self.state, Result.RESULT_OK
        return response

    async def _reset(self, request: Any, response: Any) -> None:
        check_scope(request.scope)
        self._check_idle()
        self._run.perform(Operation(RESET))

    async def _set_state(self, request: Any, response: Any) -> None:
        """Bring the robot into another state; ends the steps that are being taken."""
        names = transition(self.state, request.state.state)
        self._run.quitting = request.state.state == SimulationState.STATE_QUITTING
        if not self._run.quitting:
            self._run.end_steps()
        try:
            for name in names:
                self._run.perform(Operation(name))
        except (ValueError, RuntimeError) as error:
            raise RefusalError(SetSimulationState.Response.STATE_TRANSITION_ERROR, str(error)) from None

    async def _entity_state(self, request: Any, response: Any) -> None:
        check_entity(request.entity, self._entity)
        fill_entity_state(response.state, *self._run.look(), self._frame)

    async def _set_entity_state(self, request: Any, response: Any) -> None:
        self._run.perform(Operation(STATE, parameters=entity_state_asked(request, self._entity, self._frame)))

    async def _step(self, request: Any, response: Any) -> None:
        await self._finish(self._begin_steps(request.steps))

    def _begin_steps(self, steps: int, counted: Callable[[int], object] | None = None) -> Steps:
        check_steps(steps)
        self._check_idle()
        if not self._run.paused:
            raise ValueError("the robot is not paused; set the state 2 (PAUSED) first")
        return self._run.begin_steps(steps, counted)

    async def _finish(self, steps: Steps) -> None:
        """Wait until the samples are taken (RuntimeError: fewer were taken)."""
        words = await finished(self._run, steps)
        if steps.completed < steps.asked:
            raise RuntimeError(words)

    def _check_idle(self) -> None:
        """Refuse what cannot be done while steps are taken, or while the robot ends (RefusalError)."""
        if self._run.quitting:
            raise RefusalError(Result.RESULT_INCORRECT_STATE, "the robot is about to end")
        if steps := self._run.steps:
            raise RefusalError(Result.RESULT_INCORRECT_STATE, f"{steps.asked} steps are being taken, "
                               f"{steps.completed} so far; wait for their end, or cancel them")

    def _offer_steps(self, kind: Any, name: str) -> None:
        node, path = self._node, self._node.resolve_service_name(name)
        taken: dict[bytes, Steps] = {}  # by goal

        async def execute(goal: ServerGoalHandle) -> Any:
            result, key = kind.Result(), bytes(goal.goal_id.uuid)
            try:
                if goal.is_cancel_requested:
                    raise RuntimeError("cancelled before the first step")
                taken[key] = self._begin_steps(goal.request.steps, feedback_of(goal))
                await self._finish(taken[key])
                goal.succeed()
                result.result.result = Result.RESULT_OK
            except (ValueError, RuntimeError) as error:
                goal.canceled() if goal.is_cancel_requested else goal.abort()
                node.refusals.refuse(path, str(error))
                _fill_refusal(result.result, error)
            finally:
                taken.pop(key, None)
            return result

        def feedback_of(goal: ServerGoalHandle) -> Callable[[int], None]:
            """Publish feedback for a number of samples; in the stepping thread, which nothing about a goal may end."""
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
            if bytes(goal.goal_id.uuid) in taken:
                self._run.end_steps()
            return CancelResponse.ACCEPT

        ActionServer(node, kind, name, execute, cancel_callback=cancel, result_timeout=RESULT_TIMEOUT)


def _answering(perform: Callable[[Any, Any], Awaitable[None]]) -> Answer:
    """An answer with the result's code and words, of a function that fills the rest or raises why it is refused."""
    async def answer(request: Any, response: Any) -> Any:
        try:
            await perform(request, response)
            response.result.result = Result.RESULT_OK
        except (ValueError, RuntimeError) as error:
            _fill_refusal(response.result, error)
        return response

    return answer


def _fill_refusal(result: Result, error: ValueError | RuntimeError) -> None:
    result.result, result.error_message = getattr(error, "code", Result.RESULT_OPERATION_FAILED), str(error)
