"""The server of the live page: HTTP and web sockets by Tornado, in a thread of its own.

Of the machine it serves one page and one web socket, to who knows the token; whatever else is asked for gets a line of
plain text. `Gate` says who is let in, `Allowance` and the numbers here limit what one who is in may ask, and each page
has a sender that waits until the socket has taken what was sent before, so that a page that does not read costs the
others nothing. Nothing that a page or a stranger sends ends the server.
"""

import asyncio
import logging
import threading
from collections.abc import Callable, Sequence
from errno import EADDRINUSE
from socket import socket
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application

from vibro_ros.process.front_door import say
from vibro_ros.view import frames
from vibro_ros.view.gate import Gate
from vibro_ros.view.requests import LONGEST, Request
from vibro_ros.view.visitors import Live, Nothing, Page

MOST_PAGES = 8
"""Pages that may be open at once."""
MOST_CONNECTIONS = 64
"""Connections that may be open at once, with those that have not yet asked for anything."""
IDLE = 10.0
"""Time [s] in which a connection must ask for something."""
PINGS = 15.0
"""Time [s] between two pings of a page, each of which must be answered before the next."""
MOST_UNSENT = 64_000_000
"""Bytes that may wait in one socket's buffer: the payload of a motion, and little else."""
FAREWELL = 0.3
"""Time [s] that pages are given to take leave when the server ends."""


class Server:
    """Serves one live page to several browsers; a context manager, inside which the thread runs.

    Parameters
    ----------
    sockets : sequence of socket
        Listen already, see `listening`.
    gate : Gate
        Says who is let in.
    page : callable
        The page's text, for a nonce by which its scripts are known.
    asked : callable
        Called in the server's thread with a page's number and its request; to be answered by `answer` or `send_motion`.
    greeting : callable
        Texts that say how things stand, for a page that has just opened; called in the server's thread, too.

    Attributes
    ----------
    error : Exception or None
        What ended the thread before it was asked to.
    """

    def __init__(self, sockets: Sequence[socket], gate: Gate, page: Callable[[str], str],
                 asked: Callable[[int, Request], object], greeting: Callable[[], Sequence[tuple[str, str]]]):
        self.error: Exception | None = None
        self.gate, self.page, self.asked, self.greeting = gate, page, asked, greeting
        self._sockets, self._pages = sockets, dict[int, Live]()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop = asyncio.Event()
        self._ready, self._count = threading.Event(), 0
        self._thread = threading.Thread(target=self._run, name="server")

    def __enter__(self) -> "Server":
        _quiet_tornado()
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *_: object) -> None:
        self._post(self._stop.set)
        self._thread.join()

    @property
    def pages(self) -> int:
        """Number of pages that are open."""
        return len(self._pages)

    def send(self, kind: str, text: str) -> None:
        """Send a text to all pages; for any thread, like all that follow."""
        if self._pages:
            self._post(self._to_all, "add_text", kind, text)

    def send_samples(self, rows: bytes) -> None:
        """Send rows of samples, `frames.COLUMNS` as float64, to all pages."""
        if self._pages:
            self._post(self._to_all, "add_samples", rows)

    def answer(self, page: int, id: int | None, done: bool, words: str) -> None:
        """Answer a page's request."""
        self._post(self._to, page, "add_text", "answer", frames.text("answer", id=id, done=done, words=words))

    def send_motion(self, page: int, id: int, header: dict[str, Any], payload: bytes) -> None:
        """Answer a page's request for slow motion."""
        text = frames.text("motion", id=id, header=header)
        self._post(self._to, page, "add_motion", text, frames.motion(id, payload))

    def admit(self, page: Live) -> int | None:
        """The number of a page that has just opened; None where there are too many. For the server's thread."""
        if len(self._pages) >= MOST_PAGES:
            return None
        self._count += 1
        self._pages[self._count] = page
        return self._count

    def forget(self, number: int) -> None:
        """Take note that a page has gone. For the server's thread."""
        self._pages.pop(number, None)

    def _to_all(self, way: str, *what: object) -> None:
        for page in self._pages.values():
            page.outbox_add(way, *what)

    def _to(self, page: int, way: str, *what: object) -> None:
        if page in self._pages:
            self._pages[page].outbox_add(way, *what)

    def _post(self, call: Callable[..., object], *arguments: object) -> None:
        """Have the server's thread make a call; nothing once it has ended."""
        try:
            if self._loop:
                self._loop.call_soon_threadsafe(call, *arguments)
        except RuntimeError:  # the loop is closed
            pass

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:  # the main thread says it
            self.error = error
        finally:
            self._ready.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._loop.set_exception_handler(_say_fault)
        application = Application(
            [("/", Page, {"server": self}), ("/live", Live, {"server": self})], default_handler_class=Nothing,
            default_handler_args={"server": self}, log_function=lambda handler: None, websocket_ping_interval=PINGS,
            websocket_ping_timeout=PINGS, websocket_max_message_size=LONGEST)
        http = _Http(application, max_header_size=16_384, max_body_size=LONGEST, idle_connection_timeout=IDLE,
                     body_timeout=IDLE)
        http.of_pages = lambda: [page.ws_connection.stream for page in self._pages.values() if page.ws_connection]
        http.add_sockets(self._sockets)
        self._ready.set()
        await self._stop.wait()
        http.stop()
        for page in list(self._pages.values()):
            page.close(1001, "the view has ended")
        deadline = self._loop.time() + FAREWELL
        while self._pages and self._loop.time() < deadline:
            await asyncio.sleep(0.01)
        http.close_streams()


class _Http(HTTPServer):
    """Keeps at most `MOST_CONNECTIONS`, and limits what each may keep.

    Attributes
    ----------
    of_pages : callable
        The streams of open pages, which are not ended for newcomers.
    """

    def initialize(self, *arguments: Any, **options: Any) -> None:
        super().initialize(*arguments, **options)
        self._open: list[Any] = []
        self.of_pages: Callable[[], Sequence[Any]] = list

    def handle_stream(self, stream: Any, address: Any) -> None:
        """As in `HTTPServer`."""
        self._open = [one for one in self._open if not one.closed()]
        if len(self._open) >= MOST_CONNECTIONS:
            self._end_oldest()
        self._open.append(stream)
        stream.max_write_buffer_size = MOST_UNSENT
        super().handle_stream(stream, address)

    def _end_oldest(self) -> None:
        """Close the oldest connection that is no open page: most likely one that says nothing."""
        kept = self.of_pages()
        silent = next(one for one in self._open if one not in kept)  # there are fewer pages than connections
        self._open.remove(silent)
        silent.close()

    def close_streams(self) -> None:
        """Close every connection at once."""
        for stream in self._open:
            stream.close()


def listening(address: str, port: int) -> list[socket]:
    """Sockets that listen on `address`, an address or a name, and `port`; 0 takes any port that is free.

    Raises
    ------
    ValueError
        Naming what is wrong and the remedy.
    """
    try:
        return bind_sockets(port, address)
    except PermissionError:
        raise ValueError(f"--port {port}: this user may not listen there; give one of at least 1024") from None
    except (OSError, UnicodeError) as error:
        if getattr(error, "errno", None) == EADDRINUSE:
            raise ValueError(f"--port {port}: something listens there already, perhaps another view; give another "
                             "port, or --port 0 for any that is free") from None
        raise ValueError(f"--address {address}: nothing can listen there ({error}); give 127.0.0.1, or an address of "
                         "this machine") from None


def _quiet_tornado() -> None:
    """Let Tornado say nothing by itself: what strangers send is no news, and a fault of ours is one line."""
    for name in ("tornado.access", "tornado.general", "asyncio"):
        logging.getLogger(name).addHandler(logging.NullHandler())
        logging.getLogger(name).propagate = False
    faults = logging.getLogger("tornado.application")
    faults.handlers, faults.propagate = [_Faults()], False


class _Faults(logging.Handler):
    """Says errors that Tornado has caught, in one line each."""

    def emit(self, record: logging.LogRecord) -> None:
        """As in `Handler`."""
        _say(record.exc_info[1] if record.exc_info else None, record.getMessage())


def _say_fault(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    _say(context.get("exception"), context.get("message", ""))


def _say(error: object, message: str) -> None:
    what = f"{type(error).__name__}: {error}" if error else message
    say("view", f"the server failed with {what}; please report it. It goes on")
