"""A robot with a dc motor that starts in flight: commanded by volts, recorded, and computed again to the last bit."""

import numpy as np
import pytest
from observation import messages_of
from random_run import record_run
from std_msgs.msg import Float64

from vibro_ros.bag.reader import read_bag
from vibro_ros.recordings import replay, report

THROWN = [f"start.{name}:={value}" for name, value in (
    ("state", "given"), ("body_height", 0.02), ("body_velocity", 0.5), ("upper_position", 0.05),
    ("inclined_position", 0.06), ("inclined_velocity", -0.25), ("crank_angle", 1.0))]
VARIANCES = [float(number) for number in range(1, 13)]


def test_volts_turn_the_crank_and_the_replay_is_identical(start, bench, tmp_path, capsys):
    """The bag also has the refused commands, a speed and a voltage above the supply's, and the variances."""
    heard = {name: [] for name in ("motor_current", "electrical_power")}
    for name, of_topic in heard.items():
        bench.node.create_subscription(Float64, name, of_topic.append, 10)

    def drive(bench):
        volts, speed = bench.publishers({"motor_voltage": Float64, "motor_speed": Float64}).values()
        for publisher, value in ((volts, 18.0), (speed, 10.0), (volts, 1e3), (volts, float("nan"))):
            publisher.publish(Float64(data=value))
        before = len(heard["motor_current"])
        bench.spin_until(lambda: len(heard["motor_current"]) > before + 60 and any(
            one.data > 20.0 for one in heard["electrical_power"]), "a motor that draws power")

    bag = record_run(start, bench, tmp_path, "scene:=machine", "motor.control:=voltage",
                     "motor.winding_inductance:=2.81e-4", *THROWN, f"odom.pose_covariance_diagonal:={VARIANCES[:6]}",
                     f"odom.twist_covariance_diagonal:={VARIANCES[6:]}", seconds=0.3, then=drive)
    assert replay.main([str(bag)]) == 0
    assert capsys.readouterr().out.startswith("identical: ")
    recorded = read_bag(bag)
    assert recorded["motor_current"]["value"].max() > 1.0
    assert len(recorded["motor_current"]["value"]) == len(recorded["joint_states"]["time"])
    assert recorded["joint_states"]["crank.velocity"].max() > 10.0
    odometry = messages_of(bag)["/odom"][-1]
    assert [*np.diag(odometry.pose.covariance.reshape(6, 6)),
            *np.diag(odometry.twist.covariance.reshape(6, 6))] == VARIANCES
    assert odometry.pose.covariance.sum() == 21.0
    assert recorded["odom"]["position"][0, 2] == pytest.approx(0.02)
    assert recorded["joint_states"]["crank.position"][0] == 1.0
    assert report.main([str(bag)]) == 0
    assert "supply" in capsys.readouterr().out
