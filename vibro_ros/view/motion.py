"""The motion document: where everything was at every instant, small enough to be mailed.

A motion is cut into pieces, at every event and wherever else it is needed. In a piece each quantity is a polynomial

    value(t) = sum over k of c_k T_k(s),    s = (t - begin) / (end - begin) * 2 - 1  in [-1, 1],

with the Chebyshev polynomials T_k(s) = cos(k arccos(s)). A document is a header, which is ready for JSON, and a
payload: three arrays one behind the other, little-endian, P pieces and Q quantities:

``borders``, float64
    Begin and end [s] of each piece, 2 P numbers, ascending. The last instant of a piece is the first of the next one,
    except where nothing is known in between: there one piece ends earlier than the next begins. Where two pieces meet,
    the later one holds.
``coefficients``, float64
    For each piece and each of its known quantities c_0 to c_degree (SI), in the order of the degrees.
``degrees``, uint8
    P x Q numbers, those of a piece one behind the other: the degree of each quantity's polynomial, or `UNKNOWN`.

The header: ``pieces``, P; ``coefficients``, how many there are; ``quantities``, Q names of fields of `Samples`;
``begin`` and ``end`` [s] of the motion; ``exact``, whether all pieces are what the simulator computes, and ``why``, a
sentence when they are not; ``exact_spans``, pairs of begin and end [s] of what is exact; ``impacts``, a list of
``time`` and ``end`` [s], ``side``, ``peak_force`` [N] (null where a plate is rigid, where an impact is an instant);
``resets``, the instants [s] at which the robot stood at its start again; of a robot's own recording also ``pushes`` of
the body from outside, a list of ``begin`` and ``end`` [s], ``force_x`` and ``force_z`` [N].
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.messages.robot_messages import PLATES

UNKNOWN = 255
"""Degree of a quantity of which nothing is known in a piece."""
Document = tuple[dict[str, Any], bytes]
"""Header and payload."""

#: Precision of a place [m] and of an angle [rad]: a polynomial of 20 coefficients is then off by 5e-10 m at most.
_PLACE = 5e-11
#: Precision of the rest, as parts of their largest value: off by 2e-7 of it at most.
_PART = 2e-8
#: A place's precision is never a smaller part of its largest value: rounding is no smaller either.
_LEAST_PART = 1e-13


def is_place(name: str) -> bool:
    """Whether a field of `Samples` says where something is: in m, or the crank's angle in rad."""
    return name.endswith(("position", "height", "angle"))


def precisions(names: Sequence[str], largest: np.ndarray) -> np.ndarray:
    """Precision of a coefficient of each quantity (SI), from its largest magnitude in the motion; shape (quantities,).
    """
    places = np.array([is_place(name) for name in names])
    found = np.where(places, np.maximum(_PLACE, _LEAST_PART * largest), _PART * largest)
    return np.where(found > 0.0, found, 1.0)  # of a quantity that is 0 throughout


class MotionWriter:
    """Gathers the pieces of a motion of some quantities; `size` are the bytes of the payload so far.

    `precision` is the step of a coefficient of each quantity (SI). Coefficients are rounded to a power of two below
    it, and zeros at a polynomial's end are left out: both only make the document small.
    """

    def __init__(self, quantities: Sequence[str], precision: Sequence[float] | np.ndarray):
        self.quantities, self.size = tuple(quantities), 0
        self.precision = np.array(precision, dtype=float)
        self._step = 2.0 ** np.floor(np.log2(self.precision))[:, None]
        self._borders: list[np.ndarray] = [np.empty((0, 2))]
        self._coefficients: list[np.ndarray] = [np.empty(0)]
        self._degrees: list[np.ndarray] = [np.empty((0, len(self.quantities)), np.uint8)]

    def add(self, borders: np.ndarray, coefficients: np.ndarray) -> None:
        """Append pieces: `borders` [s], shape (p, 2), ascending, none before the end of the last, and `coefficients`.

        These are of the Chebyshev polynomials (SI), shape (p, quantities, n); not finite where nothing is known.
        """
        rounded = np.rint(coefficients / self._step) * self._step
        known, orders = np.isfinite(rounded).all(axis=2), np.arange(rounded.shape[2])
        degrees = np.max(np.where(rounded != 0.0, orders, 0), axis=2)
        chosen = rounded[(orders <= degrees[:, :, None]) & known[:, :, None]]
        self._borders.append(borders)
        self._coefficients.append(chosen)
        self._degrees.append(np.where(known, degrees, UNKNOWN).astype(np.uint8))
        self.size += borders.nbytes + chosen.nbytes + known.size

    def document(self, facts: Mapping[str, Any]) -> Document:
        """Header and payload; `facts` is what only the caller knows: ``exact``, ``why``, ``impacts``, ...

        ``begin`` and ``end`` are those of the pieces, where the facts do not say them.
        """
        borders, coefficients, degrees = (
            np.concatenate(parts) for parts in (self._borders, self._coefficients, self._degrees))
        begin, end = (float(borders[0, 0]), float(borders[-1, 1])) if len(borders) else (0.0, 0.0)
        header = {"begin": begin, "end": end, "pieces": len(borders), "coefficients": len(coefficients),
                  "quantities": list(self.quantities), **facts}
        return header, borders.astype("<f8").tobytes() + coefficients.astype("<f8").tobytes() + degrees.tobytes()


class Impact(NamedTuple):
    """A contact: first and last instant [s], side, peak force [N]."""

    time: float
    end: float
    side: str
    peak_force: float


def impacts_of(events: np.ndarray, offset: float) -> list[Impact]:
    """The contacts among events, of dtype `EVENT_DTYPE`; `offset` [s] is added to their times."""
    events = events[np.isin(events["kind"], list(PLATES))]
    times = events["time"] + offset
    return [Impact(time, end, kind.partition("_")[0], force) for time, end, kind, force in zip(
        times.tolist(), (times + events["duration"]).tolist(), events["kind"].tolist(), events["peak_force"].tolist(),
        strict=True)]


def impacts_as_json(impacts: Sequence[Impact]) -> list[dict[str, Any]]:
    """Impacts for a header, by time."""
    return [{**one._asdict(), "peak_force": one.peak_force if math.isfinite(one.peak_force) else None}
            for one in sorted(impacts)]
