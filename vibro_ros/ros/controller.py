"""The `controller` executable: plays a script of commands to the robot, from another process."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("controller"))

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import chain

from rclpy.executors import Executor
from rclpy.node import Node
from std_msgs.msg import Float64

from vibro_ros.model.parameters import Parameter, Value, checked_parameters
from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code
from vibro_ros.process.stop_signals import StopRequest
from vibro_ros.ros import process
from vibro_ros.ros.parameters import declare, parameter_lines, take_overrides
from vibro_ros.ros.player import Moments, Player
from vibro_ros.ros.qos import COMMANDS
from vibro_ros.ros.ros_arguments import check_addressed, check_arguments, own_arguments
from vibro_ros.ros.script import Script, Segment
from vibro_ros.ros.script_file import find_script, read_script, shipped_scripts

NODE_NAME = "vibro_controller"
PARAMETERS = (
    Parameter("script", "", "", "script to play when the command line names none: a shipped name or a path"),
    Parameter("wait", 0.0, "s", "longest time to wait until a robot listens to every command of the script; "
              "0 = without end", minimum=0.0, maximum=1e6),
    Parameter("rate", 50.0, "Hz", "commands a second along a ramp", minimum=0.0, maximum=1e4, positive=True),
)


class ScriptCommands:
    """The commands of a script, each sent when its value changes.

    Parameters
    ----------
    script : Script
        What to play.
    send : callable
        Publishes a message under a command's name.
    say : callable
        Is told what comes.
    """

    def __init__(self, script: Script, send: Callable[[str, Float64], None], say: Callable[[str], object]):
        self._script, self._send, self._say = script, send, say
        self._sent: dict[str, float] = {}
        self._segment: Segment | None = None

    def moments(self, rate: float) -> Moments:
        """Yield when to send, and what sends then: `rate` [Hz] times a second along ramps, and at the script's end."""
        for instant in chain(self._script.instants(rate), (self._script.duration,)):
            yield instant, partial(self._send_changes, instant)

    def _send_changes(self, instant: float) -> None:
        segment = self._script.segment_at(instant)
        if segment and segment is not self._segment:
            self._begin(segment)
        for name, value in self._script.command_at(instant).items():
            if self._sent.get(name) != value:
                self._send(name, Float64(data=value))
                self._sent[name] = value

    def _begin(self, segment: Segment) -> None:
        """Say what comes, and send anew what the entry gives: somebody else may have commanded meanwhile."""
        self._segment = segment
        self._say(segment.describe())
        for name in segment.given:
            self._sent.pop(name, None)


def main(argv: Sequence[str] | None = None) -> int:
    """Play a script.

    Returns
    -------
    int
        0 when done; 1 without a robot; 2 for bad input; 128 + the signal's number when aborted.
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
        script = read_script(path)
        node.get_logger().info(f"script {path}: {script.duration:g} s, {', '.join(script.commands)}")
        return _play(script, settings, node, executor, stop)


def _play(script: Script, settings: Mapping[str, Value], node: Node, executor: Executor, stop: StopRequest) -> int:
    publishers = {name: node.create_publisher(Float64, name, COMMANDS) for name in script.commands}
    player = Player(node, executor, publishers, script.commands, "motor_speed")
    commands = ScriptCommands(script, player.send, node.get_logger().info)
    code = player.run(commands.moments(settings["rate"]), settings["wait"], stop)
    if not code:
        node.get_logger().info("script done")
    return code


def _parser() -> Parser:
    parser = Parser(
        prog="controller",
        description=f"{EXECUTABLES['controller'].does} Shipped scripts: " + ", ".join(shipped_scripts()),
        epilog="ROS parameters (--ros-args -p name:=value):\n"
        + parameter_lines(PARAMETERS, {parameter.name: parameter.default for parameter in PARAMETERS})
        + "\n\nExit code 0: played to the end; 1: no robot, or it went away; 2: bad script or parameter;\n"
        "129, 130, 143: aborted by SIGHUP, SIGINT or SIGTERM, and the motor told to stop.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("script", nargs="?", help="a shipped script's name, or the path of a YAML file")
    return parser
