"""The motor at its extremes: ramps that stop and turn back at every phase, an hour of standstill."""

import itertools
import math

import numpy as np
import pytest
from exact_motion import NODES, WEIGHTS, slider

import vibro_ros

FREE = vibro_ros.load_scene("paper").with_parameters({
    "effects.upper_contact": "none", "effects.inclined_mass": False, "effects.motor": "ramp",
    "motor.acceleration": 2000.0, "motor.speed": 60.0})


def ramped(time, corners, speeds):
    """Crank angle [rad] at `time` of a speed that is linear between `corners` [s]."""
    speed = np.interp(time, corners, speeds)
    done = np.concatenate(([0.0], np.cumsum(np.diff(corners) * (np.add(speeds[1:], speeds[:-1]) / 2))))
    k = np.clip(np.searchsorted(corners, time, side="right") - 1, 0, len(corners) - 1)
    return done[k] + (time - np.take(corners, k)) * (np.take(speeds, k) + speed) / 2


def swing(time, corners, speeds, frequency=100.0):
    """Return Duhamel's integral over a slider at the given crank angles, by Gauss's rule on pieces of 1 ms that end at
    the corners.
    """
    edges = np.unique(np.concatenate((np.linspace(0.0, time, int(time * 1e3) + 2), [c for c in corners if c < time])))
    middle, half = (edges[1:] + edges[:-1]) / 2, (edges[1:] - edges[:-1]) / 2
    tau = middle[:, None] + half[:, None] * NODES
    angle = ramped(tau, corners, speeds)
    integrand = slider(angle, 0.02, 0.06) * np.sin(frequency * (time - tau))
    return 0.08 * math.cos(frequency * time) + frequency * np.sum(half[:, None] * WEIGHTS * integrand)


@pytest.mark.parametrize("low", [0.0, 1e-9, 20.0, -1e-9, -20.0, -60.0])
def test_a_ramp_turned_back_at_every_phase(low):
    """The motor slows down from 60 rad/s at 48 instants of a turn, and is commanded up again before it stands, after
    that, or while it turns backwards: angle and mass are as computed.
    """
    turn = 2.0 * math.pi / 60.0
    for begin in np.arange(1, 49) / 48 * turn:
        device = vibro_ros.Simulator(FREE)
        device.advance_to(begin)
        device.command(motor_speed=min(low, 0.0))
        bottom = begin + (60.0 - low) / 2000.0
        pause = bottom + (0.003 if low == 0.0 else 0.0)
        device.advance_to(pause)
        assert device.state.motor_speed == pytest.approx(low, abs=1e-12)
        device.command(motor_speed=60.0)
        end = pause + (60.0 - low) / 2000.0 + 0.01
        device.advance_to(end)
        corners = [0.0, begin, bottom, pause, end - 0.01, end]
        speeds = [60.0, 60.0, low, low, 60.0, 60.0]
        assert device.state.crank_angle == pytest.approx(float(ramped(end, corners, speeds)), rel=1e-14)
        # positions of 0.1 m, some hundred roundings
        assert device.state.upper_position == pytest.approx(swing(end, corners, speeds), abs=1e-14)


def test_a_ramp_to_standstill_that_commands_cut_at_every_tick():
    """Commands that change nothing split the ramp; the rounding error at its end neither fails the run nor turns the
    crank.
    """
    for ticks in range(1, 400, 7):
        begin = 0.005 * ticks
        device = vibro_ros.Simulator(vibro_ros.load_scene("device").with_parameters({"motor.speed": 40.0}))
        device.advance_to(begin)
        device.command(motor_speed=0.0)  # at 200 rad/s^2 it stands after 40 ticks
        for tick in range(ticks + 1, ticks + 45):
            device.command(upper_gap=device.scene["upper.gap"])
            device.advance_to(0.005 * tick)
        assert device.state.motor_speed == 0.0
        assert device.state.crank_angle == pytest.approx(40.0 * begin + 40.0**2 / 400.0, rel=1e-14)


def test_a_motor_that_stops_on_a_cell_of_the_crank_starts_again():
    """Ramps stop exactly at multiples of an eighth turn, where cells of the slider's table meet; the motor goes on
    there, or back.
    """
    for eighths, speed in itertools.product(range(1, 17), (30.0, -30.0)):
        angle = eighths * math.pi / 4.0
        device = vibro_ros.Simulator(FREE.with_parameters({"motor.acceleration": 60.0**2 / (2.0 * angle)}))
        device.command(motor_speed=0.0)
        stop = 2.0 * angle / 60.0
        device.advance_to(stop + 0.05)
        assert device.state.motor_speed == 0.0
        assert device.state.crank_angle == pytest.approx(angle, rel=1e-15)
        device.command(motor_speed=speed)
        device.advance_to(stop + 0.25 + stop / 2.0)
        expected = angle + speed * stop / 4.0 + speed * 0.2
        assert device.state.crank_angle == pytest.approx(expected, rel=1e-14, abs=1e-14)
        corners = [0.0, stop, stop + 0.05, stop + 0.05 + stop / 2.0, stop + 0.25 + stop / 2.0]
        assert device.state.upper_position == pytest.approx(
            swing(corners[-1], corners, [60.0, 0.0, 0.0, speed, speed]), abs=1e-14)


@pytest.mark.parametrize("name", ["paper", "damped", "rigid"])
def test_an_hour_at_motor_speed_zero_changes_no_bit(name):
    """Masses at rest on their sliders (or resting on a rigid plate) are exactly so an hour later."""
    scene = vibro_ros.load_scene(name).with_parameters({
        "motor.speed": 0.0, "inclined.gap": 0.03, "upper.gap": 0.0 if name == "rigid" else 0.03})
    device = vibro_ros.Simulator(scene)
    state_before = device.state
    device.advance_to(3600.0)
    after = device.state
    for field in vars(state_before):
        if field != "time":
            assert getattr(after, field) == getattr(state_before, field), field
    assert len(device.take_events()) == 0
    assert device.statistics["steps"] < 250_000  # 2 / 112 s each
