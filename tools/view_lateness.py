"""Measure what the live view costs the robot's clock: `python -m tools.view_lateness`.

One robot runs throughout. In turn nobody looks on, and then a view with three pages open; how late its ticks are, the
robot says in /diagnostics once a second. So both halves share the machine's other load, and their ratio is the view's.
A page here is a web socket that reads and unpacks everything, in a process for each; a browser draws besides, and
`--page` names a command that shows the page in one.
"""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("view_lateness"))

import argparse
import os
import shlex
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence

from rclpy.executors import Executor
from rclpy.node import Node

from tools.lateness import Measurement, robot_running, table
from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code
from vibro_ros.ros.node import process

SETTLING = 3
"""Reports of the robot while the view, whose pages are open, loads the kernels of slow motion."""
_PAGE = """
import asyncio, signal, sys
signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends when the view does
import numpy as np
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect
async def read(origin, query):
    request = HTTPRequest(f"{origin.replace('http', 'ws', 1)}/live?{query}", headers={"Origin": origin})
    page = await websocket_connect(request)
    heard = 0
    while (frame := await page.read_message()) is not None:
        if isinstance(frame, bytes):
            np.frombuffer(frame, "<f8", offset=8).sum()
            heard += 1
            if heard == 1:
                print("reads", flush=True)
origin, _, query = sys.argv[1].partition("/?")
asyncio.run(read(origin, query))
"""


class ViewMeasurement(Measurement):
    """Starts a view with some pages, and ends it.

    Parameters
    ----------
    node, executor : Node, Executor
        Used from the calling thread alone.
    namespace : str
        The robot's.
    pages : int
        How many.
    page : sequence of str
        The command of a page; the address is its last word. It says a line when it shows the robot, and ends when the
        view does.
    """

    def __init__(self, node: Node, executor: Executor, namespace: str, pages: int, page: Sequence[str]):
        super().__init__(node, executor, namespace)
        self._namespace, self._pages, self._page = namespace, pages, page
        self._running: list[subprocess.Popen] = []

    def switch(self, robot: subprocess.Popen, on: bool) -> None:
        """Start the view and its pages, or end them."""
        self.end()
        if not on:
            return
        view = subprocess.Popen(
            [sys.executable, "-m", "vibro_ros.ros.live.live_view", "--port", "0", "--ros-args", "-r",
             f"__ns:=/{self._namespace}", "--log-level", "warn"], stdout=subprocess.PIPE, text=True)
        self._running.append(view)
        address = view.stdout.readline().removeprefix("view: ").strip() if view.stdout else ""
        if not address:
            raise RuntimeError("the view has ended; it says why above")
        self._running += [subprocess.Popen([*self._page, address], stdout=subprocess.PIPE, text=True)
                          for _ in range(self._pages)]
        for one in self._running[1:]:
            if one.stdout and not one.stdout.readline():
                raise RuntimeError("a page has ended; it says why above")
        self._reports.clear()
        self._wait(robot, lambda: len(self._reports) >= SETTLING)

    def end(self) -> None:
        """End what runs, the view first: its pages then end by themselves."""
        for one in self._running:
            if one is self._running[0]:
                one.send_signal(signal.SIGINT)
            one.wait()
        self._running = []


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; 0 when done, 1 when a process failed, 2 for a bad argument, 130 when interrupted."""
    return exit_code("view_lateness", lambda: _run(argv))


def _run(argv: Sequence[str] | None) -> int:
    options = _parser().parse_args(argv)
    namespace = f"view_lateness_{os.getpid()}"
    with tempfile.TemporaryDirectory() as folder, process.node_running("view_lateness", []) as (node, executor), \
            robot_running(namespace, folder, options.rate) as robot:
        measurement = ViewMeasurement(node, executor, namespace, options.pages,
                                      shlex.split(options.page) or [sys.executable, "-c", _PAGE])
        try:
            print(table(measurement.run(robot, options.rounds, options.length), f"{options.pages} pages"))
        finally:
            measurement.end()
    return 0


def _parser() -> Parser:
    parser = Parser(prog="view_lateness", description=EXECUTABLES["view_lateness"].does,
                    formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--rounds", type=int, default=6, help="how often the view is started and ended")
    parser.add_argument("--length", type=int, default=8, help="seconds counted each time")
    parser.add_argument("--rate", type=float, default=200.0, help="rate.publish of the robot [Hz]")
    parser.add_argument("--pages", type=int, default=3, help="pages that are open")
    parser.add_argument("--page", default="", metavar="COMMAND", help="shows a page, whose address is added to it; "
                        "says a line when it does, and ends when the view does (default: reads without drawing)")
    return parser
