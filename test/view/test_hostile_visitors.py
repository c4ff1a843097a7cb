"""The server gives nothing to visitors other than its own page, and a rude visitor does not affect the others."""

import socket
import time

from visitor import BINARY, TEXT, Visit, read_answer

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
NO_REQUESTS = {
    "tls": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(500),
    "headers": b"GET / HTTP/1.1\r\n" + b"x: y\r\n" * 100_000,
    "url": b"GET /" + b"a" * 1_000_000 + b" HTTP/1.1\r\n\r\n",
    "version": b"GET / HTTP/9.9\r\nhost: \xff\xff\r\n\r\n", "zeros": bytes(100_000),
    "length": b"POST / HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-length: 99999999999999\r\n\r\n",
    "negative": b"POST / HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-length: -1\r\n\r\n",
    "chunk": b"POST / HTTP/1.1\r\nhost: 127.0.0.1\r\ntransfer-encoding: chunked\r\n\r\nffffffffffffffff\r\n",
}
RUDE_FRAMES = {
    "long": lambda visit: visit.send(b'{"id": 1, "call": "' + b"x" * 100_000 + b'"}'),
    "says it is huge": lambda visit: visit.send_frame(0x81, 1 << 62, b""),
    "pieces without end": lambda visit: [visit.send_frame(0x00 if part else 0x01, 1000, b"x" * 1000)
                                         for part in range(1000)],
    "no text": lambda visit: visit.send(b"\xff\xfe"),
    "opcode": lambda visit: visit.send_frame(0x8F, 0, b""),
    "reserved bits": lambda visit: visit.send_frame(0xF1, 2, b"{}"),
    "ping": lambda visit: visit.send_frame(0x89, 2000, bytes(2000)),
    "close": lambda visit: visit.send_frame(0x88, 1, b"\x00"),
}


def is_served(view) -> bool:
    """Whether page and web socket still serve permitted visitors."""
    visit = view.address.visit()
    assert isinstance(visit, Visit), visit
    with visit:
        assert visit.receive()[0] == TEXT
    return view.address.ask().status == 200


def test_a_view_survives_every_hostile_client(view, tmp_path):
    """One process meets all rude visitors in turn; none of them may affect the next."""
    the_page_is_for_who_knows_the_token(view)
    the_page_tells_the_browser_to_trust_nobody_else(view)
    another_name_for_this_machine_gets_nothing(view)
    commands_are_taken_from_its_own_page_only(view)
    no_path_of_the_machine_is_served(view, tmp_path)
    other_methods_do_nothing(view)
    bytes_that_are_no_request_are_refused(view)
    requests_that_are_none_are_answered_in_one_line(view)
    frames_beyond_the_limits_end_their_own_connection_only(view)
    one_page_too_many_is_told_so_and_the_next_one_has_room(view)
    connections_that_say_nothing_keep_nobody_out(view)


def the_page_is_for_who_knows_the_token(view) -> None:
    page = view.address.ask()
    assert page.status == 200 and b"<canvas" in page.body
    for target in ("/", "/?token=", "/?token=wrong", f"/?token={view.address.token[:-1]}",
                   f"/?token={view.address.token}x", f"/?token={view.address.token}&token=wrong",
                   f"/?TOKEN={view.address.token}", "/?token=%ff%00"):
        refused = view.address.ask(target)
        assert refused.status in (400, 403), target
        assert b"<" not in refused.body and view.address.token.encode() not in refused.body


def the_page_tells_the_browser_to_trust_nobody_else(view) -> None:
    headers = view.address.ask().headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy and "frame-ancestors 'none'" in policy
    assert "'unsafe-inline'" not in policy and "'unsafe-eval'" not in policy and "*" not in policy
    assert headers["referrer-policy"] == "no-referrer"  # the token is in the address
    assert headers["cache-control"] == "no-store"
    assert headers["x-content-type-options"] == "nosniff"
    assert "access-control-allow-origin" not in headers
    assert policy != view.address.ask().headers["content-security-policy"]  # a nonce is for once


def another_name_for_this_machine_gets_nothing(view) -> None:
    """DNS rebinding: a victim's browser sends requests to 127.0.0.1 under the name of the attacker's site."""
    port = view.address.port
    for host in (f"evil.example:{port}", f"192.168.1.7:{port}"):  # `test_server` has more
        assert view.address.ask(host=host).status in (400, 404), host
        visit = view.address.visit(host=host, origin=f"http://{host}")
        assert not isinstance(visit, Visit) and visit.status in (400, 404), host
    assert view.address.ask(host="").status == 400
    assert view.address.ask(host=f"localhost:{port}").status == 200


def commands_are_taken_from_its_own_page_only(view) -> None:
    port = view.address.port
    for origin in ("null", f"http://evil.example:{port}", f"http://127.0.0.1:{port + 1}", f"http://localhost:{port}",
                   f"http://x@127.0.0.1:{port}", "file://", "http://[::1"):
        visit = view.address.visit(origin=origin)
        assert not isinstance(visit, Visit) and visit.status == 403, origin
    for target in ("/live", "/live?token=wrong", "/live?token="):
        visit = view.address.visit(target)
        assert not isinstance(visit, Visit) and visit.status == 403, target
    assert is_served(view)


def no_path_of_the_machine_is_served(view, tmp_path) -> None:
    (tmp_path / "own.txt").write_text(SECRET)  # in the folder in which the view runs
    token = view.address.token
    for path in ("/own.txt", f"/..{tmp_path}/own.txt", f"//{tmp_path}/own.txt", f"/%2e%2e/%2e%2e{tmp_path}/own.txt",
                 "/page/main.js", f"file://{tmp_path}/own.txt", "/live/../own.txt", "/\\..\\own.txt"):
        for target in (path, f"{path}?token={token}"):
            answer = view.address.ask(target)
            assert answer.status in (400, 404), target
            assert SECRET.encode() not in answer.body and str(tmp_path).encode() not in answer.body


def other_methods_do_nothing(view) -> None:
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "BREW"):
        answer = view.address.ask(method=method, body=b"x=1" if method == "POST" else b"")
        assert 400 <= answer.status < 500, method
        assert b"<canvas" not in answer.body
    assert is_served(view)


def bytes_that_are_no_request_are_refused(view) -> None:
    memory_before = view.memory
    for name, data in NO_REQUESTS.items():
        with view.address.connect() as connection:
            try:
                connection.sendall(data)
                connection.shutdown(socket.SHUT_WR)
                assert read_answer(connection).status in (0, 400, 403, 405, 413, 431), name
            except ConnectionError:
                pass
        assert is_served(view), name
    assert view.memory - memory_before < 30.0  # MB


def requests_that_are_none_are_answered_in_one_line(view) -> None:
    with view.address.visit() as visit:
        for request in BAD_REQUESTS:
            visit.send(request)
            answer = visit.wait_for("answer")
            assert answer["done"] is False
            assert answer["words"] and "\n" not in answer["words"] and len(answer["words"]) < 400, request
        visit.send(b'{"id": 1, "call": "reset"}', BINARY)
        assert visit.wait_for("answer")["done"] is False
    assert is_served(view)


def frames_beyond_the_limits_end_their_own_connection_only(view) -> None:
    memory_before = view.memory
    for name, rude in RUDE_FRAMES.items():
        with view.address.visit() as other, view.address.visit() as visit:
            try:
                rude(visit)
                visit.wait_for_end()
            except ConnectionError:
                pass
            other.send({"id": 7, "call": "nothing"})
            assert other.wait_for("answer", id=7)["done"] is False, name
        assert is_served(view), name
    assert view.memory - memory_before < 30.0  # MB


def one_page_too_many_is_told_so_and_the_next_one_has_room(view) -> None:
    visits = [view.address.visit() for _ in range(MOST_PAGES)]
    try:
        for visit in visits:
            visit.receive()
        ninth = view.address.visit()
        if isinstance(ninth, Visit):
            with ninth:
                assert ninth.wait_for_end() == 1013
        else:
            assert ninth.status == 503
        visits.pop().__exit__()
        deadline = time.monotonic() + 30.0
        while not has_room(view):
            assert time.monotonic() < deadline
    finally:
        for visit in visits:
            visit.__exit__()


def has_room(view) -> bool:
    with view.address.visit() as visit:
        return visit.receive() is not None


def connections_that_say_nothing_keep_nobody_out(view) -> None:
    silent = []
    try:
        with view.address.visit() as visit:
            for number in range(300):
                silent.append(view.address.connect())
                if number % 2:
                    try:
                        silent[-1].sendall(b"GET / HTTP/1.1\r\nhost: ")
                    except ConnectionError:
                        pass
            assert view.address.ask().status == 200
            visit.send({"id": 7, "call": "nothing"})  # a page that is open stays open
            assert visit.wait_for("answer", id=7)["done"] is False
    finally:
        for connection in silent:
            connection.close()
    assert is_served(view)


def test_a_page_that_does_not_read_costs_the_others_nothing(start, view):
    start("robot", "--ros-args", "-p", "rate.publish:=1000.0", "-p", "motor.speed:=100.0",
          "-p", "record.enabled:=false")
    with view.address.visit() as reading:
        reading.wait_for("robot", patience=60.0)
        samples_heard(reading, 3000)
        with view.address.visit(receive_buffer=4096):
            memory_before = view.memory
            assert samples_heard(reading, 5000) >= 5000
            # What is not read of 5 s is 2 MB, as lists of numbers ten times that.
            assert view.memory - memory_before < 8.0  # MB
    assert is_served(view)


def samples_heard(visit: Visit, count: int) -> int:
    """Receive until so many samples have come, and return their number."""
    heard = 0
    while heard < count:
        frame = visit.receive()
        assert frame is not None
        if frame[0] == BINARY:
            assert int.from_bytes(frame[1][:4], "little") == 1
            heard += int.from_bytes(frame[1][4:8], "little")
    return heard
