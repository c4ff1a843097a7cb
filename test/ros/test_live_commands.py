"""Which commands are in force, and which publisher keeps the motor running: real messages of several publishers."""

import pytest
from std_msgs.msg import Float64

import vibro_ros
from vibro_ros.messages.operations import RESET, TIMEOUT, Operation
from vibro_ros.ros.live.commands import RETURN_TIMEOUT, PageCommands

SCENE = vibro_ros.load_scene("device")


class Both:
    """The view's commands, a robot that subscribes to them, and another node that commands."""

    def __init__(self, bench):
        self.heard: list[float] = []
        self.now = 100.0
        self.commands, self._bench = PageCommands(bench.node, lambda: self.now), bench
        bench.node.create_subscription(Float64, "motor_speed", lambda message: self.heard.append(message.data), 10)
        self._other = bench.node.create_publisher(Float64, "motor_speed", 10)
        bench.spin_until(lambda: self._other.get_subscription_count() >= 2, "both listen")

    def page(self, *speeds: float) -> None:
        """Send commands of a page, and wait until the last one is in force."""
        answers: list[bool] = []
        for speed in speeds:
            self.commands.send("motor_speed", speed, lambda done, words: answers.append(done))
        assert answers == [True] * len(speeds)
        self.wait_for(speeds[-1])

    def other(self, speed: float) -> None:
        self._other.publish(Float64(data=speed))
        self.wait_for(speed)

    def wait_for(self, speed: float) -> None:
        def heard() -> bool:
            self.commands.take(SCENE, [])
            return self.heard[-1:] == [speed] and self.commands.in_force.get("motor_speed") == speed
        self._bench.spin_until(heard, f"{speed} rad/s")


@pytest.fixture
def both(bench):
    return Both(bench)


def test_a_motor_that_a_page_commanded_stops_when_the_pages_have_gone_and_no_other_one(both):
    device = both.commands
    both.page(50.0)
    assert device.of_page and not device.stop_if_alone(1, 0.0)
    both.page(1e6, 55.0)
    assert device.of_page and device.in_force == {"motor_speed": 55.0}
    both.now += 0.9 * RETURN_TIMEOUT
    assert not device.stop_if_alone(0, 0.0)  # a page that is loaded again comes back in time
    both.now += 0.2 * RETURN_TIMEOUT
    assert device.stop_if_alone(0, 0.0) and not device.stop_if_alone(0, 0.0)
    both.wait_for(0.0)
    both.page(60.0)
    both.other(80.0)
    assert device.in_force == {"motor_speed": 80.0} and not device.of_page
    both.now += 2.0 * RETURN_TIMEOUT
    assert not device.stop_if_alone(0, 0.0) and not device.end()
    for operation in (TIMEOUT, RESET):
        both.page(70.0)
        device.take(SCENE, [Operation(operation)])
        assert not device.of_page and device.in_force == {}
    both.page(90.0)
    assert device.end() == "sent motor_speed 0"
    both.wait_for(0.0)


def test_a_robot_with_a_timeout_hears_the_page_s_command_again_and_again(both, bench):
    both.page(50.0)
    for number in range(3):
        both.now += 0.2
        assert not both.commands.stop_if_alone(1, 0.5)
        bench.spin_until(lambda number=number: len(both.heard) == number + 2, "the command again")
