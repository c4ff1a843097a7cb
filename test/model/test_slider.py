"""The sliders and their tables of series, against mpmath."""

import math

import mpmath
import numpy as np
import pytest

from vibro_ros.model.slider import Slider, signal_table

TURN = 2 * math.pi
SHORTER = [1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15]  # (L - l) / L


def exact_position(slider, theta):
    with mpmath.workdps(60):
        psi = mpmath.mpf(theta) - mpmath.mpf(slider.angle)
        radius, rod = mpmath.mpf(slider.radius), mpmath.mpf(slider.rod)
        return radius * mpmath.cos(psi) + mpmath.sqrt(rod**2 - (radius * mpmath.sin(psi)) ** 2)


def tabulated(slider, theta):
    """Values of the table's series at the angles `theta`, in [0, 2π)."""
    table = signal_table((slider,))
    cell = np.searchsorted(table.start, theta, side="right") - 1
    local = 2 * (theta - table.start[cell]) / np.diff(table.start)[cell] - 1
    return np.array([np.polynomial.polynomial.polyval(x, series)
                     for x, series in zip(local, table.series[cell, 0], strict=True)])


@pytest.mark.parametrize("slider", [
    *(Slider(0.06 * (1 - part), 0.06, 0.7) for part in SHORTER), Slider(0.06, 0.06, 0.7), Slider(0.02, 0.06, 0.0),
    Slider(0.02, 0.06, math.pi), Slider(1e-6, 0.06, 0.3), Slider(math.nextafter(0.06, 0.0), 0.06, 0.7)])
def test_position_and_series(slider):
    """A36. Everywhere in the turn, also near the kink, to 2 roundings, 1e-16 m. Near a kink a rounding of the angle
    itself moves the slider by up to 2 l times 4e-16.
    """
    random = np.random.default_rng(3)
    kinks = np.mod(slider.angle + np.array([0.5, 1.5]) * math.pi, TURN)
    near = (kinks[:, None] + np.outer([1, 1], [*10.0 ** -np.arange(2, 15), *-(10.0 ** -np.arange(2, 15))])).ravel()
    theta = np.concatenate([random.uniform(0, TURN, 300), np.mod(near, TURN)])
    expected = np.array([float(exact_position(slider, angle)) for angle in theta])
    np.testing.assert_allclose(slider.position(theta), expected, rtol=0, atol=1.2e-16)
    np.testing.assert_allclose(tabulated(slider, theta), expected, rtol=0, atol=1.2e-16)


@pytest.mark.parametrize("part", [0.5, *SHORTER[:3]])
def test_slope(part):
    """Against mpmath's differences in 60 digits, to a rounding of a length."""
    slider = Slider(0.06 * (1 - part), 0.06, 0.7)
    theta = np.linspace(0, TURN, 50)
    with mpmath.workdps(60):
        step = mpmath.mpf(10) ** -25
        expected = [float((exact_position(slider, mpmath.mpf(angle) + step)
                           - exact_position(slider, mpmath.mpf(angle) - step)) / (2 * step)) for angle in theta]
    np.testing.assert_allclose(slider.slope(theta), expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi / 2])
def test_crank_as_long_as_the_rod(angle):
    """s = l cos ψ + l |cos ψ|: slope -2 l sin ψ in front, 0 behind; it jumps at ψ = π/2 and 3π/2, by 2 l."""
    slider = Slider(0.06, 0.06, angle)
    psi = np.array([-1.2, 0.3, 1.5, 1.7, 3.0, 4.6])
    np.testing.assert_allclose(slider.slope(psi + angle), np.where(np.cos(psi) > 0, -0.12 * np.sin(psi), 0), atol=1e-15)
    assert len(slider.kinks) == 2
    for kink in slider.kinks:
        assert abs(math.cos(kink - angle)) < 1e-15
        jump = slider.slope(kink + 1e-9) - slider.slope(kink - 1e-9)
        assert abs(jump) == pytest.approx(0.12, rel=1e-6)
    starts = signal_table((slider,)).start
    assert all(kink == 0.0 or kink in starts for kink in slider.kinks)


@pytest.mark.parametrize("part", SHORTER)
def test_cells_shrink_towards_the_singularity_and_stay_few(part):
    """Their number grows like the logarithm of the distance, and they cover the turn."""
    start = signal_table(tuple(Slider(0.06 * (1 - part), 0.06, angle) for angle in (0.0, 0.87))).start
    assert start[0] == 0.0 and start[-1] == TURN
    assert np.all(np.diff(start) > 0)
    assert len(start) < 60 + 25 * math.log(1 / part)
