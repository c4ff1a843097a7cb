"""A node goes on whatever its callbacks and peers do: errors are counted and logged, in one line and at a limited rate;
and the stepping thread takes each command from DDS once and in order.
"""

import time
from collections.abc import Callable

import pytest
from std_msgs.msg import Float64

import vibro_ros
from vibro_ros.messages.codec import new_message, serialised
from vibro_ros.ros.node.node import PollingSubscription
from vibro_ros.ros.node.process import node_running, spin_until
from vibro_ros.ros.node.refusals import LONGEST_SHOWN, Refusals, Throttle, peer_text
from vibro_ros.ros.robot.subscriptions import CommandSubscriptions

PATIENCE = 10.0  # [s]


def test_a_callback_that_raises_does_not_end_the_loop_and_an_interrupt_does(domain_id, bench):
    heard: list[float] = []

    def hear(message: Float64) -> None:
        heard.append(message.data)
        if message.data < 0.0:
            raise ValueError("too slow")
        if message.data == 0.0:
            raise KeyboardInterrupt

    publisher = bench.node.create_publisher(Float64, "speed", 10)
    with node_running("victim", ()) as node:
        def spin(done: Callable[[], bool] = lambda: False) -> None:
            end = time.monotonic() + PATIENCE
            spin_until(node, lambda: done() or time.monotonic() > end)

        node.create_subscription(Float64, "speed", hear, 10)
        spin(lambda: publisher.get_subscription_count() > 0)
        for speed in (-1.0, 2.0):
            publisher.publish(Float64(data=speed))
        spin(lambda: len(heard) == 2)
        assert heard == [-1.0, 2.0] and node.refusals.count == 1
        publisher.publish(Float64(data=0.0))
        with pytest.raises(KeyboardInterrupt):
            spin()


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


def test_an_exception_of_rclpy_is_a_refusal():
    def raising() -> None:
        raise ValueError("Seconds value must\nnot be negative")

    refusals, log = caught(raising)
    assert (refusals.count, refusals.failures) == (1, 0)
    assert log.lines == [("warning", "/lab/motor_speed: refused: ValueError: Seconds value must not be negative")]


def test_an_exception_of_this_package_is_an_error_to_report():
    refusals, log = caught(lambda: peer_text(None))
    assert (refusals.count, refusals.failures) == (0, 1)
    ((kind, text),) = log.lines
    assert kind == "error"
    assert text.startswith("/lab/motor_speed: failed in vibro_ros.ros.node.refusals, line ")
    assert "AttributeError: 'NoneType' object has no attribute 'split'; please report it" in text


def test_a_flood_is_counted_and_rarely_logged():
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


def test_rclpy_hands_out_bytes_and_instant_of_a_message(bench):
    """`take_message` is not documented, so this test fails if rclpy changes or removes it."""
    subscription = PollingSubscription(bench.node, Float64, "numbers", 10)
    (publisher,) = bench.publishers({"numbers": Float64}).values()
    for number in range(3):
        publisher.publish(Float64(data=float(number)))
    taken = []
    bench.spin_until(lambda: taken.extend(subscription.take(2)) or len(taken) == 3, "messages")
    message = new_message("std_msgs/msg/Float64")
    for number, (data, instant) in enumerate(taken):
        message.data = float(number)
        assert data == serialised(message, "std_msgs/msg/Float64")
        assert number == 0 or instant >= taken[number - 1][1] > 1.7e18
    assert subscription.take(10) == []


def test_a_message_whose_publisher_came_and_left_between_two_polls_arrives(bench):
    subscription, taken = PollingSubscription(bench.node, Float64, "numbers", 10), []
    for number in range(3):  # also after a publisher that has left, which was polled in vain
        (publisher,) = bench.publishers({"numbers": Float64}).values()
        publisher.publish(Float64(data=float(number)))
        assert publisher.wait_for_all_acked()
        bench.node.destroy_publisher(publisher)
        bench.spin_until(lambda: not bench.node.count_publishers("numbers"), "the publisher's end")
        bench.spin_until(lambda n=number: taken.extend(subscription.take(2)) or len(taken) > n, "the message")
        assert subscription.take(2) == []
    assert len(taken) == 3


def test_commands_are_recorded_in_order_of_arrival_and_a_flood_keeps_its_last_ones(bench):
    scene = vibro_ros.load_scene("device")
    device, commands, recorded = vibro_ros.Simulator(scene), CommandSubscriptions(bench.node, scene), []
    publishers = bench.publishers({"motor_speed": Float64, "upper_gap": Float64}, depth=1000)

    def received(most: int) -> bool:
        commands.apply(device, 7, lambda topic, stamp, data: recorded.append((topic, stamp)))
        return len(recorded) >= most

    for number in range(4):  # the order across topics is that of arrival
        publishers[("motor_speed", "upper_gap")[number % 2]].publish(Float64(data=1e-4 * number))
        bench.spin_until(lambda number=number: received(number + 1), "a command")
    assert recorded == [("/motor_speed", 7), ("/upper_gap", 7)] * 2
    for number in range(301):
        publishers["motor_speed"].publish(Float64(data=0.25 * number))
    bench.spin_until(lambda: received(len(recorded)) and device.commanded_motor_speed == 75.0, "the last of a flood")
    assert commands.refused == 0 and commands.accepted["motor_speed"] == len(recorded) - 2
