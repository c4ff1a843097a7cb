"""Pacing by a clock that the test controls, robot time through resets, and the watchdog of `command.timeout`."""

from collections import Counter

import pytest

import vibro_ros
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.ros.robot.pacing import LONGEST_SLEEP, CommandTimeout, Pacing, RobotTime

TICK = 0.005  # [s]


class Clock:
    """A wall clock that advances only while a caller sleeps, by `oversleep` too far each time, or when a test sets it.
    """

    def __init__(self, oversleep: float = 0.0):
        self.time = 1000.0
        self.sleeps: list[float] = []
        self._oversleep = oversleep

    def now(self) -> float:
        return self.time

    def sleep(self, duration: float) -> None:
        self.sleeps.append(duration)
        self.time += duration + self._oversleep


def pacing(clock: Clock, factor: float = 1.0) -> Pacing:
    paced = Pacing(factor, max_catch_up=0.1, now=clock.now, sleep=clock.sleep)
    paced.start()
    return paced


@pytest.mark.parametrize("factor", [0.25, 1.0, 4.0])
def test_late_wake_ups_do_not_add_up(factor: float):
    clock = Clock(oversleep=0.0004)
    paced = pacing(clock, factor)
    for tick in range(1, 2001):
        assert paced.wait_until(tick * TICK) == 0.0
    # the last deadline, and at most one oversleep beyond it; 1e-9 s for the rounding of a clock at 1000 s
    assert clock.time == pytest.approx(1000.0 + 2000 * TICK / factor, abs=0.0004 + 1e-9)
    assert clock.time >= 1000.0 + 2000 * TICK / factor - 1e-9
    assert (paced.stalls, paced.dropped) == (0, 0.0)


def test_a_short_stall_is_caught_up_without_sleep():
    clock = Clock()
    paced = pacing(clock)
    clock.time += 0.09
    assert [paced.wait_until(tick * TICK) for tick in range(1, 19)] == [0.0] * 18
    assert clock.sleeps == []
    paced.wait_until(19 * TICK)
    assert clock.time == pytest.approx(1000.0 + 19 * TICK, abs=1e-9)
    assert paced.stalls == 0


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_a_long_stall_is_dropped_from_simulated_time(factor: float):
    clock = Clock()
    paced = pacing(clock, factor)
    paced.wait_until(TICK)
    clock.time += 0.5
    # the tick at 2 * TICK was due 0.5 s - TICK / factor ago
    assert paced.wait_until(2 * TICK) == pytest.approx(0.5 * factor - TICK, abs=1e-9)
    clock.sleeps.clear()
    for tick in range(3, 10):
        assert paced.wait_until(tick * TICK) == 0.0
    assert clock.sleeps == pytest.approx([TICK / factor] * 7, abs=1e-9)
    assert paced.stalls == 1
    assert paced.dropped == pytest.approx(0.5 * factor - TICK, abs=1e-9)


def test_factor_zero_never_waits_and_never_drops():
    clock = Clock()
    paced = pacing(clock, factor=0.0)
    clock.time += 5.0
    assert [paced.wait_until(tick * TICK) for tick in range(1, 100)] == [0.0] * 99
    assert sum(clock.sleeps) == 0.0
    assert paced.stalls == 0 and paced.take_lateness() == []


def test_the_lateness_of_each_wait_is_kept_until_it_is_taken():
    clock = Clock(oversleep=0.0004)
    paced = pacing(clock)
    for tick in range(1, 6):
        paced.wait_until(tick * TICK)
    clock.time += 0.03
    paced.wait_until(6 * TICK)
    # 1e-9 s for the rounding of a clock at 1000 s
    assert paced.take_lateness() == pytest.approx([0.0004] * 5 + [0.03 + 0.0004 - TICK], abs=1e-9)
    assert paced.take_lateness() == []


def test_after_a_pause_the_next_tick_is_a_period_away_and_nothing_is_late():
    clock = Clock()
    paced = pacing(clock)
    paced.wait_until(TICK)
    clock.time += 100.0
    paced.follow(TICK)
    clock.sleeps.clear()
    assert paced.wait_until(2 * TICK) == 0.0
    assert clock.sleeps == pytest.approx([TICK], abs=1e-9)
    assert (paced.missed, paced.stalls) == (0, 0)


@pytest.mark.parametrize("factor", [0.1, 1.0, 4.0])
def test_another_factor_counts_from_the_instant_at_which_it_is_set(factor: float):
    clock = Clock()
    paced = pacing(clock, factor=0.0)
    paced.wait_until(1000.0)
    paced.change_factor(factor, 1000.0)
    began = clock.time
    paced.wait_until(1000.0 + TICK)
    assert clock.time - began == pytest.approx(TICK / factor, abs=1e-9)
    paced.change_factor(0.0, 1000.0 + TICK)
    assert paced.wait_until(2000.0) == 0.0
    assert clock.time - began == pytest.approx(TICK / factor, abs=1e-9)


def test_a_factor_that_changes_during_a_wait_counts_at_once_and_a_stop_ends_it():
    clock = Clock()
    pacing(clock).wait_until(1e6, stopped=lambda: clock.time > 1000.2)
    assert 1000.2 < clock.time <= 1000.2 + 2 * LONGEST_SLEEP
    clock = Clock()
    paced = pacing(clock, factor=0.1)

    def hurry() -> bool:
        if clock.time > 1000.2:
            paced.change_factor(0.0, 0.0)
        return False

    assert paced.wait_until(1e6, hurry) == 0.0
    assert clock.time < 1000.2 + 2 * LONGEST_SLEEP + 1e-9


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


def test_the_command_timeout_counts_from_the_last_accepted_command():
    device, watchdog, accepted = vibro_ros.Simulator(vibro_ros.load_scene("device")), CommandTimeout(0.5, ""), Counter()
    assert not watchdog.is_over(10.0, accepted, device)  # a motor that nobody asked to turn needs no stop
    device.command(motor_speed=50.0)
    accepted["motor_speed"] += 1
    assert not watchdog.is_over(10.0, accepted, device)
    accepted["upper_gap"] += 1  # says nothing of the motor
    assert not watchdog.is_over(10.499, accepted, device)
    assert watchdog.is_over(10.5, accepted, device)
    assert watchdog.count == 1


def test_the_command_timeout_counts_from_the_start():
    device = vibro_ros.Simulator(vibro_ros.load_scene("paper"))
    watchdog = CommandTimeout(0.5, "")
    assert not watchdog.is_over(0.49, Counter(), device)
    assert watchdog.is_over(0.5, Counter(), device)


def test_the_slowest_factor_paces_and_drops_nothing():
    """The inverse of 5e-324 overflowed: nothing was paced, messages were dropped, and the dropped time was `nan`."""
    (factor,) = (parameter for parameter in DEVICE_PARAMETERS if parameter.name == "rate.real_time_factor")
    for value in (5e-324, 1e-320, 0.99 * factor.smallest):
        with pytest.raises(ValueError, match="0 or from 1e-06 to 1000"):
            factor.checked(value)
    clock = Clock()
    paced = pacing(clock)
    paced.change_factor(factor.checked(factor.smallest), 1e6)
    assert paced.wait_until(1e6 + 1e-6) == 0.0
    assert clock.time == pytest.approx(1001.0, abs=1e-3)  # [s] of two sums of a million seconds
    assert (paced.stalls, paced.dropped) == (0, 0.0)
