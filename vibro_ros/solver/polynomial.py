"""Polynomials of fixed length on the interval from -1 to 1: the dense output of every segment.

A polynomial is an array of `LENGTH` coefficients, constant term first, in the segment's own
time x = 2 (t - start) / duration - 1. About its middle a series reaches twice as far as from an end.

*Economization* (C. Lanczos) approximates powers beyond a polynomial's length on [-1, 1] by lower powers: x^n is a sum
of Chebyshev polynomials of degree n and less. If the polynomials that are too long are left out, the error is the sum
of their factors, of which the largest is 2^(1 - n). So a series of LENGTH terms reaches rounding over about half of its
radius of convergence; without economization, over a quarter.
"""

import functools
import math

import numpy as np

from vibro_ros.solver.elementary import cos
from vibro_ros.solver.typed import Indices, Row, Rows, part
from vibro_ros.solver.vector import (
    LENGTH,
    Vector,
    last,
    lowered,
    magnitudes,
    powers,
    raised,
    repeated,
    store,
    total,
    vector,
    with_first,
)


def _chebyshev_polynomials(length: int) -> list[list[int]]:
    """Return the coefficients of T_0, T_1, ..., each of them `length` long."""
    polynomials = [[1] + [0] * (length - 1), [0, 1] + [0] * (length - 2)]
    while len(polynomials) < length:
        last, before = polynomials[-1], polynomials[-2]
        polynomials.append([2 * a - b for a, b in zip([0, *last[:-1]], before, strict=True)])
    return polynomials


def economized_powers(length: int, count: int) -> np.ndarray:
    """Return the coefficients that replace x^length, x^(length + 1), ...; shape (count, length).

    They are exact but for the last rounding: 2^(n-1) x^n = sum over k of (n choose k) T_(n - 2 k), with half of T_0.
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
        row[:] = [a / (1 << n) for a in total]
    return rows


# The unit of whole numbers that stand for fractions, and steps after which Newton's method has converged to it.
_UNIT, _NEWTON_STEPS = 1 << 128, 5


@functools.cache
def gauss_legendre(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights of Gauss's rule on [-1, 1] with an even `count` of nodes, each rounded once.

    They are found in whole numbers, multiples of 2^-128, because numpy's rule has the rounding of LAPACK's eigenvalues.
    """
    nodes, weights = np.empty(count), np.empty(count)
    for k in range(count // 2):
        x = round(cos(math.pi * (k + 0.75) / (count + 0.5)) * _UNIT)  # near the root, by F. Tricomi
        for _ in range(_NEWTON_STEPS):
            last, before = x, _UNIT  # Legendre polynomials of degree n and n - 1 at x
            for n in range(1, count):
                last, before = ((2 * n + 1) * (x * last // _UNIT) - n * before) // (n + 1), last
            slope = count * (x * last // _UNIT - before) * _UNIT // (x * x // _UNIT - _UNIT)
            x -= last * _UNIT // slope
        nodes[count - 1 - k], nodes[k] = x / _UNIT, -x / _UNIT
        square = slope * slope // _UNIT
        weights[count - 1 - k] = weights[k] = 2 * _UNIT * _UNIT * _UNIT / ((_UNIT * _UNIT - x * x) * square)
    return nodes, weights


#: 1, 1/2, 1/3, ...
INVERSE = 1.0 / np.arange(1, LENGTH + 1)

_ORDER = np.arange(LENGTH, dtype=float)
#: Factors of the coefficients in the second derivative.
SECOND = _ORDER * (_ORDER - 1.0)
_BEYOND = economized_powers(LENGTH, 1)[0]
# Entry [n, k] is k choose n.
_BINOMIAL = np.array([[float(math.comb(k, n)) for k in range(LENGTH)] for n in range(LENGTH)])
# Entry [k, n] is n + k choose k.
_CHOICES = np.array([[float(math.comb(n + k, k)) for n in range(LENGTH)] for k in range(LENGTH)])


@part
def value(p: Row, x: float) -> float:
    """Return p(x), to rounding of its largest term."""
    return total(vector(p) * powers(x))


@part
def products(p: Row, q: Row, nodes: Vector) -> Vector:
    """Return the vector of p(x) q(x) for a vector of `nodes` x.

    Both are written as E(x²) + x O(x²), because the processor computes four series of half the length in parallel.
    """
    squares = nodes * nodes
    even_p, odd_p = repeated(p[LENGTH - 2]), repeated(p[LENGTH - 1])
    even_q, odd_q = repeated(q[LENGTH - 2]), repeated(q[LENGTH - 1])
    for n in range(LENGTH - 4, -2, -2):
        even_p, odd_p = even_p * squares + repeated(p[n]), odd_p * squares + repeated(p[n + 1])
        even_q, odd_q = even_q * squares + repeated(q[n]), odd_q * squares + repeated(q[n + 1])
    return (even_p + nodes * odd_p) * (even_q + nodes * odd_q)


@part
def values(p: Row, nodes: Vector) -> Vector:
    """Return the vector of p(x) for a vector of `nodes` x, as E(x²) + x O(x²), two series of half the length."""
    squares, even, odd = nodes * nodes, repeated(p[LENGTH - 2]), repeated(p[LENGTH - 1])
    for n in range(LENGTH - 4, -2, -2):
        even, odd = even * squares + repeated(p[n]), odd * squares + repeated(p[n + 1])
    return even + nodes * odd


@part
def value_and_derivatives(p: Row, x: float) -> tuple[float, float, float]:
    """Return p(x), to a rounding of its largest term, p'(x) and p''(x).

    p(x) is written as E(x²) + x O(x²), because the processor computes two series of half the length in parallel, and in
    parallel to the derivatives, for which powers of x with some rounding errors suffice.
    """
    of_slope = raised(powers(x))
    slope, bend = total(vector(p) * vector(_ORDER) * of_slope), total(vector(p) * vector(SECOND) * raised(of_slope))
    even, odd, square = 0.0, 0.0, x * x
    for n in range(LENGTH - 2, -2, -2):
        even, odd = even * square + p[n], odd * square + p[n + 1]
    return even + x * odd, slope, bend


@part
def sum_of_magnitudes(p: Row) -> float:
    """Return the sum of |p[n]|, a bound of |p| on [-1, 1]."""
    return total(magnitudes(vector(p)))


@part
def divide_by_root(p: Row, a: float) -> None:
    """Replace p by p / (x - a), dropping the remainder p(a)."""
    carry = 0.0
    if a == -1.0:  # where most modes begin: the same sums, without the product for which each would wait
        for n in range(LENGTH - 1, -1, -1):
            coefficient = p[n]
            p[n] = carry
            carry = coefficient - carry
        return
    for n in range(LENGTH - 1, -1, -1):
        coefficient = p[n]
        p[n] = carry
        carry = carry * a + coefficient


@part
def fill_form(form: Row, channels: Indices, z: Rows, target: Row) -> bool:
    """Set target = sum of form[c] z[c] over the leading `channels` that are not negative; return whether any are."""
    c = channels[0]
    if c < 0:
        return False
    result = form[c] * vector(z[c])
    for k in range(1, len(channels)):
        c = channels[k]
        if c < 0:
            break
        result = result + form[c] * vector(z[c])
    store(target, result)
    return True


@part
def recentre(polynomials: Rows, x: float, terms: int, targets: Rows) -> None:
    """Fill in the first `terms` coefficients of p(x + y), a polynomial of y, for every p; others become zero."""
    targets[:] = 0.0
    higher = powers(x)
    for n in range(terms):
        weights = vector(_BINOMIAL[n]) * higher
        for k in range(len(targets)):
            targets[k, n] = total(weights * vector(polynomials[k]))
        higher = raised(higher)


@part
def displace(p: Row, shift: Row, terms: int, order: int, room: Row, target: Row) -> None:
    """Fill in target(x) = p(x + shift(x)), by Taylor's formula up to the `order`-th power of the shift.

    `shift` has `terms` terms, and `room` has space for two polynomials.
    """
    store(room, vector(p))
    room[LENGTH:] = 0.0
    result = vector(_CHOICES[order]) * vector(room[order:order + LENGTH])  # derivative number `order` over order!
    for k in range(order - 1, -1, -1):
        product = shift[terms - 1] * result
        for n in range(terms - 2, -1, -1):
            # x times the product, its power beyond the length economized
            product = (raised(product) + last(product) * vector(_BEYOND)) + shift[n] * result
        result = product + vector(_CHOICES[k]) * vector(room[k:k + LENGTH])
    store(target, result)


@part
def scale_argument(p: Row, a: float, target: Row) -> None:
    """Set target(y) = p(a y)."""
    store(target, vector(p) * powers(a))


@part
def differentiate(p: Row, half: float, target: Row) -> None:
    """Fill in the time derivative of p over a segment that lasts 2 `half`."""
    store(target, (1.0 / half) * lowered(vector(_ORDER) * vector(p)))


@part
def integrate_through(p: Row, half: float, x: float, wanted: float, target: Row) -> None:
    """Fill in the time integral of p over a segment that lasts 2 `half`; the integral is `wanted` at x, and its term
    beyond the length is economized."""
    terms = half * (vector(p) * vector(INVERSE))  # coefficients of x, x², ...
    constant = wanted - total(terms * (x * powers(x)))
    beyond = p[LENGTH - 1] * (half * INVERSE[LENGTH - 1])
    store(target, with_first(raised(terms), constant) + beyond * vector(_BEYOND))
