"""The server serves nothing but its own page, and a hostile client does not affect the others."""

import socket
import time

from web_client import BINARY, TEXT, WebSocket, read_answer

SECRET = "secret-of-the-machine"
MOST_PAGES = 8
BAD_REQUESTS = [
    b"", b"[]", b"7", b"{}", b"[" * 4000, b'{"id": 1}', b'{"id": 1, "call": "quit"}', b'{"id": 1, "call": ["reset"]}',
    b'{"id": 1, "call": "pause", "on": "yes"}', b'{"id": 1, "command": "motor_speed", "value": NaN}',
    b'{"id": 1, "command": "motor_speed", "value": "100"}', b'{"id": 1, "command": "motor_speed", "value": true}',
    b'{"id": 1, "command": "motor_speed", "value": ' + b"9" * 3000 + b"}",
    b'{"id": 1, "parameter": "motor.max_speed", "value": 1}',
    b'{"id": 1, "parameter": "ground.friction", "value": "x"}',
    b'{"id": 1, "command": {"a": 1}, "value": 1}', b'{"id": 1, "slow_motion": 1e9}',
    b'{"id": 1e400, "call": "reset"}', b'{"id": 1, "call": "reset", "call": "pause", "__proto__": 1}',
]
HOSTILE_BYTES = {
    "tls": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(500),
    "headers": b"GET / HTTP/1.1\r\n" + b"x: y\r\n" * 100_000,
    "url": b"GET /" + b"a" * 1_000_000 + b" HTTP/1.1\r\n\r\n",
    "version": b"GET / HTTP/9.9\r\nhost: \xff\xff\r\n\r\n", "zeros": bytes(100_000),
    "length": b"POST / HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-length: 99999999999999\r\n\r\n",
    "negative": b"POST / HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-length: -1\r\n\r\n",
    "chunk": b"POST / HTTP/1.1\r\nhost: 127.0.0.1\r\ntransfer-encoding: chunked\r\n\r\nffffffffffffffff\r\n",
}
HOSTILE_FRAMES = {
    "long": lambda web_socket: web_socket.send(b'{"id": 1, "call": "' + b"x" * 100_000 + b'"}'),
    "says it is huge": lambda web_socket: web_socket.send_frame(0x81, 1 << 62, b""),
    "pieces without end": lambda web_socket: [web_socket.send_frame(0x00 if part else 0x01, 1000, b"x" * 1000)
                                         for part in range(1000)],
    "no text": lambda web_socket: web_socket.send(b"\xff\xfe"),
    "opcode": lambda web_socket: web_socket.send_frame(0x8F, 0, b""),
    "reserved bits": lambda web_socket: web_socket.send_frame(0xF1, 2, b"{}"),
    "ping": lambda web_socket: web_socket.send_frame(0x89, 2000, bytes(2000)),
    "close": lambda web_socket: web_socket.send_frame(0x88, 1, b"\x00"),
}


def is_served(view) -> bool:
    """Return whether page and web socket still serve permitted clients."""
    web_socket = view.address.web_socket()
    assert isinstance(web_socket, WebSocket), web_socket
    with web_socket:
        assert web_socket.receive()[0] == TEXT
    return view.address.ask().status == 200


def test_a_view_survives_every_hostile_client(view, tmp_path):
    """One view meets all hostile clients in turn; none of them may affect the next."""
    the_page_needs_the_token(view)
    the_page_has_a_strict_policy(view)
    requests_under_another_host_name_are_refused(view)
    web_sockets_of_other_origins_are_refused(view)
    no_file_of_the_machine_is_served(view, tmp_path)
    other_methods_are_refused(view)
    bytes_that_are_no_request_are_refused(view)
    invalid_requests_are_refused_in_one_line(view)
    hostile_frames_end_only_their_own_connection(view)
    a_ninth_page_is_refused_until_another_closes(view)
    idle_connections_keep_nobody_out(view)


def the_page_needs_the_token(view) -> None:
    page = view.address.ask()
    assert page.status == 200 and b"<canvas" in page.body
    for target in ("/", "/?token=", "/?token=wrong", f"/?token={view.address.token[:-1]}",
                   f"/?token={view.address.token}x", f"/?token={view.address.token}&token=wrong",
                   f"/?TOKEN={view.address.token}", "/?token=%ff%00"):
        refused = view.address.ask(target)
        assert refused.status in (400, 403), target
        assert b"<" not in refused.body and view.address.token.encode() not in refused.body


def the_page_has_a_strict_policy(view) -> None:
    headers = view.address.ask().headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy and "frame-ancestors 'none'" in policy
    assert "'unsafe-inline'" not in policy and "'unsafe-eval'" not in policy and "*" not in policy
    assert headers["referrer-policy"] == "no-referrer"  # the token is in the address
    assert headers["cache-control"] == "no-store"
    assert headers["x-content-type-options"] == "nosniff"
    assert "access-control-allow-origin" not in headers
    assert policy != view.address.ask().headers["content-security-policy"]  # a nonce is for once


def requests_under_another_host_name_are_refused(view) -> None:
    """DNS rebinding: a victim's browser sends requests to 127.0.0.1 under the name of the attacker's site."""
    port = view.address.port
    for host in (f"evil.example:{port}", f"192.168.1.7:{port}"):  # `test_server` has more
        assert view.address.ask(host=host).status in (400, 404), host
        web_socket = view.address.web_socket(host=host, origin=f"http://{host}")
        assert not isinstance(web_socket, WebSocket) and web_socket.status in (400, 404), host
    assert view.address.ask(host="").status == 400
    assert view.address.ask(host=f"localhost:{port}").status == 200


def web_sockets_of_other_origins_are_refused(view) -> None:
    port = view.address.port
    for origin in ("null", f"http://evil.example:{port}", f"http://127.0.0.1:{port + 1}", f"http://localhost:{port}",
                   f"http://x@127.0.0.1:{port}", "file://", "http://[::1"):
        web_socket = view.address.web_socket(origin=origin)
        assert not isinstance(web_socket, WebSocket) and web_socket.status == 403, origin
    for target in ("/live", "/live?token=wrong", "/live?token="):
        web_socket = view.address.web_socket(target)
        assert not isinstance(web_socket, WebSocket) and web_socket.status == 403, target
    assert is_served(view)


def no_file_of_the_machine_is_served(view, tmp_path) -> None:
    (tmp_path / "own.txt").write_text(SECRET)  # in the folder in which the view runs
    token = view.address.token
    for path in ("/own.txt", f"/..{tmp_path}/own.txt", f"//{tmp_path}/own.txt", f"/%2e%2e/%2e%2e{tmp_path}/own.txt",
                 "/page/main.js", f"file://{tmp_path}/own.txt", "/live/../own.txt", "/\\..\\own.txt"):
        for target in (path, f"{path}?token={token}"):
            answer = view.address.ask(target)
            assert answer.status in (400, 404), target
            assert SECRET.encode() not in answer.body and str(tmp_path).encode() not in answer.body


def other_methods_are_refused(view) -> None:
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "BREW"):
        answer = view.address.ask(method=method, body=b"x=1" if method == "POST" else b"")
        assert 400 <= answer.status < 500, method
        assert b"<canvas" not in answer.body
    assert is_served(view)


def bytes_that_are_no_request_are_refused(view) -> None:
    memory_before = view.memory
    for name, data in HOSTILE_BYTES.items():
        with view.address.connect() as connection:
            try:
                connection.sendall(data)
                connection.shutdown(socket.SHUT_WR)
                assert read_answer(connection).status in (0, 400, 403, 405, 413, 431), name
            except ConnectionError:
                pass
        assert is_served(view), name
    assert view.memory - memory_before < 30.0  # MB


def invalid_requests_are_refused_in_one_line(view) -> None:
    with view.address.web_socket() as web_socket:
        for request in BAD_REQUESTS:
            web_socket.send(request)
            answer = web_socket.wait_for("answer")
            assert answer["done"] is False
            assert answer["words"] and "\n" not in answer["words"] and len(answer["words"]) < 400, request
        web_socket.send(b'{"id": 1, "call": "reset"}', BINARY)
        assert web_socket.wait_for("answer")["done"] is False
    assert is_served(view)


def hostile_frames_end_only_their_own_connection(view) -> None:
    memory_before = view.memory
    for name, send_hostile_frame in HOSTILE_FRAMES.items():
        with view.address.web_socket() as other, view.address.web_socket() as web_socket:
            try:
                send_hostile_frame(web_socket)
                web_socket.wait_for_end()
            except ConnectionError:
                pass
            other.send({"id": 7, "call": "nothing"})
            assert other.wait_for("answer", id=7)["done"] is False, name
        assert is_served(view), name
    assert view.memory - memory_before < 30.0  # MB


def a_ninth_page_is_refused_until_another_closes(view) -> None:
    web_sockets = [view.address.web_socket() for _ in range(MOST_PAGES)]
    try:
        for web_socket in web_sockets:
            web_socket.receive()
        ninth = view.address.web_socket()
        if isinstance(ninth, WebSocket):
            with ninth:
                assert ninth.wait_for_end() == 1013
        else:
            assert ninth.status == 503
        web_sockets.pop().__exit__()
        deadline = time.monotonic() + 30.0
        while not has_room(view):
            assert time.monotonic() < deadline
    finally:
        for web_socket in web_sockets:
            web_socket.__exit__()


def has_room(view) -> bool:
    with view.address.web_socket() as web_socket:
        return web_socket.receive() is not None


def idle_connections_keep_nobody_out(view) -> None:
    silent = []
    try:
        with view.address.web_socket() as web_socket:
            for number in range(300):
                silent.append(view.address.connect())
                if number % 2:
                    try:
                        silent[-1].sendall(b"GET / HTTP/1.1\r\nhost: ")
                    except ConnectionError:
                        pass
            assert view.address.ask().status == 200
            web_socket.send({"id": 7, "call": "nothing"})  # a page that is open stays open
            assert web_socket.wait_for("answer", id=7)["done"] is False
    finally:
        for connection in silent:
            connection.close()
    assert is_served(view)


def test_a_page_that_does_not_read_costs_the_others_nothing(start, view):
    start("robot", "--ros-args", "-p", "rate.publish:=1000.0", "-p", "motor.speed:=100.0",
          "-p", "record.enabled:=false")
    with view.address.web_socket() as reading:
        reading.wait_for("robot", patience=60.0)
        received_samples(reading, 3000)
        with view.address.web_socket(receive_buffer=4096):
            memory_before = view.memory
            assert received_samples(reading, 5000) >= 5000
            # What is not read of 5 s is 2 MB, as lists of numbers ten times that.
            assert view.memory - memory_before < 8.0  # MB
    assert is_served(view)


def received_samples(web_socket: WebSocket, count: int) -> int:
    """Receive until so many samples have come, and return their number."""
    received = 0
    while received < count:
        frame = web_socket.receive()
        assert frame is not None
        if frame[0] == BINARY:
            assert int.from_bytes(frame[1][:4], "little") == 1
            received += int.from_bytes(frame[1][4:8], "little")
    return received
