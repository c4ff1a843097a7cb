"""Periodic orbits: a motion that repeats itself every few turns of the crank, and its Floquet multipliers."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.cut import free_phase
from vibro_ros.orbits.newton import Closed, close, derivative
from vibro_ros.orbits.turn_map import TURN, TurnMap
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator

MOST_TURNS = 64
"""Turns after which an orbit may repeat itself at most: a derivative over more loses too many digits."""
SETTLING = (200, 1000, 5000)
"""Turns of the crank after the start of the scene at which orbits are looked for, one after the other."""
_GUESSES = 4  # states of the settled motion that Newton's method begins with, those that come back best first
_CLOSE = 1e-6  # of a state that comes back, in units of the machine: what has settled repeats itself much better


class OrbitNotFoundError(RuntimeError):
    """No motion was found that repeats itself after so many turns; the message says what was found."""


@dataclass(frozen=True)
class Orbit:
    """A motion that repeats itself.

    Attributes
    ----------
    scene : Scene
        What moves so.
    turns : int
        Turns of the crank after which it repeats itself.
    state : Samples
        The device at the cut, at a crank angle from 0 to 2 pi [rad] where nothing touches; the body at 0.
    multipliers : ndarray of complex, shape (n,)
        Floquet multipliers: the eigenvalues of the derivative of `turns` turns, the largest first. A coordinate that
        something holds at the cut has the multiplier 0. The body's place along the ground is no coordinate; its
        multiplier would be 1.
    mean_speed : float
        Of the body [m/s], forwards positive.
    residual : float
        Largest difference between the state and the one `turns` turns later, in units of the machine: lengths in
        `crank.radius`, velocities in `crank.radius` times `motor.speed`.
    """

    scene: Scene
    turns: int
    state: Samples[float]
    multipliers: np.ndarray
    mean_speed: float
    residual: float

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out: every multiplier is smaller than 1 in magnitude."""
        return bool(np.abs(self.multipliers).max(initial=0.0) < 1.0)


def find_orbit(scene: Scene, turns: int = 1) -> Orbit:
    """A motion of `scene` at `motor.speed` that repeats itself after `turns` turns of the crank.

    Newton's method on the turn map, which begins with states of the motion that the scene settles to. The orbit may be
    unstable, and it may repeat itself sooner, after a part of `turns`.

    Parameters
    ----------
    scene : Scene
        Its motor turns at `motor.speed`, all the time.
    turns : int
        From 1 to `MOST_TURNS`.

    Returns
    -------
    Orbit
        The orbit, with its multipliers.

    Raises
    ------
    ValueError
        For a number of turns out of range, or a crank that stands.
    OrbitNotFoundError
        When no such motion is found; it names the number of turns after which the motion repeats itself, if it does.
    SimulationError
        If the run cannot go on.

    Examples
    --------
    >>> orbit = vibro_ros.find_orbit(vibro_ros.load_scene("damped"))
    >>> orbit.stable, f"{orbit.mean_speed * 1e3:.6f} mm/s", f"{abs(orbit.multipliers[0]):.6f}"
    (True, '-61.180667 mm/s', '0.607019')
    """
    if isinstance(turns, bool) or not isinstance(turns, int | np.integer) or not 1 <= turns <= MOST_TURNS:
        raise ValueError(f"turns: {turns!r} is out of range; give a whole number from 1 to {MOST_TURNS}")
    TurnMap(scene)  # refuses a crank that stands
    period, repeats = TURN / scene["motor.speed"], 0
    device = Simulator(scene)
    for settled in SETTLING:
        device.advance_to(max(device.time, settled * period))
        phase, _ = free_phase(scene, device)
        turn_map = TurnMap(scene, phase)
        seen = _history(turn_map, device)
        for guess in _guesses(seen, turns):
            if closed := close(turn_map, guess, turns):
                return orbit_at(turn_map, closed, turns)
        repeats = repeats or _repeats_after(seen)
    found = f"; it repeats itself after {repeats} turns: give turns={repeats}" if repeats else (
        f", nor one that repeats itself within {MOST_TURNS} turns")
    raise OrbitNotFoundError(f"{scene.name}: at {scene['motor.speed']:g} rad/s no motion was found that repeats itself "
                             f"after {turns} turns{found}")


def orbit_at(turn_map: TurnMap, closed: Closed, turns: int) -> Orbit:
    """The orbit of a state that comes back, with multipliers and mean speed."""
    free = ~turn_map.held(closed.state)
    multipliers = np.zeros(len(free), dtype=complex)
    found = np.linalg.eigvals(derivative(turn_map, closed.state, turns, free))
    multipliers[:len(found)] = found[np.argsort(-np.abs(found), kind="stable")]
    mean_speed = turn_map(closed.state, turns).advance / (turns * turn_map.period)
    return Orbit(turn_map.scene, int(turns), turn_map.sample(closed.state), multipliers, mean_speed, closed.residual)


def _history(turn_map: TurnMap, device: Simulator) -> np.ndarray:
    """States at the next 2 `MOST_TURNS` cuts of a device that goes on, shape (cuts, n)."""
    ahead = (turn_map.phase - device.state.crank_angle) % TURN / TURN
    times = device.time + (ahead + np.arange(2 * MOST_TURNS)) * turn_map.period
    samples = device.sample(times)
    return np.column_stack([getattr(samples, name) for name in turn_map.names]) / turn_map.units


def _guesses(history: np.ndarray, turns: int) -> Iterator[np.ndarray]:
    """States that come back best after `turns` turns, the best first."""
    returns = np.abs(history[turns:] - history[:-turns]).max(axis=1)
    for at in np.argsort(returns, kind="stable")[:_GUESSES]:
        yield history[at]


def _repeats_after(history: np.ndarray) -> int:
    """Least number of turns after which all states come back; 0 when they do not."""
    return next((turns for turns in range(1, MOST_TURNS + 1)
                 if np.abs(history[turns:] - history[:-turns]).max() < _CLOSE), 0)
