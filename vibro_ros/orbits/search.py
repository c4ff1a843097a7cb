"""Orbits to begin with: what several starts of a machine settle to, and unstable orbits that Newton's method finds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.branch import Branch
from vibro_ros.orbits.branch_point import LostError, corrected
from vibro_ros.orbits.cut import free_cut
from vibro_ros.orbits.family import Family, Place
from vibro_ros.orbits.newton import close
from vibro_ros.orbits.orbit import OrbitNotFoundError, find_orbit
from vibro_ros.orbits.recurrence import settle
from vibro_ros.orbits.stroboscope import Stroboscope
from vibro_ros.orbits.turn_map import TURN, TurnMap
from vibro_ros.simulation.motion import SimulationError

SAME = 1e-6
"""How far apart the states of the same orbit may be, in units of the machine."""
_UNSTABLE = 4  # turns up to which unstable orbits are looked for


@dataclass(frozen=True)
class Seed:
    """An orbit from which branches are followed.

    Attributes
    ----------
    turns : int
        Least number of turns after which it repeats itself.
    phase : float
        Crank angle at the cut [rad].
    state : ndarray, shape (n,)
        At the cut, in units of the machine.
    """

    turns: int
    phase: float
    state: np.ndarray


def seeds_of(scene: Scene, starts: int, most_turns: int) -> list[Seed]:
    """Orbits of a scene that differ, those of the fewest turns first.

    Parameters
    ----------
    scene : Scene
        Its motor turns at `motor.speed`, all the time.
    starts : int
        How many starts are tried: the scene's own, and others with crank angle and velocities drawn at random, always
        the same.
    most_turns : int
        Turns after which an orbit repeats itself at most.

    Raises
    ------
    SimulationError
        If a run cannot go on.
    """
    turn_map = free_cut(scene)
    stroboscope, found = Stroboscope(turn_map), list[Seed]()
    for start in range(starts):
        stroboscope.begin_as(**_drawn(turn_map, start))
        motion = settle(stroboscope)
        if motion and 1 <= motion.turns <= most_turns and (closed := close(turn_map, motion.states[-1], motion.turns)):
            found.append(Seed(motion.turns, turn_map.phase, closed.state))
    for turns in range(1, min(_UNSTABLE, most_turns) + 1):
        try:
            orbit = find_orbit(scene, turns)
        except OrbitNotFoundError:
            continue
        there = TurnMap(scene, orbit.state.crank_angle)
        state = there.read(orbit.state)
        found.append(Seed(_least(there, state, turns), there.phase, state))
    return _different(scene, sorted(found, key=lambda seed: seed.turns))


def lies_on(family: Family, seed: Seed, share: float, branch: Branch) -> bool:
    """Whether a branch of the same family passes through a seed at `share` of the parameter's range."""
    if branch.turns != seed.turns:
        return False
    shares = np.array([family.share(value) for value in branch.values])
    across = np.append(np.zeros(len(seed.state)), 1.0)
    for k in np.flatnonzero((shares[1:] - share) * (shares[:-1] - share) <= 0.0):
        if branch.phases[k] != branch.phases[k + 1] or shares[k] == shares[k + 1]:
            continue
        part = (share - shares[k]) / (shares[k + 1] - shares[k])
        guess = branch.states[k] + part * (branch.states[k + 1] - branch.states[k])
        own = family.with_turns(branch.turns).with_phase(float(branch.phases[k]))
        try:
            vector, _ = corrected(own, np.append(guess, share), across)
            _, (place,) = own.recut(seed.phase, iter([Place.of(vector)]))
        except (LostError, SimulationError, ValueError):
            continue
        turn_map = own.with_phase(seed.phase).map_at(share)
        if _is_same(turn_map, place.state, seed.state, seed.turns):
            return True
    return False


def _drawn(turn_map: TurnMap, start: int) -> dict[str, float]:
    """Crank angle and velocities of a start by its number; none for the scene's own, the first one."""
    if start == 0:
        return {}
    random = np.random.default_rng(start)
    given = {"crank_angle": random.uniform(0.0, TURN)}
    for name, unit in zip(turn_map.names, turn_map.units, strict=True):
        if name.endswith("velocity") and name != "body_vertical_velocity":
            given[name] = random.uniform(-unit, unit)
    return given


def _least(turn_map: TurnMap, state: np.ndarray, turns: int) -> int:
    """The least part of `turns` after which an orbit repeats itself."""
    return next(part for part in range(1, turns + 1)
                if turns % part == 0 and np.abs(turn_map(state, part).state - state).max() < SAME)


def _different(scene: Scene, seeds: Sequence[Seed]) -> list[Seed]:
    """Seeds without those that are the same orbit as one before."""
    kept: list[Seed] = []
    for seed in seeds:
        turn_map = TurnMap(scene, seed.phase)
        if not any(seed.turns == other.turns and _is_same(turn_map, _recut(scene, other, seed.phase), seed.state,
                                                          seed.turns) for other in kept):
            kept.append(seed)
    return kept


def _recut(scene: Scene, seed: Seed, phase: float) -> np.ndarray:
    """The state of a seed at another cut."""
    here, there = TurnMap(scene, seed.phase), TurnMap(scene, phase)
    stroboscope = Stroboscope(there)
    sample = here.sample(seed.state)
    given = {name: getattr(sample, name) for name in here.names}
    return stroboscope.begin_as(crank_angle=seed.phase, **given).states[-1]


def _is_same(turn_map: TurnMap, one: np.ndarray, other: np.ndarray, turns: int) -> bool:
    """Whether two states at one cut are of the same orbit."""
    return any(np.abs(turn_map(one, ahead).state - other).max() < SAME for ahead in range(1, turns + 1))
