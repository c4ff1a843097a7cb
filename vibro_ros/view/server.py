"""The server of the live page: HTTP and web sockets by Tornado, in a thread of its own.

Of the machine it serves one page and one web socket, to visitors with the token; every other request gets a line of
plain text. `Gate` says who is let in, `Allowance` and the numbers here limit what a page may ask, and each page has a
sender that waits until the socket has taken what was sent before, so that a page that does not read costs the others
nothing. Nothing that a page or a stranger sends ends the server.
"""

import asyncio
import logging
import secrets
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from errno import EADDRINUSE
from itertools import count
from socket import SO_SNDBUF, SOL_SOCKET, socket
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.iostream import StreamBufferFullError, StreamClosedError
from tornado.netutil import bind_sockets
from tornado.web import Application, Finish, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from vibro_ros.process.entry_point import say
from vibro_ros.view.gate import MOST_STRIKES, RATE, Allowance, Gate
from vibro_ros.view.motion import Document
from vibro_ros.view.page import policy
from vibro_ros.view.protocol import LONGEST, Outbox, RefusedError, Request, motion_frame, read_request, text_frame

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
SOCKET_BUFFER = 131_072
"""Bytes that the system keeps for one socket, so that a slow page is not shown what is long past."""
_TOKEN = "this page opens with the whole address that `view` has printed, its token included"
_HOST = "the address names another host; open the address that `view` has printed"
_ORIGIN = "only the page of this server may connect"


class Server:
    """Serves one live page to several browsers; a context manager, inside which the thread runs.

    The sockets listen already, see `listening`. `page` makes the page's text, for a nonce by which its scripts are
    known. The others are called in the server's thread: `asked` with a page's number and its request, to be answered
    by `answer` or `send_motion`; `greeting` for texts that say how things stand, for a page that has just opened.
    `error` is what ended the thread before it was asked to.
    """

    def __init__(self, sockets: Sequence[socket], gate: Gate, page: Callable[[str], str],
                 asked: Callable[[int, Request], object], greeting: Callable[[], Sequence[tuple[str, str]]]):
        self.error: Exception | None = None
        self.gate, self.page, self.asked, self.greeting = gate, page, asked, greeting
        self._sockets, self.pages = sockets, dict[int, "_Live"]()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop = asyncio.Event()
        self._ready, self.numbers = threading.Event(), count(1)
        self._thread = threading.Thread(target=self._run, name="server")

    def __enter__(self) -> "Server":
        _quiet_tornado()
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *_: object) -> None:
        self._post(self._stop.set)
        self._thread.join()

    def send(self, kind: str, text: str) -> None:
        """Send a text to all pages; for any thread, like all that follow."""
        if self.pages:
            self._post(self._to_all, Outbox.add_text, kind, text)

    def send_samples(self, rows: bytes) -> None:
        """Send rows of samples, `protocol.COLUMNS` as float64, to all pages."""
        if self.pages:
            self._post(self._to_all, Outbox.add_samples, rows)

    def answer(self, page: int, id: int | None, done: bool, words: str) -> None:
        """Answer a page's request."""
        self._post(self._to, page, Outbox.add_text, "answer", text_frame("answer", id=id, done=done, words=words))

    def send_motion(self, page: int, id: int, motion: Document) -> None:
        """Answer a page's request for slow motion."""
        text = text_frame("motion", id=id, header=motion[0])
        self._post(self._to, page, Outbox.add_motion, text, motion_frame(id, motion[1]))

    def _to_all(self, add: Callable[..., None], *what: object) -> None:
        for page in self.pages.values():
            page.put(add, *what)

    def _to(self, page: int, add: Callable[..., None], *what: object) -> None:
        if page in self.pages:
            self.pages[page].put(add, *what)

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
        application = Application(
            [("/", _Page, {"server": self}), ("/live", _Live, {"server": self})], default_handler_class=_Nothing,
            default_handler_args={"server": self}, log_function=lambda handler: None, websocket_ping_interval=PINGS,
            websocket_ping_timeout=PINGS, websocket_max_message_size=LONGEST)
        http = _Http(application, max_header_size=16_384, max_body_size=LONGEST, idle_connection_timeout=IDLE,
                     body_timeout=IDLE)
        http.of_pages = lambda: [page.ws_connection.stream for page in self.pages.values() if page.ws_connection]
        http.add_sockets(self._sockets)
        self._ready.set()
        await self._stop.wait()
        http.stop()
        for page in list(self.pages.values()):
            page.close(1001, "the view has ended")
        deadline = self._loop.time() + FAREWELL
        while self.pages and self._loop.time() < deadline:
            await asyncio.sleep(0.01)
        http.close_streams()


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


class _Visitor(RequestHandler):
    """A request whose host is checked before anything else, and whose errors are one line of plain text."""

    def initialize(self, server: Server) -> None:
        self._server = server
        self._stream: Any = self.request.connection.stream  # type: ignore[union-attr]

    def set_default_headers(self) -> None:  # browsers keep, guess, frame and pass on nothing
        self.clear_header("Server")
        for name, value in {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "X-Frame-Options": "DENY",
                            "Referrer-Policy": "no-referrer", "Cross-Origin-Resource-Policy": "same-origin",
                            "Cross-Origin-Opener-Policy": "same-origin",
                            "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'"}.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        if not self._server.gate.knows_host(self._header("Host")):
            self._refuse(403, _HOST)

    def check_token(self) -> None:
        given = self.get_query_arguments("token")
        if len(given) != 1 or not self._server.gate.knows_token(given[0]):
            self._refuse(403, _TOKEN)

    def write_error(self, status_code: int, **_: Any) -> None:
        self._tell(status_code, self._reason)

    def _header(self, name: str) -> str:
        """A header that comes exactly once; else nothing."""
        given = self.request.headers.get_list(name)
        return given[0] if len(given) == 1 else ""

    def _refuse(self, code: int, words: str) -> None:
        self._tell(code, words)
        raise Finish

    def _tell(self, code: int, words: str) -> None:
        self.set_status(code)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{words}\n")


class _Nothing(_Visitor):
    """Every other path."""

    def prepare(self) -> None:
        super().prepare()
        self._refuse(404, "nothing is here")


class _Page(_Visitor):
    """The page: only its own scripts, known by a nonce, can run in it, and it can talk to nobody else."""

    def get(self) -> None:
        self.check_token()
        nonce = secrets.token_urlsafe(16)
        rules = policy(nonce, connect="ws://{0} wss://{0}".format(self._header("Host")))
        self.set_header("Content-Security-Policy", f"{rules}; frame-ancestors 'none'")
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.finish(self._server.page(nonce))


class _Live(_Visitor, WebSocketHandler):
    """The web socket of one open page."""

    def prepare(self) -> None:
        super().prepare()
        if not self._server.gate.knows_origin(self._header("Origin"), self._header("Host")):
            self._refuse(403, _ORIGIN)
        self.check_token()

    def check_origin(self, origin: str) -> bool:
        return True  # `prepare` has checked it

    def open(self, *_: str, **__: str) -> None:
        self._outbox, self._news, self._allowance = Outbox(), asyncio.Event(), Allowance()
        self._number: int | None = None
        if len(self._server.pages) >= MOST_PAGES:
            self.close(1013, "too many pages are open already; close one")
            return
        self._number = next(self._server.numbers)
        self._server.pages[self._number] = self
        self.set_nodelay(True)
        self._stream.socket.setsockopt(SOL_SOCKET, SO_SNDBUF, SOCKET_BUFFER)
        for kind, text in self._server.greeting():
            self.put(Outbox.add_text, kind, text)
        self._sender = asyncio.get_running_loop().create_task(self._send())

    def put(self, add: Callable[..., None], *what: object) -> None:
        """Put something into the page's outbox; `add` is the method of `Outbox` that takes it."""
        add(self._outbox, *what)
        self._news.set()

    def on_message(self, message: str | bytes) -> None:
        if self._number is None:
            return
        is_admitted = self._allowance.admits()
        try:
            request = read_request(message)
            if not is_admitted:
                raise RefusedError(f"more than {RATE:g} requests a second; ask again later", request.id)
            self._server.asked(self._number, request)
        except RefusedError as error:
            if is_admitted:
                self._allowance.strikes += 1.0
            self.put(Outbox.add_text, "answer", text_frame("answer", id=error.id, done=False, words=str(error)))
        self._watch()

    def on_ping(self, data: bytes) -> None:
        if self._number is not None:
            self._allowance.admits()  # each makes an answer that waits while the page does not read
            self._watch()

    def on_close(self) -> None:
        number, self._number = getattr(self, "_number", None), None
        if number is not None:
            self._server.pages.pop(number, None)
            self._sender.cancel()
            self._outbox = Outbox()  # what waited may be megabytes, and Python may find that this object is gone late

    def _watch(self) -> None:
        if self._allowance.strikes > MOST_STRIKES:
            self.close(1008, "too many requests that are none")

    async def _send(self) -> None:
        """Send what is in the outbox, one frame after the other, each when the socket has taken the one before."""
        with suppress(WebSocketClosedError, StreamClosedError, StreamBufferFullError):
            while True:
                await self._news.wait()
                self._news.clear()
                while self._outbox:
                    frame = self._outbox.take()
                    await self.write_message(frame, binary=isinstance(frame, bytes))
        self.close()


class _Http(HTTPServer):
    """Keeps at most `MOST_CONNECTIONS`, and limits what each may keep.

    `of_pages` gives the streams of open pages, which are not ended for newcomers.
    """

    def initialize(self, *arguments: Any, **options: Any) -> None:
        super().initialize(*arguments, **options)
        self._open: list[Any] = []
        self.of_pages: Callable[[], Sequence[Any]] = list

    def handle_stream(self, stream: Any, address: Any) -> None:
        self._open = [one for one in self._open if not one.closed()]
        if len(self._open) >= MOST_CONNECTIONS:
            of_pages = self.of_pages()  # fewer than connections; the oldest of the others most likely says nothing
            silent = next(one for one in self._open if one not in of_pages)
            self._open.remove(silent)
            silent.close()
        self._open.append(stream)
        stream.max_write_buffer_size = MOST_UNSENT
        super().handle_stream(stream, address)

    def close_streams(self) -> None:
        for stream in self._open:
            stream.close()


def _quiet_tornado() -> None:
    """Let Tornado say nothing by itself: a bad request of a visitor is no news, and a fault of ours is one line."""
    for name in ("tornado.access", "tornado.general", "tornado.application", "asyncio"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [logging.NullHandler()], False
        if name in ("tornado.application", "asyncio"):
            logger.handlers = [_Faults(logging.ERROR)]


class _Faults(logging.Handler):
    """Says errors that Tornado or asyncio has caught, in one line each."""

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        fault = f"{type(error).__name__}: {error}" if error else record.getMessage()
        say("view", f"the server failed with {fault}; please report it. It goes on")
