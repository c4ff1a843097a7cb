"""The motion document: where everything was at every instant, small enough to be mailed.

A motion is cut into pieces, at every event and wherever else it is needed. In a piece each quantity is a polynomial

    value(t) = unit * sum over k of c_k T_k(s),    s = (t - begin) / (end - begin) * 2 - 1  in [-1, 1],

with integers c_k and the Chebyshev polynomials T_k(s) = cos(k arccos(s)). A document is a header, which is ready for
JSON, and a payload, in which the numbers of the arrays lie one after the other, little-endian, each array beginning at
a multiple of 8 bytes.

The header's ``arrays`` tell of each array ``[type, offset in bytes, number of entries]``:

``borders``, float64
    Begin and end [s] of each piece, 2 P numbers, ascending. The last instant of a piece is the first of the next one,
    except where nothing is known in between: there one piece ends earlier than the next begins. Where two pieces meet,
    the later one holds.
``degrees``, uint8
    P x Q numbers, those of a piece one after the other: the degree of each quantity's polynomial, or `UNKNOWN`.
``coefficients``, varint
    Integers, for each piece and each of its known quantities degree + 1 of them, in the order of the degrees. Each
    integer is some bytes, lowest bits first, seven bits a byte; a byte from 128 on says that another follows. An even
    result r means r / 2, an odd one -(r + 1) / 2. Results stay below 2^53, so that a browser adds up
    ``byte % 128 * 128**place`` without any rounding.

    The first integer of a polynomial is not c_0: most quantities go on where they were, so that it says by how much the
    value at the piece's begin differs from that quantity's value at the end of the last piece that knew it (0 before
    the first). With j for that integer and `before` for that value, both in units:

        c_0   = j + before - sum over k > 0 of (-1)^k c_k
        after = sum over all k of c_k,       the `before` of the next piece that knows the quantity.

    The other integers are c_1, c_2, ...

The rest of the header: ``exact``, whether all pieces are what the simulator computes, and ``why``, a sentence when they
are not; ``exact_spans``, pairs of begin and end [s] of what is exact; ``begin`` and ``end`` [s] of the motion;
``pieces``, P; ``quantities``, Q names of fields of `Samples`; ``units``, of each quantity (SI); ``impacts``, a list of
``time`` and ``end`` [s], ``side``, ``peak_force`` [N] (none where a plate is rigid, where an impact is an instant);
``resets``, the instants [s] at which the robot stood at its start again.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vibro_ros.view import varints

UNKNOWN = 255
"""Degree of a quantity of which nothing is known in a piece."""
Document = tuple[dict[str, Any], bytes]
"""Header and payload."""


class MotionWriter:
    """Gathers the pieces of a motion.

    Parameters
    ----------
    quantities : sequence of str
        Names.
    units : sequence of float
        Step of a coefficient of each quantity (SI).

    Attributes
    ----------
    size : int
        Bytes of the payload so far.
    """

    def __init__(self, quantities: Sequence[str], units: Sequence[float] | np.ndarray):
        self.quantities, self.units = tuple(quantities), np.array(units, dtype=float)
        self._borders: list[np.ndarray] = []
        self._degrees: list[np.ndarray] = []
        self._coefficients: list[bytes] = []
        self._integers = self.size = 0
        self._before = np.zeros(len(self.quantities), dtype=np.int64)

    def add(self, borders: np.ndarray, coefficients: np.ndarray) -> None:
        """Append pieces.

        Parameters
        ----------
        borders : ndarray, shape (p, 2)
            Begin and end [s] of each piece, none before the end of the last one.
        coefficients : ndarray, shape (p, quantities, n)
            Of the Chebyshev polynomials (SI); NaN where nothing is known.
        """
        known = ~np.isnan(coefficients[:, :, 0])
        limit = (varints.LIMIT - 1.0) / (2.0 * coefficients.shape[2] + 2.0)  # sums and differences stay below `LIMIT`
        with np.errstate(over="ignore"):
            integers = np.clip(np.rint(coefficients / self.units[:, None]), -limit, limit)
        integers = np.where(known[:, :, None], integers, 0.0).astype(np.int64)
        orders = np.arange(integers.shape[2])
        degrees = np.max(np.where(integers != 0, orders, 0), axis=2)
        steps = self._steps(integers, known)
        integers[:, :, 0] = steps
        wanted = (orders <= degrees[:, :, None]) & known[:, :, None]
        chosen = integers[wanted]
        self._integers += len(chosen)
        self._borders.append(np.ascontiguousarray(borders, dtype="<f8"))
        self._degrees.append(np.where(known, degrees, UNKNOWN).astype(np.uint8))
        self._coefficients.append(varints.encoded(chosen))
        self.size += sum(part[-1].nbytes for part in (self._borders, self._degrees)) + len(self._coefficients[-1])

    def _steps(self, integers: np.ndarray, known: np.ndarray) -> np.ndarray:
        """From the end of the last piece that knew the quantity to the begin of each; shape (p, quantities)."""
        signs = 1 - 2 * (np.arange(integers.shape[2]) % 2)
        begins, ends = integers @ signs, integers.sum(axis=2)
        # Number of the last piece before that knew the quantity; 0 stands for what was before all of them.
        numbers = np.where(known, np.arange(1, len(known) + 1)[:, None], 0)
        last = np.maximum.accumulate(np.vstack([np.zeros_like(numbers[:1]), numbers]), axis=0)
        ends = np.vstack([self._before, ends])
        self._before = np.take_along_axis(ends, last[-1:], axis=0)[0]
        return begins - np.take_along_axis(ends, last[:-1], axis=0)

    def document(self, facts: Mapping[str, Any]) -> Document:
        """Header and payload; `facts` is what only the caller knows: ``exact``, ``why``, ``impacts``, ...

        ``begin`` and ``end`` are those of the pieces, where the facts do not say them.
        """
        empty = np.empty((0, 2))
        borders = np.concatenate([empty, *self._borders])
        degrees = np.concatenate([np.empty((0, len(self.quantities)), np.uint8), *self._degrees])
        parts, arrays, payload = {
            "borders": ("float64", borders.size, borders.astype("<f8").tobytes()),
            "degrees": ("uint8", degrees.size, degrees.tobytes()),
            "coefficients": ("varint", self._integers, b"".join(self._coefficients))}, {}, bytearray()
        for name, (kind, count, data) in parts.items():
            arrays[name] = [kind, len(payload), count]
            payload += data + bytes(-len(data) % 8)
        begin, end = (float(borders[0, 0]), float(borders[-1, 1])) if len(borders) else (0.0, 0.0)
        return {"begin": begin, "end": end, "pieces": len(borders), "quantities": list(self.quantities),
                "units": self.units.tolist(), "arrays": arrays, **facts}, bytes(payload)


class Motion:
    """Reads a document, in place of a browser.

    Parameters
    ----------
    header, payload : dict, bytes
        The document.
    """

    def __init__(self, header: Mapping[str, Any], payload: bytes):
        self.header = header
        pieces, self.quantities = header["pieces"], tuple(header["quantities"])
        self._borders = self._array(payload, "borders", "<f8").reshape(pieces, 2)
        degrees = self._array(payload, "degrees", np.uint8).reshape(pieces, len(self.quantities)).astype(np.int64)
        self.known = degrees != UNKNOWN
        _, offset, count = header["arrays"]["coefficients"]
        self.coefficients = self._scaled(varints.decoded(memoryview(payload)[offset:], count),
                                         np.where(self.known, degrees, -1))

    @property
    def borders(self) -> np.ndarray:
        """Begin and end [s] of each piece, shape (pieces, 2)."""
        return self._borders

    def _array(self, payload: bytes, name: str, kind: Any) -> np.ndarray:
        _, offset, count = self.header["arrays"][name]
        return np.frombuffer(payload, dtype=kind, count=count, offset=offset)

    def _scaled(self, integers: np.ndarray, degrees: np.ndarray) -> np.ndarray:
        """Coefficients (SI), shape (pieces, quantities, n)."""
        orders = np.arange(int(degrees.max(initial=0)) + 1)
        filled = np.zeros((*degrees.shape, len(orders)), dtype=np.int64)
        filled[orders <= degrees[:, :, None]] = integers
        signs = 1 - 2 * (orders % 2)
        begin_to_end = np.where(orders % 2 == 1, 2 * filled, 0).sum(axis=2)
        # `before` of each piece: all steps and all ways from begin to end that came earlier
        begins = np.cumsum(filled[:, :, 0] + np.vstack([np.zeros_like(begin_to_end[:1]), begin_to_end[:-1]]), axis=0)
        filled[:, :, 0] = begins - (filled[:, :, 1:] * signs[1:]).sum(axis=2)
        return filled * np.array(self.header["units"])[:, None]

    def at(self, times: np.ndarray) -> dict[str, np.ndarray]:
        """Every quantity at `times` [s], each of shape (n,); NaN where nothing is known."""
        times = np.asarray(times, dtype=float)
        found: dict[str, np.ndarray] = {name: np.full(len(times), np.nan) for name in self.quantities}
        if not len(self._borders):
            return found
        piece = np.clip(np.searchsorted(self._borders[:, 0], times, side="right") - 1, 0, len(self._borders) - 1)
        begin, end = self._borders[piece].T
        inside = (times >= begin) & (times <= end)
        s = (times - begin) / (end - begin) * 2.0 - 1.0
        for q, name in enumerate(self.quantities):
            values = np.polynomial.chebyshev.chebval(s, self.coefficients[piece, q].T, tensor=False)
            found[name] = np.where(inside & self.known[piece, q], values, np.nan)
        return found
