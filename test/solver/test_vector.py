"""Vectors of kernels that run as plain Python, against numpy; test_core.py compares the compiled ones with these."""

import numpy as np
import pytest

from vibro_ros.solver.vector import (
    LENGTH,
    first_index,
    indices_above,
    last,
    lowered,
    magnitudes,
    powers,
    raised,
    store,
    total,
    vector,
    with_first,
)

RANDOM = np.random.default_rng(29)
P, Q = RANDOM.normal(size=(2, LENGTH))


def stored(function, *arguments):
    """Return the value that a kernel stores as its first argument."""
    target = np.full(LENGTH, np.nan)
    function(target, *arguments)
    return target


def test_arrays_may_begin_anywhere():
    for first in range(9):
        room = np.zeros(LENGTH + 9)
        store(room[first:first + LENGTH], vector(P))
        np.testing.assert_array_equal(room, [*np.zeros(first), *P, *np.zeros(9 - first)])


def test_arithmetic():
    """Element by element, and with one number: rounded as by numpy."""
    np.testing.assert_array_equal(stored(lambda target, p, q: store(target, vector(p) + vector(q)), P, Q), P + Q)
    np.testing.assert_array_equal(stored(lambda target, p, q: store(target, vector(p) - vector(q)), P, Q), P - Q)
    np.testing.assert_array_equal(stored(lambda target, p, q: store(target, vector(p) * vector(q)), P, Q), P * Q)
    np.testing.assert_array_equal(stored(lambda target, p: store(target, 0.3 * vector(p)), P), 0.3 * P)
    np.testing.assert_array_equal(stored(lambda target, p: store(target, magnitudes(vector(p))), P), abs(P))


def test_places():
    assert last(vector(P)) == P[-1]
    np.testing.assert_array_equal(stored(lambda target, p: store(target, raised(vector(p))), P), [0.0, *P[:-1]])
    np.testing.assert_array_equal(stored(lambda target, p: store(target, lowered(vector(p))), P), [*P[1:], 0.0])
    np.testing.assert_array_equal(stored(lambda target, p: store(target, with_first(vector(p), 7.0)), P), [7.0, *P[1:]])


def test_places_by_size():
    """Compared with numpy's comparison; NaN is not above any number."""
    for p in (P, np.where(np.arange(LENGTH) == 3, np.nan, Q), np.zeros(LENGTH)):
        for limit in (-0.3, 0.0, 5.0):
            bits = indices_above(p, limit)
            assert [bits >> n & 1 for n in range(64)] == [*(p > limit), *[False] * (64 - LENGTH)]
            assert first_index(bits) == next(iter(np.flatnonzero(p > limit)), 64)


def test_total():
    """Exact for numbers whose sums are exact, and to rounding for others."""
    assert total(np.arange(LENGTH) * 0.5) == LENGTH * (LENGTH - 1) / 4
    assert total(P) == pytest.approx(P.sum(), abs=1e-15 * abs(P).sum())


@pytest.mark.parametrize("x", [0.0, 1.0, -1.0, 0.5, -0.3, 1.7])
def test_powers(x):
    found = stored(lambda target, x: store(target, powers(x)), x)
    np.testing.assert_allclose(found, x ** np.arange(LENGTH), rtol=2e-15)
    np.testing.assert_array_equal(found[:3], [1.0, x, x * x])

