"""The first root of a guard, compared with the eigenvalues of companion matrices and with exact rational arithmetic."""

import math
from fractions import Fraction
from math import comb

import numpy as np
import pytest

from vibro_ros.solver import guards
from vibro_ros.solver.guards import NO_ROOT
from vibro_ros.solver.vector import LENGTH

first_root, maximum = guards.first_root, guards.maximum

ROUNDING = 4e-15  # of an instant in [0, 1] where the guard's slope is of its coefficients' order


def padded(coefficients):
    polynomial = np.zeros(LENGTH)
    polynomial[:len(coefficients)] = coefficients
    return polynomial


def search(coefficients, start=0.0, noise=0.0, limit=1.0):
    return first_root(padded(coefficients), start, limit, noise, np.empty((2, LENGTH)))


def exact_value(coefficients, x):
    total = Fraction(0)
    for coefficient in reversed(coefficients):
        total = total * Fraction(float(x)) + Fraction(float(coefficient))
    return total


def real_roots(coefficients, start=0.0):
    """Real roots in (start, 1), ascending, by numpy's companion matrix."""
    roots = np.roots(np.asarray(coefficients)[::-1])
    return np.sort(roots.real[(abs(roots.imag) < 1e-9) & (roots.real > start) & (roots.real < 1.0)])


def first_crossing(coefficients, start=0.0):
    """Return the first root after which the polynomial is negative, with exact signs; NO_ROOT if there is none."""
    if exact_value(coefficients, start) < 0:
        return start
    edges = [*real_roots(coefficients, start), 1.0]
    for root, following in zip(edges, edges[1:], strict=False):
        if exact_value(coefficients, (root + following) / 2) < 0:
            return root
    return NO_ROOT


def product(*factors):
    result = np.ones(1)
    for factor in factors:
        result = np.convolve(result, factor)
    return result


def power(root, order):
    """Coefficients of (x - root)^order."""
    return np.array([comb(order, n) * (-root) ** (order - n) for n in range(order + 1)])


def motion(random):
    """Return the series of a random oscillation about a random position over two radians, a typical guard."""
    order = np.arange(LENGTH)
    factorial = np.cumprod(np.maximum(order, 1.0))
    phase, rate = random.uniform(0, 2 * np.pi), random.uniform(0.01, 2.0)
    series = np.cos(phase + order * np.pi / 2) * rate**order / factorial
    series[:3] += random.uniform(-1, 1, 3)
    return series


@pytest.mark.parametrize("kind", ["oscillation", "decaying", "any"])
def test_random_polynomials(kind):
    """For 1000 guards each, the first crossing agrees to 1e-9 with the companion matrix, which is less exact."""
    random = np.random.default_rng(["oscillation", "decaying", "any"].index(kind))
    crossings = 0
    for number in range(1000):
        polynomial = motion(random) if kind == "oscillation" else random.normal(size=LENGTH)
        if kind == "decaying":
            polynomial *= random.uniform(0.1, 1.0) ** np.arange(LENGTH)
        start = random.choice([0.0, random.uniform(0, 0.5)])
        if random.random() < 0.9:
            polynomial *= np.sign(np.polynomial.polynomial.polyval(start, polynomial))
        expected = first_crossing(polynomial, start)
        root = search(polynomial, start, 1e-15 * abs(polynomial).sum())
        assert root == pytest.approx(expected, abs=1e-9), number
        crossings += start < root < NO_ROOT
    assert crossings > 150


@pytest.mark.parametrize("lift", [1e-13, -1e-13, 1e-10, -1e-10])
def test_a_graze_is_told_from_a_hit(lift):
    """(x - r)² + lift has no root for lift > 0, and its first root at r - sqrt(-lift) for lift < 0."""
    random = np.random.default_rng(7)
    for _ in range(300):
        place = random.uniform(0.05, 0.95)
        polynomial = product(power(place, 2), [1.0, random.uniform(-0.5, 0.5)])
        polynomial[0] += lift
        root = search(polynomial, 0.0, 2e-15)
        if lift > 0:
            assert root == NO_ROOT
        else:
            depth = -lift / (1.0 + polynomial[3] * place)
            assert root == pytest.approx(place - np.sqrt(depth), abs=2e-15 / np.sqrt(depth) + 3 * depth)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("start", [0.0, 0.3, 0.71])
def test_a_root_at_the_start_does_not_hide_the_next_one(order, start):
    """(x - a)^n (r - x) turns negative at r; with the other sign it is negative from a on."""
    for behind in (0.04, 0.1, 0.25):
        polynomial = product(power(start, order), [start + behind, -1.0])
        noise = 1e-15
        assert search(polynomial, start, noise) == pytest.approx(start + behind, abs=1e-10)
        assert search(-polynomial, start, noise) == start


@pytest.mark.parametrize("distance", [1e-2, 1e-4, 1e-6])
def test_two_crossings_close_together(distance):
    """The first of the two is found whatever their distance, to the guard's rounding error over its slope."""
    random = np.random.default_rng(11)
    for _ in range(300):
        root = random.uniform(0.01, 0.98)
        polynomial = product([-root, 1.0], [-root - distance, 1.0], [1.0, random.uniform(-0.9, 2.0), 0.3])
        assert search(polynomial, 0.0, 1e-16) == pytest.approx(root, abs=ROUNDING / distance)


def test_what_is_all_noise_has_no_root():
    random = np.random.default_rng(13)
    for _ in range(200):
        assert search(random.normal(size=LENGTH) * 1e-15, random.uniform(0, 0.2), 1e-12) == NO_ROOT
    assert search(np.zeros(LENGTH)) == NO_ROOT


@pytest.mark.parametrize("height", [1e-9, 1e-13, 1e-14, 1e-15, 1e-17])
def test_a_guard_that_rises_from_almost_zero(height):
    """ε + x - 1.25 x² falls through zero at 0.8 + ε to first order; a step with cancellation once went beyond it."""
    assert search([height, 1.0, -1.25]) == pytest.approx(0.8 + height, abs=ROUNDING)


@pytest.mark.parametrize("order", [3, 4, 5, 6, 8])
@pytest.mark.parametrize("height", [1e-9, 1e-12, 1e-15])
def test_a_flat_guard(order, height):
    """ε - x^n: all derivatives but the n-th are small up to the root, as in a motion that starts from rest."""
    assert search([height] + [0.0] * (order - 1) + [-1.0]) == pytest.approx(height ** (1 / order), rel=1e-10)


def test_the_start_when_the_guard_is_negative_there():
    assert search([-1e-3, 1.0]) == 0.0
    assert search([1.0, -2.0], 0.75) == 0.75


def test_the_search_ends_at_its_limit():
    """A root after the limit is not found; a root before the limit is the same as without a limit."""
    cubic = product([-0.4, 1.0], [-0.4, 1.0], [0.7, -1.0])
    assert search(cubic) == pytest.approx(0.7, abs=ROUNDING)
    for limit in (0.1, 0.4, 0.6999):
        assert search(cubic, limit=limit) == NO_ROOT
    assert search(cubic, limit=0.7001) == pytest.approx(0.7, abs=ROUNDING)


def test_a_root_at_the_very_end():
    """A root at exactly 1 belongs to the next segment, which starts there."""
    assert search([1.0 - 1e-12, -1.0]) == pytest.approx(1.0 - 1e-12, abs=ROUNDING)
    assert search([1.0 + 1e-12, -1.0]) == NO_ROOT


def test_maximum():
    """Compared with the values at the ends and at all roots of the derivative."""
    random = np.random.default_rng(17)
    work = np.empty((3, LENGTH))
    for _ in range(500):
        polynomial = motion(random) if random.random() < 0.7 else random.normal(size=LENGTH)
        start, end = np.sort(random.uniform(0, 1, 2))
        slope = np.arange(1, LENGTH) * polynomial[1:]
        turns = [x for x in real_roots(slope) if start < x < end]
        expected = max(np.polynomial.polynomial.polyval([start, end, *turns], polynomial))
        rounding = 1e-13 * abs(polynomial).sum()
        assert maximum(polynomial, start, end, -math.inf, work) == pytest.approx(expected, abs=rounding)
        assert maximum(polynomial, start, end, expected + 2.0 * rounding, work) == expected + 2.0 * rounding


@pytest.mark.parametrize("magnitude", [1e-90, 1e-150, 1e-164, 1e-300, 1e-320])
def test_a_motion_that_has_died_away(magnitude):
    """The squares of the coefficients are below the smallest number: the searches end, and tiny values count as zero.
    """
    random = np.random.default_rng(19)
    for _ in range(50):
        polynomial = motion(random) * magnitude
        root = search(polynomial)
        expected = search(polynomial / magnitude) if magnitude > 1e-100 else NO_ROOT
        assert root == pytest.approx(expected, abs=1e-12)
        highest = maximum(polynomial, 0.0, 1.0, -math.inf, np.empty((3, LENGTH)))
        assert max(polynomial[0], polynomial.sum()) - magnitude * 1e-12 <= highest <= 10 * magnitude


@pytest.mark.parametrize("coefficients", [[1e-30, 0.0, -1e-300], [1e-30, 1e-200, -1e-300], [1e-30, -1e-200, -1e-300]])
def test_terms_whose_products_vanish(coefficients):
    assert search(coefficients) == NO_ROOT
