"""Many turns of the crank in one go: the states at every cut on the way, without a stop in between.

`TurnMap` puts a device into a state for every turn, which costs as much as twenty turns. A stroboscope puts the device
once and lets it run on.
"""

from typing import NamedTuple

import numpy as np

from vibro_ros.orbits.turn_map import TURN, TurnMap
from vibro_ros.simulation.simulator import Simulator


class Cuts(NamedTuple):
    """A device at successive cuts.

    Attributes
    ----------
    states : ndarray, shape (cuts, n)
        In units of the machine, as `TurnMap` has them.
    positions : ndarray, shape (cuts,)
        Of the body along the ground [m], forwards positive.
    """

    states: np.ndarray
    positions: np.ndarray


class Stroboscope:
    """A device of a turn map's scene that runs on, seen once a turn.

    Parameters
    ----------
    turn_map : TurnMap
        Scene, cut and units.

    Attributes
    ----------
    turn_map : TurnMap
        The same.

    Raises
    ------
    ValueError
        For a scene in which nothing moves but the crank.
    """

    def __init__(self, turn_map: TurnMap):
        if not turn_map.names:
            raise ValueError(f"{turn_map.scene.name or 'scene'}: nothing moves in it but the crank; give it "
                             "effects.upper_mass or effects.inclined_mass")
        self.turn_map = turn_map
        self._device = Simulator(turn_map.scene)
        self._start = self._device.checkpoint()
        self._cut = 0.0  # s, the last cut

    def begin(self, state: np.ndarray) -> None:
        """Begin at the cut, in a state of shape (n,), the body at 0 (ValueError for a state that cannot be)."""
        self.turn_map.put(self._device, state)
        self._cut = 0.0

    def begin_as(self, **given: float) -> Cuts:
        """Begin as the scene starts, but with what is `given`, and go on to the first cut.

        Parameters
        ----------
        given : float
            As `Simulator.set_state` takes it, in SI units.

        Returns
        -------
        Cuts
            The first cut: within the first turn, or the start itself.

        Raises
        ------
        ValueError
            For a state that cannot be.
        SimulationError
            If the run cannot go on.
        """
        self._device.restore(self._start)
        if given:
            self._device.set_state(**given)
        ahead = (self.turn_map.phase - self._device.state.crank_angle) % TURN / TURN
        self._cut = (ahead - 1.0) * self.turn_map.period
        return self.turns(1)

    def turns(self, count: int) -> Cuts:
        """Go on over `count` turns; the cuts that follow the last one.

        Raises
        ------
        SimulationError
            If the run cannot go on.
        """
        times = self._cut + np.arange(1, count + 1) * self.turn_map.period
        samples = self._device.sample(times)
        self._device.take_events()  # or they would be kept
        self._cut = float(times[-1])
        states = np.column_stack([getattr(samples, name) for name in self.turn_map.names]) / self.turn_map.units
        return Cuts(states, samples.body_position)
