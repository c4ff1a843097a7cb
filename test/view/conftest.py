"""Pages of a real browser, which fail their test when they complain or ask another host for anything."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tools.browser import Engine, Session, running

sys.path.insert(0, str(Path(__file__).parent))

from live_view import LiveView  # noqa: E402 (beside the tests)
from real_processes import bench, compiled, start, udp_only  # noqa: E402 (in the folder above)
from watched_page import Watch, engine_or_outcome  # noqa: E402 (beside the tests)

__all__ = ["bench", "compiled", "start", "udp_only"]


@pytest.fixture(scope="session")
def engine() -> Engine:
    """The browser to use. Without one, tests are skipped on a developer's machine and fail where `CI` is set."""
    return engine_or_outcome()


@pytest.fixture(scope="session")
def browser(engine) -> Iterator[str | None]:
    """The address of a browser that all tests share, each with pages of its own; None if each page is a browser."""
    if not engine.many_pages:
        yield None
        return
    with running(engine) as address:
        yield address


@pytest.fixture
def watch() -> Iterator[Watch]:
    """Fail the test on what its pages complained of."""
    watch = Watch()
    yield watch
    assert watch.complaints == []


@pytest.fixture
def open_page(engine, browser, watch) -> Iterator[Callable]:
    """Open an empty page, `open_page(width, height, touch)`; it is closed at the end of the test."""
    with Session(engine, browser) as session:
        def open_one(width: int = 1280, height: int = 720, touch: bool = False):
            page = session.page(width, height, touch)
            watch.follow(page)
            return page
        yield open_one


@pytest.fixture
def page(open_page):
    """Give an empty page of 1280 x 720."""
    return open_page()


@pytest.fixture
def view(start) -> Iterator[LiveView]:
    """The view as a process of its own; ended at the end as a user does, and it must not have failed meanwhile."""
    view = LiveView(start)
    yield view
    if not view.executable.ended:
        view.end()
    view.check()
