"""One orbit of a branch, and Newton's method for it."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibro_ros.orbits.family import Family, Place
from vibro_ros.orbits.newton import CLOSED
from vibro_ros.orbits.passage import Passage, passage
from vibro_ros.simulation.motion import SimulationError

LONGEST_STEP = 0.05
"""Longest step along a branch: in units of the machine and shares of the parameter's range."""
_MOST_ITERATIONS = 24
_SLOW = 0.1  # a step that leaves a larger part of the residual has an old derivative


class PlacedOrbit(NamedTuple):
    """An orbit of a family: its place, the mean speed of the body [m/s], and its contacts."""

    place: Place
    mean_speed: float
    passage: Passage


@dataclass(frozen=True)
class BranchPoint:
    """One orbit of a branch.

    Attributes
    ----------
    family : Family
        The equations, with the cut that was used.
    place : Place
        State and parameter.
    tangent : ndarray, shape (n + 1,)
        Unit vector along the branch.
    multipliers : ndarray of complex, shape (n,)
        Floquet multipliers, the largest first.
    mean_speed : float
        Of the body [m/s].
    passage : Passage
        Its contacts.
    width : float
        Where the order of events changes just behind this point: width of the interval of the parameter [its unit] in
        which it changes; else 0.
    """

    family: Family
    place: Place
    tangent: np.ndarray
    multipliers: np.ndarray
    mean_speed: float
    passage: Passage
    width: float = 0.0

    @property
    def value(self) -> float:
        """The parameter, in its unit."""
        return self.family.value(self.place.share)

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return bool(np.abs(self.multipliers).max(initial=0.0) < 1.0)


class LostError(RuntimeError):
    """A branch cannot be followed further; the message says why."""


def corrected(family: Family, guess: np.ndarray, normal: np.ndarray,
              reach: float = LONGEST_STEP) -> tuple[np.ndarray, int]:
    """The orbit on the plane through `guess` that is perpendicular to `normal`, and how many derivatives it took.

    Parameters
    ----------
    family : Family
        The equations.
    guess, normal : ndarray, shape (n + 1,)
        State and share; the plane's normal.
    reach : float
        See `Family.jacobian`; dimensionless.

    Raises
    ------
    LostError
        Where Newton's method does not converge.
    """
    at, best, closest, matrix, derivatives = guess.copy(), np.inf, guess, None, 0
    for _ in range(_MOST_ITERATIONS):
        try:
            place = Place.of(at)
            held, residual = family.held(place), family.residual(place)
            size = float(np.abs(residual).max())
            if size <= CLOSED and size >= 0.25 * best:  # as good as rounding lets it become
                return closest if best < size else at, derivatives
            if matrix is None or size > _SLOW * best:
                matrix, derivatives = np.vstack([family.jacobian(place, held, reach), normal]), derivatives + 1
            if size < best:
                best, closest = size, at
            residual[held] = 0.0
            at = at - np.linalg.solve(matrix, np.append(residual, normal @ (at - guess)))
        except (np.linalg.LinAlgError, SimulationError, ValueError) as error:
            raise LostError(str(error)) from error
        if not np.all(np.isfinite(at)) or np.abs(at - guess).max() > 10.0 * LONGEST_STEP:
            break
    if best <= CLOSED:
        return closest, derivatives
    raise LostError(f"Newton's method does not close an orbit near {family.name} = {family.value(guess[-1]):.9g}")


def tangent_at(family: Family, place: Place, along: np.ndarray, reach: float,
               fine: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Unit tangent of the branch in the direction of `along`, and the derivative of the map by the state, (n, n)."""
    held, n = family.held(place), len(place.state)
    matrix = family.jacobian(place, held, reach, fine)
    *_, rows = np.linalg.svd(matrix)
    tangent = rows[-1] if rows[-1] @ along >= 0.0 else -rows[-1]
    return tangent, matrix[:, :n] + np.eye(n)


def point_at(family: Family, vector: np.ndarray, along: np.ndarray,
             reach: float = LONGEST_STEP, fine: bool = False) -> BranchPoint:
    """The branch's point at a solution, shape (n + 1,); `reach` and `fine` as for `Family.jacobian`."""
    here = orbit_of(family, Place.of(vector))
    tangent, matrix = tangent_at(family, here.place, along, reach, fine)
    found = np.linalg.eigvals(matrix)
    return BranchPoint(family, here.place, tangent, found[np.argsort(-np.abs(found), kind="stable")], here.mean_speed,
                       here.passage)


def orbit_of(family: Family, place: Place) -> PlacedOrbit:
    """What the orbit at a place does, without derivatives."""
    turn_map = family.map_at(place.share)
    advance = turn_map(place.state, family.turns).advance
    return PlacedOrbit(place, advance / (family.turns * turn_map.period), passage(turn_map, place.state, family.turns))
