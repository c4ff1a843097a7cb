"""The `controller` executable: plays a script of commands to the robot."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    from vibro_ros.process.entry_point import enter

    raise SystemExit(enter("controller"))

import argparse
import sys
from collections.abc import Mapping, Sequence

from rclpy.node import Node
from std_msgs.msg import Float64

from vibro_ros.configuration.scene_file import find_file, shipped
from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.model.parameters import Parameter, Value, checked_parameters
from vibro_ros.process.entry_point import LAUNCHED, Parser, StopRequest, exit_code
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.ros.controller.commanded_robot import ODOM, CommandedRobot, FaultService, OdometrySubscription
from vibro_ros.ros.controller.feedback import check_reach
from vibro_ros.ros.controller.player import Player, ScriptSchedule
from vibro_ros.ros.controller.script import MOTOR, Script, read_script
from vibro_ros.ros.node import process
from vibro_ros.ros.node.arguments import check_addressed, check_arguments, own_arguments
from vibro_ros.ros.node.node import GuardedNode, check_qos_overrides, qos_profile
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
    files = check_arguments(words)
    with StopRequest() as stop, process.node_running(NODE_NAME, words) as node:
        check_addressed(files, node.get_fully_qualified_name())
        settings = {parameter.name: parameter.default for parameter in PARAMETERS}
        settings |= checked_parameters(take_overrides(node), PARAMETERS)
        check_qos_overrides(node, COMMAND_UNITS, (ODOM, process.CLOCK))
        settings["script"] = arguments.script or settings["script"]
        declare(node, PARAMETERS, settings)
        if settings["reach"] == 0.0:
            raise ValueError("reach: 0 is out of range; give a mean speed other than 0 m/s, "
                             "negative if the robot goes backwards")
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
    publishers = {name: node.create_publisher(Float64, name, qos_profile(name)) for name in script.commands}
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
        _report_motor(node, robot)
    return code


def check_limits(script: Script, file: str, robot: CommandedRobot) -> None:
    """Refuse a script, read from `file`, with a command that the robot would refuse (ValueError)."""
    for segment in script.segments:
        values = [(name, value) for name in segment.given
                  for value in (segment.ramps[name].start, segment.ramps[name].end)]
        if segment.goal:
            values.append((MOTOR, segment.goal.motor[1]))
        for name, value in values:
            if reason := robot.refusal(name, value):
                raise ValueError(f"{file}: entry {segment.entry}: {reason}")


def _report_motor(node: Node, robot: CommandedRobot) -> None:
    """Log at which speed a script that was played to its end leaves the motor."""
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
        + "\n\nExit code 0: played to the end; 1: no robot, or two, it went away or refuses a command, /clock\n"
        "jumped back, or a speed or a position was not held or reached, with the motor told to stop;\n"
        "2: bad script or parameter, out of reach, or beyond the robot's limits;\n"
        "129, 130, 143: aborted by SIGHUP, SIGINT or SIGTERM, and the motor told to stop.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("script", nargs="?", help="a shipped script's name, or the path of a YAML file")
    parser.add_argument(LAUNCHED, action="store_true", help="exit code 0 after a signal, for launch files, which "
                        "report any other code as a process that has died")
    return parser
