"""The smallest disturbance that changes a motion for good: its minimal fatal shock.

A shock moves the state at once, at some instant of the motion; small ones die out, and the smallest that does not is
the distance of the motion from the edge of its basin. L. Halekotte and U. Feudel, Minimal fatal shocks in multistable
complex networks, Sci. Rep. 10 (2020) 11783, give the name. V. V. Klinshov, V. I. Nekorkin and J. Kurths, Stability
threshold approach for complex dynamical systems, New J. Phys. 18 (2016) 013004, walk along the edge from shock to
smaller shock. Impacts give the edge corners, where it has no gradient, and so the search here draws shocks instead:
each that is fatal is shortened along its ray, and the next ones are drawn from within its length.

What is found is an upper bound: it was seen to be fatal, and there may be a smaller one that was not drawn.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vibro_ros.orbits.recurrence import FIRST_TURNS, MOST_TURNS, SettledMotion, settle
from vibro_ros.orbits.turn_map import TURN, Stroboscope
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import Simulator

LARGEST = 4.0
"""Length of the largest shock that is tried, in units of the machine."""
PLACES = 16
"""Instants of a motion, evenly over its turns, at which shocks are tried."""
_ORDERS = 2.5  # of magnitude, below the largest shock, from which the first one is drawn
_HALVINGS = 10  # of a fatal shock along its ray: a thousandth of its length is left open
_NARROWING = 0.7  # of the cone from which neighbours of the best shock are drawn, after each that is not fatal
_WIDEST, _NARROWEST = 0.5, 1e-3  # widths of the cone, in lengths of the shock


@dataclass(frozen=True)
class Shock:
    """A disturbance that changes the motion.

    Attributes
    ----------
    size : float
        Its length, in units of the machine: crank radii, and crank radii times motor speed.
    change : ndarray, shape (n,)
        What it adds to the state, in these units, in the order of `TurnMap.names`.
    crank_angle : float
        Where in a turn it acts [rad], from 0 to 2 pi.
    leads_to : SettledMotion
        The motion that follows.
    """

    size: float
    change: np.ndarray
    crank_angle: float
    leads_to: SettledMotion


class Shocked:
    """A motion under disturbances.

    Parameters
    ----------
    stroboscope : Stroboscope
        Of the scene and cut of the motion.
    motion : SettledMotion
        What is disturbed.
    seed : int
        Of the random numbers.
    """

    def __init__(self, stroboscope: Stroboscope, motion: SettledMotion, seed: int = 0):
        self._stroboscope, self._motion = stroboscope, motion
        self._draw = np.random.default_rng(seed)
        turn_map, device = stroboscope.turn_map, Simulator(stroboscope.turn_map.scene)
        turn_map.put(device, motion.states[-1])
        spacing = motion.turns / PLACES if motion.turns else 1.0 + 1.0 / PLACES
        times = np.arange(PLACES) * spacing * turn_map.turn_time(motion.states[-1], motion.turns or 1)
        seen = []
        for time in times.tolist():
            device.advance_to(time)
            seen.append((device.state.crank_angle, turn_map.read_device(device)))
        self._angles = np.mod([angle for angle, _ in seen], TURN)  # rad, where in a turn shocks are tried
        self._states: np.ndarray = np.array([state for _, state in seen])

    def along(self, coordinate: int, tries: int) -> Shock | None:
        """The smallest fatal shock that is found to change one coordinate of the state alone; None for none.

        Parameters
        ----------
        coordinate : int
            Its place in the state.
        tries : int
            Shocks that are drawn, dimensionless.
        """
        def drawn(best: Shock | None) -> np.ndarray:
            direction = np.zeros(self._states.shape[1])
            direction[coordinate] = self._draw.choice([-1.0, 1.0])
            return direction * self._length(best, 1)
        return self._shortest(None, drawn, tries)

    def anywhere(self, best: Shock | None, tries: int) -> Shock | None:
        """The smallest fatal shock that is found in any direction; None for none up to `LARGEST`.

        Parameters
        ----------
        best : Shock, optional
            The smallest one so far.
        tries : int
            Shocks that are drawn, dimensionless: a half from all directions, and a half from near the best one.
        """
        def near(best: Shock | None) -> np.ndarray:
            assert best
            moved = best.change / best.size + self._cone * self._draw.uniform() * self._direction()
            return moved / np.linalg.norm(moved) * (1.0 - 0.1 * self._cone)

        best = self._shortest(best, lambda best: self._direction() * self._length(best, self._states.shape[1]),
                              tries - tries // 2)
        return best and self._shortest(best, near, tries // 2)

    def _shortest(self, best: Shock | None, drawn: Callable[[Shock | None], np.ndarray], tries: int) -> Shock | None:
        """The shortest of fatal shocks that are drawn, each no longer than the one before; `drawn` gives them in
        lengths of the best one."""
        self._cone = _WIDEST
        for _ in range(tries):
            place = int(self._draw.integers(PLACES))
            shock = self._fatal(place, drawn(best) * (best.size if best else LARGEST))
            self._cone = _WIDEST if shock else max(_NARROWEST, _NARROWING * self._cone)
            if shock:  # shortened along its ray to the edge of the basin
                low, high, best = 0.0, 1.0, shock
                for _ in range(_HALVINGS):
                    middle = 0.5 * (low + high)
                    if found := self._fatal(place, middle / high * best.change):
                        best, high = found, middle
                    else:
                        low = middle
        return best

    def _direction(self) -> np.ndarray:
        direction = self._draw.normal(size=self._states.shape[-1:])
        return direction / np.linalg.norm(direction)

    def _length(self, best: Shock | None, dimension: int) -> float:
        """A share of the best shock's length, as in a ball; without one, of any order of magnitude."""
        return self._draw.uniform() ** (1.0 / dimension) if best else 10.0 ** (-_ORDERS * self._draw.uniform())

    def _fatal(self, place: int, change: np.ndarray) -> Shock | None:
        """The shock, if it can be and the motion is another one afterwards."""
        turn_map, angle = self._stroboscope.turn_map, float(self._angles[place])
        values = (self._states[place] + change) * turn_map.units
        try:
            self._stroboscope.begin_as(crank_angle=angle, **dict(zip(turn_map.names, values.tolist(), strict=True)))
            after = settle(self._stroboscope, FIRST_TURNS, MOST_TURNS)
        except (ValueError, SimulationError):  # such as a mass beyond its rigid plate
            return None
        if after is None or after.is_same(self._motion):
            return None
        return Shock(float(np.linalg.norm(change)), change, angle, after)
