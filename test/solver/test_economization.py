"""Economized powers, against numpy's Chebyshev series and functions whose series converge slowly."""

import numpy as np
import pytest
from numpy.polynomial import Chebyshev, Polynomial

from vibro_ros.solver.polynomial import economized_powers
from vibro_ros.solver.vector import LENGTH


def test_a_power_loses_its_highest_chebyshev_polynomials_and_nothing_else():
    """numpy's conversions round sums of coefficients up to 1e3: 1e-12."""
    for power, replaced in enumerate(economized_powers(LENGTH, 12), start=LENGTH):
        kept = Polynomial.basis(power).convert(kind=Chebyshev).coef[:LENGTH]
        expected = Chebyshev(kept).convert(kind=Polynomial).coef  # without trailing zeros
        np.testing.assert_allclose(replaced[:len(expected)], expected, rtol=0, atol=1e-12)
        assert not replaced[len(expected):].any()


@pytest.mark.parametrize("power", [LENGTH, LENGTH + 1, LENGTH + 7])
def test_a_power_is_off_by_the_factors_of_what_it_loses(power):
    """The largest: 2^(1-n) (k over n) for T_(n - 2k) with n - 2k >= LENGTH; all of them are 1 at x = 1."""
    x = np.linspace(-1.0, 1.0, 2001)
    off = np.polynomial.polynomial.polyval(x, economized_powers(LENGTH, power + 1 - LENGTH)[-1]) - x**power
    lost = Polynomial.basis(power).convert(kind=Chebyshev).coef[LENGTH:]
    assert abs(off).max() == pytest.approx(abs(lost).sum(), rel=1e-6)


def test_a_series_reaches_rounding_where_its_first_terms_do_not():
    """(1 - 0.45 x)^(-1/2): the first terms alone are off by 0.45^LENGTH, and more."""
    terms = 4 * LENGTH
    ratio = 0.45
    series = np.cumprod(np.concatenate([[1.0], [(n - 0.5) / n * ratio for n in range(1, terms)]]))
    x = np.linspace(-1.0, 1.0, 501)
    exact = (1.0 - ratio * x) ** -0.5
    cut = np.polynomial.polynomial.polyval(x, series[:LENGTH])
    economized = series[:LENGTH] + series[LENGTH:] @ economized_powers(LENGTH, terms - LENGTH)
    assert abs(cut - exact).max() > 1e-10
    np.testing.assert_allclose(np.polynomial.polynomial.polyval(x, economized), exact, rtol=1e-15)
