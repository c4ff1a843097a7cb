"""Lanczos' economization: powers beyond a polynomial's length, replaced by what they come to on [-1, 1].

x^n is a sum of Chebyshev polynomials of degree n and less. If the polynomials that are too long are left out, the sum
is off by their factors, of which the largest is 2^(1 - n). So a series of LENGTH terms reaches rounding over about half
of its radius of convergence; without the economization, over a quarter.
"""

import math

import numpy as np


def _chebyshev_polynomials(length: int) -> list[list[int]]:
    """Coefficients of T_0, T_1, ..., each of them `length` long."""
    polynomials = [[1] + [0] * (length - 1), [0, 1] + [0] * (length - 2)]
    while len(polynomials) < length:
        last, before = polynomials[-1], polynomials[-2]
        polynomials.append([2 * a - b for a, b in zip([0, *last[:-1]], before, strict=True)])
    return polynomials


def economized_powers(length: int, count: int) -> np.ndarray:
    """Coefficients of what replaces x^length, x^(length + 1), ...; shape (count, length).

    In exact arithmetic but for the last rounding: 2^(n-1) x^n = sum over k of (k over n) T_(n - 2 k), where T_0 counts
    half.
    """
    chebyshev = _chebyshev_polynomials(length)
    rows = np.zeros((count, length))
    for row, n in zip(rows, range(length, length + count), strict=True):
        total = [0] * length
        for k in range(n // 2 + 1):
            degree = n - 2 * k
            if degree < length:
                weight = math.comb(n, k) * (2 if degree else 1)
                total = [a + weight * b for a, b in zip(total, chebyshev[degree], strict=True)]
        row[:] = [a / 2**n for a in total]
    return rows
