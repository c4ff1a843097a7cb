"""Reads a motion document, as `page/motion.js` does in a browser, and compares it with a run."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from vibro_ros.view.motion import UNKNOWN

PLACES = ("position", "height", "angle")
NEAR = 1e-9  # m, rad
PART = 1e-6  # of the largest value of a force, a speed or a power


class MotionDocument:
    """A document, read: `borders`, begin and end [s] of each piece; where each quantity is `known`; and the
    `coefficients` of the Chebyshev polynomials (SI), shape (pieces, quantities, n), 0 where nothing is known."""

    def __init__(self, header: Mapping[str, Any], payload: bytes):
        self.header, self.quantities = header, tuple(header["quantities"])
        pieces, count = header["pieces"], header["coefficients"]
        self.borders = np.frombuffer(payload, "<f8", 2 * pieces).reshape(pieces, 2)
        degrees = np.frombuffer(payload, np.uint8, pieces * len(self.quantities), 8 * (2 * pieces + count))
        degrees = degrees.reshape(pieces, len(self.quantities))
        self.known = degrees != UNKNOWN
        ends = np.where(self.known, degrees.astype(int) + 1, 0)[:, :, None]
        orders = np.arange(int(ends.max(initial=1)))
        self.coefficients = np.zeros((*degrees.shape, len(orders)))
        self.coefficients[orders < ends] = np.frombuffer(payload, "<f8", count, 16 * pieces)

    def at(self, times: np.ndarray) -> dict[str, np.ndarray]:
        """Return every quantity at `times` [s], each of shape (n,); NaN where it is not known."""
        times = np.asarray(times, dtype=float)
        if not len(self.borders):
            return {name: np.full(len(times), np.nan) for name in self.quantities}
        piece = np.clip(np.searchsorted(self.borders[:, 0], times, side="right") - 1, 0, len(self.borders) - 1)
        begin, end = self.borders[piece].T
        inside = (times >= begin) & (times <= end)
        s = (times - begin) / (end - begin) * 2.0 - 1.0
        return {name: np.where(
            inside & self.known[piece, q],
            np.polynomial.chebyshev.chebval(s, self.coefficients[piece, q].T, tensor=False), np.nan)
            for q, name in enumerate(self.quantities)}


def assert_is_run(motion: MotionDocument, run, offset: float = 0.0) -> None:
    """Every quantity of the motion is that of a run, whose times count from `offset` [s] on."""
    for name, values in motion.at(run.time + offset).items():
        right = getattr(run, name)
        allowed = NEAR if name.endswith(PLACES) else PART * max(np.abs(right).max(), 1e-6)
        assert np.abs(values - right).max() <= allowed, name
