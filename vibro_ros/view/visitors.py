"""What the server answers to a browser: the page, the web socket behind it, and a line of text for all else."""

import asyncio
import json
import secrets
from collections.abc import Sequence
from contextlib import suppress
from socket import SO_SNDBUF, SOL_SOCKET
from typing import Any, Protocol

from tornado.iostream import StreamBufferFullError, StreamClosedError
from tornado.web import Finish, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from vibro_ros.view import frames
from vibro_ros.view.gate import Gate
from vibro_ros.view.limits import RATE, Allowance
from vibro_ros.view.outbox import Outbox
from vibro_ros.view.page import policy
from vibro_ros.view.requests import RefusedError, Request, read_request

SOCKET_BUFFER = 131_072
"""Bytes that the system keeps for one socket, so that a slow page is not shown what is long past."""
_TOKEN = "this page opens with the whole address that `view` has printed, its token included"
_HOST = "the address names another host; open the address that `view` has printed"
_ORIGIN = "only the page of this server may connect"


class Host(Protocol):
    """What visitors need of the server, see `server.Server`."""

    gate: Gate

    def page(self, nonce: str) -> str:
        """The page's text."""

    def asked(self, number: int, request: Request) -> object:
        """Take a page's request."""

    def greeting(self) -> Sequence[tuple[str, str]]:
        """What a page is told first: kinds and texts."""

    def admit(self, page: "Live") -> int | None:
        """The number of a page that has just opened; None where there are too many."""

    def forget(self, number: int) -> None:
        """Take note that a page has gone."""


class _Visitor(RequestHandler):
    """A request whose host is checked before anything else, and whose errors are one line of plain text."""

    def initialize(self, server: Host) -> None:
        self._server = server
        self._stream: Any = self.request.connection.stream  # type: ignore[union-attr]

    def set_default_headers(self) -> None:
        """Say nothing of the server, and let browsers keep, guess, frame and pass on nothing."""
        self.clear_header("Server")
        for name, value in {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "X-Frame-Options": "DENY",
                            "Referrer-Policy": "no-referrer", "Cross-Origin-Resource-Policy": "same-origin",
                            "Cross-Origin-Opener-Policy": "same-origin",
                            "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'"}.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Refuse a host that is not this machine."""
        if not self._server.gate.knows_host(self._header("Host")):
            self._refuse(403, _HOST)

    def compute_etag(self) -> None:
        """Nothing: what is not kept needs no mark by which it is known again."""

    def check_token(self) -> None:
        """Refuse who does not know the token."""
        given = self.get_query_arguments("token")
        if len(given) != 1 or not self._server.gate.knows_token(given[0]):
            self._refuse(403, _TOKEN)

    def write_error(self, status_code: int, **_: Any) -> None:
        """One line, which tells nothing of the machine."""
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


class Nothing(_Visitor):
    """Every other path."""

    def prepare(self) -> None:
        """Refuse."""
        super().prepare()
        self._refuse(404, "nothing is here")


class Page(_Visitor):
    """The page."""

    def get(self) -> None:
        """Send it; nothing but its own scripts, known by a nonce, can run in it, and it can talk to nobody else."""
        self.check_token()
        nonce = secrets.token_urlsafe(16)
        host = self._header("Host")
        rules = policy(nonce, connect=f"ws://{host} wss://{host}")
        self.set_header("Content-Security-Policy", f"{rules}; frame-ancestors 'none'")
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.finish(self._server.page(nonce))


class Live(_Visitor, WebSocketHandler):
    """The web socket of one open page."""

    def prepare(self) -> None:
        """Refuse other hosts, other origins, and who does not know the token."""
        super().prepare()
        if not self._server.gate.knows_origin(self._header("Origin"), self._header("Host")):
            self._refuse(403, _ORIGIN)
        self.check_token()

    def check_origin(self, origin: str) -> bool:
        """True: `prepare` has checked it, also where there is none."""
        return True

    def open(self, *_: str, **__: str) -> None:
        """Greet the page, unless there are too many."""
        self._outbox, self._news, self._allowance = Outbox(), asyncio.Event(), Allowance()
        self._number = self._server.admit(self)
        if self._number is None:
            self.close(1013, "too many pages are open already; close one")
            return
        self.set_nodelay(True)
        self._stream.socket.setsockopt(SOL_SOCKET, SO_SNDBUF, SOCKET_BUFFER)
        for kind, text in self._server.greeting():
            self.outbox_add("add_text", kind, text)
        self._sender = asyncio.get_running_loop().create_task(self._send())

    def outbox_add(self, way: str, *what: Any) -> None:
        """Put something into the page's outbox; `way` names the function of `Outbox` that takes it."""
        getattr(self._outbox, way)(*what)
        self._news.set()

    def on_message(self, message: str | bytes) -> None:
        """Take what the page asks, unless it asks too much."""
        if self._number is None:
            return
        if not self._allowance.admits():
            self._answer(_id_in(message), f"more than {RATE:g} requests a second; ask again later")
        else:
            try:
                self._server.asked(self._number, read_request(message))
            except RefusedError as error:
                self._allowance.strike()
                self._answer(error.id, str(error))
        self._watch()

    def on_ping(self, data: bytes) -> None:
        """Count it: each makes an answer that a page which does not read lets lie."""
        if self._number is not None:
            self._allowance.admits()
            self._watch()

    def on_close(self) -> None:
        """Forget the page."""
        number, self._number = getattr(self, "_number", None), None
        if number is not None:
            self._server.forget(number)
            self._sender.cancel()
            self._outbox = Outbox()  # what waited may be megabytes, and Python may find that this object is gone late

    def _answer(self, id: int | None, words: str) -> None:
        self.outbox_add("add_text", "answer", frames.text("answer", id=id, done=False, words=words))

    def _watch(self) -> None:
        if self._allowance.over:
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


def _id_in(message: str | bytes) -> int | None:
    """The id of a request that is not looked at further."""
    with suppress(ValueError, RecursionError):
        asked = json.loads(message)
        if isinstance(asked, dict) and type(asked.get("id")) is int:
            return asked["id"]
    return None
