"""Polynomials of fixed length on the interval from -1 to 1: the dense output of every segment.

A polynomial is an array of `LENGTH` coefficients, constant term first, in the segment's own
time x = 2 (t - start) / duration - 1. About its middle a series reaches twice as far as from an end.

Loops over all coefficients run to `len(p)`, not to `LENGTH`: a loop of known length would be unrolled, and the
compiler does not turn that into vector instructions.
"""

import math

import numpy as np

from vibro_ros.solver.compilation import kernel, sum_kernel
from vibro_ros.solver.economization import economized_powers

#: Coefficients of a polynomial. The flow's series is cut where 1.7^n / n! and 0.22^n (`system.STRIDE`) reach rounding.
LENGTH = 24
#: Entry n is 1 / n, for n from 1 to LENGTH.
INVERSE = np.array([0.0] + [1.0 / n for n in range(1, LENGTH + 1)])

_ORDER = np.arange(LENGTH, dtype=float)
_BEYOND = economized_powers(LENGTH, 1)[0]
# Entry [n, k] is k over n.
_BINOMIAL = np.array([[float(math.comb(k, n)) for k in range(LENGTH)] for n in range(LENGTH)])


@kernel
def value(p, x):
    """p(x)."""
    result = p[LENGTH - 1]
    for n in range(LENGTH - 2, -1, -1):
        result = result * x + p[n]
    return result


@kernel
def fill_powers(x, powers):
    """powers[n] = x^n, for `product`."""
    square = x * x
    powers[0], powers[1], powers[2], powers[3] = 1.0, x, square, square * x
    fourth = square * square
    for n in range(4, LENGTH):
        powers[n] = powers[n - 4] * fourth


@sum_kernel
def product(p, q):
    """Sum of p[n] q[n]: the value of p where `fill_powers` filled q, to rounding of its largest term."""
    total = 0.0
    for n in range(len(p)):
        total += p[n] * q[n]
    return total


@kernel
def value_and_derivatives(p, pairs, x):
    """p(x), p'(x) and p''(x), of the first 2 `pairs` coefficients.

    As p(x) = E(x²) + x O(x²): of two series of half the length, the processor computes one beside the other.
    """
    y = x * x
    even, odd = 0.0, 0.0
    even_d, odd_d = 0.0, 0.0
    half_even_dd, half_odd_dd = 0.0, 0.0
    for n in range(pairs - 1, -1, -1):
        half_even_dd = half_even_dd * y + even_d
        half_odd_dd = half_odd_dd * y + odd_d
        even_d = even_d * y + even
        odd_d = odd_d * y + odd
        even = even * y + p[2 * n]
        odd = odd * y + p[2 * n + 1]
    second = 2.0 * even_d + 8.0 * (y * half_even_dd) + x * (6.0 * odd_d + 8.0 * (y * half_odd_dd))
    return even + x * odd, 2.0 * x * even_d + odd + 2.0 * (y * odd_d), second


@kernel
def copy(p, target):
    """target = p."""
    for n in range(len(p)):
        target[n] = p[n]


@kernel
def divide_by_root(p, a):
    """Replace p by p / (x - a), dropping the remainder p(a)."""
    carry = 0.0
    for n in range(LENGTH - 1, -1, -1):
        coefficient = p[n]
        p[n] = carry
        carry = carry * a + coefficient


@kernel
def fill_multiple(target, factor, p):
    """target = factor * p."""
    for n in range(len(p)):
        target[n] = factor * p[n]


@kernel
def fill_two_multiples(target, a, p, b, q):
    """target = a * p + b * q."""
    for n in range(len(p)):
        target[n] = a * p[n] + b * q[n]


@kernel
def add_two_multiples(target, a, p, b, q):
    """target += a * p + b * q."""
    for n in range(len(p)):
        target[n] += a * p[n] + b * q[n]


@kernel
def fill_sum(target, r, a, p, b, q):
    """target = r + a * p + b * q."""
    for n in range(len(r)):
        target[n] = r[n] + (a * p[n] + b * q[n])


@kernel
def fill_form(form, channels, z, target):
    """target = sum of form[c] z[c] over the leading `channels` that are not negative; returns whether there are any."""
    count = 0
    while count < len(channels) and channels[count] >= 0:
        count += 1
    if count == 0:
        return False
    if count % 2 == 1:
        fill_multiple(target, form[channels[0]], z[channels[0]])
    else:
        fill_two_multiples(target, form[channels[0]], z[channels[0]], form[channels[1]], z[channels[1]])
    for k in range(2 - count % 2, count, 2):
        c, d = channels[k], channels[k + 1]
        add_two_multiples(target, form[c], z[c], form[d], z[d])
    return True


@sum_kernel
def _product_of_three(p, q, r):
    total = 0.0
    for n in range(len(p)):
        total += p[n] * q[n] * r[n]
    return total


@kernel
def recentre(p, powers, terms, target):
    """First `terms` coefficients of target(y) = p(x + y); the others become zero.

    `powers`, shape (2 LENGTH,), are zeros and then the powers of x as `fill_powers` fills them, so that every sum has
    the same length.
    """
    for n in range(len(target)):
        target[n] = 0.0
    for n in range(terms):
        target[n] = _product_of_three(_BINOMIAL[n], p, powers[LENGTH - n:2 * LENGTH - n])


@kernel
def substitute(p, terms, inner, inner_terms, target):
    """Coefficients of target(y) = p(inner(y)), cut at their length; of p the first `terms` are read.

    `inner` has `inner_terms` terms, and inner(0) = 0.
    """
    most = min(LENGTH, (terms - 1) * (inner_terms - 1) + 1)
    for n in range(len(target)):
        target[n] = 0.0
    for k in range(terms - 1, -1, -1):
        for n in range(most - 1, 0, -1):
            total = 0.0
            for m in range(1, min(n + 1, inner_terms)):
                total += inner[m] * target[n - m]
            target[n] = total
        target[0] = p[k]


@kernel
def scale_argument(p, powers, target):
    """target(y) = p(a y), with the powers of a."""
    for n in range(len(p)):
        target[n] = p[n] * powers[n]


@kernel
def differentiate(p, half, target):
    """Coefficients of the time derivative of p over a segment that lasts 2 `half`."""
    rate = 1.0 / half
    for n in range(len(p) - 1):
        target[n] = (_ORDER[n + 1] * p[n + 1]) * rate
    target[len(p) - 1] = 0.0


@kernel
def fill_integral_powers(powers, target):
    """target[n] = x^(n + 1) / (n + 1), for `integrate_through`, where `fill_powers` filled x."""
    last = len(powers) - 1
    for n in range(last):
        target[n] = powers[n + 1] * INVERSE[n + 1]
    target[last] = powers[last] * powers[1] * INVERSE[LENGTH]


@kernel
def integrate_through(p, half, x, wanted, target):
    """Coefficients of the time integral of p over a segment that lasts 2 `half`, which is `wanted` where
    `fill_integral_powers` filled `x`; its term beyond the length is economized."""
    beyond = p[len(p) - 1] * (half * INVERSE[LENGTH])
    target[0] = wanted - half * product(p, x)
    for n in range(len(p) - 1):
        target[n + 1] = p[n] * (half * INVERSE[n + 1])
    for n in range(len(p)):
        target[n] += beyond * _BEYOND[n]
