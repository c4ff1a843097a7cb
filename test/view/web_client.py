"""A client of the view's server that speaks HTTP and WebSocket by hand, so that it can break the rules of both."""

import base64
import json
import os
import re
import socket
import struct
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from urllib.parse import urlsplit

PATIENCE = 30.0  # [s] deadline of what takes milliseconds on an idle machine
TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10  # opcodes of RFC 6455


@dataclass(frozen=True)
class Answer:
    status: int
    headers: Mapping[str, str]
    body: bytes


@dataclass(frozen=True)
class Address:
    """The address that the view prints, with methods for clients."""

    url: str

    @property
    def port(self) -> int:
        return urlsplit(self.url).port

    @property
    def token(self) -> str:
        return urlsplit(self.url).query.removeprefix("token=")

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.port}"

    def connect(self, receive_buffer: int = 0) -> socket.socket:
        connection = socket.socket()
        if receive_buffer:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        connection.settimeout(PATIENCE)
        connection.connect(("127.0.0.1", self.port))
        return connection

    def ask(self, target: str | None = None, method: str = "GET", body: bytes = b"", **headers: str) -> Answer:
        """Send one request, by default for the page as the browser does; `host=""` leaves the header out."""
        with self.connect() as connection:
            target = f"/?token={self.token}" if target is None else target
            connection.sendall(self._request(target, method, headers, body))
            return read_answer(connection)

    def web_socket(self, target: str | None = None, receive_buffer: int = 0, **headers: str) -> "WebSocket | Answer":
        """Open the web socket, by default as the page does; returns the server's answer if it refuses."""
        connection = self.connect(receive_buffer)
        try:
            defaults = {"origin": f"http://{self.host}", "upgrade": "websocket", "connection": "Upgrade",
                        "sec-websocket-version": "13", "sec-websocket-key": base64.b64encode(os.urandom(16)).decode()}
            target = f"/live?token={self.token}" if target is None else target
            connection.sendall(self._request(target, "GET", defaults | headers, b""))
            answer = read_answer(connection)
        except BaseException:
            connection.close()
            raise
        if answer.status != 101:
            connection.close()
            return answer
        return WebSocket(connection, answer.body)

    def _request(self, target: str, method: str, headers: Mapping[str, str], body: bytes) -> bytes:
        fields = {"host": self.host} | {name.replace("_", "-"): value for name, value in headers.items()}
        if body:
            fields["content-length"] = str(len(body))
        lines = [f"{name}: {value}" for name, value in fields.items() if value]
        return "\r\n".join([f"{method} {target} HTTP/1.1", *lines, "", ""]).encode() + body


def address_of(view) -> Address:
    """Return the address that a view's process has printed."""
    return Address(re.search(r"http://\S+:\d+/\?token=\S+", view.wait_for("/?token="))[0])


def read_answer(connection: socket.socket) -> Answer:
    """Read one answer; after a switch of protocols, `body` has the bytes that followed it. Status 0: closed without an
    answer.
    """
    data = b""
    while b"\r\n\r\n" not in data:
        try:
            part = connection.recv(65536)
        except ConnectionError:
            part = b""
        if not part:
            return Answer(0, {}, data)
        data += part
    head, _, body = data.partition(b"\r\n\r\n")
    first, *lines = head.decode().split("\r\n")
    headers = {name.lower(): value for name, value in (line.split(": ", 1) for line in lines)}
    status = int(first.split()[1])
    while status != 101 and len(body) < int(headers.get("content-length", 0)):
        part = connection.recv(65536)
        if not part:
            break
        body += part
    return Answer(status, headers, body)


class WebSocket:
    """An open web socket; a context manager that closes it."""

    def __init__(self, connection: socket.socket, data: bytes):
        self._socket, self._data = connection, data
        self.closed_with: int | None = None

    def __enter__(self) -> "WebSocket":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def end(self) -> None:
        """End the connection, also for a thread that receives."""
        with suppress(OSError):  # it has ended already
            self._socket.shutdown(socket.SHUT_RDWR)

    def send(self, content: object, opcode: int = TEXT) -> None:
        """Send a frame: bytes as they are, all else as JSON."""
        data = content if isinstance(content, bytes) else json.dumps(content).encode()
        self.send_frame(0x80 | opcode, len(data), data)

    def send_frame(self, first: int, length: int, data: bytes) -> None:
        """Send a frame that states a length of `length` bytes; the mask is 0, so that it has no effect."""
        size = (struct.pack(">B", 0x80 | length) if length < 126
                else struct.pack(">BH", 0x80 | 126, length) if length < 1 << 16
                else struct.pack(">BQ", 0x80 | 127, length))
        self._socket.sendall(bytes([first]) + size + bytes(4) + data)

    def receive(self, patience: float = PATIENCE) -> tuple[int, bytes] | None:
        """Return the next frame of text or bytes, or None once the server has closed, with the code `closed_with`."""
        deadline = time.monotonic() + patience
        while True:
            opcode, data = self._frame(deadline)
            if opcode in (TEXT, BINARY):
                return opcode, data
            if opcode == PING:
                self.send(data, PONG)
            if opcode == CLOSE:
                self.closed_with = int.from_bytes(data[:2], "big") if len(data) >= 2 else self.closed_with or 1005
                return None

    def wait_for(self, kind: str, patience: float = PATIENCE, **fields: object) -> dict:
        """Return the next message of a kind whose fields have these values."""
        return self.wait_for_one_of((kind,), patience, **fields)

    def wait_for_one_of(self, kinds: Sequence[str], patience: float = PATIENCE, **fields: object) -> dict:
        """Return the next message of one of these kinds whose fields have these values."""
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline:
            frame = self.receive(deadline - time.monotonic())
            assert frame is not None, f"closed with {self.closed_with} before {kinds}"
            if frame[0] == TEXT:
                message = json.loads(frame[1])
                if message["kind"] in kinds and all(message.get(name) == value for name, value in fields.items()):
                    return message
        raise AssertionError(f"no {kinds} with {fields} within {patience} s")

    def wait_for_end(self, patience: float = PATIENCE) -> int:
        """Return the code with which the server closes; 1006 if it closes without one."""
        deadline = time.monotonic() + patience
        while self.receive(deadline - time.monotonic()) is not None:
            assert time.monotonic() < deadline
        return self.closed_with

    def _frame(self, deadline: float) -> tuple[int, bytes]:
        head = self._read(2, deadline)
        if head is None:
            return CLOSE, (1006).to_bytes(2, "big")
        length = head[1] & 0x7F
        if length >= 126:
            extended = self._read(2 if length == 126 else 8, deadline) or b""
            length = int.from_bytes(extended, "big")
        data = self._read(length, deadline)
        return (head[0] & 0x0F, data) if data is not None else (CLOSE, (1006).to_bytes(2, "big"))

    def _read(self, count: int, deadline: float) -> bytes | None:
        """Return so many bytes, or None if the connection ends before."""
        while len(self._data) < count:
            self._socket.settimeout(max(0.001, deadline - time.monotonic()))
            try:
                part = self._socket.recv(1 << 16)
            except TimeoutError as error:
                raise AssertionError("the server said nothing in time") from error
            except ConnectionError:
                part = b""
            if not part:
                return None
            self._data += part
        data, self._data = self._data[:count], self._data[count:]
        return data
