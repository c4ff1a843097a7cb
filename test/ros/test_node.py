"""A node goes on whatever its callbacks and peers do: errors are counted and logged, in one line and at a limited rate.
"""

from collections.abc import Callable, Iterator

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Float64

from vibro_ros.ros.node.node import GuardedNode
from vibro_ros.ros.node.process import spin_once
from vibro_ros.ros.node.refusals import LONGEST_SHOWN, Refusals, Throttle, peer_text

PATIENCE = 10.0  # [s]


class Victim:
    """A node that subscribes to `speed` and keeps what it has received."""

    def __init__(self):
        self.node = GuardedNode("victim")
        self.refusals, self.executor = self.node.refusals, SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.heard: list[float] = []
        self.raised: BaseException | None = None
        self.node.create_subscription(Float64, "speed", self._hear, 10)

    def _hear(self, message: Float64) -> None:
        self.heard.append(message.data)
        error, self.raised = self.raised, None
        if error:
            raise error

    def spin_until(self, done: Callable[[], bool], what: str) -> None:
        began = self.node.get_clock().now()
        while not done():
            assert (self.node.get_clock().now() - began).nanoseconds < PATIENCE * 1e9, what
            spin_once(self.node, 0.05)


@pytest.fixture
def victim(domain_id) -> Iterator[Victim]:
    rclpy.init()
    victim = Victim()
    yield victim
    victim.executor.shutdown()
    victim.node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def publish(victim, bench) -> Callable[[float], None]:
    publisher = bench.node.create_publisher(Float64, "speed", 10)
    victim.spin_until(publisher.get_subscription_count, "match")
    return lambda value: publisher.publish(Float64(data=value))


def test_a_callback_that_raises_does_not_end_the_loop(victim, publish):
    victim.raised = ValueError("too fast")
    publish(1.0)
    victim.spin_until(lambda: victim.refusals.count == 1, "refusal")
    publish(2.0)
    victim.spin_until(lambda: victim.heard == [1.0, 2.0], "next message")


def test_an_interrupt_is_raised(victim, publish):
    victim.raised = KeyboardInterrupt()
    publish(1.0)
    with pytest.raises(KeyboardInterrupt):
        victim.spin_until(lambda: False, "interrupt")


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


def test_a_burst_passes_then_one_a_period_with_the_number_withheld():
    now = 0.0
    throttle = Throttle(burst=3, period=1.0, now=lambda: now)
    assert [throttle.admit("hot") for _ in range(5)] == ["hot", "hot", "hot", None, None]
    now = 0.9
    assert throttle.admit("hot") is None
    now = 1.0
    assert throttle.admit("hot") == "hot (3 more like it not shown)"
    assert throttle.admit("hot") is None
    now = 1000.0  # silence earns no more than the burst
    assert [throttle.admit("hot") is None for _ in range(4)] == [False, False, False, True]
