"""Pages of a real browser, which fail their test if they log an error or send a request to another host."""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from urllib.parse import urlsplit

import pytest

from tools.browser import NoBrowserError, Session, browser_program, running

LOOPBACK_NAMES = {"127.0.0.1", "localhost", "[::1]", "::1"}
NO_HOST = {"about", "blob", "data", "file"}  # schemes by which nothing leaves the machine


class PageWatch:
    """Errors that a page logs, and its requests to other hosts.

    A test that provokes a complaint takes it with `expect`; what is left fails the test.
    """

    def __init__(self) -> None:
        self.complaints: list[str] = []

    def follow(self, page) -> None:
        page.on("console", lambda message: self._take_console_message(message.type, message.text))
        page.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        page.on("crash", lambda page: self.complaints.append(f"crash: {page.url}"))
        page.on("request", lambda request: self._take_request(request.url))
        page.on("websocket", lambda socket: self._take_request(socket.url))

    def expect(self, words: str) -> None:
        """Take the errors that contain `words` from the list; there must be at least one."""
        left = [complaint for complaint in self.complaints if words not in complaint]
        assert len(left) < len(self.complaints), f"no complaint holds {words!r}: {self.complaints}"
        self.complaints = left

    def _take_console_message(self, kind: str, text: str) -> None:
        if kind in ("error", "warning", "assert"):
            self.complaints.append(f"{kind}: {text}")

    def _take_request(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in NO_HOST and parts.hostname not in LOOPBACK_NAMES:
            self.complaints.append(f"asks another host: {url}")


@pytest.fixture(scope="session")
def browser() -> Iterator[str]:
    """The address of a browser that all tests share, each with pages of its own.

    Without a browser, tests are skipped on a developer's machine and fail where `CI` is set.
    """
    try:
        program = browser_program()
    except NoBrowserError as error:
        if os.environ.get("CI"):
            pytest.fail(str(error))
        pytest.skip(str(error))
    with running(program) as address:
        yield address


@pytest.fixture
def watch() -> Iterator[PageWatch]:
    """Fail the test if its pages logged an error or sent a request to another host."""
    watch = PageWatch()
    yield watch
    assert watch.complaints == []


@pytest.fixture(scope="module")
def session(browser) -> Iterator[Session]:
    """The control of the browser, which takes a second to start, for the tests of a module."""
    with Session(browser) as session:
        yield session


@pytest.fixture
def open_page(session, watch) -> Iterator[Callable]:
    """Open an empty page, `open_page(width, height, touch)`; it is closed at the end of the test."""
    with ExitStack() as at_end:
        def open_one(width: int = 1280, height: int = 720, touch: bool = False):
            page = session.page(width, height, touch)
            at_end.callback(page.context.close)
            watch.follow(page)
            return page
        yield open_one
