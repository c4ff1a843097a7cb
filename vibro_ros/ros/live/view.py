"""The live half of the `view` executable: a robot in the browser, with its knobs and buttons."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    from vibro_ros.process.entry_point import enter

    raise SystemExit(enter("live_view"))

import argparse
import gc
import os
import socket
import sys
import tempfile
import webbrowser
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from html import escape
from importlib import metadata
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

from rcl_interfaces.srv import SetParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter as ParameterOfRclpy
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from vibro_ros.configuration.scene_file import NODE_NAME as ROBOT
from vibro_ros.messages.operations import SET
from vibro_ros.model.parameters import Parameter, checked_parameters
from vibro_ros.process.entry_point import Parser, StopRequest, exit_code
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.files import one_line
from vibro_ros.ros.live.commands import RETURN_TIMEOUT, PageCommands
from vibro_ros.ros.live.robot import LiveRobot, RobotStatus
from vibro_ros.ros.node import process
from vibro_ros.ros.node.arguments import check_addressed, check_arguments, check_names, own_arguments
from vibro_ros.ros.node.node import GuardedNode
from vibro_ros.ros.node.parameters import declare, parameter_lines, take_overrides
from vibro_ros.ros.node.refusals import peer_text
from vibro_ros.ros.node.robot_parameters import Settings
from vibro_ros.view.motion import Impact
from vibro_ros.view.page import page_text
from vibro_ros.view.protocol import (
    CALL,
    COLUMNS,
    COMMAND,
    PLAIN_CALLS,
    SLOW_MOTION,
    SWITCHES,
    Request,
    drawing,
    text_frame,
)
from vibro_ros.view.server import Server, is_loopback, listening
from vibro_ros.view.slow_motion import History

NODE_NAME = "vibro_view"
PORT = 8742
NICENESS = 5  # niceness of the view, so that it gives way to the robot, which must keep time
PARAMETERS = (
    Parameter("robot", ROBOT, "", "name of the robot's node, with its namespace if that is another than the view's"),
)


def main(words: Sequence[str] | None = None) -> int:
    """Serve the page until SIGINT, SIGTERM or SIGHUP. Returns the exit code, which `--help` explains."""
    return exit_code("view", lambda: _run(sys.argv[1:] if words is None else words))


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(own_arguments(words))
    files = check_arguments(words)
    sockets = listening(options.address, options.port)
    os.nice(NICENESS)
    with StopRequest() as stop, process.node_running(NODE_NAME, words) as node:
        check_addressed(files, node.get_fully_qualified_name())
        robot = _robot(node, options.robot)
        setting: dict[str, Any] = {"mode": "live", "title": f"{robot} live", "robot": robot,
                                   "version": metadata.version("vibro_ros")}
        page = LivePage(node, robot)
        server = Server(sockets, options.address, [socket.gethostname()],
                        lambda nonce: page_text(setting, None, nonce), page.ask, page.greeting)
        with server:
            stop.hold()
            page.begin(server)
            gc.freeze()  # permanent objects: without them, garbage such as closed pages is collected sooner
            name = "127.0.0.1" if options.address in ("", "0.0.0.0", "::") else options.address
            port = sockets[0].getsockname()[1]
            address = f"http://{f'[{name}]' if ':' in name else name}:{port}/?token={server.token}"
            print(f"view: {address}", flush=True)
            if not is_loopback(options.address):
                node.get_logger().warning("other machines reach this page, and who has its whole address commands the "
                                          "robot; they write this machine's address or name, "
                                          f"{socket.gethostname()}, in it")
            with _redirect(address) if options.open else nullcontext() as url:
                if url and not webbrowser.open(url):
                    node.get_logger().warning("no browser could be opened; open the address above")
                process.spin_until(node, lambda: bool(stop or server.error))
                page.end()
    if server.error:
        raise RuntimeError(f"the server ended: {server.error}")
    return 0


def _robot(node: GuardedNode, given: str | None) -> str:
    """Return the full name of the robot's node."""
    settings = checked_parameters(take_overrides(node), PARAMETERS)
    name = given if given is not None else settings.get("robot", ROBOT)
    declare(node, PARAMETERS, {"robot": name})
    full = name if name.startswith("/") else f"{node.get_namespace().rstrip('/')}/{name}"
    try:
        node.resolve_service_name(f"{full}/get_parameters")
        check_names(node, ())
    except Exception:
        raise ValueError(f"--robot {peer_text(name)}: no node's name; give one such as /r1/vibro_robot") from None
    return full


@contextmanager
def _redirect(address: str) -> Iterator[str]:
    """Context with the URL of a file that redirects to `address` and that only this user can read.

    The address holds a token, and every user of the machine can read the command line with which a browser is started.
    """
    with tempfile.NamedTemporaryFile("w", prefix="vibro_view_", suffix=".html") as file:  # its mode is 0600
        file.write(f'<!doctype html><meta http-equiv="refresh" content="0;url={escape(address)}">')
        file.flush()
        yield Path(file.name).as_uri()


def _port(text: str) -> int:
    port = int(text) if text.isdecimal() else -1
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f"{text} is no port; give a number from 0 to 65535, 0 for any that is free")
    return port


def _parser() -> Parser:
    parser = Parser(
        prog="view", description=EXECUTABLES["live_view"].does,
        epilog="ROS parameters (--ros-args -p name:=value):\n"
        + parameter_lines(PARAMETERS, {"robot": ROBOT})
        + "\n\nTopics can be remapped with --ros-args -r.\n\n"
        "Exit code 0: ended by SIGINT, SIGTERM or SIGHUP; 1: the server failed; 2: bad argument, or the port is taken.",
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", metavar="NODE", help=f"the robot's node (default: the parameter robot, {ROBOT})")
    parser.add_argument("--address", default="127.0.0.1", help="where the page is served (default: %(default)s, which "
                        "only this machine reaches)")
    parser.add_argument("--port", type=_port, default=PORT, help="0 for any that is free (default: %(default)s)")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    return parser


PERIOD = 1.0 / 30.0  # time [s] between two batches of samples
LOOK_PERIOD = 0.5  # time [s] between two checks of who publishes and who offers services
ABSENCE_TIMEOUT = 5.0
"""Time [s] after which the log says that there is no robot; a robot started together with the view takes 2 s."""
MOST_REQUESTED = 400  # most requests of pages that wait for the node
IMPACT_MARGIN = 1.0  # time [s] by which an impact may lie before robot time 0 or after the latest sample
ANSWER_TIMEOUT = 5.0  # longest wait [s] for an answer of the robot
MOST_WAITING = 50  # most service calls that wait for an answer at once
STATUS = {"real_time_factor": 0.0, "dropped_share": 0.0, "refused": 0, "paused": False, "recording": ""}
_TIME = COLUMNS.index("time")

Answer = Callable[[bool, str], object]  # callback with the outcome of a request: whether it was done, and a sentence


class Presence(NamedTuple):
    """State of the robot for the pages, or why none is shown; `origin` is the stamp [ns] of its robot time 0."""

    absence: str
    settings: Settings | None
    origin: int | None
    offers: Mapping[str, bool]


class LivePage:
    """Connects the robot, whose node has the full name `robot`, with the server of its pages."""

    def __init__(self, node: GuardedNode, robot: str):
        self._node, self._name = node, robot
        self._commands, self._requests = PageCommands(node), Requests(node, robot)
        self._robot_status = RobotStatus(node, robot)
        self._robot = LiveRobot(node, robot)  # last: a robot that answers it has discovered all clients
        self._history, self._requested = History(), deque[tuple[int, Request]](maxlen=MOST_REQUESTED)
        self._presence = Presence("the view is starting", None, None, {})
        self._in_force = text_frame("commands", values={})
        self._run: tuple[int | None, int] = None, 0
        self._last_look = float("-inf")
        self._absence, self._since = "", monotonic()
        self._server: Server | None = None

    def begin(self, server: Server) -> None:
        """Begin to serve the server's pages."""
        self._server = server
        self._node.create_timer(PERIOD, partial(self._poll, server), clock=Clock(clock_type=ClockType.STEADY_TIME))

    def ask(self, page: int, request: Request) -> None:
        """Take a page's request; for the server's thread."""
        self._requested.append((page, request))
        self._node.executor.create_task(self._execute_requests)

    def greeting(self) -> list[tuple[str, str]]:
        """Return kind and text of the frames for a page that has just opened; for the server's thread."""
        frames = [self._frame(self._presence), ("commands", self._in_force)]
        return [*frames, ("status", self._status())] if self._robot_status.status else frames

    def end(self) -> None:
        """Stop the motor if a page has commanded it, because no page can stop it any more."""
        if words := self._commands.end():
            self._node.get_logger().info(f"the motor was commanded from a page; {words}")

    def _poll(self, server: Server) -> None:
        origin = self._robot.origin
        rows = self._robot.poll()
        if self._robot.origin != origin:
            self._history.clear()
        if self._robot_status.diagnostics():
            self._robot.hear()
            server.send("status", self._status())
        if (now := monotonic()) > self._last_look + LOOK_PERIOD:
            self._last_look = now
            self._robot.look()
            self._warn_of_absence(now)
        self._update_presence(server)
        if len(rows):
            self._history.add(rows)
            server.send_samples(rows.tobytes())
        self._forward_reports(server)
        self._watch_commands(server)
        self._requests.tick()

    def _warn_of_absence(self, now: float) -> None:
        """Log once why there is nothing to show, if that lasts."""
        if self._presence.absence != self._absence:
            self._absence, self._since = self._presence.absence, now
        elif self._absence and now > self._since + ABSENCE_TIMEOUT:
            self._since = float("inf")
            self._node.get_logger().warning(self._absence)

    def _update_presence(self, server: Server) -> None:
        """Send the robot's state to the pages, if it has changed."""
        robot = self._robot
        absence = robot.absence
        presence = (Presence(absence, None, None, {}) if absence
                    else Presence("", robot.settings, robot.origin, self._requests.offers))
        last, self._presence = self._presence, presence
        if presence == last:
            return
        if presence.settings and presence.settings != last.settings:
            self._robot_status.begin(presence.settings.prefix)
        server.send(*self._frame(presence))

    def _forward_reports(self, server: Server) -> None:
        """Forward the robot's operations, impacts and log."""
        robot, operations = self._robot, self._robot_status.operations()
        run = robot.origin, robot.silences
        goes_on, self._run = run == self._run, run  # else earlier commands do not hold any more
        self._commands.take(robot.settings.scene if robot.settings and goes_on else None, operations)
        if any(operation.name == SET for operation in operations):
            self._robot.reader.read()
        if operations and self._robot_status.status:
            server.send("status", self._status())
        self._forward_impacts(server)
        for level, words in self._robot_status.log():
            server.send("log", text_frame("log", level=level, words=words))

    def _forward_impacts(self, server: Server) -> None:
        """Forward the impacts whose stamps fit the samples of this run; any program can publish others."""
        reported, last, origin = self._robot_status.impacts(), self._history.last(), self._presence.origin
        if last is None or origin is None:
            return
        impacts = [Impact(time, time, impact.side, impact.peak_force) for impact in reported
                   if -IMPACT_MARGIN < (time := (impact.stamp - origin) * 1e-9) < last[_TIME] + IMPACT_MARGIN]
        self._history.add_impacts(impacts)
        if impacts:
            server.send("impacts", text_frame("impacts", list=[
                {"time": impact.time, "side": impact.side, "peak_force": impact.peak_force} for impact in impacts]))

    def _watch_commands(self, server: Server) -> None:
        """Send the commands in force to the pages, and stop a motor that closed pages have left turning."""
        in_force = text_frame("commands", values=self._commands.in_force)
        if in_force != self._in_force:
            self._in_force = in_force
            server.send("commands", in_force)
        settings = self._robot.settings
        if self._commands.stop_if_alone(len(server.pages), settings.command_timeout if settings else 0.0):
            self._node.get_logger().warning(f"no page has been open for {RETURN_TIMEOUT:g} s, and the motor was "
                                            "commanded from one; sent motor_speed 0")

    def _execute_requests(self) -> None:
        while self._requested and self._server:
            page, request = self._requested.popleft()
            answer = partial(self._server.answer, page, request.id)
            if request.kind == COMMAND:
                self._commands.send(request.name, float(request.value or 0.0), answer)
            elif request.kind == SLOW_MOTION:
                self._slow_motion(page, request, self._server)
            else:
                self._requests.ask(request, answer)

    def _slow_motion(self, page: int, request: Request, server: Server) -> None:
        settings = self._presence.settings
        try:
            if settings is None:
                raise ValueError(f"there is no robot: {self._presence.absence}")
            server.send_motion(page, request.id, self._history.motion(settings.scene, float(request.value or 0.0)))
        except ValueError as error:
            server.answer(page, request.id, False, str(error))

    def _status(self) -> str:
        return text_frame("status", **{**STATUS, **self._robot_status.status})

    def _frame(self, presence: Presence) -> tuple[str, str]:
        """Return kind and text of the frame with the robot's state."""
        if presence.settings is None:
            return "absent", text_frame("absent", words=presence.absence)
        return "robot", text_frame("robot", name=self._name, machine=drawing(presence.settings.scene),
                                   columns=list(COLUMNS), origin=str(presence.origin or 0),
                                   offers=dict(presence.offers))


@dataclass(eq=False)
class _Waiting:
    """A request that was sent and waits for its answer."""

    service: str
    answer: Answer
    begun: float
    sent: Future


class Requests:
    """Clients of one robot's services; used in the executor's thread."""

    def __init__(self, node: Node, robot: str):
        kinds = {**dict.fromkeys(PLAIN_CALLS, Trigger), **dict.fromkeys(SWITCHES, SetBool)}
        self._clients = {name: node.create_client(kind, f"{robot}/{name}") for name, kind in kinds.items()}
        self._setting = node.create_client(SetParameters, f"{robot}/set_parameters")
        self._waiting: list[_Waiting] = []

    @property
    def offers(self) -> dict[str, bool]:
        """Which services the robot offers."""
        return {name: client.service_is_ready() for name, client in self._clients.items()}

    def ask(self, request: Request, answer: Answer) -> None:
        """Call a service or set a parameter of the robot; `answer` is called with the outcome."""
        client = self._clients[request.name] if request.kind == CALL else self._setting
        if not client.service_is_ready():
            answer(False, f"nobody offers {client.srv_name}; is the robot running?")
        elif len(self._waiting) >= MOST_WAITING:
            answer(False, f"{MOST_WAITING} requests wait for the robot's answer already; ask again later")
        else:
            waiting = _Waiting(client.srv_name, answer, monotonic(), client.call_async(_message(request)))
            self._waiting.append(waiting)
            waiting.sent.add_done_callback(lambda _: self._take(waiting))

    def tick(self) -> None:
        """Give up requests that have waited too long; to be called often."""
        for late in [waiting for waiting in self._waiting if monotonic() > waiting.begun + ANSWER_TIMEOUT]:
            self._waiting.remove(late)
            late.sent.cancel()  # the client then forgets it
            late.answer(False, f"{late.service} has not answered for {ANSWER_TIMEOUT:g} s; it may still do what was "
                               "asked")

    def _take(self, waiting: _Waiting) -> None:
        if waiting not in self._waiting or waiting.sent.cancelled():
            return
        self._waiting.remove(waiting)
        response: Any = waiting.sent.result()
        if hasattr(response, "results"):
            done = all(result.successful for result in response.results)
            words = " ".join(result.reason for result in response.results)
        else:
            done, words = response.success, response.message
        waiting.answer(bool(done), one_line(words, 500))


def _message(request: Request) -> Any:
    """Return the message of a service for a page's request."""
    if request.kind != CALL:
        parameter = ParameterOfRclpy(request.name, value=request.value)
        return SetParameters.Request(parameters=[parameter.to_parameter_msg()])
    return Trigger.Request() if request.value is None else SetBool.Request(data=request.value)
