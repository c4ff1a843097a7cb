"""A browser for tests and screenshots: Chromium or Chrome where one is found, else Qt WebEngine from a wheel.

Each runs headless as a process of its own, keeps its files in a folder of its own, and is ended with all its children.
Playwright steers both kinds through their debugging port. Qt WebEngine has one page and cannot be asked for another; a
`Session` therefore starts a process for each page of that kind.
"""

import importlib.util
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import BrowserType, Page

CHOICE = "VIBRO_ROS_BROWSER"
"""Environment variable that chooses: `chromium`, `qt`, or the path of a Chromium or Chrome; unset: what is found."""
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
"""Programs to look for on PATH, in this order."""
REMEDY = f"install chromium (Debian: apt install chromium), or take Qt WebEngine from PyPI: {CHOICE}=qt make test"
START_PATIENCE = 60.0
"""How long [s] a browser may take until it can be steered; it takes one on an idle machine."""
END_PATIENCE = 5.0
"""How long [s] a browser may take to end before it is killed."""
_QT_WINDOW = Path(__file__).with_name("qt_window.py")
_LISTENING = re.compile(r"^DevTools listening on (ws://\S+)", re.MULTILINE)
_FLAGS = ("--headless=new", "--remote-debugging-port=0", "--no-first-run", "--no-default-browser-check",
          "--no-proxy-server", "--disable-background-networking", "--disable-component-update", "--disable-sync",
          "--disable-extensions", "--disable-dev-shm-usage", "--mute-audio", "--password-store=basic",
          # Pages that are not in front would otherwise draw once a second.
          "--disable-background-timer-throttling", "--disable-backgrounding-occluded-windows",
          "--disable-renderer-backgrounding")


class NoBrowserError(RuntimeError):
    """There is no browser, or it does not start; the message names the remedy."""


@dataclass(frozen=True)
class Engine:
    """A browser that can be started: its name, `chromium`, for Chrome as well, or `qt`, and the path of its program."""

    name: str
    program: str

    @property
    def many_pages(self) -> bool:
        """Whether one process has as many pages as are asked for."""
        return self.name != "qt"


def chosen_engine(choice: str | None = None) -> Engine:
    """The browser to use: `choice`, or the environment variable `CHOICE`; NoBrowserError when there is none such.
    """
    choice = os.environ.get(CHOICE, "") if choice is None else choice
    if choice == "qt" or not choice and not _chromium():
        if importlib.util.find_spec("PySide6") is None or importlib.util.find_spec("PySide6.QtWebEngineCore") is None:
            raise NoBrowserError(f"{'Qt WebEngine is not installed' if choice else 'no browser here'}; {REMEDY}")
        return Engine("qt", sys.executable)
    program = _chromium() if choice in ("", "chromium") else shutil.which(choice)
    if not program:
        raise NoBrowserError(f"{CHOICE}={choice}: no such program here; {REMEDY}")
    return Engine("chromium", program)


def _chromium() -> str | None:
    """The first Chromium or Chrome on PATH that runs. Ubuntu's `chromium-browser` only tells how to get one."""
    for name in NAMES:
        program = shutil.which(name)
        if program and subprocess.run([program, "--version"], capture_output=True, check=False).returncode == 0:
            return program
    return None


@contextmanager
def running(engine: Engine) -> Iterator[str]:
    """Start a browser and end it with all its children; gives the address by which it is steered.

    Raises
    ------
    NoBrowserError
        When it does not start.
    """
    with tempfile.TemporaryDirectory(prefix="vibro_ros_browser_", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        words, environment = _command(engine, folder)
        log = folder / "log"
        with log.open("wb") as said:
            process = subprocess.Popen(words, env=environment, stdin=subprocess.DEVNULL, stdout=said, stderr=said,
                                       start_new_session=True)
        try:
            yield _address(engine, process, log)
        finally:
            _end(process)


def _command(engine: Engine, folder: Path) -> tuple[Sequence[str], Mapping[str, str]]:
    """Words and environment of a browser that keeps everything in `folder`; root has no sandbox in either."""
    environment = {**os.environ, **{name: str(folder) for name in ("XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME",
                                                                  "XDG_RUNTIME_DIR")}}
    root = ["--no-sandbox"] if os.geteuid() == 0 else []
    if engine.many_pages:
        return [engine.program, *_FLAGS, *root, f"--user-data-dir={folder / 'profile'}", "about:blank"], environment
    flags = [flag for flag in _FLAGS if flag.startswith("--disable-")]
    return [engine.program, str(_QT_WINDOW)], environment | {
        "QT_QPA_PLATFORM": "offscreen", "QTWEBENGINE_REMOTE_DEBUGGING": f"127.0.0.1:{_free_port()}",
        "QTWEBENGINE_CHROMIUM_FLAGS": " ".join([*flags, *root])}


def _free_port() -> int:
    """A port that is free now: Qt WebEngine cannot be told to choose one."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _address(engine: Engine, process: subprocess.Popen, log: Path) -> str:
    """Wait until the browser says where it listens."""
    deadline = time.monotonic() + START_PATIENCE
    while time.monotonic() < deadline:
        ended = process.poll() is not None
        text = log.read_text(errors="replace")
        if found := _LISTENING.search(text):
            return found[1]
        if ended:
            break
        time.sleep(0.01)
    last = next((line for line in reversed(text.splitlines()) if line.strip()), "it said nothing")
    how = f"ended with {process.returncode}" if ended else f"did not start within {START_PATIENCE:g} s"
    raise NoBrowserError(f"{engine.name} ({engine.program}) {how}: {last.strip()}; {REMEDY}")


def _end(process: subprocess.Popen) -> None:
    """Ask the browser to end, then kill what is left of its group: children outlive it otherwise."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGTERM)
    with suppress(subprocess.TimeoutExpired):
        process.wait(END_PATIENCE)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@dataclass
class Session(AbstractContextManager):
    """Pages of one test or picture, all closed at its end.

    `address` is that of a process that runs and can have many pages; without it the session starts its own.
    """

    engine: Engine
    address: str | None = None
    _stack: ExitStack = field(default_factory=ExitStack, init=False)
    _driver: "BrowserType | None" = field(default=None, init=False)

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def page(self, width: int = 1280, height: int = 720, touch: bool = False) -> "Page":
        """Open an empty page that shows so many CSS pixels.

        `touch` says whether it is a phone's, with fingers and two pixels to each of CSS; Qt WebEngine has the size
        only.
        """
        from playwright.sync_api import sync_playwright  # costs 0.2 s, and is not installed by `make setup`

        if self._driver is None:
            self._driver = self._stack.enter_context(sync_playwright()).chromium
        if not self.engine.many_pages:
            return self._only_page(self._driver, width, height)
        if self.address is None:
            self.address = self._stack.enter_context(running(self.engine))
        context = self._driver.connect_over_cdp(self.address).new_context(
            viewport={"width": width, "height": height}, has_touch=touch, is_mobile=touch,
            device_scale_factor=2 if touch else 1)
        self._stack.callback(context.close)
        return context.new_page()

    def _only_page(self, driver: "BrowserType", width: int, height: int) -> "Page":
        address = self._stack.enter_context(running(self.engine))
        # It refuses what Playwright otherwise sets first, such as a folder for downloads.
        page = driver.connect_over_cdp(address, no_defaults=True).contexts[0].pages[0]
        page.set_viewport_size({"width": width, "height": height})
        return page
