"""Demonstrations for users: `make demo` and `make view`.

The demonstration runs robot and controller for about 20 s, which gives a bag, and reports on it. With the argument
`look` it runs robot and view until Ctrl-C.
"""

import json
import os
import random
import signal
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tools.child import Child
from vibro_ros.bag.reader import Bag, BagError, read_bag
from vibro_ros.configuration.scene_file import NODE_NAME
from vibro_ros.messages.topics import OF_DC_MOTOR, ROBOT_TOPICS
from vibro_ros.process.entry_point import Parser, StopRequest, exit_code, say
from vibro_ros.recordings.report import write_report
from vibro_ros.view.view import write_page

MOVED = 0.01
"""Least distance [m] from the start that counts as motion; the shipped script moves the robot more than ten times that.
"""
TIMEOUT = "command.timeout:=1.0"
"""Parameter by which the motor stops after so many seconds without commands, even if only the robot is left running."""
ALWAYS_THERE = ("odom", "joint_states", "ground_contact", "impacts", "motor_power", "motor_speed")
"""Topics that have messages after every script that makes the robot move."""
LOOK_SPEED = 60.0
"""Motor speed [rad/s] of `make view`: the robot crawls at once, and the user can still increase the speed."""


class DemoError(RuntimeError):
    """The demonstration failed; the message says why in one line."""


def main(words: Sequence[str]) -> int:
    """Run the demonstration; returns 0, 1 with a reason if it failed, or 130 if it was stopped.

    Robot and view (`look`) return 0 after a signal, 1 if one of them failed.
    """
    if words[:1] == ["look"]:
        return exit_code("make view", lambda: _look(words[1:]))
    return exit_code("make demo", lambda: _demonstrate(words))


def _demonstrate(words: Sequence[str]) -> int:
    options = _parser().parse_args(words)
    try:
        folder = _run(options.script, options.output)
        if folder is None:
            say("make demo", "stopped")
            return 128 + signal.SIGINT
        text, files = write_report(folder)
        page = write_page(folder)
    except BagError as error:
        raise DemoError(str(error)) from error
    print(f"\n{text}")
    for label, path in zip(("bag", "summary", "numbers", "picture", "page"), (folder, *files, page), strict=True):
        _say(_shown(path), label)
    return 0


def _run(script: str, output: Path) -> Path | None:
    """Let the robot crawl, and return its checked bag, or None if a signal stopped it."""
    output.mkdir(parents=True, exist_ok=True)
    earlier = set(output.iterdir())
    environment = ros_environment()
    space = own_namespace("demo")
    _say(f"look on with ROS_DOMAIN_ID={environment['ROS_DOMAIN_ID']}, for example: view --robot {space}/{NODE_NAME}")
    with StopRequest() as stop:
        stop.hold()  # so that both processes are ended in any case
        _play(script, output, environment, space, stop)
        if stop:
            return None
    new = [path for path in set(output.iterdir()) - earlier if path.is_dir()]
    if len(new) != 1:
        raise DemoError(f"{output}: {len(new)} new bags in it where the robot should have made one")
    check_bag(read_bag(new[0]))
    return new[0]


def _play(script: str, output: Path, environment: Mapping[str, str], space: str, stop: StopRequest) -> None:
    """Run both processes in the namespace `space` until the script ends or `stop`, and end both."""
    record_to = f"record.directory:={json.dumps(str(output))}"  # quoted, because a folder named 2026 would be a number
    robot_words = ("vibro_ros.ros.robot.robot", "--ros-args", "-r", f"__ns:={space}", "-p", record_to, "-p", TIMEOUT)
    controller_words = ("vibro_ros.ros.controller.controller", script,  # it waits for the robot
                        "--ros-args", "-r", f"__ns:={space}")
    with (
        Child(*robot_words, environment=environment) as robot,
        Child(*controller_words, environment=environment) as controller,
    ):
        while not stop and controller.exit_code is None and robot.exit_code is None:
            time.sleep(0.05)
        if stop:
            return
        if robot.exit_code is not None:
            raise DemoError(f"the robot ended before the script, with exit code {robot.stop()}; it says why above")
        if controller.exit_code != 0:
            raise DemoError(f"the controller failed with exit code {controller.stop()}; it says why above")
        if robot.stop() != 0:
            raise DemoError(f"the robot did not end well, exit code {robot.exit_code}; it says why above")


def _look(words: Sequence[str]) -> int:
    """Run robot and view until a signal."""
    options = _look_parser().parse_args(words)
    options.output.mkdir(parents=True, exist_ok=True)
    # The user's domain, so that README's next commands find this robot; on this machine only, unless the user chose.
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", **os.environ}
    settings = {"motor.speed": LOOK_SPEED, "record.enabled": "false",  # the page's button begins a recording
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
        stop.hold()  # so that both processes are ended in any case
        _say(f"ROS domain {environment.get('ROS_DOMAIN_ID') or 0}, robot {options.namespace.rstrip('/')}/{NODE_NAME}; "
             "open the address below in a browser; Ctrl-C ends all", "look")
        while not stop and view.exit_code is None and robot.exit_code is None:
            time.sleep(0.05)
        if not stop:
            ended = view if view.exit_code is not None else robot
            raise DemoError(f"{ended.name} has ended with exit code {ended.stop()}; it says why above")
        for child in (view, robot):
            if child.stop():
                raise DemoError(f"{child.name} did not end well, exit code {child.exit_code}; it says why above")
    return 0


def check_bag(bag: Bag) -> None:
    """Refuse a recording in which a topic is missing or empty, or the body stayed within `MOVED` of its start."""
    names = {topic.rpartition("/")[2] for topic in bag.topics}
    missing = [name for name in ROBOT_TOPICS if name not in (*names, "tf", "tf_static", *OF_DC_MOTOR)]
    if missing:
        raise DemoError(f"{bag.path}: topics missing: {', '.join(missing)}")
    x = bag["odom"]["position"][:, 0]
    way = float(np.abs(x - x[0]).max()) if len(x) else 0.0
    if way < MOVED:
        raise DemoError(f"the robot did not move: {way * 1e3:.3f} mm from its start; {MOVED * 1e3:g} mm are the least")
    empty = [name for name in ALWAYS_THERE if not len(bag[name]["time"])]
    if empty:
        raise DemoError(f"{bag.path}: no messages on {', '.join(empty)}")


def own_namespace(name: str) -> str:
    """Return a namespace that no other process uses, so that a robot of the user in the same domain is not affected."""
    return f"/{name}_{os.getpid()}"


def ros_environment() -> dict[str, str]:
    """Return this process's environment, with ROS on this machine only and in a free domain, unless the user chose.

    On this machine only, because two students in one network may get the same domain, and each robot would then obey
    both controllers.
    """
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", **os.environ}
    return {"ROS_DOMAIN_ID": str(_free_domain()), **environment} if "ROS_DOMAIN_ID" not in environment else environment


def _free_domain() -> int:
    """Return a domain whose first discovery port (DDSI-RTPS 9.6.1) no participant on this machine uses."""
    domains = range(1, 102)  # above 101 the ports overlap Linux's ephemeral ones
    for domain in random.sample(domains, len(domains)):  # random, so that simultaneous demonstrations seldom collide
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7400 + 250 * domain + 10))
            except OSError:
                continue
            return domain
    raise DemoError("every ROS domain from 1 to 101 is in use; set ROS_DOMAIN_ID to share one")


def _say(text: object, name: str = "demo") -> None:
    print(f"{name:>10} | {text}", flush=True)


def _shown(path: Path) -> Path:
    """Return `path`, relative if it lies below the current folder."""
    current, path = Path.cwd(), Path(path).resolve()
    return path.relative_to(current) if path.is_relative_to(current) else path


def _parser() -> Parser:
    parser = Parser(prog="python -m tools.demo", description=__doc__)
    parser.add_argument("--script", default="crawl", help="controller script to play (default: %(default)s, 18 s)")
    parser.add_argument("--output", type=Path, default=Path("out"), metavar="DIR",
                        help="where the bag and the report go (default: %(default)s)")
    return parser


def _look_parser() -> Parser:
    parser = Parser(prog="python -m tools.demo look", description=__doc__)
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
