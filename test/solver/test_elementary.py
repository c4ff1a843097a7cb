"""Elementary functions, compared with mpmath's at 400 bits, and compiled kernels with plain Python."""

import math

import mpmath
import numpy as np
import pytest
from plain import plain

from vibro_ros.solver import elementary

RANDOM = np.random.default_rng(46)
TINY = 10.0 ** RANDOM.uniform(-300.0, 0.0, 1000)
SIGNED = np.concatenate([TINY, -TINY, RANDOM.uniform(-1.0, 1.0, 3000)])
QUARTERS = np.concatenate([np.arange(-200, 201), RANDOM.integers(-63_000, 63_000, 1000)]) * (0.5 * math.pi)
ANGLES = np.concatenate([SIGNED, QUARTERS, np.nextafter(QUARTERS, math.inf), RANDOM.uniform(-7.0, 7.0, 3000),
                         RANDOM.uniform(-1e5, 1e5, 3000)])
POWERS = np.concatenate([SIGNED, RANDOM.uniform(-45.0, 45.0, 3000), RANDOM.uniform(-745.0, 709.7, 3000)])
POSITIVE = np.concatenate([10.0 ** RANDOM.uniform(-323.0, 308.0, 2000), RANDOM.uniform(0.5, 2.0, 3000), 1.0 + TINY])
ABOVE_MINUS_1 = np.concatenate([SIGNED, RANDOM.uniform(-1.0, 3.0, 3000), 10.0 ** RANDOM.uniform(-300.0, 308.0, 1000)])

ARGUMENTS = {"sin": ANGLES, "cos": ANGLES, "exp": POWERS, "expm1": POWERS, "log": POSITIVE, "log1p": ABOVE_MINUS_1}


@pytest.mark.parametrize("name", ARGUMENTS)
def test_the_error_is_below_one_unit_in_the_last_place(name):
    function, exact = getattr(elementary, name), getattr(mpmath, name)
    with mpmath.workprec(400):
        for x in map(float, ARGUMENTS[name]):
            expected = exact(mpmath.mpf(x))
            assert abs(function(x) - expected) < math.ulp(float(expected)), x


@pytest.mark.parametrize("name", ARGUMENTS)
def test_kernels_have_the_bits_of_plain_python(name):
    function, kernel = getattr(plain(elementary), name), getattr(elementary, name)
    for x in (*map(float, ARGUMENTS[name]), 0.0, -0.0, math.inf, -math.inf, math.nan):
        np.testing.assert_array_equal(kernel(x), function(x), strict=True)


@pytest.mark.parametrize(("name", "argument", "value"), [
    ("sin", 0.0, 0.0), ("cos", 0.0, 1.0), ("exp", 0.0, 1.0), ("exp", 709.79, math.inf), ("exp", -745.14, 0.0),
    ("exp", -math.inf, 0.0), ("expm1", 0.0, 0.0), ("expm1", -math.inf, -1.0), ("expm1", 800.0, math.inf),
    ("log", 1.0, 0.0), ("log", 0.0, -math.inf), ("log", -1.0, math.nan), ("log", math.inf, math.inf),
    ("log1p", 0.0, 0.0), ("log1p", -1.0, -math.inf), ("log1p", -1.5, math.nan), ("log1p", math.inf, math.inf)])
def test_limits(name, argument, value):
    np.testing.assert_equal(getattr(elementary, name)(argument), value)


def test_exponential_of_the_largest_argument_is_finite():
    assert math.isfinite(elementary.exp(709.782712893384))
