"""The robot as a simulator: its state, and how requests of other programs change it without blocking anybody."""

import math
from collections.abc import Callable

from rclpy.node import Node

from vibro_ros.messages.operations import RESET, STEP, Operation
from vibro_ros.ros.node.requests import Request
from vibro_ros.ros.robot.operations import Operations
from vibro_ros.ros.robot.robot_time import RobotTime
from vibro_ros.ros.robot.run_services import finished
from vibro_ros.ros.robot.simulation_rules import (
    Code,
    RefusalError,
    State,
    check_scope,
    check_steps,
    current_state,
    transition,
)


class SimulationControl:
    """Answers requests in the words of `simulation_rules`; all functions are for the executor's thread.

    What takes long is awaited, so that the executor serves others meanwhile.

    Parameters
    ----------
    node : Node
        Whose executor awaits.
    operations : Operations
        Perform what is asked.
    robot_time : RobotTime
        Knows whether the robot is at its start.

    Attributes
    ----------
    quitting : bool
        Whether somebody asked that the robot ends.
    waiting : int
        Requests whose answer is awaited.
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
        self._check_idle()
        await self._answer(self._operations.ask(Operation(RESET)), Code.OPERATION_FAILED)

    def begin_steps(self, steps: int, counted: Callable[[int], object] | None = None) -> Request:
        """Ask for samples while robot time stands still.

        Parameters
        ----------
        steps : int
            How many.
        counted : callable, optional
            Given the number of samples so far after each one; called by the stepping thread.

        Raises
        ------
        RefusalError
            When they cannot be taken.
        """
        check_steps(steps)
        self._check_idle()
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
        """Take no more of the samples that were asked for; who waits for them is told how many there were."""
        request.give_up()
        self._operations.woken.set()

    def _check_idle(self) -> None:
        if self.quitting:
            raise RefusalError(Code.INCORRECT_STATE, "the robot is about to end")
        if self._steps and not self._steps.done():
            raise RefusalError(Code.INCORRECT_STATE, f"{self._steps.operation.steps} steps are being taken, "
                                                f"{self._steps.completed} so far; wait for their end, or cancel them")

    async def _answer(self, request: Request, failure: Code) -> str:
        """The words that answer what was asked for (RefusalError with the code of `failure`)."""
        await self._finished(request)
        try:
            return request.result()
        except (ValueError, RuntimeError) as error:
            raise RefusalError(failure, str(error)) from None

    async def _finished(self, request: Request) -> None:
        """Wait for the stepping thread's answer, however long it takes."""
        self.waiting += 1
        try:
            await finished(self._node, request, math.inf)
        finally:
            self.waiting -= 1
