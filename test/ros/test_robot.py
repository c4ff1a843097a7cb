"""The robot as a process of its own, commanded and observed over DDS."""

import json
import math
import signal
from collections import defaultdict
from pathlib import Path

from operated_robot import COMMANDS, HEARD, PERIOD, Operator, stop
from recorded_bag import by_mcap, by_rosbags

from vibro_ros.bag.reader import read_bag
from vibro_ros.recordings import replay


def raw_messages(folder: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Return stamps and bytes by topic, as two independent readers read them."""
    messages: dict[str, list] = defaultdict(list)
    for topic, stamp, data in by_rosbags(folder):
        messages[topic].append((stamp, data))
    assert by_mcap(folder) == by_rosbags(folder)
    return messages


def test_it_moves_as_the_simulation_says_and_the_bag_holds_every_message(start, bench, tmp_path):
    robot = start("robot", "--ros-args", "-p", "record.directory:=bags")
    operator = Operator(bench)
    operator.wait_for_robot()
    for speed in (300.0, 200.0, 100.0):  # all within one tick or two: the last must win
        operator.command(motor_speed=speed)
    operator.spin_for_samples(200)
    operator.command(upper_gap=0.0005, inclined_gap=-0.0003, motor_speed=130.0)
    operator.spin_for_samples(200)
    operator.command(motor_speed=60.0)
    operator.spin_for_samples(100)
    folder = tmp_path / stop(robot)

    recorded = raw_messages(folder)
    known = (*HEARD, *COMMANDS, "joint_commands", "robot_description", "tf_static", "tf", "vibro_robot/operations")
    assert set(read_bag(folder).topics) == {f"/{topic}" for topic in known}
    for topic, heard in operator.heard.items():
        data = [data for _, data in recorded[f"/{topic}"]]
        pieces = (data[first : first + len(heard)] for first in range(len(data) - len(heard) + 1))
        assert heard in pieces, f"{topic}: heard is not a piece of the bag, without a gap"
    bag = read_bag(folder)
    sent = [300.0, 200.0, 100.0, 130.0, 60.0], [0.0005], [-0.0003]
    assert tuple(bag[name]["value"].tolist() for name in COMMANDS) == sent
    assert abs(operator.odom().pose.pose.position.x) > 0.01  # [m]

    start_ns = recorded["/odom"][0][0]
    assert [stamp for stamp, _ in recorded["/odom"]] == [start_ns + PERIOD * i for i in range(len(recorded["/odom"]))]
    assert (bag.metadata["scene"], bag.metadata["start"]) == ("device", str(start_ns))
    assert json.loads(bag.metadata["parameters"])["upper.spring.damping"] == 2.0
    assert len(bag["impacts"]["time"]) > 10
    assert replay.main([str(folder)]) == 0  # and `test_publishers.py` says what the numbers of a message are


def test_bad_commands_are_refused_and_the_robot_goes_on_until_an_impatient_user_ends_it(start, bench, tmp_path):
    robot = start("robot", "--ros-args", "-p", "effects.motor:=ideal")
    operator = Operator(bench)
    operator.wait_for_robot()
    operator.command(motor_speed=80.0)
    bench.spin_until(lambda: operator.joint("crank")[1] == 80.0, "motor at speed")
    refusals = (
        ("motor_speed", math.nan, "/motor_speed: nan is not finite"),
        ("motor_speed", 501.0, "/motor_speed: 501 is out of range; give a number from -500 to 500 rad/s"),
        ("upper_gap", 0.07, "/upper_gap: 0.07 is out of range; give a number from -0.06 to 0.06 m"),
        ("inclined_gap", math.nan, "/inclined_gap: nan is not finite"),
    )
    for name, value, reason in refusals:
        operator.command(**{name: value})
        line = robot.wait_for(f"command refused: {reason}")
        assert "[WARN]" in line
    plates = operator.joint("upper_plate")[0], operator.joint("inclined_plate")[0]
    operator.spin_for_samples(50)
    assert operator.joint("crank")[1] == 80.0
    assert (operator.joint("upper_plate")[0], operator.joint("inclined_plate")[0]) == plates
    operator.command(motor_speed=90.0)
    bench.spin_until(lambda: operator.joint("crank")[1] == 90.0, "the next good command")
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        robot.send(number)
    assert robot.end() == 0, robot.text
    assert f"{len(refusals)} commands refused" in robot.lines[-1]
    (folder,) = tmp_path.glob("vibro_robot_*")
    assert "odom" in read_bag(folder)
