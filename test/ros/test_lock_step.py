"""Lock-step: nodes in simulated time, unchanged, whose commands come at the same robot time in every run."""

from functools import partial
from pathlib import Path

import pytest
from observation import bags, stop
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from vibro_ros.bag.stream import BagStream

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


def test_it_stands_still_for_a_node_that_is_not_there_and_says_so_and_hears_signals(start, bench, resume):
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
