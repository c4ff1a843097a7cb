"""Robot time through resets, and the watchdog that counts it."""

from collections import Counter

import pytest

import vibro_ros
from vibro_ros.ros.robot.command_timeout import CommandTimeout
from vibro_ros.ros.robot.robot_time import RobotTime


@pytest.mark.parametrize("rate", [0.1, 3.0, 200.0, 300.0, 1e4])
def test_stamps_grow_by_a_period_through_resets_and_the_device_begins_at_0(rate: float):
    time = RobotTime(rate, start=17)
    stamps, since = [time.stamp], 0
    for tick in range(1, 1000):
        if tick % 97 == 0:
            time.restart()
            since = tick
        assert time.due_of_device == (tick - since) / rate
        time.ticks += 1
        stamps.append(time.stamp)
        assert abs(time.stamp_of((tick - since) / rate) - time.stamp) <= 1  # ns, of two roundings
    assert stamps == [17 + round(tick / rate * 1e9) for tick in range(1000)]


def test_the_watchdog_counts_from_the_last_command_that_took_effect():
    device, watchdog, accepted = vibro_ros.Simulator(vibro_ros.load_scene("device")), CommandTimeout(0.5), Counter()
    assert not watchdog.is_over(10.0, accepted, device)  # a motor that nobody asked to turn needs no stop
    device.command(motor_speed=50.0)
    accepted["motor_speed"] += 1
    assert not watchdog.is_over(10.0, accepted, device)
    accepted["upper_gap"] += 1  # says nothing of the motor
    assert not watchdog.is_over(10.499, accepted, device)
    assert watchdog.is_over(10.5, accepted, device)
    assert watchdog.count == 1


def test_a_motor_that_turns_from_the_start_is_watched_from_the_start():
    device = vibro_ros.Simulator(vibro_ros.load_scene("paper"))
    watchdog = CommandTimeout(0.5)
    assert not watchdog.is_over(0.49, Counter(), device)
    assert watchdog.is_over(0.5, Counter(), device)
