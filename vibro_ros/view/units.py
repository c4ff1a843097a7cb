"""The step of a coefficient of each quantity: as fine as promised, and no finer than rounding."""

from collections.abc import Sequence

import numpy as np

#: Steps of a place [m] and of an angle [rad]: a polynomial of 20 coefficients is then off by 5e-10 m at most.
_PLACE = 5e-11
#: Steps of the rest, as parts of their largest value: off by 2e-7 of it at most.
_PART = 2e-8
#: A place's step is never a smaller part of its largest value, so that integers stay small enough for a browser.
_LEAST_PART = 1e-13


def is_place(name: str) -> bool:
    """Whether a field of `Samples` says where something is: in m, or the crank's angle in rad."""
    return name.endswith(("position", "height", "angle"))


def units(names: Sequence[str], largest: np.ndarray) -> np.ndarray:
    """Step of a coefficient of each quantity (SI), from its largest magnitude in the motion; shape (quantities,)."""
    places = np.array([is_place(name) for name in names])
    steps = np.where(places, np.maximum(_PLACE, _LEAST_PART * largest), _PART * largest)
    return np.where(steps > 0.0, steps, 1.0)  # of what is 0 throughout
