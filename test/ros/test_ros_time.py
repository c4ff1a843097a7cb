"""Simulated time: a robot that takes it from /clock, and lock-step, in which nodes in simulated time have their
commands at the same robot time in every run.
"""

import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from observation import bags, stop, value_of
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from vibro_ros.bag.reader import read_bag
from vibro_ros.bag.stream import BagStream
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


def test_the_wait_for_time_is_logged_and_ended_by_a_signal(start, tmp_path):
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


HERE = Path(__file__).parent
def lock_stepped(start, nodes: str, *more: str):
    """Start a robot that waits at robot time 0 until it is resumed, and then runs as fast as robot and `nodes` can."""
    return start("robot", "--ros-args", "-p", "clock.publish:=true", "-p", f"clock.lock_step:=[{nodes}]",
                 "-p", "rate.start_paused:=true", "-p", "rate.real_time_factor:=0.0", *more)


@pytest.fixture
def resume(call):
    """Let a robot that started paused run."""
    def let_it_run() -> None:
        assert call(SetBool, "pause", data=False).success
    return let_it_run


def messages(folder: Path) -> list[tuple[str, int, bytes]]:
    with BagStream(folder) as stream:
        return list(stream.messages(frozenset(stream.topics)))


def assert_equal(first: list[tuple[str, int, bytes]], second: list[tuple[str, int, bytes]]) -> None:
    """Compare two bags, and say where they first differ; pytest would search a thousand messages for it."""
    parted = next((k for k, pair in enumerate(zip(first, second, strict=False)) if pair[0] != pair[1]), None)
    if parted is not None:
        raise AssertionError(f"message {parted} of {len(first)}, {len(second)}: {first[parted - 2:parted + 2]} and "
                             f"{second[parted - 2:parted + 2]}")
    assert len(first) == len(second)


@pytest.fixture
def start_peer(start):
    """Start the node of `simulated_time_peer.py`."""
    return partial(start, str(HERE / "simulated_time_peer.py"), "--ros-args", "-p", "use_sim_time:=true")


def test_two_runs_of_a_node_with_a_timer_have_bags_with_the_same_messages(start, start_peer, bench, resume, tmp_path):
    for _ in range(2):
        robot, peer = lock_stepped(start, "/simulated_time_peer"), start_peer()
        bench.spin_until(lambda: bench.node.count_publishers("/motor_speed") == 1
                         and bench.node.count_subscribers("/odom") == 1
                         and bench.node.count_subscribers("/clock") == 1, "the peer")
        resume()
        assert peer.end() == 0, peer.text
        stop(robot)
    first, second = map(messages, bags(tmp_path))
    assert_equal(first, second)
    stamps = [stamp for topic, stamp, _ in first if topic == "/motor_speed"]
    assert stamps == [20_000_000 * k for k in range(1, 101)]  # [ns] each command at the very time of its timer


def test_lock_step_waits_for_a_missing_node_and_obeys_signals(start, bench, resume):
    robot = lock_stepped(start, "/nobody")
    clocks: list[Clock] = []
    bench.node.create_subscription(Clock, "/clock", clocks.append, 10)
    robot.wait_for("paused until")
    resume()
    robot.wait_for("clock.lock_step: waiting for /nobody")
    robot.wait_for("it is not there; robot time stands still")
    assert all(message.clock.sec == message.clock.nanosec == 0 for message in clocks)
    stop(robot)
    assert "0.000 s simulated" in robot.lines[-1]
