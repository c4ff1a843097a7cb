"""The step of a coefficient of each quantity: as fine as promised, and no finer than rounding."""

from collections.abc import Sequence

import numpy as np

#: Steps of a place [m] and of an angle [rad]: a polynomial of 20 coefficients is then off by 5e-10 m at most.
_PLACE = 5e-11
#: Steps of the rest, as parts of their largest value: off by 2e-7 of it at most.
_PART = 2e-8
#: A place's step is never a smaller part of its largest value, so that integers stay small enough for a browser.
_LEAST_PART = 1e-13


def units(names: Sequence[str], largest: np.ndarray) -> np.ndarray:
    """Step of a coefficient of each quantity (SI), from its largest magnitude in the motion; shape (quantities,)."""
    is_place = np.array([name.endswith(("position", "height", "angle")) for name in names])
    steps = np.where(is_place, np.maximum(_PLACE, _LEAST_PART * largest), _PART * largest)
    return np.where(steps > 0.0, steps, 1.0)  # of what is 0 throughout
