"""What no load may break, and the measurement that says how much a load costs."""

import re
import signal
from pathlib import Path

import pytest
from nav_msgs.msg import Odometry
from observation import value_of
from operated_robot import Operator
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message

from tools.load import LOADS, Outcome, lost_by, rate_of, table
from tools.probe import CALM, Effects, Listening

MOST_GROWTH = 1.0  # MB


def odom(seconds: float, position: float = 0.0, velocity: float = 0.0) -> bytes:
    message = Odometry()
    message.header.frame_id, message.child_frame_id = "odom", "base_link"
    message.header.stamp.sec, message.header.stamp.nanosec = int(seconds), round(seconds % 1.0 * 1e9)
    message.pose.pose.position.x, message.twist.twist.linear.x = position, velocity
    return serialize_message(message)


def test_twenty_listeners_hear_every_sample_while_commands_flood_the_robot(start, bench):
    """And the last command of the flood counts."""
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false", "-p", "effects.motor:=ideal")
    heard: list[list[bytes]] = [[] for _ in range(20)]
    operator = Operator(bench, ("odom", "joint_states"))
    operator.wait_for_robot()
    for one in heard:
        bench.node.create_subscription(Odometry, "odom", one.append, QoSProfile(depth=10_000), raw=True)
    bench.spin_until(lambda: all(heard), "all listeners")
    for _ in range(200):
        for _ in range(25):  # 5 kHz at 200 samples a second
            operator.command(motor_speed=50.0)
        operator.spin_for_samples(1)
    operator.command(motor_speed=40.0)
    bench.spin_until(lambda: operator.joint("crank")[1] == 40.0, "the last command")
    for one in heard:
        stamps = [stamp.sec * 10**9 + stamp.nanosec for stamp in
                  (deserialize_message(data, Odometry).header.stamp for data in one)]
        assert {after - before for before, after in zip(stamps, stamps[1:], strict=False)} == {5_000_000}
        assert len(stamps) > 100
    robot.send(signal.SIGINT)
    assert robot.end() == 0, robot.text
    assert "0 commands refused" in robot.lines[-1]


def test_a_robot_that_records_does_not_grow(start, listener):
    """In five minutes of robot time, as fast as it can. The bag's index grows with wall time: test_growing_bytes."""
    robot = start("robot", "--ros-args", "-p", "rate.publish:=50.0", "-p", "rate.real_time_factor:=0.0",
                  "-p", "motor.speed:=100.0")
    memory = []
    for due in (30.0, 330.0):
        listener.wait_for_status("simulation", lambda status, due=due: value_of(status, "simulated time [s]") > due)
        text = Path(f"/proc/{robot.pid}/status").read_text()
        memory.append(int(text.partition("VmRSS:")[2].split()[0]) * 1024e-6)
    robot.send(signal.SIGINT)
    assert robot.end() == 0, robot.text
    assert memory[1] - memory[0] < MOST_GROWTH


def test_a_subscription_says_its_rate_and_what_it_has_not_heard(monkeypatch):
    clock = iter([10.0, 10.5, 11.0, 12.0])
    monkeypatch.setattr("time.monotonic", lambda: next(clock))
    one = Listening()
    for seconds in (7.0, 7.5, 8.0, 9.0):
        one.hear(odom(seconds))
    assert rate_of(one) == 1.5
    assert lost_by(one, 2.0) == 1


def test_a_delay_ends_with_the_first_message_that_shows_the_command(monkeypatch):
    clock = iter(range(100))
    monkeypatch.setattr("time.monotonic", lambda: next(clock))
    effects = Effects()
    for _ in range(CALM + 1):
        assert not effects.ready
        effects.hear(odom(1.0, position=0.5))
    assert effects.ready
    effects.expect(5.5)  # after the message of instant 5
    effects.hear(odom(1.0, position=0.5))  # under way before
    assert effects.waits
    effects.hear(odom(1.0, position=0.5, velocity=1e-9))
    assert effects.delays == [1.5]
    effects.hear(odom(1.0, position=0.5))
    assert not effects.waits and not effects.ready


def test_the_table_has_the_worst_of_each():
    shown = table({"robots": Outcome([1.0, 0.99, 1.005], 3, [0.1, 0.25], [0.5] * 99 + [1.75], 4999.6)})
    assert shown.splitlines()[-1] == "| robots | 0.9900 | 3 | 0.25 MB | 5000/s | 0.50 periods | 0.51 | 1.75 | 100 |"


@pytest.mark.quiet
def test_a_load_is_measured_and_nothing_stays_behind(start, tmp_path):
    measuring = start("load", "flood", "--settling", "0.5", "--duration", "3.0")
    assert measuring.end() == 0, measuring.text
    (row,) = re.findall(r"^\| flood \|.*$", measuring.text, re.MULTILINE)
    rate, lost, _, flooded, *_, watched = [cell.strip() for cell in row.split("|")[2:-1]]
    assert float(rate) > 0.0 and int(watched) > 0
    assert lost == "0"
    assert 0.0 < float(flooded.removesuffix("/s")) <= 1.05 * LOADS["flood"].flood
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_measurement_ends_what_it_has_started(start):
    measuring = start("load", "robots")
    measuring.wait_for("about 70 s")
    children = Path(f"/proc/{measuring.pid}/task/{measuring.pid}/children")
    while not (child := children.read_text().strip()):
        assert not measuring.ended, measuring.text
    measuring.send(signal.SIGINT)
    assert measuring.end() == 130
    assert not Path(f"/proc/{child.split()[0]}").exists()
