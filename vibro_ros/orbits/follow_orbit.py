"""Branches of periodic orbits to begin with: through an orbit, and from a period doubling on."""

import numpy as np

from vibro_ros.model.parameters import BY_NAME, parameter_named
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.branch import Branch
from vibro_ros.orbits.branch_point import LostError, corrected, point_at
from vibro_ros.orbits.family import Family, Place
from vibro_ros.orbits.orbit import Orbit
from vibro_ros.orbits.turn_map import TurnMap
from vibro_ros.orbits.whole_branch import Notice, gathered, whole_branch
from vibro_ros.simulation.motion import SimulationError

MOST_POINTS = 100_000
_AMPLITUDES = (1e-2, 3e-3, 1e-3)  # in units of the machine, at which an orbit of doubled period is looked for


def follow_orbit(orbit: Orbit, name: str, low: float, high: float, upwards: bool = True, points: int = 1000) -> Branch:
    """The branch of periodic orbits through `orbit` as a parameter changes, through folds, grazings and corners.

    Pseudo-arclength continuation of the turn map (H. B. Keller 1977), which ends and begins anew where the order of
    events changes, because the map is smooth only in between (M. di Bernardo et al., Piecewise-smooth Dynamical
    Systems, Springer 2008).

    Parameters
    ----------
    orbit : Orbit
        As `find_orbit` gives it.
    name : str
        A number among the scene's parameters.
    low, high : float
        Range of the parameter, in its unit; the orbit's own value lies within.
    upwards : bool
        Whether to begin towards larger values.
    points : int
        Most orbits on the way, from 2 to 100 000.

    Returns
    -------
    Branch
        The orbits, and the special points between them.

    Raises
    ------
    ValueError
        For a parameter that is no number, a range that is none or does not hold the orbit's value, or a number of
        points out of range.

    Examples
    --------
    >>> orbit = vibro_ros.find_orbit(vibro_ros.load_scene("damped"))
    >>> branch = vibro_ros.follow_orbit(orbit, "motor.speed", 99.0, 103.0)
    >>> branch.end, bool(branch.stable.all()), len(branch.special_points)
    ('motor.speed leaves its range at 103 rad/s', True, 0)
    """
    if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 2 <= points <= MOST_POINTS:
        raise ValueError(f"points: {points!r} is out of range; give a whole number from 2 to {MOST_POINTS}")
    family, here = family_of(orbit.scene, name, low, high, orbit.turns, orbit.state.crank_angle), orbit.scene[name]
    if not low <= here <= high:
        raise ValueError(f"{name}: the orbit's {here:g} is not from {low:g} to {high:g}; give a range that holds it")
    turn_map = TurnMap(orbit.scene, orbit.state.crank_angle)
    state = turn_map.read(orbit.state) * turn_map.units / family.units
    return branch_from(family, state, family.share(here), 1.0 if upwards else -1.0, points)


def family_of(scene: Scene, name: str, low: float, high: float, turns: int, phase: float) -> Family:
    """The orbits of a scene over a range of a parameter, both of whose ends are checked (ValueError)."""
    parameter = parameter_named(name, BY_NAME)
    if not isinstance(parameter.default, float):
        raise ValueError(f"{name}: is {parameter.type_name}, along which no branch can be followed; choose a number")
    family = Family(scene, name, parameter.checked(low), parameter.checked(high), turns, phase)
    for end in (0.0, 1.0):
        family.scene_at(end)
    return family


def branch_from(family: Family, state: np.ndarray, share: float, direction: float, points: int,
                notice: Notice | None = None) -> Branch:
    """The branch through a known orbit, towards larger values of the parameter with `direction` 1.0, else -1.0."""
    along = np.append(np.zeros_like(state), direction)
    try:
        vector, _ = corrected(family, np.append(state, share), along)
        start = point_at(family, vector, along)
    except (LostError, SimulationError, ValueError) as error:
        return gathered(family, [], [], str(error))
    return whole_branch(start, points, notice)


def doubled_branch_from(family: Family, state: np.ndarray, share: float, points: int,
                        notice: Notice | None = None) -> Branch:
    """The branch of orbits of twice the period that begins at a period doubling of `family`.

    Its orbits leave along the eigenvector of the multiplier -1. The other side of the eigenvector holds the same
    orbits, half a period later.
    """
    place, twice = Place(state, share), family.with_turns(2 * family.turns)
    matrix = family.jacobian(place, family.held(place))[:, :-1] + np.eye(len(state))
    values, vectors = np.linalg.eig(matrix)
    away = np.append(np.real(vectors[:, np.argmin(np.abs(values + 1.0))]), 0.0)
    away /= np.linalg.norm(away)
    for amplitude in _AMPLITUDES:
        try:
            vector, _ = corrected(twice, place.vector + amplitude * away, away, amplitude)
            start = point_at(twice, vector, vector - place.vector, amplitude)
        except (LostError, SimulationError, ValueError):
            continue
        return whole_branch(start, points, notice)
    return gathered(twice, [], [], "no orbit of doubled period was found beside the period doubling")
