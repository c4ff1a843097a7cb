"""The `controller` executable: plays a script of commands to the robot, from another process."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.front_door import enter

    sys.exit(enter("controller"))

import argparse
import sys
import time
from collections.abc import Sequence
from itertools import chain

from rclpy.duration import Duration
from rclpy.executors import Executor
from rclpy.node import Node
from std_msgs.msg import Float64

from vibro_ros.command_line import Parser
from vibro_ros.front_door import exit_code
from vibro_ros.model.parameters import Parameter, checked_parameters
from vibro_ros.ros import process
from vibro_ros.ros.listeners import wait_for_listeners
from vibro_ros.ros.parameters import declare, parameter_lines, take_overrides
from vibro_ros.ros.qos import COMMANDS
from vibro_ros.ros.ros_arguments import check_addressed, check_arguments, own_arguments
from vibro_ros.ros.script import Script, Segment
from vibro_ros.ros.script_file import find_script, read_script, shipped_scripts
from vibro_ros.stop_signals import StopRequest

NODE_NAME = "vibro_controller"
PARAMETERS = (
    Parameter("script", "", "", "script to play when the command line names none: a shipped name or a path"),
    Parameter("wait", 0.0, "s", "longest time to wait until a robot listens to every command of the script; "
              "0 = without end", minimum=0.0, maximum=1e6),
    Parameter("rate", 50.0, "Hz", "commands a second along a ramp", minimum=0.0, maximum=1e4, positive=True),
)
LAST_WORD = 0.5
"""Longest wait [s] for the robot to acknowledge the last command; Fast DDS asks for that every 3 s only."""


class Controller:
    """Plays one script on a node.

    Parameters
    ----------
    node : Node
        Publishes the commands under the node's names.
    executor : Executor
        Spun while waiting.
    script : Script
        What to play.
    """

    def __init__(self, node: Node, executor: Executor, script: Script):
        self._node, self._log = node, node.get_logger()
        self._executor = executor
        self._script = script
        self._sent: dict[str, float] = {}
        self._publishers = {name: node.create_publisher(Float64, name, COMMANDS) for name in script.commands}

    def wait_for_robot(self, patience: float, stop: StopRequest) -> None:
        """Return when somebody subscribes to every command, or on `stop`; see `wait_for_listeners`."""
        wait_for_listeners(self._node, self._executor, list(self._publishers.values()), patience, stop)

    def play(self, rate: float, stop: StopRequest) -> None:
        """Send every command at its time, `rate` [Hz] times a second along ramps; return at the end or on `stop`.

        Raises
        ------
        RuntimeError
            When the robot is gone.
        """
        began, segment = time.monotonic(), None
        for instant in chain(self._script.instants(rate), (self._script.duration,)):
            self._wait_until(began + instant, stop)
            if stop:
                return
            if self._script.segment_at(instant) is not segment:
                segment = self._script.segment_at(instant)
                self._begin(segment)
            self._send(self._script.command_at(instant))

    def stop_motor(self) -> None:
        """Command motor speed 0 if the script drives the motor: what an operator means who aborts."""
        if "motor_speed" in self._sent:
            self._send({"motor_speed": 0.0})
            self._log.info("aborted: motor_speed 0 rad/s")

    def finish(self) -> None:
        """Give the last commands `LAST_WORD` to arrive: a publisher that goes takes undelivered ones with it."""
        deadline = time.monotonic() + LAST_WORD
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))

    def _begin(self, segment: Segment) -> None:
        """Say what comes, and send anew what the entry gives: somebody else may have commanded meanwhile."""
        self._log.info(segment.describe())
        for name in segment.given:
            self._sent.pop(name, None)

    def _wait_until(self, deadline: float, stop: StopRequest) -> None:
        while not stop and (ahead := deadline - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=min(ahead, process.POLL))
            if self._deaf():
                raise RuntimeError(f"the robot is gone: nobody listens to {', '.join(self._deaf())} any more")

    def _send(self, commands: dict[str, float]) -> None:
        for name, value in commands.items():
            if self._sent.get(name) != value:
                self._publishers[name].publish(Float64(data=value))
                self._sent[name] = value

    def _deaf(self) -> list[str]:
        """Topics that nobody subscribes to."""
        return [publisher.topic_name for publisher in self._publishers.values()
                if publisher.get_subscription_count() == 0]


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
        return _play(Controller(node, executor, script), settings, node, stop)


def _play(controller: Controller, settings: dict, node: Node, stop: StopRequest) -> int:
    controller.wait_for_robot(settings["wait"], stop)
    stop.hold()  # the motor must be told to stop
    try:
        controller.play(settings["rate"], stop)
    finally:
        if stop:
            controller.stop_motor()
        controller.finish()
    if stop:
        return 128 + stop.signal
    node.get_logger().info("script done")
    return 0


def _parser() -> Parser:
    parser = Parser(
        prog="controller",
        description="Play a script of commands to the robot. Shipped scripts: " + ", ".join(shipped_scripts()),
        epilog="ROS parameters (--ros-args -p name:=value):\n"
        + parameter_lines(PARAMETERS, {parameter.name: parameter.default for parameter in PARAMETERS})
        + "\n\nExit code 0: played to the end; 1: no robot, or it went away; 2: bad script or parameter;\n"
        "129, 130, 143: aborted by SIGHUP, SIGINT or SIGTERM, and the motor told to stop.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("script", nargs="?", help="a shipped script's name, or the path of a YAML file")
    return parser
