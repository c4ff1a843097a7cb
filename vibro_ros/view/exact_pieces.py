"""Pieces of stretches of a simulated run."""

from collections.abc import Sequence

import numpy as np

from vibro_ros.simulation.simulator import Simulator
from vibro_ros.view.pieces import Sampler, cut, extremes, fitted
from vibro_ros.view.stretch import Stretch, quiet_device

MOST_A_SECOND, MOST_OF_STEPS = 20_000, 2000
"""Pieces of a second, by the method exact and by another one, whose every step may be a border that nobody sees."""


class ExactPieces:
    """Makes the pieces of stretches.

    Parameters
    ----------
    names : sequence of str
        Quantities.
    instants : sequence of ndarray, each of shape (n,)
        Robot time [s] of every event.
    """

    def __init__(self, names: Sequence[str], instants: Sequence[np.ndarray]):
        self._names, self._instants = names, np.sort(np.concatenate([np.empty(0), *instants]))
        self._device: Simulator | None = None

    def largest(self, stretch: Stretch) -> np.ndarray:
        """Largest magnitude of each quantity in a stretch, shape (quantities,)."""
        return extremes(self._sampler(stretch), self._borders(stretch))

    def pieces(self, stretch: Stretch, allowed: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Borders [s] by robot time, and coefficients, of a stretch, and which quantities they resolve: see `fitted`.

        `allowed` are the largest coefficients that may be neglected (SI), shape (quantities,).
        """
        borders = self._borders(stretch)
        a_second = MOST_A_SECOND if stretch.scene["solver.method"] == "exact" else MOST_OF_STEPS
        most = len(borders) + a_second * (stretch.end - stretch.begin)
        borders, coefficients, resolved = fitted(self._sampler(stretch), borders, allowed, int(most))
        return borders + stretch.offset, coefficients, resolved

    def _borders(self, stretch: Stretch) -> np.ndarray:
        first, last = np.searchsorted(self._instants, [stretch.begin + stretch.offset, stretch.end + stretch.offset])
        commands = [time for time, _ in stretch.commands]
        return cut(stretch.begin, stretch.end,
                   np.concatenate([self._instants[first:last] - stretch.offset, commands]))

    def _sampler(self, stretch: Stretch) -> Sampler:
        if self._device is None or self._device.scene != stretch.scene:
            self._device = quiet_device(stretch.scene)
        device = self._device
        return lambda times: stretch.values(device, times, self._names)
