"""The live half of the `view` executable: a robot in the browser, with its knobs and buttons."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.entry_point import enter

    sys.exit(enter("live_view"))

import argparse
import gc
import os
import socket
import sys
import tempfile
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from html import escape
from importlib import metadata
from pathlib import Path
from typing import Any

from vibro_ros.configuration.scene_file import NODE_NAME as ROBOT
from vibro_ros.model.parameters import Parameter, checked_parameters
from vibro_ros.process.entry_point import Parser, StopRequest, exit_code
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.ros.live.page import LivePage
from vibro_ros.ros.node import process
from vibro_ros.ros.node.arguments import check_addressed, check_arguments, check_names, own_arguments
from vibro_ros.ros.node.node import GuardedNode
from vibro_ros.ros.node.parameters import declare, parameter_lines, take_overrides
from vibro_ros.ros.node.refusals import peer_text
from vibro_ros.view.page import page_text
from vibro_ros.view.server import Server, is_loopback, listening

NODE_NAME = "vibro_view"
PORT = 8742
NICENESS = 5
"""Niceness of the view, so that it gives way to the robot, which must keep time."""
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
