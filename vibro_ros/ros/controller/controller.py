"""The `controller` executable: plays a script of commands to the robot, or serves goals of other programs by actions.

The actions `go_to` and `hold_speed` have types of `vibro_ros_interfaces`; their goals mean the same as the entries of a
script and use the same laws. One goal at a time has the motor. Whenever a goal that has commanded the motor ends, the
motor is stopped, because no other program may be in charge of it. Every goal is accepted, so that its result can say in
words what is wrong with it.
"""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.entry_point import enter

    sys.exit(enter("controller"))

import argparse
import math
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Float64

from vibro_ros.configuration.scene_file import find_file, shipped
from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.model.parameters import Parameter, Value, checked_parameters
from vibro_ros.process.entry_point import LAUNCHED, Parser, StopRequest, exit_code
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.ros.controller.commanded_robot import ODOM, OWN_TYPES, CommandedRobot, FaultService, OdometrySubscription
from vibro_ros.ros.controller.feedback import RATE, GoalTracking, check_reach
from vibro_ros.ros.controller.player import (
    ACKNOWLEDGE_TIMEOUT,
    Player,
    ScriptSchedule,
    Timeline,
    timeline,
    topics_without_subscribers,
)
from vibro_ros.ros.controller.script import MOTOR, Script, read_goal, read_script
from vibro_ros.ros.node import process, qos
from vibro_ros.ros.node.arguments import check_addressed, check_arguments, own_arguments
from vibro_ros.ros.node.node import RESULT_TIMEOUT, GuardedNode, NextTurn, installed_type
from vibro_ros.ros.node.parameters import declare, parameter_lines, take_overrides

NODE_NAME = "vibro_controller"
PARAMETERS = (
    Parameter("script", "", "", "script to play when the command line names none: a shipped name or a path"),
    Parameter("wait", 0.0, "s", "longest time to wait until a robot listens to every command of the script; "
              "0 = without end", minimum=0.0, maximum=1e6),
    Parameter("rate", 50.0, "Hz", "commands a second along a ramp", minimum=0.0, maximum=1e4, positive=True),
    Parameter("reach", -0.06, "m/s", "mean speed that the robot holds at most where feedback asks for a speed or a "
              "position; negative for a robot that goes backwards", minimum=-1e3, maximum=1e3),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Play a script. Returns the exit code, which `--help` explains."""
    return exit_code("controller", lambda: _run(argv))


def _run(argv: Sequence[str] | None) -> int:
    words = sys.argv[1:] if argv is None else argv
    arguments = _parser().parse_args(own_arguments(words, PARAMETERS))
    if arguments.serve and arguments.script:
        raise ValueError("--serve: takes goals from other programs, not from a script; leave one of the two out")
    files = check_arguments(words)
    with StopRequest() as stop, process.node_running(NODE_NAME, words) as node:
        check_addressed(files, node.get_fully_qualified_name())
        settings = {parameter.name: parameter.default for parameter in PARAMETERS}
        settings |= checked_parameters(take_overrides(node), PARAMETERS)
        qos.check_overrides(node, COMMAND_UNITS, (ODOM, process.CLOCK))
        settings["script"] = arguments.script or settings["script"]
        declare(node, PARAMETERS, settings)
        if settings["reach"] == 0.0:
            raise ValueError("reach: 0 is out of range; give a mean speed other than 0 m/s, "
                             "negative if the robot goes backwards")
        if arguments.serve:
            return _serve(settings, node, stop)
        path = find_file("script", settings["script"])
        script = read_script(path)
        try:
            check_reach(script.goals, settings["reach"])
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        longest = " at most" if script.goals else ""
        node.get_logger().info(f"script {path}: {script.duration:g} s{longest}, {', '.join(script.commands)}")
        return _play(script, settings, node, stop)


def _play(script: Script, settings: Mapping[str, Value], node: GuardedNode, stop: StopRequest) -> int:
    publishers = {name: node.create_publisher(Float64, name, qos.profile(name)) for name in script.commands}
    robot = CommandedRobot(node, publishers[script.commands[0]])
    faults = FaultService(node, robot) if script.needs_faults else None

    def prepare() -> None:
        robot.wait(stop)
        if stop:
            return
        check_limits(script, str(settings["script"]), robot)
        if faults:
            faults.wait(stop)

    def meanwhile(_: float) -> None:
        robot.tick()
        if faults:
            faults.check()

    def send(name: str, value: float) -> None:
        robot.note(name, value)
        player.send(name, value)

    player = Player(node, publishers, meanwhile, prepare)
    odometer = OdometrySubscription(node) if script.goals else None
    schedule = ScriptSchedule(script, settings["reach"], odometer, send, node.get_logger().info, robot, faults)
    code = player.run(schedule.instants(settings["rate"]), settings["wait"], stop)
    if not (code or stop):
        _say_what_still_runs(node, robot)
    return code


def _serve(settings: Mapping[str, Value], node: GuardedNode, stop: StopRequest) -> int:
    """Serve the goals of other programs until a signal comes."""
    types = action_types()
    publisher = node.create_publisher(Float64, MOTOR, qos.profile(MOTOR))
    stop.hold()  # the motor must be told to stop
    server = GoalServer(node, types, CommandedRobot(node, publisher), publisher, timeline(node), settings["reach"])
    node.get_logger().info("ready: actions " + ", ".join(map(node.resolve_service_name, NAMES.values())))
    process.spin_until(node, lambda: bool(stop))
    server.ending = True
    over = time.monotonic() + ACKNOWLEDGE_TIMEOUT * server.busy  # time for the goal's sender to get its result
    process.spin_until(node, lambda: time.monotonic() >= over)
    publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_TIMEOUT))
    return 0


def check_limits(script: Script, file: str, robot: CommandedRobot) -> None:
    """Refuse a script, read from `file`, with a command that the robot would refuse.

    ValueError: the message names the entry, the topic, the limit and the robot.
    """
    for segment in script.segments:
        values = [(name, value) for name in segment.given
                  for value in (segment.ramps[name].start, segment.ramps[name].end)]
        if segment.goal:
            values.append((MOTOR, segment.goal.motor[1]))
        for name, value in values:
            if reason := robot.refusal(name, value):
                raise ValueError(f"{file}: entry {segment.entry}: {reason}")


def _say_what_still_runs(node: Node, robot: CommandedRobot) -> None:
    topic, speed, log = node.resolve_topic_name(MOTOR), robot.sent_speed, node.get_logger()
    if speed is None:
        log.info(f"script done; it has not commanded {topic}, where the motor stays as it was")
    elif not speed:
        log.info(f"script done; {topic} is at 0 rad/s, so that the motor stops")
    elif timeout := robot.timeout:
        log.info(f"script done; {topic} is at {speed:g} rad/s, and command.timeout of {robot.name} stops the motor in "
                 f"{timeout:g} s")
    else:
        log.warning(f"script done, and the motor goes on: {topic} stays at {speed:g} rad/s until another command "
                    f"comes; stop it by the page of `view{robot.name and f' --robot {robot.name}'}`, or by "
                    "a script that ends with motor_speed: 0.0")


def _parser() -> Parser:
    parser = Parser(
        prog="controller",
        description=f"{EXECUTABLES['controller'].does} Shipped scripts: " + ", ".join(shipped("script")),
        epilog="ROS parameters (--ros-args -p name:=value):\n"
        + parameter_lines(PARAMETERS, {parameter.name: parameter.default for parameter in PARAMETERS})
        + "\n\nExit code 0: played to the end, or --serve ended by a signal; 1: no robot, or two, it went\n"
        "away or refuses a command, /clock jumped back, or a speed or a position was not held or reached, with the\n"
        "motor told to stop; 2: bad script or parameter, out of reach, or beyond the robot's limits;\n"
        "129, 130, 143: aborted by SIGHUP, SIGINT or SIGTERM, and the motor told to stop.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("script", nargs="?", help="a shipped script's name, or the path of a YAML file")
    parser.add_argument("--serve", action="store_true", help="offer the actions go_to and hold_speed to other "
                        "programs, until a signal, instead of playing a script")
    parser.add_argument(LAUNCHED, action="store_true", help="exit code 0 after a signal, for launch files, which "
                        "report any other code as a process that has died")
    return parser


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
