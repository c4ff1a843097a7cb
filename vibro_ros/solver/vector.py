"""Vectors: a polynomial's coefficients as one value, added, subtracted and multiplied number by number, and scaled:

    store(target, vector(p) + 2.0 * (vector(q) * powers(x)))

In compiled kernels a vector lies in the processor's registers (`vectors.h`). These are the same functions in numpy,
with the same bits, for kernels that run as plain Python.
"""

from typing import TypeAlias

import numpy as np

#: Numbers in a vector. A flow's series is cut where 1.7^n / n! and 0.225^n (`system.STRIDE`) reach rounding.
LENGTH = 24

Vector: TypeAlias = np.ndarray


def vector(array: np.ndarray) -> Vector:
    """Return the vector of an array's first LENGTH numbers."""
    return array[:LENGTH].copy()


def store(array: np.ndarray, numbers: Vector) -> None:
    """Store a vector in an array of LENGTH numbers."""
    array[:LENGTH] = numbers


def total(numbers: Vector) -> float:
    """Return the sum of the numbers, added in the same order on every processor."""
    a, b, c, d, e, f = numbers.reshape(6, 4)
    four = ((a + c) + e) + ((b + d) + f)
    return float((four[0] + four[2]) + (four[1] + four[3]))


def raised(numbers: Vector) -> Vector:
    """Return the vector with every number moved to the next index; the first becomes zero, the last is dropped."""
    return np.append(0.0, numbers[:-1])


def lowered(numbers: Vector) -> Vector:
    """Return the vector with every number moved to the index before; the last becomes zero, the first is dropped."""
    return np.append(numbers[1:], 0.0)


def with_first(numbers: Vector, number: float) -> Vector:
    """Return the vector with its first number replaced."""
    return np.append(number, numbers[1:])


def last(numbers: Vector) -> float:
    """Return the last number."""
    return float(numbers[-1])


def magnitudes(numbers: Vector) -> Vector:
    """Return the vector of the numbers' magnitudes."""
    return np.abs(numbers)


def indices_above(numbers: Vector, limit: float) -> int:
    """Return an integer whose bit n is set if number n is greater than `limit`."""
    return sum(1 << n for n in range(LENGTH) if numbers[n] > limit)


def first_index(bits: int) -> int:
    """Return the index of the lowest bit that is set; LENGTH or more if no bit is."""
    return (bits & -bits).bit_length() - 1 if bits else 64


def repeated(number: float) -> Vector:
    """Return the vector of LENGTH equal numbers."""
    return np.full(LENGTH, number)


def powers(x: float) -> Vector:
    """Return the vector 1, x, x², ..."""
    square = x * x
    fourth = square * square
    low = np.array([1.0, x, square, x * square])
    parts, eighth = [low, low * fourth], fourth * fourth
    for k in range(4):
        parts.append(parts[k] * eighth)
    return np.concatenate(parts)


def as_column(array: np.ndarray) -> np.ndarray:
    """Return the array, shape (n,), as a table of n rows with one number each."""
    return array.reshape(len(array), 1)
