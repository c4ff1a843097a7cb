"""A page, and a view as a process of its own, for each test of the page."""

from collections.abc import Iterator

import pytest
from browser_pages import browser, open_page, session, watch
from live_view import LiveView
from real_processes import bench, start, udp_only

__all__ = ["bench", "browser", "open_page", "session", "start", "udp_only", "watch"]


@pytest.fixture
def page(open_page):
    """Give an empty page of 1280 x 720."""
    return open_page()


@pytest.fixture
def view(start) -> Iterator[LiveView]:
    """Start the view as a process; at the end of the test it is ended as by a user, and must not have failed."""
    view = LiveView(start)
    yield view
    if not view.executable.ended:
        view.end()
