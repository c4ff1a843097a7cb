"""What the live view costs with real browsers: `python -m tools.view_load`.

`memory` keeps pages open for minutes and tells how the memory of the view and of the pages grows. `first` tells how
long after a robot's first sample the page shows it. `lateness` tells how much later the robot's ticks are while
browsers show it than while nobody looks on, in turn, in one robot; a machine that draws without a graphics card also
measures its own lack of cores. `--nice` lets the browsers step back.
"""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("view_load"))

import argparse
import json
import shlex
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import urlsplit

from tqdm import tqdm

from tools.browser import Session, chosen_engine
from tools.watched_robot import WatchedRobot, show_robot, until, watched_robot
from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code

if TYPE_CHECKING:
    from playwright.sync_api import CDPSession

SETTLING = 0.1
"""Share of the time that does not count: buffers fill, and the browser optimises what runs often."""
SAMPLES = 20
"""How often memory is read."""


class Memory(NamedTuple):
    """Memory at an instant.

    Attributes
    ----------
    time : float
        Since the pages show the robot [s].
    view : float
        Resident memory of the view [MB].
    page : float
        The scripts' objects in the first page after a collection of garbage [MB].
    """

    time: float
    view: float
    page: float


def resident(pid: int) -> float:
    """Resident memory [MB] of a process."""
    text = Path(f"/proc/{pid}/status").read_text()
    return int(text.partition("VmRSS:")[2].split()[0]) * 1024e-6


def memories(pages: int, duration: float, samples: int = SAMPLES) -> Iterator[Memory]:
    """Show a robot in so many pages for a duration [s], and read the memory now and then."""
    with Session(chosen_engine()) as session, watched_robot() as robot:
        opened = [session.page() for _ in range(pages)]
        for page in opened:
            show_robot(page, robot)
        tools = opened[0].context.new_cdp_session(opened[0])
        begin = time.monotonic()
        for number in range(samples + 1):
            due = begin + number * duration / samples
            while (rest := due - time.monotonic()) > 0.0:
                opened[0].wait_for_timeout(1e3 * min(0.5, rest))
            yield Memory(time.monotonic() - begin, resident(robot.view), _scripts_memory(tools))


def _scripts_memory(tools: "CDPSession") -> float:
    tools.send("HeapProfiler.collectGarbage")
    return tools.send("Runtime.getHeapUsage")["usedSize"] * 1e-6


def memory_table(found: Sequence[Memory]) -> str:
    """First and last memory after the settling, and the ratio, as Markdown."""
    counted = [one for one in found if one.time >= SETTLING * found[-1].time]
    first, last = counted[0], counted[-1]
    rows = [f"| memory | after {first.time:.0f} s | after {last.time:.0f} s | most | ratio |\n|{'---|' * 5}"]
    for name, title in (("view", "the view, resident"), ("page", "a page's objects")):
        values = [getattr(one, name) for one in counted]
        rows.append(f"| {title} [MB] | {values[0]:.1f} | {values[-1]:.1f} | {max(values):.1f} | "
                    f"{values[-1] / values[0]:.3f} |")
    return "\n".join(rows)


def first_picture() -> float:
    """Time [s] from the stamp of a robot's first sample to the page's first picture of it; the page is open already."""
    origins: list[int] = []

    def hear(data: str | bytes) -> None:
        if isinstance(data, str) and (message := json.loads(data))["kind"] == "robot":
            origins.append(int(message["origin"]))

    with Session(chosen_engine()) as session:
        page = session.page()  # before the robot, which takes a second to start
        page.on("websocket", lambda socket: socket.on("framereceived", hear))
        with watched_robot() as robot:
            show_robot(page, robot)
            shown = time.time_ns()
            until(page, lambda: bool(origins), "the robot's origin")
    return (shown - origins[0]) * 1e-9


def show(address: str) -> None:
    """Show the page in a browser, and say so, until nobody serves it any more."""
    with Session(chosen_engine()) as session:
        page = session.page()
        show_robot(page, WatchedRobot(address, 0))
        print("shows", flush=True)
        while _is_served(address):
            page.wait_for_timeout(200)


def _is_served(address: str) -> bool:
    parts = urlsplit(address)
    try:
        with socket.create_connection((parts.hostname, parts.port), timeout=10.0):
            return True
    except OSError:
        return False


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; 0 when done, 1 when a process failed, 2 for a bad argument, 130 when interrupted."""
    return exit_code("view_load", lambda: _run(sys.argv[1:] if argv is None else argv))


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(words)
    if options.what == "memory":
        bar = tqdm(memories(options.pages, options.duration), total=SAMPLES + 1, disable=None, leave=False)
        print(memory_table(list(bar)))
    elif options.what == "first":
        print(f"first picture {first_picture():.2f} s after the first sample")
    elif options.what == "lateness":
        page = shlex.join(["nice", "-n", str(options.nice), sys.executable, "-m", EXECUTABLES["view_load"].module,
                           "show", "--address"])
        return subprocess.run([sys.executable, "-m", EXECUTABLES["view_lateness"].module, "--page", page, "--pages",
                               str(options.pages), "--rounds", str(options.rounds)], check=False).returncode
    else:
        show(options.address)
    return 0


def _parser() -> Parser:
    parser = Parser(prog="view_load", description=EXECUTABLES["view_load"].does,
                    formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("what", choices=("memory", "first", "lateness", "show"),
                        help="what to measure; or show the page of an --address while it is served")
    parser.add_argument("--pages", type=int, default=3, help="pages that are open, or browsers")
    parser.add_argument("--duration", type=float, default=600.0, help="of memory [s]")
    parser.add_argument("--rounds", type=int, default=6, help="of lateness: how often browsers are started and ended")
    parser.add_argument("--nice", type=int, default=0, help="of lateness: by how much the browsers step back")
    parser.add_argument("--address", default="", help="of a page to show")
    return parser
