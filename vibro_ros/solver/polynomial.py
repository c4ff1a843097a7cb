"""Polynomials of fixed length on the unit interval: the dense output of every segment.

A polynomial is an array of `LENGTH` coefficients, constant term first, in the segment's own
time tau = (t - start) / duration, which runs from 0 to 1.
"""

import math

import numpy as np

from vibro_ros.solver.compilation import kernel

#: Coefficients of a polynomial. The flow's series is cut where 2^n / n! and 0.22^n (`system.STRIDE`) reach rounding.
LENGTH = 24

# Entry [k, n] is n + k over n.
_BINOMIAL = np.array([[float(math.comb(n + k, n)) for n in range(LENGTH)] for k in range(LENGTH)])


@kernel
def value(p, x):
    """p(x)."""
    result = p[LENGTH - 1]
    for n in range(LENGTH - 2, -1, -1):
        result = result * x + p[n]
    return result


@kernel
def value_and_derivatives(p, terms, x):
    """p(x), p'(x) and p''(x), of the first `terms` coefficients."""
    f = p[terms - 1]
    d = 0.0
    half_dd = 0.0
    for n in range(terms - 2, -1, -1):
        half_dd = half_dd * x + d
        d = d * x + f
        f = f * x + p[n]
    return f, d, 2.0 * half_dd


@kernel
def copy(p, target):
    """target = p."""
    for n in range(LENGTH):
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
def add_multiple(target, factor, p):
    """target += factor * p."""
    for n in range(LENGTH):
        target[n] += factor * p[n]


@kernel
def recentre(p, x, terms, target):
    """First `terms` coefficients of target(y) = p(x + y); the others become zero."""
    target[:] = 0.0
    power = 1.0
    for k in range(LENGTH):
        for n in range(min(terms, LENGTH - k)):
            target[n] += power * (_BINOMIAL[k, n] * p[n + k])
        power *= x


@kernel
def substitute(p, inner, terms, target):
    """Coefficients of target(y) = p(inner(y)), cut at the length of p; `inner` has `terms` terms and inner(0) = 0."""
    if terms == 2:
        copy(p, target)
        scale_argument(target, inner[1])
        return
    target[:] = 0.0
    for k in range(LENGTH - 1, -1, -1):
        for n in range(LENGTH - 1, 0, -1):
            total = 0.0
            for m in range(1, min(n + 1, terms)):
                total += inner[m] * target[n - m]
            target[n] = total
        target[0] = p[k]


@kernel
def scale_argument(p, a):
    """Replace p(y) by p(a y)."""
    power = 1.0
    for n in range(LENGTH):
        p[n] *= power
        power *= a


@kernel
def differentiate(p, duration, target):
    """Coefficients of the time derivative of p over a segment of `duration`."""
    for n in range(LENGTH - 1):
        target[n] = (n + 1) * p[n + 1] / duration
    target[LENGTH - 1] = 0.0
