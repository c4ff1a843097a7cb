"""What an effect contributes to the modes: states, and the guards that end them."""

from typing import NamedTuple

import numpy as np

from vibro_ros.solver.system import NOTHING


class Guard(NamedTuple):
    """A condition that a state keeps: form >= 0.

    Attributes
    ----------
    form : ndarray, shape (channels,)
        The linear form.
    targets : tuple of str
        States of the same effect to try, in order, when the form turns negative.
    text : str
        The condition in the paper's symbols.
    halt : int
        Coordinate whose velocity becomes exactly zero then, or `NOTHING`.
    """

    form: np.ndarray
    targets: tuple[str, ...]
    text: str
    halt: int = NOTHING
