"""An executor that goes on: what a callback raises is counted and said, and the next message is taken."""

from collections.abc import Callable, Iterator

import pytest
import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64

from vibro_ros.ros.node.executor import SteadyExecutor
from vibro_ros.ros.node.refusals import Refusals

PATIENCE = 10.0  # [s]


class Victim:
    """A node that listens to `speed`, with what it has heard."""

    def __init__(self):
        self.node = Node("victim")
        self.refusals = Refusals(self.node.get_logger)
        self.executor = SteadyExecutor(self.refusals)
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
            self.executor.spin_once(timeout_sec=0.05)


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


def test_an_error_while_a_message_is_taken_leaves_the_node_able_to_hear(victim, publish, monkeypatch):
    """rclpy leaves the subscription and its callback group marked as busy then, and the node would be deaf for ever."""
    take = victim.executor._take_subscription

    def fail_once(subscription):
        monkeypatch.setattr(victim.executor, "_take_subscription", take)
        take(subscription)
        raise UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte")

    monkeypatch.setattr(victim.executor, "_take_subscription", fail_once)
    publish(1.0)
    victim.spin_until(lambda: victim.refusals.count == 1, "refusal")
    publish(2.0)
    victim.spin_until(lambda: victim.heard == [2.0], "next message")


def test_an_error_of_a_task_without_an_entity_is_caught_too(victim):
    def fail() -> None:
        raise ValueError("late")

    victim.executor.create_task(fail)
    victim.spin_until(lambda: victim.refusals.count == 1, "refusal")


def test_an_interrupt_is_raised(victim, publish):
    victim.raised = KeyboardInterrupt()
    publish(1.0)
    with pytest.raises(KeyboardInterrupt):
        victim.spin_until(lambda: False, "interrupt")
