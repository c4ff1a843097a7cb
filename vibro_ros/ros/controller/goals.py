"""`controller --serve`: actions by which other programs set a position or a mean speed as a goal.

The actions `go_to` and `hold_speed` have types of `vibro_ros_interfaces`; their goals mean the same as the entries of a
script and use the same laws. One goal at a time has the motor. Whenever a goal that has commanded the motor ends, the
motor is stopped, because no other program may be in charge of it. Every goal is accepted, so that its result can say in
words what is wrong with it.
"""

import math
from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.publisher import Publisher
from std_msgs.msg import Float64

from vibro_ros.ros.controller.commanded_robot import OWN_TYPES, CommandedRobot, OdometrySubscription
from vibro_ros.ros.controller.feedback import RATE, GoalTracking, check_reach
from vibro_ros.ros.controller.player import Timeline, topics_without_subscribers
from vibro_ros.ros.controller.script import MOTOR, read_goal
from vibro_ros.ros.node.node import RESULT_TIMEOUT, GuardedNode, NextTurn, installed_type

NAMES = {"GoTo": "go_to", "HoldSpeed": "hold_speed"}
"""Name of each action, by its type."""


def action_types() -> dict[str, Any]:
    """Return the types of the actions (ValueError if they are not installed)."""
    types = {name: installed_type(OWN_TYPES, "action", name) for name in NAMES}
    if not all(types.values()):
        raise ValueError(f"--serve: {OWN_TYPES} is not installed, so there are no actions; `make setup` builds it "
                         "where there is a C++ compiler, and colcon from the folder interfaces")
    return types


class _CancelledError(Exception):
    """The goal's sender has cancelled it."""


class GoalServer:
    """Action servers of `types`; used in the executor's thread.

    `time` measures the time of a goal; `reach` is the largest mean speed [m/s] that the robot holds, with the sign of
    its direction. `busy` says whether a goal is being pursued; the caller sets `ending` to end it.
    """

    def __init__(self, node: GuardedNode, types: dict[str, Any], robot: CommandedRobot, publisher: Publisher,
                 time: Timeline, reach: float):
        self.busy = self.ending = self._moved = False
        self._node, self._robot, self._publisher = node, robot, publisher
        self._time, self._reach, self._odometer = time, reach, OdometrySubscription(node)
        for kind, name in NAMES.items():
            ActionServer(node, types[kind], name, partial(self._execute, types[kind], name),
                         cancel_callback=lambda _: CancelResponse.ACCEPT, result_timeout=RESULT_TIMEOUT)

    async def _execute(self, kind: Any, name: str, handle: ServerGoalHandle) -> Any:
        result, path = kind.Result(), self._node.resolve_service_name(name)
        if self.busy:
            result.message = "another goal is being pursued; cancel it, or wait for its end"
            self._node.refusals.refuse(path, result.message)
            handle.abort()
            return result
        self.busy, self._moved = True, False
        try:
            result.message = await self._pursue(kind, name, handle)
            handle.succeed()
        except _CancelledError:
            result.message = "cancelled"
            handle.canceled()
        except (ValueError, RuntimeError) as error:
            result.message = str(error).removeprefix(f"entry {name}: ")
            self._node.refusals.refuse(path, result.message)
            handle.abort()
        except Exception as error:  # whatever it is, the caller waits for a result
            result.message = f"{type(error).__name__}; the node's log says more"
            self._node.refusals.catch(path, error)
            handle.abort()
        finally:
            if self._moved:
                self._publisher.publish(Float64(data=0.0))
            self.busy = False
        result.position = self._position()
        self._node.get_logger().info(f"{path}: {result.message}{'; the motor is told to stop' * self._moved}")
        return result

    async def _pursue(self, kind: Any, name: str, handle: ServerGoalHandle) -> str:
        """Pursue a goal to its end and return in words what was reached.

        ValueError for an invalid goal, or one that the robot cannot reach. RuntimeError when the goal was missed, or no
        robot is there. _CancelledError when the goal was cancelled.
        """
        duration, goal = read_goal(_entry(name, handle.request))
        check_reach([(name, goal)], self._reach)
        await self._ask_robot(handle)
        if reason := self._robot.refusal(MOTOR, goal.motor[1]):
            raise ValueError(reason)
        self._node.get_logger().info(f"{goal.describe()}, {duration:g} s")
        self._odometer.restart()
        self._time.begin()
        tracking = GoalTracking(goal, 0.0, duration, self._reach, self._odometer.mean)
        words, speed, due = "", 0.0, 0.0
        while not tracking.over:
            self._check(handle)
            if (elapsed := self._time.elapsed()) < due:
                await NextTurn()
                continue
            due = (math.floor(elapsed * RATE) + 1) / RATE
            self._odometer.read(elapsed)
            given = tracking.motor_speed(elapsed)
            for words in tracking.take_words():
                self._node.get_logger().info(f"{name}: {words}")
            if given is not None:
                speed = given
                self._robot.note(MOTOR, speed)
                self._publisher.publish(Float64(data=speed))
                self._moved = True
            handle.publish_feedback(kind.Feedback(elapsed=elapsed, position=self._position(), motor_speed=speed))
        return words

    async def _ask_robot(self, handle: ServerGoalHandle) -> None:
        """Wait until the robot has answered with its limits, which may have changed since the previous goal."""
        self._robot.ask_again()
        while not self._robot.answered:
            self._check(handle)
            await NextTurn()
        if topics := topics_without_subscribers([self._publisher]):
            raise RuntimeError(f"nobody listens to {', '.join(topics)}; start a robot")

    def _check(self, handle: ServerGoalHandle) -> None:
        """Raise if the goal must not be pursued any more."""
        if handle.is_cancel_requested:
            raise _CancelledError
        if self.ending:
            raise RuntimeError("the controller ends")
        if self._robot.settings and topics_without_subscribers([self._publisher]):
            raise RuntimeError(f"{self._robot} is gone")
        self._robot.tick()

    def _position(self) -> float:
        """Return the mean position [m] of the body; NaN before the first sample of odometry."""
        position = self._odometer.mean.position
        return math.nan if position is None else position


def _entry(name: str, goal: Any) -> dict[str, object]:
    """Return a goal as an entry of a script; a field that is 0 gets the script's default."""
    entry: dict[str, object] = {"go_to": goal.position, "timeout": goal.timeout} if name == "go_to" else {
        "hold_speed": goal.speed, "for": goal.duration}
    if goal.within:
        entry["within"] = goal.within
    if goal.motor_from or goal.motor_to:
        entry["motor_speed"] = {"from": goal.motor_from, "to": goal.motor_to}
    return entry
