"""What a page of a real browser complains of, and what it asks other hosts for."""

import os
from urllib.parse import urlsplit

import pytest

from tools.browser import Engine, NoBrowserError, chosen_engine

HERE = {"127.0.0.1", "localhost", "[::1]", "::1"}
NO_HOST = {"about", "blob", "data", "file"}  # schemes by which nothing leaves the machine


class Watch:
    """What a page complains of, and what it asks other hosts for.

    A test that provokes a complaint takes it with `expect`; what is left fails the test.
    """

    def __init__(self) -> None:
        self.complaints: list[str] = []

    def follow(self, page) -> None:
        page.on("console", lambda said: self._hear(said.type, said.text))
        page.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        page.on("crash", lambda page: self.complaints.append(f"crash: {page.url}"))
        page.on("request", lambda request: self._look(request.url))
        page.on("websocket", lambda socket: self._look(socket.url))

    def expect(self, words: str) -> None:
        """Take the complaints that hold `words`; at least one must be there."""
        left = [one for one in self.complaints if words not in one]
        assert len(left) < len(self.complaints), f"no complaint holds {words!r}: {self.complaints}"
        self.complaints = left

    def _hear(self, kind: str, text: str) -> None:
        if kind in ("error", "warning", "assert"):
            self.complaints.append(f"{kind}: {text}")

    def _look(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in NO_HOST and parts.hostname not in HERE:
            self.complaints.append(f"asks another host: {url}")


def engine_or_outcome() -> Engine:
    """The browser to test with; without one the test is skipped, and fails where the environment has `CI`."""
    try:
        return chosen_engine()
    except NoBrowserError as error:
        if os.environ.get("CI"):
            pytest.fail(str(error))
        pytest.skip(str(error))
