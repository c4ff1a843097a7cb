"""`use_sim_time`: the robot's time starts with /clock, and no message on /clock ends the robot."""

import signal
from collections.abc import Callable

import pytest
from observation import bags, stop, value_of
from rosgraph_msgs.msg import Clock

from vibro_ros.bag.reader import read_bag
from vibro_ros.ros.node.node import LAST_SECOND

SIMULATED = ("--ros-args", "-p", "use_sim_time:=true")
NO_TIME = ((-5, 0), (-2**31, 0), (LAST_SECOND + 1, 0), (2**31 - 1, 999_999_999), (5, 1_000_000_000), (5, 2**32 - 1))


def clock(seconds: int, nanoseconds: int = 0) -> Clock:
    message = Clock()
    message.clock.sec, message.clock.nanosec = seconds, nanoseconds
    return message


@pytest.fixture
def publish(bench) -> Callable[..., None]:
    """Publish on /clock repeatedly until a condition holds, because the robot subscribes to it with best effort."""
    publisher = bench.node.create_publisher(Clock, "/clock", 10)

    def until(message: Clock | bytes, done: Callable[[], bool] = lambda: True) -> None:
        bench.spin_until(publisher.get_subscription_count, "robot listens to /clock")

        def seen() -> bool:
            publisher.publish(message)
            return done()

        bench.spin_until(seen, f"effect of {message}")
    return until


def test_it_says_what_it_waits_for_and_a_signal_ends_the_wait(start, tmp_path):
    robot = start("robot", *SIMULATED)
    for seconds in (0, 2):
        robot.wait_for(f"waiting for the first time on /clock ({seconds} s; nobody publishes it); start a simulator")
    robot.send(signal.SIGTERM)
    assert robot.end() == 0, robot.text
    assert robot.lines[-1] == "robot: stopped while starting"
    assert not bags(tmp_path)


def test_stamps_begin_at_the_first_time_whatever_else_comes(start, bench, listener, publish, tmp_path):
    robot = start("robot", *SIMULATED)
    robot.wait_for("waiting for the first time")
    for seconds, nanoseconds in NO_TIME:
        words = f"/clock: refused: {seconds} s and {nanoseconds} ns is no time; give 0 to"
        publish(clock(seconds, nanoseconds), lambda words=words: words in robot.text)
    for message in (b"\0", b"\0\1\0\0", clock(0)):
        publish(message)
    robot.wait_for("its time is 0 so far")
    assert not any("ready" in line for line in robot.lines)
    publish(clock(1000, 5), lambda: listener.stamps)
    _, values = listener.wait_for_status("simulation", lambda status: True)
    for message in (*(clock(*time) for time in NO_TIME), b"\0", b"\xff" * 12, clock(0), clock(1), clock(2000)):
        publish(message)
        listener.spin_for_samples(5)
    refused_before = float(values["refused requests"])
    listener.wait_for_status("simulation", lambda status: value_of(status, "refused requests") > refused_before)
    stop(robot)
    assert listener.stamps[0] >= 1000 * 10**9 + 5
    assert set(b - a for a, b in zip(listener.stamps, listener.stamps[1:], strict=False)) == {5_000_000}
    (folder,) = bags(tmp_path)
    assert read_bag(folder, {}).metadata["start"] == str(1000 * 10**9 + 5)
