"""The flow of one mode, against closed forms evaluated in 40 digits."""

import math

import mpmath
import numpy as np
import pytest
from small_system import Integration, build, cosine_table

from vibro_ros.solver.channels import Channels
from vibro_ros.solver.equations import RATE_LIMIT, longest_segments

DRIVEN_OSCILLATOR = Channels(1, 1, 1, 0)


def oscillator(stiffness, damping, drive):
    """q'' = -stiffness q - damping q' + drive cos(phase)."""
    row = np.zeros(DRIVEN_OSCILLATOR.count)
    row[DRIVEN_OSCILLATOR.position(0)], row[DRIVEN_OSCILLATOR.velocity(0)] = -stiffness, -damping
    row[DRIVEN_OSCILLATOR.signal(0)] = drive
    return build(DRIVEN_OSCILLATOR, [[row]], signals=cosine_table())


def exact(stiffness, damping, drive, speed, position, velocity, times):
    """Position from a complex particular and two complex homogeneous solutions, in 60 digits. Double roots and
    resonance are avoided by a shift of 1e-20, whose effect is far below a double's rounding.
    """
    with mpmath.workdps(60):
        hair = mpmath.mpf(10) ** -20
        k, c, w = mpmath.mpf(stiffness) * (1 + hair) + hair, mpmath.mpf(damping), mpmath.mpf(speed)
        root = mpmath.sqrt(c * c / 4 - k)
        first, second = -c / 2 + root, -c / 2 - root
        forced = mpmath.mpf(drive) / (k - w * w + 1j * w * c)
        u, v = mpmath.mpf(position) - forced.real, mpmath.mpf(velocity) - (1j * w * forced).real
        a = (v - second * u) / (first - second)
        b = u - a
        return np.array([float(mpmath.re(a * mpmath.exp(first * t) + b * mpmath.exp(second * t)
                                         + mpmath.re(forced * mpmath.exp(1j * w * t))))
                         for t in map(mpmath.mpf, map(float, times))])


@pytest.mark.parametrize("detuning", [0.0, 1e-15, 1e-12, 1e-8, 1e-4, -1e-8, 0.3])
@pytest.mark.parametrize("damping", [0.0, 1e-6, 3.0])
def test_at_and_near_resonance(detuning, damping):
    """Over 60 turns the undamped motion grows to 190 amplitudes of the drive; the error is 1e-13 of that."""
    times = np.linspace(0, 3.8, 80)
    speed = 100.0 * (1 + detuning)
    points, _, _ = Integration(oscillator(1e4, damping, 1e4), [0.3], [-4.0], speed=speed).sample(times)
    expected = exact(1e4, damping, 1e4, speed, 0.3, -4.0, times)
    np.testing.assert_allclose(points[:, 0], expected, rtol=0, atol=2e-13 * abs(expected).max())


@pytest.mark.parametrize("stiffness", [0.0, 1.0, 1e4, 1e8, 1e11])
@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.999999, 1.0, 1.000001, 30.0])
def test_slow_and_stiff_damped_and_overdamped(stiffness, ratio):
    """`ratio` is the damping over the critical damping; the run lasts 20 time constants of the mode, under the same
    drive.
    """
    rate = max(math.sqrt(stiffness), 1.0)
    times = np.linspace(0, 20.0 / rate, 50)
    system = oscillator(stiffness, 2 * ratio * math.sqrt(stiffness), rate**2)
    points, _, _ = Integration(system, [0.2], [0.7 * rate], speed=100.0).sample(times)
    expected = exact(stiffness, 2 * ratio * math.sqrt(stiffness), rate**2, 100.0, 0.2, 0.7 * rate, times)
    np.testing.assert_allclose(points[:, 0], expected, rtol=0, atol=1e-13 * abs(expected).max())


def test_velocity_and_acceleration_are_the_derivatives():
    """Channels q' and q'' against the equation and against central differences in time."""
    channels, system = DRIVEN_OSCILLATOR, oscillator(1e4, 5.0, 1e4)
    middle = np.linspace(0.01, 0.2, 20)
    points, _, _ = Integration(system, [0.2], [0.7], speed=70.0).sample(
        np.sort(np.concatenate([middle - 1e-6, middle, middle + 1e-6])))
    points_before, now, after = points[0::3], points[1::3], points[2::3]
    np.testing.assert_allclose(now[:, 1], (after[:, 0] - points_before[:, 0]) / 2e-6, rtol=0, atol=1e-6)
    acceleration = -1e4 * now[:, 0] - 5.0 * now[:, 1] + 1e4 * now[:, channels.signal(0)]
    np.testing.assert_allclose(now[:, channels.acceleration(0)], acceleration, rtol=0, atol=1e-10)


def test_a_ramp_as_forcing():
    """q'' = k (r - q) with r = v t: q = v t - v sin(Ω t)/Ω, in quick and in slow coordinates."""
    channels = Channels(1, 1, 0, 1)
    for rate in (0.1, 100.0, 1e4):
        row = np.zeros(channels.count)
        row[channels.position(0)], row[channels.ramp(0)] = -rate**2, rate**2
        run = Integration(build(channels, [[row]]), [0.0], [0.0], ramps=[0.0])
        run.move_ramp(0, 1.0, 0.005)
        times = np.linspace(0, 3.0, 40)
        points, _, _ = run.sample(times)
        expected = 0.005 * (times - np.sin(rate * times) / rate)
        np.testing.assert_allclose(points[:, 0], expected, rtol=0, atol=1e-14)


def test_a_driven_coordinate_integrates_the_others():
    """x'' = q'' / 2 + g: x - q/2 falls freely."""
    channels = Channels(2, 1, 0, 0)
    dynamic, driven = np.zeros((2, channels.count))
    dynamic[channels.position(0)] = -1e4
    driven[channels.acceleration(0)], driven[channels.one] = 0.5, -9.81
    run = Integration(build(channels, [[dynamic, driven]]), [0.03, 1.0], [2.0, -0.4])
    times = np.linspace(0, 2.0, 50)
    points, _, _ = run.sample(times)
    swing = 0.03 * np.cos(100 * times) + 0.02 * np.sin(100 * times)
    np.testing.assert_allclose(points[:, 0], swing, rtol=0, atol=1e-14)
    free = (1.0 - 0.015) + (-0.4 - 1.0) * times - 9.81 * times**2 / 2
    np.testing.assert_allclose(points[:, 1] - points[:, 0] / 2, free, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(points[:, 3] - points[:, 2] / 2, -1.4 - 9.81 * times, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("stiffness", [5e3, 9e3, 1e4, 1.1e4, 2e4])
def test_energy_of_a_free_oscillator_over_a_million_radians(stiffness):
    """The series is cut off below rounding: each of 3e5 equal segments changes the energy by at most five roundings."""
    run = Integration(oscillator(stiffness, 0.0, 0.0), [1.0], [0.0])
    points, _, _ = run.sample([1e4])
    assert run.status == 0
    energy = points[0, 0] ** 2 + points[0, 1] ** 2 / stiffness
    assert energy == pytest.approx(1.0, abs=5 * 2.2e-16 * run.segments)


def test_longest_segments():
    """2 RATE_LIMIT over the fastest eigenvalue: for a spring, an overdamped one, and no rate at all."""
    channels = Channels(1, 1, 0, 0)
    rows = np.zeros((4, 1, channels.count))
    rows[0, 0, 0] = -1e4
    rows[1, 0, :2] = -1e4, -1e4
    rows[2, 0, 1] = -50.0
    slow = 5e3 + math.sqrt(25e6 - 1e4)
    expected = [RATE_LIMIT / 50, 2 * RATE_LIMIT / slow, RATE_LIMIT / 25, math.inf]
    np.testing.assert_allclose(longest_segments(rows, channels), expected)
