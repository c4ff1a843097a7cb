"""Exact motions of one driven mass, by means that share nothing with vibro_ros: Fourier and Duhamel.

All lengths in m, times in s. `rod` and `radius` are the crank's, `angle` the guide's.
"""

import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def slider(angle, radius, rod):
    """Slider position; `angle` is the crank angle seen from the guide [rad]."""
    return radius * np.cos(angle) + np.sqrt(rod**2 - (radius * np.sin(angle)) ** 2)


def duhamel(times, motor_speed, frequency, position, radius, rod, angle=0.0):
    """Position of an undamped mass that starts at rest at `position`, shape of `times`.

    Duhamel's integral u = u0 cos Ωt + Ω ∫ s(τ) sin Ω(t-τ) dτ by Gauss's rule on pieces of at most an
    eighth turn that also end at the kinks of s (radius = rod); good to rounding, resonance or not.
    """
    return np.array([_duhamel_once(t, motor_speed, frequency, position, radius, rod, angle) for t in times])


def _duhamel_once(time, motor_speed, frequency, position, radius, rod, angle):
    first = np.pi / 4 * np.ceil((0.0 - angle) / (np.pi / 4))  # multiples of π/4 include the kinks at π/2 + nπ
    cuts = (np.arange(first, motor_speed * time - angle, np.pi / 4) + angle) / motor_speed
    edges = np.concatenate(([0.0], cuts[(cuts > 0.0) & (cuts < time)], [time]))
    middle, half = (edges[1:] + edges[:-1]) / 2, (edges[1:] - edges[:-1]) / 2
    tau = middle[:, None] + half[:, None] * NODES
    integrand = slider(motor_speed * tau - angle, radius, rod) * np.sin(frequency * (time - tau))
    return position * np.cos(frequency * time) + frequency * np.sum(half[:, None] * WEIGHTS * integrand)


def harmonics(radius, rod, count=128):
    """Fourier coefficients s_n, n = 0..count/2, of s(θ) = Re Σ s_n exp(inθ); exact to rounding for radius < rod."""
    theta = 2 * np.pi * np.arange(count) / count
    coefficients = np.fft.rfft(slider(theta, radius, rod)) / count
    coefficients[1:] *= 2
    return coefficients.real


class SteadyMotion:
    """Steady motion of a damped, driven mass without contact: u = Re Σ u_n exp(inωt)."""

    def __init__(self, motor_speed, mass, stiffness, damping, radius, rod):
        coefficients = harmonics(radius, rod)
        self.rates = 1j * motor_speed * np.arange(len(coefficients))
        drive = stiffness + self.rates * damping
        self.amplitudes = coefficients * drive / (drive + self.rates**2 * mass)

    def derivative(self, times, order=0):
        """The motion's derivative of the given order at `times`."""
        return np.sum(self.amplitudes * self.rates**order * np.exp(np.multiply.outer(times, self.rates)), axis=-1).real

    def highest(self, period):
        """Instant and value of the greatest position in a period."""
        times = np.linspace(0.0, period, 400)
        instant = times[np.argmax(self.derivative(times))]
        for _ in range(6):
            instant -= self.derivative(instant, 1) / self.derivative(instant, 2)
        return instant, self.derivative(instant)
