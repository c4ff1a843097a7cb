"""What is said of what peers send: one line, without their control characters, and whose fault it was."""

import pytest

from vibro_ros.ros.node.refusals import LONGEST_SHOWN, Refusals, peer_text


class Log:
    def __init__(self):
        self.lines: list[tuple[str, str]] = []

    def warning(self, text: str) -> None:
        self.lines.append(("warning", text))

    def error(self, text: str) -> None:
        self.lines.append(("error", text))


def caught(raising) -> tuple[Refusals, Log]:
    log = Log()
    refusals = Refusals(lambda: log)
    try:
        raising()
    except Exception as error:
        refusals.catch("/lab/motor_speed", error)
    return refusals, log


def test_what_rclpy_raises_is_a_refusal():
    def raising() -> None:
        raise ValueError("Seconds value must\nnot be negative")

    refusals, log = caught(raising)
    assert (refusals.count, refusals.failures) == (1, 0)
    assert log.lines == [("warning", "/lab/motor_speed: refused: ValueError: Seconds value must not be negative")]


def test_what_this_packages_own_code_raises_is_an_error_to_report():
    refusals, log = caught(lambda: peer_text(None))
    assert (refusals.count, refusals.failures) == (0, 1)
    ((kind, text),) = log.lines
    assert kind == "error"
    assert text.startswith("/lab/motor_speed: failed in vibro_ros.ros.node.refusals, line ")
    assert "AttributeError: 'NoneType' object has no attribute 'split'; please report it" in text


def test_a_flood_is_counted_and_said_seldom():
    log = Log()
    refusals = Refusals(lambda: log)
    for _ in range(1000):
        refusals.refuse("/clock", "no time")
    assert refusals.count == 1000
    assert len(log.lines) < 10
    refusals.refuse("/other", "no time")
    assert log.lines[-1] == ("warning", "/other: refused: no time")


@pytest.mark.parametrize(("text", "shown"), [
    ("mass.body", "mass.body"),
    ("", "''"),
    ("two\nlines", "two lines"),
    ("\x1b[31mred", r"\x1b[31mred"),
    ("a" * 10**6, "a" * (LONGEST_SHOWN // 2) + "…" + "a" * (LONGEST_SHOWN // 2)),
])
def test_a_peers_text_is_shown_as_one_short_line(text, shown):
    assert peer_text(text) == shown
