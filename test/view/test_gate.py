"""Who is let in: names of this machine, the page's own origin, and the token."""

import pytest

from vibro_ros.view.gate import Gate


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.1:8742", "localhost:9", "LocalHost:8742", "[::1]:8742",
                                  "127.8.9.10:1"])
def test_this_machine_is_known_by_its_names(host):
    assert Gate("127.0.0.1").knows_host(host)


@pytest.mark.parametrize("host", [
    "", "evil.example", "127.0.0.1.evil.example:8742", "localhost.evil", "192.168.1.2:8742", "0.0.0.0:8742",
    "[::]:8742", "127.0.0.1:8742:1", "127.0.0.1:123456", "a b", "@localhost", "localhost/", "robot-pc:8742", "[::1",
    "::1", "127.1", "2130706433"])
def test_all_else_is_another_host(host):
    assert not Gate("127.0.0.1", ["robot-pc"]).knows_host(host)


def test_beyond_this_machine_numbers_and_known_names_are_taken():
    gate = Gate("0.0.0.0", ["Robot-PC"])
    assert all(map(gate.knows_host, ("192.168.1.2:8742", "robot-pc:8742", "127.0.0.1", "[fe80::1]:8742")))
    assert not any(map(gate.knows_host, ("evil.example:8742", "0.0.0.0:8742", "robot-pc.evil:8742")))


def test_the_origin_is_the_page_s_own():
    gate = Gate("127.0.0.1")
    assert gate.knows_origin("http://127.0.0.1:8742", "127.0.0.1:8742")
    assert gate.knows_origin("https://localhost:9", "localhost:9")  # a tunnel's end
    for origin in ("", "null", "http://127.0.0.1", "http://127.0.0.1:8743", "http://localhost:8742", "file://",
                   "http://127.0.0.1:8742/", "http://x@127.0.0.1:8742", "ws://127.0.0.1:8742", "http://[::1"):
        assert not gate.knows_origin(origin, "127.0.0.1:8742")


def test_tokens_differ_and_only_the_whole_one_is_known():
    gate, other = Gate("127.0.0.1"), Gate("127.0.0.1")
    assert gate.token != other.token and len(gate.token) >= 20
    assert gate.knows_token(gate.token)
    for given in ("", other.token, gate.token[:-1], gate.token + "x", "\udcff", "é" * 20):
        assert not gate.knows_token(given)
