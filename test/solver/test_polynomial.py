"""Polynomials of fixed length, compared with exact rational arithmetic and numpy."""

from fractions import Fraction

import numpy as np
import pytest
from numpy.polynomial import Chebyshev, Polynomial

from vibro_ros.solver import polynomial
from vibro_ros.solver.polynomial import economized_powers
from vibro_ros.solver.vector import LENGTH

poly = polynomial

RANDOM = np.random.default_rng(23)
DECAYING = RANDOM.normal(size=(20, LENGTH)) * 0.3 ** np.arange(LENGTH)


def exact(coefficients, x):
    total = Fraction(0)
    for coefficient in reversed(coefficients):
        total = total * x + Fraction(float(coefficient))
    return total


@pytest.mark.parametrize("x", [0.0, 0.25, 0.7, 1.0])
def test_value_and_derivatives(x):
    """To a few roundings of the sum of the terms."""
    for p in DECAYING:
        derivatives = [exact(p, Fraction(x))]
        coefficients = [Fraction(float(c)) for c in p]
        for _ in range(2):
            coefficients = [n * c for n, c in enumerate(coefficients)][1:]
            derivatives.append(sum(c * Fraction(x) ** n for n, c in enumerate(coefficients)))
        values = poly.value_and_derivatives(p, x)
        np.testing.assert_allclose(values, [float(d) for d in derivatives], rtol=0, atol=1e-14)
        assert poly.value(p, x) == pytest.approx(float(derivatives[0]), abs=1e-15)


@pytest.mark.parametrize("x", [0.0, 0.2, 0.9])
def test_recentre(x):
    expected = np.array([Polynomial(p)(Polynomial([x, 1.0])).coef for p in DECAYING])
    targets = np.empty_like(DECAYING)
    poly.recentre(DECAYING, x, LENGTH, targets)
    np.testing.assert_allclose(targets, expected, rtol=0, atol=1e-14)
    poly.recentre(DECAYING, x, 5, targets)
    np.testing.assert_allclose(targets[:, :5], expected[:, :5], rtol=0, atol=1e-14)
    assert not targets[:, 5:].any()


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.3), (0.02, 0.0, -0.02), (0.03, 0.01, -0.03, -0.01),
                                   (0.0, 0.0, -0.3, 0.1, -0.03)])
def test_displace(shift):
    """p(x + shift(x)) to rounding, because powers beyond the length are economized instead of cut off. Series over a
    part of a cell shrink by 0.225 (`system.STRIDE`) from term to term, and so does the shift.
    """
    target, room, series = np.empty(LENGTH), np.empty(2 * LENGTH), np.zeros(LENGTH)
    series[:len(shift)] = shift
    places = np.linspace(-1.0, 1.0, 101)
    for p in DECAYING * 0.55 ** np.arange(LENGTH):
        poly.displace(p, series, len(shift), LENGTH - 1, room, target)
        expected = Polynomial(p)(places + Polynomial(shift)(places))
        np.testing.assert_allclose(Polynomial(target)(places), expected, rtol=0, atol=2e-15)


@pytest.mark.parametrize("x", [-1.0, 0.3])
def test_integrate_through(x):
    """The exact integral, with the value `wanted` at x, apart from the highest Chebyshev polynomial of the term beyond
    the length.
    """
    target = np.empty(LENGTH)
    places = np.linspace(-1.0, 1.0, 101)
    for p in (*DECAYING, np.ones(LENGTH)):
        poly.integrate_through(p, 0.02, x, 0.7, target)
        left_out = 0.02 * abs(p[-1]) / LENGTH * 2.0 ** (1 - LENGTH)
        assert poly.value(target, x) == pytest.approx(0.7, abs=3e-16 + left_out)  # its own rounding, twice
        exact = Polynomial(p).integ(lbnd=x) * 0.02 + 0.7
        assert abs(Polynomial(target)(places) - exact(places)).max() <= 5e-16 + 2.0 * left_out


def test_a_power_loses_its_highest_chebyshev_polynomials_and_nothing_else():
    """numpy's conversions round sums of coefficients up to 1e3: 1e-12."""
    for power, replaced in enumerate(economized_powers(LENGTH, 12), start=LENGTH):
        low = Polynomial.basis(power).convert(kind=Chebyshev).coef[:LENGTH]
        expected = Chebyshev(low).convert(kind=Polynomial).coef  # without trailing zeros
        np.testing.assert_allclose(replaced[:len(expected)], expected, rtol=0, atol=1e-12)
        assert not replaced[len(expected):].any()


def test_a_series_reaches_rounding_where_its_first_terms_do_not():
    """(1 - 0.45 x)^(-1/2): the first terms alone have an error of more than 0.45^LENGTH."""
    terms = 4 * LENGTH
    ratio = 0.45
    series = np.cumprod(np.concatenate([[1.0], [(n - 0.5) / n * ratio for n in range(1, terms)]]))
    x = np.linspace(-1.0, 1.0, 501)
    exact = (1.0 - ratio * x) ** -0.5
    cut = np.polynomial.polynomial.polyval(x, series[:LENGTH])
    economized = series[:LENGTH] + series[LENGTH:] @ economized_powers(LENGTH, terms - LENGTH)
    assert abs(cut - exact).max() > 1e-10
    np.testing.assert_allclose(np.polynomial.polynomial.polyval(x, economized), exact, rtol=1e-15)
