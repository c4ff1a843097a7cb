"""A branch of periodic orbits as users get it: arrays along the branch, its special points, and why it ends."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Special:
    """A special point of a branch.

    Attributes
    ----------
    kind : str
        ``fold``, ``period doubling``, ``Neimark-Sacker``, ``grazing`` or ``corner``.
    value, width : float
        The parameter there, and the width of the interval in which it was found, in its unit.
    mean_speed : float
        Of the body [m/s].
    multipliers : ndarray of complex, shape (n,)
        Floquet multipliers; of a grazing or corner those on this side of it.
    change : str
        What becomes of the events, and whether the branch turns back, at a grazing or corner.
    phase : float
        Crank angle at the cut [rad].
    state : ndarray, shape (n,)
        At the cut, in units of the machine.
    at : int
        How many of the branch's orbits lie before it.
    """

    kind: str
    value: float
    width: float
    mean_speed: float
    multipliers: np.ndarray
    change: str
    phase: float
    state: np.ndarray
    at: int


@dataclass(frozen=True)
class Branch:
    """Orbits that follow each other as a parameter changes.

    Attributes
    ----------
    name : str
        The parameter.
    turns : int
        Turns of the crank after which the orbits repeat themselves.
    values : ndarray, shape (points,)
        The parameter, in its unit, in the order of the branch; it turns back at folds.
    mean_speeds : ndarray, shape (points,)
        Of the body [m/s].
    multipliers : ndarray of complex, shape (points, n)
        Floquet multipliers, the largest first.
    phases : ndarray, shape (points,)
        Crank angle of the cut [rad].
    states : ndarray, shape (points, n)
        At the cut, in units of the machine: lengths in `crank.radius`, velocities in `crank.radius` times `motor.speed`
        of the scene that the branch began with.
    strobe : dict of str to ndarray, shape (points, turns)
        Positions [m] and velocities [m/s] each time the crank passes the angle 0, by the names of `Samples`.
    special_points : tuple of Special
        In the order of the branch.
    end : str
        Why the branch was not followed further.
    """

    name: str
    turns: int
    values: np.ndarray
    mean_speeds: np.ndarray
    multipliers: np.ndarray
    phases: np.ndarray
    states: np.ndarray
    strobe: dict[str, np.ndarray]
    special_points: tuple[Special, ...]
    end: str

    def __len__(self) -> int:
        """Number of orbits."""
        return len(self.values)

    @property
    def stable(self) -> np.ndarray:
        """Whether small disturbances of an orbit die out, shape (points,) of bool."""
        return np.abs(self.multipliers).max(axis=1, initial=0.0) < 1.0
