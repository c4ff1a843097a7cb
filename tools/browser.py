"""A browser for the tests of the page, and pictures of the live view for the documents: `python -m tools.browser`.

Chromium or Chrome runs headless in its own process with its own folder of files, and is ended with all its children.
Playwright controls it through its debugging port.
"""

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from tools.child import Child
from tools.demo import ros_environment

if TYPE_CHECKING:
    from playwright.sync_api import BrowserType, Page

CHOICE = "VIBRO_ROS_BROWSER"
"""Environment variable that names the program; if unset, the first of `NAMES` that runs is used."""
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
"""Programs to look for on PATH, in this order."""
REMEDY = f"install chromium (Debian: apt install chromium), or set {CHOICE} to the path of a Chromium or Chrome"
START_PATIENCE = 60.0
"""Longest time [s] until a browser can be controlled; it takes 1 s on an idle machine."""
END_PATIENCE = 5.0
"""Longest time [s] for a browser to end before it is killed."""
DRAW_PATIENCE = 120.0
"""Longest time [s] for the page to draw a picture's content."""
CHARTS_FULL = 7.0
"""Simulated time [s] from which the strip charts are filled."""
BLOWS = 12
"""Number of impacts of the slow motion before the one in the picture, so that others are visible on both sides."""
SLOWNESS = "1/33"
_SHOWN = "Boolean(globalThis.vibro) && Number.isFinite(vibro.drawn().time) && document.querySelector('#absent').hidden"
_LISTENING = re.compile(r"^DevTools listening on (ws://\S+)", re.MULTILINE)
_FLAGS = ("--headless=new", "--remote-debugging-port=0", "--no-first-run", "--no-default-browser-check",
          "--no-proxy-server", "--disable-background-networking", "--disable-component-update", "--disable-sync",
          "--disable-extensions", "--disable-dev-shm-usage", "--mute-audio", "--password-store=basic",
          # Otherwise pages in the background draw only once a second.
          "--disable-background-timer-throttling", "--disable-backgrounding-occluded-windows",
          "--disable-renderer-backgrounding")


class NoBrowserError(RuntimeError):
    """No browser was found, or it does not start; the message names the remedy."""


def browser_program() -> str:
    """Path of the browser's program (NoBrowserError if there is none).

    Each name is run, because Ubuntu's `chromium-browser` may only print how to install a browser.
    """
    if choice := os.environ.get(CHOICE):
        program = shutil.which(choice)
        if not program:
            raise NoBrowserError(f"{CHOICE}={choice}: no such program here; {REMEDY}")
        return program
    for name in NAMES:
        program = shutil.which(name)
        if program and subprocess.run([program, "--version"], capture_output=True, check=False).returncode == 0:
            return program
    raise NoBrowserError(f"no browser here; {REMEDY}")


@contextmanager
def running(program: str) -> Iterator[str]:
    """Start a browser (or NoBrowserError), yield the address by which it is controlled, and end it."""
    with tempfile.TemporaryDirectory(prefix="vibro_ros_browser_", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        environment = {**os.environ, **dict.fromkeys(
            ("XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "XDG_RUNTIME_DIR"), name)}
        root = ["--no-sandbox"] if os.geteuid() == 0 else []  # the sandbox does not work for root
        log = folder / "log"
        with log.open("wb") as said:
            process = subprocess.Popen(
                [program, *_FLAGS, *root, f"--user-data-dir={folder / 'profile'}", "about:blank"], env=environment,
                stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True)
        try:
            yield _address(program, process, log)
        finally:
            _end(process)


def _address(program: str, process: subprocess.Popen, log: Path) -> str:
    """Wait until the browser prints its address, and return it."""
    deadline = time.monotonic() + START_PATIENCE
    while time.monotonic() < deadline:
        ended = process.poll() is not None
        text = log.read_text(errors="replace")
        if listening := _LISTENING.search(text):
            return listening[1]
        if ended:
            break
        time.sleep(0.01)
    last = next((line for line in reversed(text.splitlines()) if line.strip()), "it said nothing")
    how = f"ended with {process.returncode}" if ended else f"did not start within {START_PATIENCE:g} s"
    raise NoBrowserError(f"{program} {how}: {last.strip()}; {REMEDY}")


def _end(process: subprocess.Popen) -> None:
    """Ask the browser to end, then kill the rest of its process group, because children may outlive it."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGTERM)
    with suppress(subprocess.TimeoutExpired):
        process.wait(END_PATIENCE)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@dataclass
class Session(AbstractContextManager):
    """Pages of one test or picture, all closed at its end; `address` is that of a running browser."""

    address: str
    _stack: ExitStack = field(default_factory=ExitStack, init=False)
    _driver: "BrowserType | None" = field(default=None, init=False)

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def page(self, width: int = 1280, height: int = 720, touch: bool = False) -> "Page":
        """Open an empty page of `width` x `height` CSS pixels.

        With `touch`, it is a phone's page, with touch events and two device pixels per CSS pixel.
        """
        from playwright.sync_api import sync_playwright  # costs 0.2 s, and is not installed by `make setup`

        if self._driver is None:
            self._driver = self._stack.enter_context(sync_playwright()).chromium
        context = self._driver.connect_over_cdp(self.address).new_context(
            viewport={"width": width, "height": height}, has_touch=touch, is_mobile=touch,
            device_scale_factor=2 if touch else 1)
        self._stack.callback(context.close)
        return context.new_page()


@contextmanager
def shown_robot() -> Iterator[str]:
    """Run a crawling robot and its view until the block ends (RuntimeError); yields the address of the page."""
    environment = ros_environment()
    with tempfile.TemporaryDirectory() as folder, \
            Child("vibro_ros.ros.live.view", "--port", "0", environment=environment, shown=False) as view:
        address = view.wait_for("/?token=").removeprefix("view: ").strip()
        # drawing without a graphics card is slow: the robot must catch up, and not report stalls
        settings = {"motor.speed": 100.0, "record.enabled": "false", "record.directory": json.dumps(folder),
                    "rate.max_catch_up": 10.0}
        words = [word for name, value in settings.items() for word in ("-p", f"{name}:={value}")]
        with Child("vibro_ros.ros.robot.robot", "--ros-args", *words, environment=environment):
            yield address


def wait_for(page: "Page", condition: str) -> None:
    """Wait until a JavaScript `condition` holds, for `DRAW_PATIENCE` at most (else RuntimeError).

    The page's security policy forbids Playwright's own function.
    """
    deadline = time.monotonic() + DRAW_PATIENCE
    while not page.evaluate(condition):
        if time.monotonic() > deadline:
            raise RuntimeError(f"the page: not within {DRAW_PATIENCE:g} s: {condition}")
        page.wait_for_timeout(20)


def main(words: Sequence[str]) -> int:
    """Take the pictures: the running robot, and an impact in slow motion with its forces."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("docs"), metavar="DIR",
                        help="where view.png and view_live.png are written (default: %(default)s)")
    output = parser.parse_args(words).output
    with running(browser_program()) as browser_address, Session(browser_address) as session, shown_robot() as address:
        page = session.page()
        page.goto(address)
        wait_for(page, _SHOWN)
        wait_for(page, f"vibro.drawn().time > {CHARTS_FULL}")
        _save(page, output / "view_live.png")
        page.check("#forces")
        page.click("#slow")
        wait_for(page, "!document.querySelector('#timeline').disabled")
        page.select_option("#speed", label=SLOWNESS)
        for _ in range(BLOWS):
            page.click("#next")
        page.evaluate("document.activeElement.blur()")
        page.wait_for_timeout(500)  # so that fading elements have faded
        _save(page, output / "view.png")
    return 0


def _save(page: "Page", path: Path) -> None:
    page.screenshot(path=path)
    print(path)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
