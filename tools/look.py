"""Robot and view as two processes, until Ctrl-C: what `make view` starts."""

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from tools.child import Child
from vibro_ros.configuration.scene_file import NODE_NAME
from vibro_ros.process.entry_point import Parser, StopRequest, exit_code

SPEED = 60.0
"""Motor speed [rad/s] with which the robot starts: it crawls at once, and there is room for a knob to be turned up."""
_POLL = 0.05  # s


def main(words: Sequence[str]) -> int:
    """Run both until a signal; 0 then, 1 when one of them failed, 2 for a bad argument."""
    return exit_code("look", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(words)
    options.output.mkdir(parents=True, exist_ok=True)
    # The user's domain, so that README's next commands find this robot; on this machine alone, unless the user chose.
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", **os.environ}
    settings = {"motor.speed": SPEED, "record.enabled": "false",  # the page's button begins a recording
                "record.directory": json.dumps(str(options.output))}
    space = ["-r", f"__ns:={options.namespace}"] if options.namespace else []
    robot_words = [word for name, value in settings.items() for word in ("-p", f"{name}:={value}")]
    view_words = ["--port", options.port, "--address", options.address, *["--open"] * options.open,
                  "--ros-args", *space]
    with (
        StopRequest() as stop,
        Child("vibro_ros.ros.live.view", *view_words, environment=environment) as view,
        Child("vibro_ros.ros.robot.robot", "--ros-args", *space, *robot_words, environment=environment) as robot,
    ):
        stop.hold()  # neither process may be left behind
        robot_name = f"{options.namespace.rstrip('/')}/{NODE_NAME}"
        print(f"      look | ROS domain {environment.get('ROS_DOMAIN_ID') or 0}, robot {robot_name}; open the address "
              "below in a browser; Ctrl-C ends all", flush=True)
        while not stop and view.exit_code is None and robot.exit_code is None:
            time.sleep(_POLL)
        if not stop:
            ended = view if view.exit_code is not None else robot
            raise RuntimeError(f"{ended.name} has ended with exit code {ended.stop()}; it says why above")
        for one in (view, robot):
            if one.stop():
                raise RuntimeError(f"{one.name} did not end well, exit code {one.exit_code}; it says why above")
    return 0


def _parser() -> Parser:
    parser = Parser(prog="look", description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("out"), metavar="DIR",
                        help="where recordings go that the page asks for (default: %(default)s)")
    parser.add_argument("--namespace", default="", metavar="NAME", help="of robot and page, such as /r2 beside another "
                        "robot in this domain (default: none)")
    parser.add_argument("--port", default="8742", help="of the page; 0 for any that is free (default: %(default)s)")
    parser.add_argument("--address", default="127.0.0.1", help="where the page is served (default: %(default)s)")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
