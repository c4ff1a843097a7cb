"""The sliders of the crank mechanism, eqs. (2) and (3).

    s(theta) = l cos(theta - psi) + sqrt(L² - l² sin²(theta - psi))

with psi = 0 for the upper slider B and psi = phi for the inclined slider C. The square root has
branch points at theta = psi + pi/2 + k pi ± i arcosh(L/l), which reach the real axis when l = L: there
s = l cos + l |cos|, and the slider's speed jumps twice a turn.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibro_ros.solver.elementary import cos, log1p, sin
from vibro_ros.solver.polynomial import economized_powers
from vibro_ros.solver.system import CELL_STRIDE, SignalTable
from vibro_ros.solver.vector import LENGTH

_TURN = 2.0 * math.pi
# Half of the longest cell [rad] over which the series of the cosine reaches rounding, however short the crank is.
_LONGEST_HALF = math.pi / 4.0
# The cosine has no singularity, but grows as if one were at this distance [rad].
_FARTHEST_SINGULARITY = 3.5
# Iterations for a cell's length, each of which contracts the error by CELL_STRIDE: to a ten-thousandth of the length.
_CONTRACTIONS = 12
# Terms of a Taylor series before economization: CELL_STRIDE to this power is far below rounding.
_TERMS = 2 * LENGTH
_ORDER = np.arange(_TERMS)
_FACTORIAL = np.array([math.factorial(n) for n in range(_TERMS)], dtype=float)
_ECONOMIZED_POWERS = economized_powers(LENGTH, _TERMS - LENGTH)


def _of_arrays(function: Callable[[float], float]) -> Callable[[Any], Any]:
    """Return the function of a number as one of a number or an array."""
    return lambda angle: function(angle) if isinstance(angle, float) else np.array(
        [function(number) for number in angle.ravel().tolist()]).reshape(angle.shape)


_cosine, _sine = _of_arrays(cos), _of_arrays(sin)


@dataclass(frozen=True)
class Slider:
    """One slider."""

    radius: float  # crank radius l [m]
    rod: float  # rod length L [m], at least l; 0 for the crank pin itself, whose s is l cos(theta - psi)
    angle: float  # angle psi of its guide from the vertical [rad]

    def position(self, theta: float | np.ndarray) -> float | np.ndarray:
        """s [m] at crank angle theta [rad]; scalar or array."""
        psi = theta - self.angle
        return self.radius * _cosine(psi) + self.root(psi)

    def slope(self, theta: float | np.ndarray) -> float | np.ndarray:
        """ds/dtheta [m/rad]; at a kink, which exists for l = L, the value just after the kink."""
        psi = theta - self.angle
        sine, cosine = _sine(psi), _cosine(psi)
        if self.rod == 0.0:
            return -self.radius * sine
        if self.radius == self.rod:
            return -self.radius * sine * (1.0 + np.where(cosine == 0.0, -np.sign(sine), np.sign(cosine)))
        return -self.radius * sine * (1.0 + self.radius * cosine / self.root(psi))

    @property
    def kinks(self) -> np.ndarray:
        """Crank angles in [0, 2 pi) at which the slope jumps; empty unless l = L."""
        if self.radius != self.rod:
            return np.empty(0)
        return np.sort(np.mod(self.angle + np.array([0.5, 1.5]) * math.pi, _TURN))

    def distance_to_singularity(self, theta: float) -> float:
        """Distance in the complex plane from theta to the nearest branch point [rad]; infinite if l = L."""
        if self.radius >= self.rod:
            return math.inf
        along = math.remainder(theta - self.angle - 0.5 * math.pi, math.pi)
        return math.sqrt(along * along + self._across * self._across)

    @functools.cached_property
    def _across(self) -> float:
        """Distance from the real axis to a branch point, arcosh(L / l) [rad]."""
        more = (self.rod - self.radius) / self.radius
        return log1p(more + math.sqrt(more * (more + 2.0)))

    def least_distance_to_singularity(self, start: float, end: float) -> float:
        """Least distance in the complex plane from the angles between `start` and `end` to a branch point [rad]."""
        offset = math.remainder(start - self.angle - 0.5 * math.pi, math.pi)
        ahead = 0.0 if offset == 0.0 else (-offset if offset < 0.0 else math.pi - offset)
        if start + ahead <= end:
            return self.distance_to_singularity(start + ahead)
        return min(self.distance_to_singularity(start), self.distance_to_singularity(end))

    def root(self, psi: Any) -> Any:
        """sqrt(L² - l² sin² psi), factored, because the difference cancels where l is close to L; 0 without a rod."""
        if self.rod == 0.0:
            return 0.0 * psi
        along = self.radius * _cosine(psi)
        return np.sqrt((self.rod - self.radius) * (self.rod + self.radius) + along * along)


def _series(sliders: tuple[Slider, ...], middle: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return the economized coefficients of each s in (angle - middle) / half, shape (sliders, cells, LENGTH)."""
    numbers = np.array([(slider.angle, slider.radius, 0.5 * slider.radius * slider.radius) for slider in sliders])
    angle, radius, half_square = numbers.reshape(-1, 3).T[:, :, None]
    psi = middle - angle
    cosine = radius[:, :, None] * _cosine_series(psi, half, 1.0)
    root = np.zeros_like(cosine)
    square = half_square[:, :, None] * _cosine_series(2.0 * psi, half, 2.0)  # root² but for the constant term
    for k, slider in enumerate(sliders):
        if slider.radius == slider.rod:
            root[k] = np.sign(_cosine(psi[k]))[:, None] * cosine[k]
    smooth = [k for k, slider in enumerate(sliders) if slider.radius < slider.rod]
    if smooth:
        value = np.concatenate([sliders[k].root(psi[k]) for k in smooth])
        root[smooth] = _root_series(value, np.concatenate(square[smooth])).reshape(len(smooth), -1, _TERMS)
    series = cosine + root
    # Added term by term from the last on, because a product of matrices adds in any order.
    economized = (series[..., :LENGTH - 1:-1, None] * _ECONOMIZED_POWERS[::-1]).cumsum(axis=-2)[..., -1, :]
    return series[..., :LENGTH] + (economized + 0.0)  # no -0.0


def _cosine_series(at: np.ndarray, half: np.ndarray, factor: float) -> np.ndarray:
    """Taylor coefficients of cos(at + factor half y) in y; shape (*at.shape, _TERMS)."""
    cosine, sine = _cosine(at), _sine(at)
    derivatives = np.stack([cosine, -sine, -cosine, sine], axis=-1)
    powers = np.ones((len(half), _TERMS))
    powers[:, 1:] = factor * half[:, None]
    return derivatives[..., _ORDER % 4] * np.cumprod(powers, axis=1) / _FACTORIAL


def _root_series(value: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Series of sqrt(g) in each cell from its constant term and the series of g; shape (cells, _TERMS), as `square`."""
    root, twice = square.T.copy(), 2.0 * value  # terms come first, so that each line below works on all cells
    root[0] = value
    root[1] /= twice
    for n in range(2, _TERMS):
        term = root[n]
        term -= (root[1:n] * root[n - 1:0:-1]).cumsum(axis=0)[-1]  # added one after the other
        term /= twice
    return root.T


@functools.lru_cache(maxsize=64)
def signal_table(sliders: tuple[Slider, ...]) -> SignalTable:
    """Table of the sliders' positions over one turn, in cells whose series reach rounding; read only."""
    start = _cell_starts(sliders)
    series = _series(sliders, 0.5 * (start[:-1] + start[1:]), 0.5 * np.diff(start))
    distances = np.array([min([_FARTHEST_SINGULARITY, *(slider.least_distance_to_singularity(first, last)
                                                        for slider in sliders)])
                          for first, last in zip(start[:-1], start[1:], strict=True)])
    return SignalTable(start, distances, np.ascontiguousarray(series.swapaxes(0, 1)))


def _cell_starts(sliders: tuple[Slider, ...]) -> np.ndarray:
    """Crank angles [rad] at which cells begin, and 2 pi; shape (cells + 1,). A cell ends at each kink.

    Half the longest cell whose series reaches rounding is CELL_STRIDE times the distance from the cell's middle to the
    nearest singularity. That distance changes by no more than the middle moves, so that the iteration contracts by
    CELL_STRIDE.
    """
    kinks = sorted({float(kink) for slider in sliders for kink in slider.kinks if kink > 0.0} | {_TURN})
    starts = [0.0]
    for kink in kinks:
        while starts[-1] < kink:
            half, previous = 0.0, math.nan
            for _ in range(_CONTRACTIONS):
                if half == previous:
                    break
                distances = (slider.distance_to_singularity(starts[-1] + half) for slider in sliders)
                previous, half = half, min([_LONGEST_HALF] + [CELL_STRIDE * distance for distance in distances])
            starts.append(min(starts[-1] + 2.0 * half, kink))
    return np.array(starts)
