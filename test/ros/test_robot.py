"""The robot as a process of its own, commanded and observed over DDS."""

import json
from collections import defaultdict
from pathlib import Path

from observation import COMMANDS, HEARD, PERIOD, Operator, stop_with_whole_bag
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
    folder = tmp_path / stop_with_whole_bag(robot)

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
