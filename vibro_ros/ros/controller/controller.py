"""The `controller` executable: plays a script of commands to the robot, from another process."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("controller"))

import argparse
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from rclpy.executors import Executor
from rclpy.node import Node
from std_msgs.msg import Float64

from vibro_ros.configuration.command_map import CommandMap, find_map, read_map, shipped_maps
from vibro_ros.model.parameters import Parameter, Value, checked_parameters
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import Parser, exit_code
from vibro_ros.process.stop_signals import StopRequest
from vibro_ros.ros.controller.goals import check_reach
from vibro_ros.ros.controller.map_adviser import MapAdviser
from vibro_ros.ros.controller.player import Player
from vibro_ros.ros.controller.script import MOTOR, Script
from vibro_ros.ros.controller.script_file import find_script, read_script, shipped_scripts
from vibro_ros.ros.controller.script_player import Odometer, ScriptPlayer
from vibro_ros.ros.controller.timeline import timeline
from vibro_ros.ros.node import process
from vibro_ros.ros.node.parameters import declare, parameter_lines, take_overrides
from vibro_ros.ros.node.qos import COMMANDS
from vibro_ros.ros.node.ros_arguments import check_addressed, check_arguments, own_arguments

NODE_NAME = "vibro_controller"
PARAMETERS = (
    Parameter("script", "", "", "script to play when the command line names none: a shipped name or a path"),
    Parameter("wait", 0.0, "s", "longest time to wait until a robot listens to every command of the script; "
              "0 = without end", minimum=0.0, maximum=1e6),
    Parameter("rate", 50.0, "Hz", "commands a second along a ramp", minimum=0.0, maximum=1e4, positive=True),
    Parameter("reach", -0.06, "m/s", "mean speed that the robot holds at most where feedback asks for a speed or a "
              "position; negative for a robot that goes backwards", minimum=-1e3, maximum=1e3),
    Parameter("map", "device", "", "command map, a shipped scene's name or a path: gives the commands for a speed over "
              "ground, and says when commands cross into another motion, if it is the robot's"),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Play a script.

    Returns
    -------
    int
        0 when done; 1 when it failed, as without a robot; 2 for bad input; 128 + the signal's number when aborted.
    """
    return exit_code("controller", lambda: _run(argv))


def _run(argv: Sequence[str] | None) -> int:
    words = sys.argv[1:] if argv is None else argv
    arguments = _parser().parse_args(own_arguments(words))
    files = check_arguments(words)
    with StopRequest() as stop, process.node_running(NODE_NAME, words) as (node, executor):
        check_addressed(files, node.get_fully_qualified_name())
        settings = {parameter.name: parameter.default for parameter in PARAMETERS}
        settings |= checked_parameters(take_overrides(node), PARAMETERS)
        settings["script"] = arguments.script or settings["script"]
        declare(node, PARAMETERS, settings)
        path = find_script(settings["script"])
        map_path = find_map(settings["map"])
        command_map = read_map(map_path)
        script = read_script(path, command_map)
        _check_goals(path, script, settings["reach"])
        longest = " at most" if script.goals else ""
        node.get_logger().info(f"script {path}: {script.duration:g} s{longest}, {', '.join(script.commands)}")
        return _play(script, (command_map, map_path), settings, node, executor, stop)


def _check_goals(path: Path, script: Script, reach: float) -> None:
    """Refuse what the robot cannot reach before anything is sent."""
    if reach == 0.0:
        raise ValueError("reach: 0 is out of range; give a mean speed other than 0 m/s, "
                         "negative if the robot goes backwards")
    try:
        check_reach(script.goals, reach)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _play(script: Script, known: tuple[CommandMap, Path], settings: Mapping[str, Value], node: Node, executor: Executor,
          stop: StopRequest) -> int:
    publishers = {name: node.create_publisher(Float64, name, COMMANDS) for name in script.commands}
    adviser = MapAdviser(node, *known, publishers[script.commands[0]])
    prepare = partial(adviser.require, executor) if script.needs_map else lambda stop: None
    player = Player(node, executor, publishers, script.commands, MOTOR, lambda elapsed: adviser.tick(), prepare=prepare,
                    timeline=timeline(node))
    odometer = Odometer(node) if script.goals else None
    played = ScriptPlayer(script, settings["reach"], odometer, player.send, node.get_logger().info, adviser.advise)
    code = player.run(played.moments(settings["rate"]), settings["wait"], stop)
    if not code:
        node.get_logger().info("script done")
    return code


def _parser() -> Parser:
    parser = Parser(
        prog="controller",
        description=f"{EXECUTABLES['controller'].does} Shipped scripts: " + ", ".join(shipped_scripts())
        + "; maps: " + ", ".join(shipped_maps()),
        epilog="ROS parameters (--ros-args -p name:=value):\n"
        + parameter_lines(PARAMETERS, {parameter.name: parameter.default for parameter in PARAMETERS})
        + "\n\nExit code 0: played to the end; 1: no robot, it is not that of the map, it went away, /clock jumped\n"
        "back, or a speed or a position was not held or reached, with the motor told to stop; 2: bad script,\n"
        "parameter or map, or out of reach;\n"
        "129, 130, 143: aborted by SIGHUP, SIGINT or SIGTERM, and the motor told to stop.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("script", nargs="?", help="a shipped script's name, or the path of a YAML file")
    return parser
