"""How much of the starts each motion has, and how mixed the starts are."""

import math
from typing import NamedTuple

import numpy as np

#: Starts along a side of a box of `basin_entropy`, as its authors have it.
BOX = 5
_QUANTILE = 1.959963984540054  # of the normal distribution, for 95 %


class Fraction(NamedTuple):
    """A share of starts and its 95 % interval; dimensionless."""

    share: float
    low: float
    high: float


class BasinEntropy(NamedTuple):
    """How hard it is to tell where a start leads.

    Attributes
    ----------
    entropy : float
        Mean over all boxes of the entropy of the motions within a box [nat]: 0 where every box has one motion.
    boundary : float
        Mean over the boxes with more than one motion [nat]; NaN without any. Above log 2 the boundary is fractal;
        below, it may be either.
    boxes, mixed : int
        Boxes, and those with more than one motion.
    """

    entropy: float
    boundary: float
    boxes: int
    mixed: int

    @property
    def fractal(self) -> bool:
        """Whether the boundary must be fractal, as the log 2 criterion says."""
        return self.boundary > math.log(2.0)


def wilson(found: int, of: int) -> Fraction:
    """A share with its interval by E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.

    Parameters
    ----------
    found, of : int
        Starts that are counted, among how many drawn ones; `of` is above 0.
    """
    share, square = found / of, _QUANTILE**2 / of
    middle = (share + 0.5 * square) / (1.0 + square)
    half = _QUANTILE * math.sqrt(share * (1.0 - share) / of + 0.25 * square / of) / (1.0 + square)
    return Fraction(share, max(0.0, middle - half) if found else 0.0, min(1.0, middle + half) if found < of else 1.0)


def basin_entropy(numbers: np.ndarray, outside: int, side: int = BOX) -> BasinEntropy | None:
    """Basin entropy and boundary basin entropy of a grid of starts; None for a grid without a whole box.

    Both, and the criterion of log 2, are those of A. Daza, A. Wagemakers, B. Georgeot, D. Guery-Odelin and
    M. A. F. Sanjuan, Sci. Rep. 6 (2016) 31416.

    Parameters
    ----------
    numbers : ndarray of int, shape (rows, columns)
        Where each start leads.
    outside : int
        What stands where nothing can start; a box with such a start is left out.
    side : int
        Starts along a side of a box, dimensionless; what is left over at the ends of the grid is left out.
    """
    rows, columns = (count // side for count in numbers.shape)
    boxes = numbers[:rows * side, :columns * side].reshape(rows, side, columns, side).swapaxes(1, 2)
    entropies = np.array([_entropy(box) for box in boxes.reshape(rows * columns, side * side) if outside not in box])
    if not len(entropies):
        return None
    mixed = entropies > 0.0
    boundary = float(entropies[mixed].mean()) if mixed.any() else math.nan
    return BasinEntropy(float(entropies.mean()), boundary, len(entropies), int(mixed.sum()))


def _entropy(numbers: np.ndarray) -> float:
    _, counts = np.unique(numbers, return_counts=True)
    shares = counts / len(numbers)
    return float(-np.sum(shares * np.log(shares))) if len(counts) > 1 else 0.0
