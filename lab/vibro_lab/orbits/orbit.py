"""Periodic orbits: motions that repeat themselves every few turns of the crank, and their Floquet multipliers.

Newton's method finds fixed points of the turn map over that many turns, with the map's derivative by central
differences. Its initial guesses are states of the motion that the scene settles to from its own start; `seeds_of` also
uses other starts.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from vibro_lab.orbits.recurrence import command_in_words, settle
from vibro_lab.orbits.turn_map import (
    TURN,
    Stroboscope,
    TurnEnd,
    TurnMap,
    at_cut,
    check_closes,
    free_cut,
    free_phase,
    turn_round,
    whole_number,
)
from vibro_ros import Samples, Scene, SimulationError, Simulator

MOST_TURNS = 64
"""Longest period of an orbit [turns]: a derivative over more turns loses too many digits."""
SETTLING = (200, 1000, 5000)
"""Turns after the scene's start at which orbits are searched for; the next is used if the one before finds none."""
STEP = 1e-5
"""Step of the central differences, in units of the machine: the errors of the step (its square) and of rounding
(rounding / step) are both about 1e-9."""
_DIFFERENCE_STEPS = (STEP, 1e-6, 1e-7, 1e-8)
"""Steps that are tried for multipliers: contacts that are soft or close to each other need smaller ones than `STEP`."""
_AGREEMENT = 1e-8  # difference of the multipliers of two steps below which no third step is tried
CLOSED = 1e-11
"""Largest residual of an orbit, in units of the machine; rounding along a turn makes 1e-14 to 1e-12."""
_MOST_STEPS = 40
_LEAST_STEP_PART = 2.0**-10  # smallest part of a Newton step that is tried
SAME = 1e-6
"""Largest difference between states that count as the same orbit, in units of the machine."""
_LONGEST_UNSTABLE = 4  # longest period [turns] of the unstable orbits that `seeds_of` searches for
_GUESSES = 4  # states of the settled motion that Newton's method begins with, those of the smallest residual first
# Largest difference after a period, in units of the machine; a settled motion repeats itself much better.
_LARGEST_RETURN = 1e-6


class OrbitNotFoundError(RuntimeError):
    """No motion repeats itself after the given number of turns; the message says which motion was found."""


class FixedPoint(NamedTuple):
    """A fixed point of the turn map over one or more turns."""

    state: np.ndarray  # shape (n,): state at the cut, in units of the machine
    residual: float  # largest difference between the state and its image under the map, in units of the machine


@dataclass(frozen=True)
class Orbit:
    """A periodic orbit."""

    scene: Scene  # scene that has this orbit
    turns: int  # turns of the crank after which it repeats itself
    # Quantities at the cut, at a crank angle from 0 to 2 pi [rad] without contacts; the body at 0.
    state: Samples[float]
    # Shape (n,): Floquet multipliers: the eigenvalues of the map's derivative over `turns` turns, the largest first. A
    # coordinate that is held at the cut by friction, the ground or a rigid plate has the multiplier 0. The body's
    # position along the ground is not a coordinate; its multiplier would be 1.
    multipliers: np.ndarray
    # Bound on the error of any multiplier, dimensionless: twice the largest change of a multiplier between two
    # difference steps that differ by a factor of ten, for the pair of steps that agree best.
    multiplier_error: float
    mean_speed: float  # mean speed of the body [m/s], forwards positive
    # Largest difference between the state and the one `turns` turns later, in units of the machine: lengths in
    # `crank.radius`, velocities in `crank.radius` times `motor.speed`; see `period`.
    residual: float
    # Time after which the motion repeats itself [s]. With a dc motor it follows from the orbit, and the crank's speed
    # and the current belong to the state, in units of the speed without load.
    period: float

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out: every multiplier is smaller than 1 in magnitude."""
        return bool(np.abs(self.multipliers).max(initial=0.0) < 1.0)


def find_orbit(scene: Scene, turns: int = 1) -> Orbit:
    """Find a periodic orbit of `scene` at `motor.speed` that repeats itself after `turns` turns of the crank.

    A dc motor runs at a constant `motor.voltage` instead. A dc motor whose controller samples the speed has no closed
    orbits and is refused.

    The orbit is found by Newton's method on the turn map, which begins with states of the motion that the scene settles
    to. The orbit may be unstable, and its least period may be a divisor of `turns`.

    Parameters
    ----------
    scene : Scene
        Its motor turns at a constant `motor.speed`.
    turns : int
        From 1 to `MOST_TURNS`.

    Raises
    ------
    ValueError
        For a number of turns out of range, a crank that stands, or a controller that takes samples.
    OrbitNotFoundError
        When no such orbit is found; the message names the period of the settled motion [turns], if it has one.

    Examples
    --------
    >>> orbit = vibro_lab.find_orbit(vibro_ros.load_scene("damped"))
    >>> orbit.stable, f"{orbit.mean_speed * 1e3:.6f} mm/s", f"{abs(orbit.multipliers[0]):.6f}"
    (True, '-61.180667 mm/s', '0.607019')
    """
    turns = whole_number("turns", turns, 1, MOST_TURNS)
    check_closes(scene)
    TurnMap(scene)  # refuses a crank that stands
    device, repeats = Simulator(scene), 0
    for settling in SETTLING:
        turn_round(device, settling)
        phase, _ = free_phase(scene, device)
        turn_map = TurnMap(scene, phase)
        cuts = turn_map.cuts(device, 2 * MOST_TURNS).states
        returns = np.abs(cuts[turns:] - cuts[:-turns]).max(axis=1)
        for best in np.argsort(returns, kind="stable")[:_GUESSES]:
            if point := fixed_point(turn_map, cuts[best], turns):
                return orbit_at(turn_map, point, turns)
        repeats = repeats or next((count for count in range(1, MOST_TURNS + 1)
                                   if np.abs(cuts[count:] - cuts[:-count]).max() < _LARGEST_RETURN), 0)
    advice = f"; it repeats itself after {repeats} turns: give turns={repeats}" if repeats else (
        f", nor one that repeats itself within {MOST_TURNS} turns")
    raise OrbitNotFoundError(f"{scene.name}: at {command_in_words(scene)} no motion was found that repeats itself "
                             f"after {turns} turns{advice}")


def orbit_at(turn_map: TurnMap, point: FixedPoint, turns: int) -> Orbit:
    """Return the orbit through a fixed point of the map, with multipliers and mean speed."""
    multipliers, error = _multipliers(turn_map, point.state, turns)
    end = turn_map(point.state, turns)
    return Orbit(turn_map.scene, turns, turn_map.sample(point.state), multipliers, error,
                 end.advance / end.duration, point.residual, end.duration)


def _multipliers(turn_map: TurnMap, state: np.ndarray, turns: int) -> tuple[np.ndarray, float]:
    """`Orbit.multipliers` and `Orbit.multiplier_error` at a fixed point of the map.

    The truncation error of a central difference falls with the square of its step, the rounding error grows as the step
    shrinks. So the step is reduced as long as the multipliers change less with each reduction.
    """
    free = np.flatnonzero(~turn_map.held(state))
    best, error, last = np.zeros(len(free), complex), np.inf, None
    for step in _DIFFERENCE_STEPS:
        multipliers_of_step = np.linalg.eigvals(derivative(turn_map, state, turns, step)[0][np.ix_(free, free)])
        if last is not None:
            apart = np.abs(multipliers_of_step[:, None] - last)
            change = float(apart[linear_sum_assignment(apart)].max(initial=0.0))
            if change >= error:
                break
            best, error = multipliers_of_step, change
            if change <= _AGREEMENT:
                break
        last = multipliers_of_step
    multipliers = np.zeros(len(state), dtype=complex)
    multipliers[:len(best)] = best[np.argsort(-np.abs(best), kind="stable")]
    return multipliers, 2.0 * error


def derivative(turn_map: TurnMap, state: np.ndarray, turns: int = 1,
               step: float = STEP) -> tuple[np.ndarray, TurnEnd]:
    """Derivative of the map over `turns` turns, shape (n, n), and the end of these turns.

    Central differences of a map that is exact to rounding: their error is the truncation error of the step, unless a
    mass grazes a plate within the step. The column of a coordinate that is held at the cut is 0. Where a coordinate
    cannot be displaced to one side, because a rigid plate or the ground is there, the difference is one-sided.
    """
    end = turn_map(state, turns)
    free = ~turn_map.held(state)
    return differences(lambda moved: turn_map(moved, turns).state, state, free, step, end.state), end


def differences(end_of: Callable[[np.ndarray], np.ndarray], unknowns: np.ndarray, free: np.ndarray, step: float,
                centre: np.ndarray | None = None) -> np.ndarray:
    """Derivative of `end_of` with respect to `unknowns` by central differences, shape (n, unknowns).

    The columns of unknowns that are not `free` are 0. If `centre`, the value of `end_of` at `unknowns`, is given, an
    unknown that cannot be displaced to one side (ValueError) has a one-sided difference, and one that cannot be
    displaced at all has 0.
    """
    columns = dict[int, np.ndarray]()
    for i in np.flatnonzero(free).tolist():
        ends, reach = [], 0.0
        for moved in (step, -step):
            displaced = unknowns.copy()
            displaced[i] += moved
            try:
                ends.append(end_of(displaced))
                reach += step
            except ValueError:
                if centre is None:
                    raise
                ends.append(centre)
        columns[i] = (ends[0] - ends[1]) / reach if reach else np.zeros_like(ends[0])
    zero = np.zeros_like(next(iter(columns.values()), unknowns))
    return np.column_stack([columns.get(i, zero) for i in range(len(unknowns))])


def fixed_point(turn_map: TurnMap, guess: np.ndarray, turns: int) -> FixedPoint | None:
    """Fixed point of the map over `turns` turns by Newton's method from `guess`; None if it does not converge.

    A step that does not reduce the residual is halved. Coordinates that a plate, the ground or friction holds at the
    cut are not changed.
    """
    try:
        state, residual = guess, turn_map(guess, turns).state - guess
    except (SimulationError, ValueError):  # no possible state
        return None
    for _ in range(_MOST_STEPS):
        free = ~turn_map.held(state)
        difference = np.zeros_like(state)
        try:
            matrix = derivative(turn_map, state, turns)[0][np.ix_(free, free)] - np.eye(int(free.sum()))
            difference[free] = np.linalg.solve(matrix, residual[free])
        except (np.linalg.LinAlgError, SimulationError, ValueError):
            return None
        part = 1.0
        while part >= _LEAST_STEP_PART:
            moved = state - part * difference
            try:
                moved_residual = turn_map(moved, turns).state - moved
            except (SimulationError, ValueError):
                moved_residual = np.full_like(residual, np.inf)
            if np.abs(moved_residual).max() < np.abs(residual).max():
                state, residual = moved, moved_residual
                break
            part *= 0.5
        else:
            break
    size = float(np.abs(residual).max(initial=0.0))
    return FixedPoint(state, size) if size <= CLOSED else None


@dataclass(frozen=True)
class Seed:
    """An orbit from which branches are followed."""

    turns: int  # least number of turns after which it repeats itself
    phase: float  # crank angle at the cut [rad]
    state: np.ndarray  # shape (n,): state at the cut, in units of the machine


def seeds_of(scene: Scene, starts: int, most_turns: int) -> list[Seed]:
    """Distinct orbits of a scene, of at most `most_turns` turns, those of the fewest turns first.

    They are sought from the scene's own start, and from others with random crank angle and velocities, the same in
    every call.
    """
    check_closes(scene)
    turn_map = free_cut(scene)
    stroboscope, seeds = Stroboscope(turn_map), list[Seed]()
    for start in range(starts):
        stroboscope.begin_as(**_random_start(turn_map, start))
        motion = settle(stroboscope)
        if motion and 1 <= motion.turns <= most_turns and (
                point := fixed_point(turn_map, motion.states[-1], motion.turns)):
            seeds.append(Seed(motion.turns, turn_map.phase, point.state))
    for turns in range(1, min(_LONGEST_UNSTABLE, most_turns) + 1):
        try:
            orbit = find_orbit(scene, turns)
        except OrbitNotFoundError:
            continue
        orbit_map = TurnMap(scene, orbit.state.crank_angle)
        state = orbit_map.read(orbit.state)
        least = next(part for part in range(1, turns + 1)
                     if turns % part == 0 and np.abs(orbit_map(state, part).state - state).max() < SAME)
        seeds.append(Seed(least, orbit_map.phase, state))
    different: list[Seed] = []
    for seed in sorted(seeds, key=lambda seed: seed.turns):
        turn_map = TurnMap(scene, seed.phase)
        if not any(seed.turns == other.turns and is_same(
                turn_map, at_cut(TurnMap(scene, other.phase), other.state, turn_map), seed.state, seed.turns)
                   for other in different):
            different.append(seed)
    return different


def _random_start(turn_map: TurnMap, start: int) -> dict[str, float]:
    """Random crank angle and velocities of start number `start`, as arguments of `Simulator.set_state`.

    Empty for start 0, the scene's own.
    """
    if start == 0:
        return {}
    random = np.random.default_rng(start)
    given = {"crank_angle": random.uniform(0.0, TURN)}
    for name, unit in zip(turn_map.names, turn_map.units, strict=True):
        if name.endswith("velocity") and name != "body_vertical_velocity":
            given[name] = random.uniform(-unit, unit)
        elif name == "motor_speed":
            given[name] = random.uniform(0.0, unit)
    return given


def is_same(turn_map: TurnMap, state: np.ndarray, other: np.ndarray, turns: int) -> bool:
    """Whether two states at the cut of `turn_map` belong to the same orbit of `turns` turns."""
    return any(np.abs(turn_map(state, ahead).state - other).max() < SAME for ahead in range(1, turns + 1))
