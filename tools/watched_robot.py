"""A robot that crawls, its live view, and their processes: what pictures and measurements of the page need."""

import json
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tools.child import Child
from tools.demo import ros_environment

if TYPE_CHECKING:
    from playwright.sync_api import Page

PATIENCE = 120.0
"""How long [s] what is waited for may take; the robot may have to compile its kernels first."""
_SHOWN = "Boolean(globalThis.vibro) && Number.isFinite(vibro.drawn().time) && document.querySelector('#absent').hidden"


@dataclass(frozen=True)
class WatchedRobot:
    """What runs: the address of the page, and the number of the view's process."""

    address: str
    view: int


@contextmanager
def watched_robot(settings: Mapping[str, object] | None = None) -> Iterator[WatchedRobot]:
    """Run a robot with these parameters, and its view, until the block ends; the robot does not record.

    Raises
    ------
    RuntimeError
        When the view does not start.
    """
    environment = ros_environment()
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        settings = {"motor.speed": 100.0, "record.enabled": "false", "record.directory": json.dumps(folder),
                    **(settings or {})}
        words = [word for name, value in settings.items() for word in ("-p", f"{name}:={value}")]
        view = stack.enter_context(Child("vibro_ros.ros.live.view", "--port", "0", environment=environment,
                                         shown=False))
        address = view.wait_for("/?token=").removeprefix("view: ").strip()
        stack.enter_context(Child("vibro_ros.ros.robot.robot", "--ros-args", *words, environment=environment))
        yield WatchedRobot(address, view.pid)


def wait_for(page: "Page", condition: str) -> None:
    """Wait until JavaScript's `condition` holds; the page's policy forbids Playwright's own way.

    Raises
    ------
    RuntimeError
        When that takes longer than `PATIENCE`.
    """
    until(page, lambda: bool(page.evaluate(condition)), condition)


def until(page: "Page", done: Callable[[], bool], what: str) -> None:
    """Wait until `done()`, while the page goes on; RuntimeError that names `what` if that takes too long."""
    deadline = time.monotonic() + PATIENCE
    while not done():
        if time.monotonic() > deadline:
            raise RuntimeError(f"the page: not within {PATIENCE:g} s: {what}")
        page.wait_for_timeout(20)


def show_robot(page: "Page", robot: WatchedRobot) -> None:
    """Open the page and wait until it draws the robot."""
    page.goto(robot.address)
    wait_for(page, _SHOWN)
