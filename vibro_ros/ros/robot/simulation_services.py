"""The robot as a simulator: the services and the action of `simulation_interfaces` 2.1.0, with its own constants.

Imported only where that package is installed. Methods of `RobotRun` carry out the requests; pure functions decide what
a request means, or why it is refused.
"""

import math
import re
import time
from collections.abc import Awaitable, Callable, Iterable
from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from simulation_interfaces.msg import EntityCategory, EntityState, Result, SimulationState, SimulatorFeatures
from simulation_interfaces.srv import ResetSimulation, SetEntityState, SetSimulationState

from vibro_ros.messages.frames import fill_header
from vibro_ros.messages.operations import PAUSE, RESET, RESUME, STATE, Operation
from vibro_ros.model.parameters import quoted
from vibro_ros.ros.node.node import GuardedNode
from vibro_ros.ros.robot.run import RobotRun, Steps
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
    "GetEntities": ("~/get_entities", ()),
    "GetEntitiesStates": ("~/get_entities_states", ()),
    "GetEntityInfo": ("~/get_entity_info", (
        SimulatorFeatures.ENTITY_CATEGORIES, SimulatorFeatures.ENTITY_INFO_GETTING)),
    "GetEntityState": ("~/get_entity_state", (SimulatorFeatures.ENTITY_STATE_GETTING,)),
    "SetEntityState": ("~/set_entity_state", (SimulatorFeatures.ENTITY_STATE_SETTING,)),
}
"""For each type: the name of the service or action, and the features that it brings."""
LONGEST_FILTER, MOST_QUANTIFIERS = 64, 4
"""Longest regular expression of a peer, and most quantifiers in it, without groups: others can take for ever."""
MOST_STEPS = 100_000  # most steps of one request: about 8 minutes of robot time and 0.3 GB of a bag at the default rate
RESULT_TIMEOUT = 60
"""Time [s] for which the result of a finished goal is kept for its sender; it takes memory until then."""
FEEDBACK_PERIOD = 0.02
"""Least time [s] between two messages of feedback, except the last, because steps run as fast as they can."""

STATES = {SimulationState.STATE_STOPPED: "STOPPED", SimulationState.STATE_PLAYING: "PLAYING",
          SimulationState.STATE_PAUSED: "PAUSED", SimulationState.STATE_QUITTING: "QUITTING"}
"""States of this robot; `STOPPED` means paused at its start."""
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
"""The operations that lead from one state to another. `STOPPED` to `PAUSED` is missing: it is the example of an
incorrect transition in the definition of simulation_interfaces, because a stopped simulation stands still already."""


class RefusalError(ValueError):
    """Refusal of a request: `code` is the reason for programs, `words` that for people, with value, limit and remedy.

    Any other ValueError or RuntimeError is answered with the code `RESULT_OPERATION_FAILED`.
    """

    def __init__(self, code: int, words: str):
        super().__init__(words)
        self.code = code


def transition(current: int, wanted: int) -> tuple[str, ...]:
    """Return the operations that lead from the current state to the wanted one (RefusalError if none do)."""
    if wanted in (SimulationState.STATE_NO_WORLD, SimulationState.STATE_LOADING_WORLD):
        raise RefusalError(Result.RESULT_FEATURE_UNSUPPORTED, f"{wanted}: a robot is always in its scene; give one of "
                                                              f"{_state_list(TRANSITIONS)}")
    if wanted not in STATES:
        raise RefusalError(Result.RESULT_NOT_FOUND, f"{wanted} is no state; give one of {_state_list(TRANSITIONS)}")
    if wanted == current:
        raise RefusalError(SetSimulationState.Response.ALREADY_IN_TARGET_STATE,
                           f"the robot is {STATES[current]} already")
    if wanted not in TRANSITIONS[current]:
        reachable = _state_list(TRANSITIONS[current]) or "none, because the robot is about to end"
        raise RefusalError(SetSimulationState.Response.INCORRECT_TRANSITION,
                           f"nothing leads from {STATES[current]} to {STATES[wanted]}; from {STATES[current]} these "
                           f"can be reached: {reachable}")
    return TRANSITIONS[current][wanted]


def check_scope(scope: int) -> None:
    """Refuse a reset that includes what this robot cannot reset, so that no reset is partial (RefusalError).

    `SCOPE_DEFAULT` and `SCOPE_ALL` mean everything that this robot can reset: its state.
    """
    scopes = ResetSimulation.Request
    remedy = "give 2 for the state, or 0 for all that can be put back"
    if scope in (scopes.SCOPE_DEFAULT, scopes.SCOPE_ALL, scopes.SCOPE_STATE):
        return
    if unknown := scope & ~(scopes.SCOPE_TIME | scopes.SCOPE_STATE | scopes.SCOPE_SPAWNED):
        raise RefusalError(Result.RESULT_NOT_FOUND, f"scope {scope}: {unknown} is no scope; {remedy}")
    why = "robot time never runs back" if scope & scopes.SCOPE_TIME else "this robot spawns nothing"
    raise RefusalError(Result.RESULT_FEATURE_UNSUPPORTED, f"scope {scope}: {why}; {remedy}")


def _state_list(states: Iterable[int]) -> str:
    return ", ".join(f"{state} ({STATES[state]})" for state in states)


def requested_entity_state(request: Any, entity: str, frame: str) -> dict[str, float]:
    """Return the state in a request of SetEntityState, by fields of the device's state; `frame` is that of odometry.

    An empty frame in the request means `frame`. ValueError for another entity or frame, and for a pose or twist that
    leaves the plane of motion or turns the body. Accelerations are ignored.
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
    """Refuse any entity other than the robot (RefusalError)."""
    if asked != entity:
        raise RefusalError(Result.RESULT_NOT_FOUND, f"entity: {quoted(asked)} is not here; give {entity}")


def is_chosen(filters: Any, entity: str) -> bool:
    """Return whether the filters of a request choose the robot, which has no tags (RefusalError for bounds)."""
    if filters.bounds.type or len(filters.bounds.points):
        raise RefusalError(Result.RESULT_FEATURE_UNSUPPORTED, "bounds: this robot has none; leave them empty")
    text = filters.filter
    if "(" in text or len(text) > LONGEST_FILTER or sum(map(text.count, "*+?{")) > MOST_QUANTIFIERS:
        raise RefusalError(Result.RESULT_FEATURE_UNSUPPORTED, f"filter: {quoted(text)} could take long; give at most "
                           f"{LONGEST_FILTER} characters with {MOST_QUANTIFIERS} quantifiers and no group")
    try:
        is_named = re.search(text, entity) is not None
    except (re.error, OverflowError) as error:
        raise ValueError(f"filter: {quoted(text)} is no regular expression: {error}; leave it empty for all") from None
    categories = [category.category for category in filters.categories]
    return is_named and not filters.tags.tags and (not categories or EntityCategory.CATEGORY_ROBOT in categories)


def fill_entity_state(message: Any, state: Samples, stamp: int, frame: str) -> None:
    """Fill in position [m] and velocity [m/s] of the body; its accelerations are not known: NaN."""
    fill_header(message.header, stamp, frame)
    message.pose.position.x, message.pose.position.z = float(state.body_position), float(state.body_height)
    message.twist.linear.x = float(state.body_velocity)
    message.twist.linear.z = float(state.body_vertical_velocity)
    message.acceleration.linear.x = message.acceleration.linear.z = math.nan


class SimulationServices:
    """Servers of the services and the action of `simulation_interfaces`; used in the executor's thread.

    Those with installed types are offered; the log names the others in one line. `frame` is the frame of odometry, in
    which the robot's state as an entity is given.
    """

    def __init__(self, node: GuardedNode, run: RobotRun, frame: str):
        self._node, self._run, self._frame = node, run, frame
        self._entity = node.get_fully_qualified_name().lstrip("/")
        types = installed_types(PACKAGE, OFFERED)
        if missing := [name for name in OFFERED if name not in types]:
            node.get_logger().info(f"{PACKAGE} lacks {', '.join(missing)}: without "
                                   f"{', '.join(OFFERED[name][0] for name in missing)}")
        self._features = sorted({feature for name in types for feature in OFFERED[name][1]})
        acts = {"GetSimulatorFeatures": self._get_features, "ResetSimulation": self._reset,
                "GetSimulationState": self._get_state, "SetSimulationState": self._set_state,
                "StepSimulation": self._step, "GetEntities": self._entities,
                "GetEntitiesStates": self._entities_states, "GetEntityInfo": self._entity_info,
                "GetEntityState": self._entity_state, "SetEntityState": self._set_entity_state}
        group = ReentrantCallbackGroup()  # so that others are served while one waits for steps
        for name, kind in types.items():
            path, _ = OFFERED[name]
            if name in acts:
                node.create_service(kind, path, partial(_answer, acts[name]), callback_group=group)
            else:
                self._offer_steps(kind, path)

    @property
    def state(self) -> int:
        """State of the simulation, one of `STATES`; a robot that takes steps is paused."""
        if self._run.is_ending:
            return SimulationState.STATE_QUITTING
        if not self._run.paused:
            return SimulationState.STATE_PLAYING
        return SimulationState.STATE_STOPPED if self._run.robot_time.at_start else SimulationState.STATE_PAUSED

    async def _get_features(self, request: Any, response: Any) -> None:
        response.features.features, response.features.custom_info = self._features, ABOUT

    async def _get_state(self, request: Any, response: Any) -> None:
        response.state.state = self.state

    async def _reset(self, request: Any, response: Any) -> None:
        check_scope(request.scope)
        self._check_idle()
        self._run.reset()

    async def _set_state(self, request: Any, response: Any) -> None:
        """Bring the robot into another state; steps that are being taken end."""
        names = transition(self.state, request.state.state)
        if request.state.state == SimulationState.STATE_QUITTING:
            self._run.end()
            return
        self._run.end_steps()
        perform = {PAUSE: self._run.pause, RESUME: self._run.resume, RESET: self._run.reset}
        try:
            for name in names:
                perform[name]()
        except (ValueError, RuntimeError) as error:
            raise RefusalError(SetSimulationState.Response.STATE_TRANSITION_ERROR, str(error)) from None

    async def _entities(self, request: Any, response: Any) -> None:
        response.entities = [self._entity] * is_chosen(request.filters, self._entity)

    async def _entities_states(self, request: Any, response: Any) -> None:
        await self._entities(request, response)
        state, stamp = self._run.stamped_state()
        response.states = [EntityState() for _ in response.entities]
        for message in response.states:
            fill_entity_state(message, state, stamp, self._frame)

    async def _entity_info(self, request: Any, response: Any) -> None:
        check_entity(request.entity, self._entity)
        response.info.category.category = EntityCategory.CATEGORY_ROBOT
        response.info.description = f"vibro-impact robot, scene {self._run.device.scene.name}"

    async def _entity_state(self, request: Any, response: Any) -> None:
        check_entity(request.entity, self._entity)
        fill_entity_state(response.state, *self._run.stamped_state(), self._frame)

    async def _set_entity_state(self, request: Any, response: Any) -> None:
        self._run.disturb(Operation(STATE, parameters=requested_entity_state(request, self._entity, self._frame)))

    async def _step(self, request: Any, response: Any) -> None:
        await self._finish(self._begin_steps(request.steps))

    def _begin_steps(self, count: int, on_step: Callable[[int], object] | None = None) -> Steps:
        if not 1 <= count <= MOST_STEPS:
            raise ValueError(f"{count} steps; give 1 to {MOST_STEPS}, and ask again for more")
        self._check_idle()
        if not self._run.paused:
            raise ValueError("the robot is not paused; set the state 2 (PAUSED) first")
        return self._run.begin_steps(count, on_step)

    async def _finish(self, steps: Steps) -> None:
        """Wait until all samples are taken (RuntimeError if fewer were taken)."""
        words = await finished(self._run, steps)
        if steps.completed < steps.asked:
            raise RuntimeError(words)

    def _check_idle(self) -> None:
        """Refuse a request while steps are taken, or while the robot ends (RefusalError)."""
        if self._run.is_ending:
            raise RefusalError(Result.RESULT_INCORRECT_STATE, "the robot is about to end")
        if steps := self._run.steps:
            raise RefusalError(Result.RESULT_INCORRECT_STATE, f"{steps.asked} steps are being taken, "
                               f"{steps.completed} so far; wait for their end, or cancel them")

    def _offer_steps(self, kind: Any, name: str) -> None:
        node, path = self._node, self._node.resolve_service_name(name)
        steps_of_goal: dict[bytes, Steps] = {}

        async def execute(goal: ServerGoalHandle) -> Any:
            result, key = kind.Result(), bytes(goal.goal_id.uuid)
            try:
                if goal.is_cancel_requested:
                    raise RuntimeError("cancelled before the first step")
                on_step = _feedback(goal, kind.Feedback, partial(node.refusals.catch, path))
                steps_of_goal[key] = self._begin_steps(goal.request.steps, on_step)
                await self._finish(steps_of_goal[key])
                goal.succeed()
                result.result.result = Result.RESULT_OK
            except (ValueError, RuntimeError) as error:
                goal.canceled() if goal.is_cancel_requested else goal.abort()
                node.refusals.refuse(path, str(error))
                result.result.result = getattr(error, "code", Result.RESULT_OPERATION_FAILED)
                result.result.error_message = str(error)
            finally:
                steps_of_goal.pop(key, None)
            return result

        def cancel(goal: ServerGoalHandle) -> CancelResponse:
            if bytes(goal.goal_id.uuid) in steps_of_goal:
                self._run.end_steps()
            return CancelResponse.ACCEPT

        ActionServer(node, kind, name, execute, cancel_callback=cancel, result_timeout=RESULT_TIMEOUT)


def _feedback(goal: ServerGoalHandle, kind: Any, catch: Callable[[Exception], object]) -> Callable[[int], None]:
    """Return a function that publishes feedback on a number of completed steps; it passes errors to `catch`, because
    the stepping thread calls it."""
    due = -math.inf

    def publish(completed: int) -> None:
        nonlocal due
        now, remaining = time.monotonic(), goal.request.steps - completed
        if now < due and remaining:
            return
        due = now + FEEDBACK_PERIOD
        try:
            goal.publish_feedback(kind(completed_steps=completed, remaining_steps=remaining))
        except Exception as error:
            catch(error)

    return publish


async def _answer(act: Callable[[Any, Any], Awaitable[None]], request: Any, response: Any) -> Any:
    """Return the response to a request, which `act` fills in, or refuses by an error."""
    await act(request, response)
    if hasattr(response, "result"):
        response.result.result = Result.RESULT_OK
    return response
