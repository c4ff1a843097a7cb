"""Sensors of a real robot: received as users receive them, recorded, and computed again to the last bit."""

from importlib import import_module
from importlib.util import find_spec

import numpy as np
import pytest
from random_run import FASTER, SENSORS, record_run
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu
from std_srvs.srv import Trigger

from vibro_ros.bag.reader import read_bag
from vibro_ros.messages.topics import SENSOR_TOPICS, TOPICS
from vibro_ros.recordings import replay


def test_a_sensed_run_is_identical_in_its_replay_and_another_seed_is_another_noise(start, bench, call, tmp_path,
                                                                                   capsys):
    heard = []
    bench.node.create_subscription(Imu, "imu/data_raw", heard.append, qos_profile_sensor_data)

    def reset_and_fail(bench):
        call(Trigger, "reset")
        if find_spec("vibro_ros_interfaces.srv"):  # built where there is a compiler
            kind = import_module("vibro_ros_interfaces.srv").InjectFault
            for fault in ({"fault": "sensor_freeze", "of": "encoder"}, {"fault": "supply_sag", "value": 9.0}):
                answer = call(kind, "inject_fault", duration=0.5, **fault)
                assert answer.success, answer.message

    bag = record_run(start, bench, tmp_path, f"rate.real_time_factor:={FASTER}", *SENSORS, seconds=1.0,
                     then=reset_and_fail)
    assert len(heard) > 100
    assert heard[-1].header.frame_id == "imu_link" and heard[-1].orientation_covariance[0] == -1.0
    one = read_bag(bag)
    assert all(one.topics[f"/{topic}"].messages > 50 and one.topics[f"/{topic}"].type_name == TOPICS[topic].type
               for topic in SENSOR_TOPICS.values())
    assert replay.main([str(bag)]) == 0
    assert capsys.readouterr().out.startswith("identical: ")
    imu, tracking = one["imu/data_raw"], one["tracking"]
    assert np.all(imu["acceleration_variance"] > 0.0) and np.all(tracking["variance"] == 1e-6)
    delays = tracking["time"] - tracking["stamp"]
    assert delays.min() > 0.04 - 1e-6 and delays.max() < 0.05 + 1e-6  # the latency, and up to a sample's period

    assert replay.main([str(bag), "--set", "sensors.seed=7"]) == 0
    folder = capsys.readouterr().out.splitlines()[-1]
    other = read_bag(folder)
    count = min(len(each["odom"]["time"]) for each in (one, other))
    assert np.array_equal(one["odom"]["position"][:count], other["odom"]["position"][:count])
    assert np.array_equal(one["encoder"]["crank.position"][:50], other["encoder"]["crank.position"][:50])
    assert not np.array_equal(one["imu/data_raw"]["acceleration"][:50], other["imu/data_raw"]["acceleration"][:50])


@pytest.mark.process
def test_a_run_without_sensors_is_sensed_in_its_replay(recorded, capsys):
    assert not set(SENSOR_TOPICS.values()) & {topic[1:] for topic in read_bag(recorded).topics}
    assert replay.main([str(recorded), "--set", "sensors.imu.rate=500.0"]) == 0
    folder = capsys.readouterr().out.splitlines()[-1]
    assert len(read_bag(folder)["imu/data_raw"]["time"]) > 100
    assert replay.main([folder]) == 0
