"""The known forcing over segments of every kind: signals of a phase that runs or ramps, and ramps."""

import math

import mpmath
import numpy as np
import pytest
from small_system import Integration, build, cosine_table

from vibro_ros.model.slider import Slider, signal_table
from vibro_ros.solver.channels import Channels
from vibro_ros.solver.events import PHASE_KIND

ONE_SIGNAL = Channels(0, 0, 1, 0)
SLIDERS = [Slider(0.02, 0.06, 0.7)] + [Slider(0.06 * (1 - 10.0**-n), 0.06, 0.7) for n in (1, 3, 9, 15)] + [
    Slider(0.06, 0.06, 0.7), Slider(0.06, 0.06, 0.0)]


def exact_slider(slider, theta):
    psi = theta - mpmath.mpf(slider.angle)
    radius, rod = mpmath.mpf(slider.radius), mpmath.mpf(slider.rod)
    return radius * mpmath.cos(psi) + mpmath.sqrt(rod**2 - (radius * mpmath.sin(psi)) ** 2)


def exact_phase(time, speed, change, ramp_time):
    """Phase [rad] at `time`, with a speed that changes for `ramp_time` [s]."""
    time, speed, change = mpmath.mpf(float(time)), mpmath.mpf(speed), mpmath.mpf(change)
    ramped = min(time, mpmath.mpf(ramp_time))
    return speed * time + change * ramped * (time - ramped / 2)


def check(slider, speed, target, change, times):
    """Compare signal and phase: to the rounding of a position, and of the phase (2e-15 of its change) at the slider's
    speed.
    """
    run = Integration(build(ONE_SIGNAL, [[]], signals=signal_table((slider,))), speed=speed)
    ramp_time = 0.0
    if target != speed:
        run.ramp_speed(target, change)
        change = math.copysign(change, target - speed)
        ramp_time = (target - speed) / change
    points, _, phases = run.sample(times)
    fastest = max(speed, target)
    with mpmath.workdps(40):
        theta = [exact_phase(time, speed, change, ramp_time) for time in times]
        expected = np.array([float(exact_slider(slider, angle)) for angle in theta])
        turned = np.array([float(angle) for angle in theta])
    rounding = 3e-16 + 2 * slider.radius * fastest * times * 2e-15
    assert np.all(abs(points[:, 0] - expected) <= rounding), abs(points[:, 0] - expected).max()
    angle = phases[:, 0] * 2 * math.pi + phases[:, 1]
    # The instant within a cell, of at most 2 rad, is rounded to 1.1e-16 of its half.
    np.testing.assert_allclose(angle, turned, rtol=1e-15, atol=fastest * times.max() * 1e-15 + 1.1e-16)
    return run, points, phases


@pytest.mark.parametrize("slider", SLIDERS)
@pytest.mark.parametrize("speed", [0.01, 100.0, 500.0])
def test_steady_speed(slider, speed):
    check(slider, speed, speed, 0.0, np.linspace(0, 20.0 / speed, 150))


@pytest.mark.parametrize("slider", SLIDERS)
@pytest.mark.parametrize(("speed", "target", "change"), [
    (0.0, 100.0, 200.0), (0.0, 500.0, 1e4), (100.0, 0.0, 200.0), (100.0, 99.0, 1e6), (3.0, 5.0, 0.1),
    (500.0, 0.0, 1e5)])
def test_changing_speed(slider, speed, target, change):
    """Over a ramp and beyond it, from standstill and to standstill."""
    duration = min(1.3 * abs(target - speed) / change, 3.0)
    run, _, phases = check(slider, speed, target, change, np.linspace(0, duration, 150))
    times = np.linspace(0, duration, 150)
    ramp_time = abs(target - speed) / change
    expected = np.where(times < ramp_time, speed + math.copysign(change, target - speed) * times, target)
    np.testing.assert_allclose(phases[:, 2], expected, rtol=0, atol=1e-13 * max(speed, target))
    if duration > ramp_time:
        assert phases[-1, 2] == target
        (event,) = run.events
        assert event[1] == PHASE_KIND
        assert event[0] == pytest.approx(ramp_time, rel=1e-15)


@pytest.mark.parametrize("slider", SLIDERS[:4])
def test_signal_rates(slider):
    """ds/dt, to the rounding of a position over the time in which the crank passes a cell."""
    run = Integration(build(ONE_SIGNAL, [[]], signals=signal_table((slider,))), speed=100.0)
    times = np.linspace(0, 0.1, 100)
    points, _, phases = run.sample(times)
    np.testing.assert_allclose(points[:, 1], slider.slope(phases[:, 1]) * 100.0, rtol=0, atol=1e-13)


def test_a_phase_that_stops_in_a_cell_stays_there():
    """Halfway into a cell: from 10 rad/s at 100 rad/s² it turns by 0.5 rad; then nothing moves for an hour."""
    run = Integration(build(ONE_SIGNAL, [[]], signals=cosine_table()), speed=10.0)
    run.ramp_speed(0.0, 100.0)
    points, _, phases = run.sample([0.1, 1.0, 3600.0])
    np.testing.assert_allclose(points[:, 0], math.cos(0.5), rtol=0, atol=3e-16)
    assert np.all(phases[1:, 2] == 0.0)
    np.testing.assert_array_equal(points[1], points[2])


@pytest.mark.parametrize("distance", [math.pi / 4, math.nextafter(math.pi / 4, 0.0), math.nextafter(math.pi / 4, 1.0)])
def test_a_phase_that_stops_at_the_end_of_a_cell(distance):
    """The speed vanishes exactly at the end of the cell, just before it, or just after it."""
    change = 50.0**2 / (2 * distance)
    run = Integration(build(ONE_SIGNAL, [[]], signals=cosine_table()), speed=50.0)
    run.ramp_speed(0.0, change)
    points, _, phases = run.sample([50.0 / change, 1.0])
    np.testing.assert_allclose(points[:, 0], math.cos(math.pi / 4), rtol=0, atol=2e-16)
    assert phases[1, 2] == 0.0


def test_turns_are_counted_for_an_hour():
    """The clock stores its rounding error: after 57 000 turns the phase is right to 1e-15 of the turned angle."""
    run = Integration(build(ONE_SIGNAL, [[]], signals=cosine_table()), speed=100.0)
    _, _, phases = run.sample([3600.0])
    assert phases[0, 0] * 2 * math.pi + phases[0, 1] == pytest.approx(3.6e5, rel=1e-15)
