"""A motion document put together: exact pieces and interpolated ones in the order of time, in common units."""

from collections.abc import Callable, Sequence

import numpy as np

from vibro_ros.view.exact_pieces import ExactPieces
from vibro_ros.view.motion import MotionWriter
from vibro_ros.view.stretch import Stretch
from vibro_ros.view.units import is_place, units

Span = tuple[float, float]
"""Begin and end [s]."""
#: Borders [s] and Chebyshev coefficients (SI) of interpolated pieces.
Interpolated = tuple[np.ndarray, np.ndarray]


class Assembly:
    """What was put together.

    Parameters
    ----------
    names : sequence of str
        Quantities.
    stretches : sequence of Stretch
        What is exact, by time.
    instants : sequence of ndarray, each of shape (n,)
        Events in the stretches [s].
    rest : sequence of Interpolated
        What is not.

    Attributes
    ----------
    writer : MotionWriter
        Holds the pieces.
    exact : list of Stretch
        Those stretches whose pieces follow the simulator's positions everywhere.
    end : float
        Instant [s] from which on pieces were left out; infinite if none were.
    """

    def __init__(self, names: Sequence[str], stretches: Sequence[Stretch], instants: Sequence[np.ndarray],
                 rest: Sequence[Interpolated]):
        self._places = [q for q, name in enumerate(names) if is_place(name)]
        self._exact, self._rest = ExactPieces(names, instants), [one for one in rest if len(one[0])]
        largest = np.max([np.zeros(len(names)), *map(self._exact.largest, stretches),
                          *(_largest(coefficients) for _, coefficients in self._rest)], axis=0)
        self._parts: list[tuple[float, Stretch | Interpolated]] = [
            *((one.begin + one.offset, one) for one in stretches), *((float(one[0][0, 0]), one) for one in self._rest)]
        self._parts.sort(key=lambda part: part[0])
        self.writer, self.end = MotionWriter(names, units(names, largest)), np.inf
        self.exact: list[Stretch] = []

    def write(self, limit: float = np.inf, progress: Callable[[float], object] = lambda share: None) -> None:
        """Write all pieces, or those that fit into `limit` bytes; `progress` is told the share that is done."""
        for number, (begin, part) in enumerate(self._parts):
            progress(number / len(self._parts))
            if self.writer.size > limit:
                self.end = begin
                return
            if isinstance(part, Stretch):
                borders, coefficients, resolved = self._exact.pieces(part, 0.5 * self.writer.units)
                if resolved[self._places].all():
                    self.exact.append(part)
                part = borders, coefficients
            self.writer.add(*part)


def spans(stretches: Sequence[Stretch]) -> list[Span]:
    """Begin and end [s] of what is exact, stretches that meet as one."""
    found: list[Span] = []
    for one in stretches:
        begin, end = one.begin + one.offset, one.end + one.offset
        if found and begin <= found[-1][1]:
            begin = found.pop()[0]
        found.append((begin, end))
    return found


def _largest(coefficients: np.ndarray) -> np.ndarray:
    """Bound of the magnitude of every quantity, from its coefficients of shape (p, quantities, n); 0 if unknown."""
    bounds = np.abs(coefficients).sum(axis=2)
    return np.where(np.isnan(bounds), 0.0, bounds).max(axis=0, initial=0.0)
