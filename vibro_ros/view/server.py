"""The server of the live page: HTTP and web sockets by Tornado, in a thread of its own.

The server listens on this machine's loopback address by default, but every page that is open in the user's browser can
send requests there. Three checks keep other sites out:

- The token is a secret in the page's address. A page of another site does not know it.
- The name in the `Host` header must be this machine's (`host_pattern`). A site whose name points to 127.0.0.1 (DNS
  rebinding) would otherwise count as the same origin in the browser.
- A web socket must be opened by the page that this server has sent: Tornado compares `Origin` with `Host`.

It serves one page and one web socket; every other request gets a line of plain text. The constants here limit the
memory for one client, and each page has a sender that waits until the socket has taken the previous frame, so that a
page that does not read costs the others nothing. Nothing that a page or another client sends can end the server.
"""

import asyncio
import hmac
import ipaddress
import logging
import re
import secrets
import threading
from collections import deque
from collections.abc import Callable, Collection, Sequence
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
from vibro_ros.view.motion import Document
from vibro_ros.view.page import policy
from vibro_ros.view.protocol import (
    LONGEST,
    RefusedError,
    Request,
    motion_frame,
    read_request,
    samples_frame,
    text_frame,
)

MOST_PAGES = 8  # most pages that may be open at once
MOST_CONNECTIONS = 64  # most connections that may be open at once, including those without a request so far
IDLE_TIMEOUT = 10.0  # time [s] in which a connection must send a request
PING_INTERVAL = 15.0  # time [s] between two pings of a page, each of which must be answered before the next
MOST_UNSENT = 64_000_000
"""Most bytes that may wait in one socket's buffer: enough for the payload of a motion, and little more."""
CLOSE_TIMEOUT = 0.3  # time [s] that pages get to close their web sockets when the server ends
SOCKET_BUFFER = 131_072
"""Size [bytes] of the system's send buffer of a socket; small, so that a slow page does not lag far behind."""
MOST_BYTES = 2_000_000  # most bytes of samples that wait for one page: 10 s at 1 kHz
MOST_TEXTS = 200  # most texts that wait for one page; none wait for a page that reads
FRAME_BYTES = 250_000  # size [bytes] of samples from which a frame is not extended
_NO_TOKEN = "this page opens with the whole address that `view` has printed, its token included"
_NOT_FOUND = "nothing is here; open the whole address that `view` has printed"


class Server:
    """Serves one live page to several browsers; a context manager, inside which the thread runs.

    The sockets already listen on `address`, see `listening`; `names` are those by which others reach this machine if
    the address is no loopback one. `token` is the secret in the page's address, new for each server. `page` returns the
    page's text for a nonce that its scripts must have. Two callbacks are called in the server's thread: `asked` with a
    page's number and its request, which is to be answered by `answer` or `send_motion`; `greeting` for the first texts
    to a page that has just opened, kind and text of each. `error` is the error that ended the thread, if one did.
    """

    def __init__(self, sockets: Sequence[socket], address: str, names: Collection[str], page: Callable[[str], str],
                 asked: Callable[[int, Request], object], greeting: Callable[[], Sequence[tuple[str, str]]]):
        self.error: Exception | None = None
        self.token, self._hosts = secrets.token_urlsafe(16), host_pattern(address, names)
        self.page, self.asked, self.greeting = page, asked, greeting
        self._sockets, self.pages = sockets, dict[int, "_PageSocket"]()
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
        """Send a text to all pages; this and the methods below may be called in any thread."""
        if self.pages:
            self._post(self._to_all, kind, text)

    def send_samples(self, rows: bytes) -> None:
        """Send rows of samples, `protocol.COLUMNS` as float64, to all pages."""
        if self.pages:
            self._post(self._to_all, "samples", rows)

    def answer(self, page: int, id: int | None, done: bool, words: str) -> None:
        """Answer a page's request."""
        self._post(self._to, page, "answer", text_frame("answer", id=id, done=done, words=words))

    def send_motion(self, page: int, id: int, motion: Document) -> None:
        """Answer a page's request for slow motion."""
        text = text_frame("motion", id=id, header=motion[0])
        self._post(self._to, page, "motion", text, motion_frame(id, motion[1]))

    def _to_all(self, kind: str, *frames: str | bytes) -> None:
        for page in self.pages.values():
            page.put(kind, *frames)

    def _to(self, page: int, kind: str, *frames: str | bytes) -> None:
        if page in self.pages:
            self.pages[page].put(kind, *frames)

    def _post(self, call: Callable[..., object], *arguments: object) -> None:
        """Call a function in the server's thread; does nothing once the thread has ended."""
        try:
            if self._loop:
                self._loop.call_soon_threadsafe(call, *arguments)
        except RuntimeError:  # the loop is closed
            pass

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception as error:  # the main thread reports it
            self.error = error
        finally:
            self._ready.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        application = Application(
            default_handler_class=_NotFound, default_handler_args={"server": self}, log_function=lambda handler: None,
            websocket_ping_interval=PING_INTERVAL, websocket_ping_timeout=PING_INTERVAL,
            websocket_max_message_size=LONGEST)
        arguments = {"server": self}
        application.add_handlers(self._hosts, [("/", _Page, arguments), ("/live", _PageSocket, arguments)])
        http = _Http(application, max_header_size=16_384, max_body_size=LONGEST, idle_connection_timeout=IDLE_TIMEOUT,
                     body_timeout=IDLE_TIMEOUT)
        http.page_streams = lambda: [page.ws_connection.stream for page in self.pages.values() if page.ws_connection]
        http.add_sockets(self._sockets)
        self._ready.set()
        await self._stop.wait()
        http.stop()
        for page in list(self.pages.values()):
            page.close(1001, "the view has ended")
        deadline = self._loop.time() + CLOSE_TIMEOUT
        while self.pages and self._loop.time() < deadline:
            await asyncio.sleep(0.01)
        http.close_streams()


def listening(address: str, port: int) -> list[socket]:
    """Return sockets that listen on an address or a name and a port, 0 for any free one (ValueError if none can)."""
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


def is_loopback(address: str) -> bool:
    """Return whether `address` can be reached from this machine only."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address.lower() == "localhost"


def host_pattern(address: str, names: Collection[str]) -> str:
    """Return a regular expression of this machine's host names, without port, for a server that listens on `address`.

    An IP address cannot be rebound: a page whose URL has one does come from that machine. So IP addresses are accepted
    (others than loopback ones only if the server listens there), and names only if they are known. The parentheses are
    needed, because Tornado appends a `$`, which would otherwise apply to the last alternative only.
    """
    hosts = [r"localhost", r"127\.\d+\.\d+\.\d+", r"\[::1\]"]
    if not is_loopback(address):
        hosts += [r"(?!0\.0\.0\.0)\d+\.\d+\.\d+\.\d+", r"\[(?!::\])[0-9a-f:.]+\]"]
        hosts += [re.escape(name.lower()) for name in (address, *names) if name and name not in ("0.0.0.0", "::")]
    return f"({'|'.join(hosts)})"


class _Handler(RequestHandler):
    """A request handler with strict security headers, whose errors are one line of plain text."""

    def initialize(self, server: Server) -> None:
        self._server = server

    def set_default_headers(self) -> None:  # no caching, sniffing, framing or referrer
        self.clear_header("Server")
        for name, value in {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "X-Frame-Options": "DENY",
                            "Referrer-Policy": "no-referrer", "Cross-Origin-Resource-Policy": "same-origin",
                            "Cross-Origin-Opener-Policy": "same-origin",
                            "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'"}.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        tokens = self.get_query_arguments("token")
        if len(tokens) != 1 or not hmac.compare_digest(tokens[0].encode(errors="replace"), self._server.token.encode()):
            self.refuse(403, _NO_TOKEN)

    def refuse(self, code: int, words: str) -> None:
        """Answer with one line and end the request."""
        self._answer(code, words)
        raise Finish

    def write_error(self, status_code: int, **_: Any) -> None:
        self._answer(status_code, self._reason)

    def _answer(self, code: int, words: str) -> None:
        self.set_status(code)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{words}\n")


class _NotFound(_Handler):
    """Handler of every other path, and of every path under another host name."""

    def prepare(self) -> None:
        self.refuse(404, _NOT_FOUND)


class _Page(_Handler):
    """Handler of the page, whose policy allows only its own scripts, by a nonce, and connections to this server."""

    def get(self) -> None:
        nonce = secrets.token_urlsafe(16)
        rules = policy(nonce, connect=f"ws://{self.request.host} wss://{self.request.host}")
        self.set_header("Content-Security-Policy", f"{rules}; frame-ancestors 'none'")
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.finish(self._server.page(nonce))


class _PageSocket(_Handler, WebSocketHandler):
    """The web socket of one open page."""

    def initialize(self, server: Server) -> None:
        super().initialize(server)
        self._stream: Any = self.request.connection.stream  # type: ignore[union-attr]

    def check_origin(self, origin: str) -> bool:
        try:
            return super().check_origin(origin)
        except ValueError:  # not a URL, such as http://[::1
            return False

    def open(self, *_: str, **__: str) -> None:
        self._outbox, self._news = Outbox(), asyncio.Event()
        self._number: int | None = None
        if len(self._server.pages) >= MOST_PAGES:
            self.close(1013, "too many pages are open already; close one")
            return
        self._number = next(self._server.numbers)
        self._server.pages[self._number] = self
        self.set_nodelay(True)
        self._stream.socket.setsockopt(SOL_SOCKET, SO_SNDBUF, SOCKET_BUFFER)
        for kind, text in self._server.greeting():
            self.put(kind, text)
        self._sender = asyncio.get_running_loop().create_task(self._send())

    def put(self, kind: str, *frames: str | bytes) -> None:
        """Put frames into the page's outbox, see `Outbox.add`."""
        self._outbox.add(kind, *frames)
        self._news.set()

    def on_message(self, message: str | bytes) -> None:
        if self._number is None:
            return
        try:
            self._server.asked(self._number, read_request(message))
        except RefusedError as error:
            self.put("answer", text_frame("answer", id=error.id, done=False, words=str(error)))

    def on_close(self) -> None:
        number, self._number = getattr(self, "_number", None), None
        if number is not None:
            self._server.pages.pop(number, None)
            self._sender.cancel()
            self._outbox = Outbox()  # frees megabytes now, because this object may be collected late

    async def _send(self) -> None:
        """Send the frames in the outbox one by one, each when the socket has taken the previous one."""
        with suppress(WebSocketClosedError, StreamClosedError, StreamBufferFullError):
            while True:
                await self._news.wait()
                self._news.clear()
                while self._outbox:
                    frame = self._outbox.take()
                    await self.write_message(frame, binary=isinstance(frame, bytes))
        self.close()


_FRAMES_OF_ROBOT = ("robot", "absent", "samples", "impacts")
#: For each kind, the kinds of waiting frames that a new one replaces: an earlier state or status, a late motion.
_REPLACES = {"robot": _FRAMES_OF_ROBOT, "absent": _FRAMES_OF_ROBOT, "status": ("status",), "commands": ("commands",),
             "motion": ("motion",)}


class Outbox:
    """Frames that wait to be sent to one page: bounded, so that a page that reads slowly costs no memory.

    When there is no room, the oldest samples or texts are dropped, so that a slow page shows the present.
    """

    def __init__(self):
        self._queue: deque[tuple[str, str | bytes]] = deque()  # kind and data

    def __len__(self) -> int:
        return len(self._queue)

    def add(self, kind: str, *frames: str | bytes) -> None:
        """Add texts, a motion's text and payload, or rows of samples without head; see `_REPLACES`."""
        self._queue = deque(frame for frame in self._queue if frame[0] not in _REPLACES.get(kind, ()))
        self._queue += [(kind, frame) for frame in frames]
        if sum(len(data) for kind_of_frame, data in self._queue if kind_of_frame == "samples") > MOST_BYTES:
            self._drop_oldest("samples")
        if sum(isinstance(data, str) for _, data in self._queue) > MOST_TEXTS:
            self._drop_oldest("impacts", "log", "answer", "status")

    def take(self) -> str | bytes:
        """Remove and return the next frame; consecutive rows of samples are joined to one frame."""
        kind, data = self._queue.popleft()
        if isinstance(data, str) or kind != "samples":
            return data
        while len(data) < FRAME_BYTES and self._queue and self._queue[0][0] == "samples":
            _, more = self._queue.popleft()
            assert isinstance(more, bytes)
            data += more
        return samples_frame(data)

    def _drop_oldest(self, *kinds: str) -> None:
        for item in self._queue:
            if item[0] in kinds:
                self._queue.remove(item)
                return


class _Http(HTTPServer):
    """An HTTP server with at most `MOST_CONNECTIONS`, and a limited write buffer for each.

    `page_streams` returns the streams of open pages, which are not closed to make room for new connections.
    """

    def initialize(self, *arguments: Any, **options: Any) -> None:
        super().initialize(*arguments, **options)
        self._open: list[Any] = []
        self.page_streams: Callable[[], Sequence[Any]] = list

    def handle_stream(self, stream: Any, address: Any) -> None:
        self._open = [open_stream for open_stream in self._open if not open_stream.closed()]
        if len(self._open) >= MOST_CONNECTIONS:
            page_streams = self.page_streams()  # fewer than connections; the oldest other one is most likely idle
            idle = next(open_stream for open_stream in self._open if open_stream not in page_streams)
            self._open.remove(idle)
            idle.close()
        self._open.append(stream)
        stream.max_write_buffer_size = MOST_UNSENT
        super().handle_stream(stream, address)

    def close_streams(self) -> None:
        for stream in self._open:
            stream.close()


def _quiet_tornado() -> None:
    """Silence Tornado's log, because bad requests do not matter; internal errors become one line each."""
    for name in ("tornado.access", "tornado.general", "tornado.application", "asyncio"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [logging.NullHandler()], False
        if name in ("tornado.application", "asyncio"):
            logger.handlers = [_Faults(logging.ERROR)]


class _Faults(logging.Handler):
    """Log handler that prints errors caught by Tornado or asyncio, in one line each."""

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        fault = f"{type(error).__name__}: {error}" if error else record.getMessage()
        say("view", f"the server failed with {fault}; please report it. It goes on")
