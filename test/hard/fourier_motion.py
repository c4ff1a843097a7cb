"""Exact motion of one undamped, driven mass as a Fourier sum that stays exact through every resonance."""

import numpy as np
from exact_motion import harmonics


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
