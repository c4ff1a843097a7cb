"""What ends an integration by scipy, as a class: scipy reads the direction from the function itself."""

from collections.abc import Callable

import numpy as np


class Guard:
    """A function of time and state at whose passage through zero an integration by scipy ends.

    Attributes
    ----------
    terminal : bool
        Always True, which is how scipy is told to end there.
    direction : float
        Sign of the passages that count, dimensionless; 0 for both.
    """

    terminal = True

    def __init__(self, function: Callable[[float, np.ndarray], float], direction: float):
        self._function, self.direction = function, direction

    def __call__(self, time: float, state: np.ndarray) -> float:
        """The function's value."""
        return self._function(time, state)
