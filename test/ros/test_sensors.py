"""A machine with a dc motor and sensors, thrown at its start and driven by volts: what users receive of it, and its
recording, computed again to the last bit.
"""

from importlib import import_module
from importlib.util import find_spec

import numpy as np
import pytest
from observation import messages_of
from random_run import FASTER, SENSORS, record_run
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from vibro_ros.bag.reader import read_bag
from vibro_ros.messages.topics import SENSOR_TOPICS, TOPICS
from vibro_ros.recordings import replay, report

THROWN = [f"start.{name}:={value}" for name, value in (
    ("state", "given"), ("body_height", 0.02), ("body_velocity", 0.5), ("upper_position", 0.05),
    ("inclined_position", 0.06), ("inclined_velocity", -0.25), ("crank_angle", 1.0))]
VARIANCES = [float(number) for number in range(1, 13)]
MACHINE = ("scene:=machine", "motor.control:=voltage", "motor.winding_inductance:=2.81e-4", *THROWN,
           f"odom.pose_covariance_diagonal:={VARIANCES[:6]}", f"odom.twist_covariance_diagonal:={VARIANCES[6:]}")


def test_a_machine_with_sensors_replays_identically_and_another_seed_gives_other_noise(
        start, bench, call, tmp_path, capsys):
    """The bag also has the refused commands: every speed, and voltages above the supply's or not finite."""
    imu_messages: list[Imu] = []
    powers: list[float] = []
    bench.node.create_subscription(Imu, "imu/data_raw", imu_messages.append, qos_profile_sensor_data)
    bench.node.create_subscription(Float64, "electrical_power", lambda message: powers.append(message.data), 10)

    def drive_reset_and_fail(bench):
        (volts,) = bench.publishers({"motor_voltage": Float64}).values()
        for value in (18.0, 1e3, float("nan")):
            volts.publish(Float64(data=value))
        bench.spin_until(lambda: max(powers[-100:], default=0.0) > 20.0, "a motor that draws power")
        call(Trigger, "reset")
        if find_spec("vibro_ros_interfaces.srv"):  # built where there is a compiler
            kind = import_module("vibro_ros_interfaces.srv").InjectFault
            for fault in ({"fault": "sensor_freeze", "of": "encoder"}, {"fault": "supply_sag", "value": 9.0}):
                answer = call(kind, "inject_fault", duration=0.5, **fault)
                assert answer.success, answer.message

    bag = record_run(start, bench, tmp_path, f"rate.real_time_factor:={FASTER}", *SENSORS, *MACHINE, seconds=0.5,
                     afterwards=drive_reset_and_fail)
    assert len(imu_messages) > 100
    assert imu_messages[-1].header.frame_id == "imu_link" and imu_messages[-1].orientation_covariance[0] == -1.0
    recorded = read_bag(bag)
    assert all(recorded.topics[f"/{topic}"].messages > 50
               and recorded.topics[f"/{topic}"].type_name == TOPICS[topic].type for topic in SENSOR_TOPICS.values())
    assert replay.main([str(bag)]) == 0
    assert capsys.readouterr().out.startswith("identical: ")
    imu, tracking = recorded["imu/data_raw"], recorded["tracking"]
    assert np.all(imu["acceleration_variance"] > 0.0) and np.all(tracking["variance"] == 1e-6)
    delays = tracking["time"] - tracking["stamp"]
    assert delays.min() > 0.04 - 1e-6 and delays.max() < 0.05 + 1e-6  # the latency, and up to a sample's period
    assert recorded["motor_current"]["value"].max() > 1.0
    assert recorded["joint_states"]["crank.velocity"].max() > 10.0
    assert recorded["joint_states"]["crank.position"][0] == 1.0
    assert recorded["odom"]["position"][0, 2] == pytest.approx(0.02)
    odometry = messages_of(bag)["/odom"][-1]
    assert [*np.diag(odometry.pose.covariance.reshape(6, 6)),
            *np.diag(odometry.twist.covariance.reshape(6, 6))] == VARIANCES
    assert odometry.pose.covariance.sum() == sum(VARIANCES[:6])
    assert report.main([str(bag)]) == 0
    assert "supply" in capsys.readouterr().out

    assert replay.main([str(bag), "--set", "sensors.seed=7"]) == 0
    reseeded = read_bag(capsys.readouterr().out.splitlines()[-1])
    count = min(len(each["odom"]["time"]) for each in (recorded, reseeded))
    assert np.array_equal(recorded["odom"]["position"][:count], reseeded["odom"]["position"][:count])
    assert np.array_equal(recorded["encoder"]["crank.position"][:50], reseeded["encoder"]["crank.position"][:50])
    assert not np.array_equal(imu["acceleration"][:50], reseeded["imu/data_raw"]["acceleration"][:50])


@pytest.mark.process
def test_a_replay_can_add_sensors_to_a_run(recorded, capsys):
    assert not set(SENSOR_TOPICS.values()) & {topic[1:] for topic in read_bag(recorded).topics}
    assert replay.main([str(recorded), "--set", "sensors.imu.rate=500.0"]) == 0
    folder = capsys.readouterr().out.splitlines()[-1]
    assert len(read_bag(folder)["imu/data_raw"]["time"]) > 100
    assert replay.main([folder]) == 0
