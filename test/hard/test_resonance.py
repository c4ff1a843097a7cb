"""A drive at and near resonance, against the exact Fourier sum; no contact."""

import numpy as np
import pytest
from exact_motion import harmonics

import vibro_ros

PAPER = vibro_ros.load_scene("paper").with_parameters(
    {"effects.upper_contact": "none", "effects.inclined_mass": False, "mass.upper": 0.1})


def fourier_motion(times, motor_speed, frequency, radius=0.02, rod=0.06):
    """Position at `times` [s] of a mass that starts at rest on its slider at crank angle 0.

    Of u'' = Ω² (s - u), s = Σ s_n cos nωt: u = s(0) cos Ωt + Σ s_n Ω² (cos nωt - cos Ωt) / (Ω² - n²ω²), where the
    difference of cosines is a product of sines, so that sin(x)/x is left of the vanishing divisor.
    """
    coefficients = harmonics(radius, rod)
    order = np.arange(len(coefficients))[:, None] * motor_speed
    total, half = (order + frequency) * times / 2, (order - frequency) * times / 2
    beat = frequency**2 * times / (order + frequency) * np.sin(total) * np.sinc(half / np.pi)
    return coefficients.sum() * np.cos(frequency * times) + coefficients @ beat


@pytest.mark.parametrize("harmonic", [1, 2, 4])
@pytest.mark.parametrize("detuning", [0.0, *(sign * 10.0**-digits for digits in (12, 9, 6, 3) for sign in (1, -1))])
def test_near_resonance_nothing_divides_by_zero(detuning, harmonic):
    """A3, A4. √(k2/m2) = n ω (1 + detuning) over 64 turns, at the crank's own frequency and at two of the rod's."""
    frequency = 100.0 * harmonic * (1.0 + detuning)
    scene = PAPER.with_parameters({"upper.spring.stiffness": 0.1 * frequency**2})
    times = np.linspace(0.0, 4.0, 401)
    run = vibro_ros.simulate(scene, times=times)
    exact = fourier_motion(times, 100.0, np.sqrt(scene["upper.spring.stiffness"] / 0.1))
    largest = np.abs(exact).max()
    assert largest > (3.0 if harmonic == 1 and abs(detuning) < 1e-2 else 0.08)
    # phases up to 1600 are rounded to 2e-13, and so is the frequency's square root
    np.testing.assert_allclose(run.upper_position, exact, rtol=0, atol=1e-12 * largest)


def test_a_hundred_seconds_at_resonance_grow_to_a_hundred_metres():
    """A2. The crank has a rod of finite length, which adds its harmonics."""
    times = np.linspace(0.0, 100.0, 1001)
    run = vibro_ros.simulate(PAPER, times=times)
    exact = fourier_motion(times, 100.0, 100.0)
    assert np.abs(exact).max() > 90.0
    # phases up to 1e4 are rounded to 2e-12
    np.testing.assert_allclose(run.upper_position, exact, rtol=0, atol=1e-11 * np.abs(exact).max())


@pytest.mark.parametrize(("speed", "duration"), [(0.01, 100.0), (1.0, 20.0), (500.0, 2.0), (1e4, 0.2)])
def test_very_slow_and_very_fast_motors(speed, duration):
    """Up to the highest speed that may be allowed, 1e4 rad/s."""
    scene = PAPER.with_parameters({"motor.max_speed": 1e4, "motor.speed": speed})
    times = np.linspace(0.0, duration, 401)
    run = vibro_ros.simulate(scene, times=times)
    # phases up to 1e4 are rounded to 2e-12; amplitudes are 0.1 m
    np.testing.assert_allclose(run.upper_position, fourier_motion(times, speed, 100.0), rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.crank_angle, speed * times, rtol=1e-13, atol=0)  # 5000 segments


@pytest.mark.parametrize("mass", [1e-3, 1e-6, 1e-9])
def test_a_mass_that_nearly_vanishes_follows_its_slider(mass):
    """The motion is exact for each mass, and u - s vanishes with the mass, as s'' m / k."""
    times = np.linspace(0.0, 0.1, 101)
    run = vibro_ros.simulate(PAPER.with_parameters({"mass.upper": mass}), times=times)
    exact = fourier_motion(times, 100.0, np.sqrt(1e3 / mass))
    # the exact sum's terms, of 0.08 m, have phases of up to 1e5, rounded to 2e-16 of that
    phase = 0.1 * np.sqrt(1e3 / mass)
    np.testing.assert_allclose(run.upper_position, exact, rtol=0, atol=1e-14 + 0.08 * phase * 2.3e-16)
    stretch = run.upper_drive_force / 1e3
    assert np.abs(stretch).max() <= 0.02 * 1e4 * (1 + 1 / 3) * mass / 1e3 * 2.05  # s'' and as much of free vibration


def test_a_mass_without_spring_or_damper_stays_where_it_is():
    run = vibro_ros.simulate(PAPER.with_parameters({"upper.spring.stiffness": 0.0}), duration=10.0, rate=10.0)
    assert (run.upper_position == run.upper_position[0]).all() and not run.upper_velocity.any()
