"""The events of a motion: counted by kind, and kept until they are asked for."""

from collections.abc import Sequence

import numpy as np

from vibro_ros.model.modes import MODE_EVENTS
from vibro_ros.simulation.samples import EVENT_DTYPE
from vibro_ros.solver.events import MONITOR_KIND, PHASE_KIND, RAMP_KIND

_NONE = np.empty(0, dtype=EVENT_DTYPE)


class EventLog:
    """Events by kind.

    Parameters
    ----------
    plates : sequence of str
        Sides that have a plate, in the solver's order.
    """

    def __init__(self, plates: Sequence[str]):
        self._kinds = _names_of_kinds(plates)
        self._counts = np.zeros(len(self._kinds), dtype=np.int64)
        self._untaken: list[np.ndarray] = []

    def add(self, events: np.ndarray) -> None:
        """Add events as the solver records them, shape (n, EVENT_COLUMNS); a copy is kept."""
        if len(events) == 0:
            return
        self._untaken.append(events.copy())
        self._counts += np.bincount(events[:, 1].astype(np.int64), minlength=len(self._counts))

    def take(self) -> np.ndarray:
        """Return the events added since the last call, in the order in which they ended; dtype `EVENT_DTYPE`."""
        if not self._untaken:
            return _NONE
        raw = np.concatenate(self._untaken)
        self._untaken.clear()
        events = np.empty(len(raw), dtype=EVENT_DTYPE)
        events["time"], events["speed"], events["peak_force"], events["duration"] = raw[:, [0, 2, 3, 4]].T
        events["kind"] = self._kinds[raw[:, 1].astype(np.int64)]
        return events

    def drop_untaken(self) -> None:
        """Drop the events that were not taken; they stay counted."""
        self._untaken.clear()

    def counts(self) -> dict[str, int]:
        """Return how many events of each kind have been added; kinds without one are left out."""
        counts: dict[str, int] = {}
        for kind in np.flatnonzero(self._counts):
            name = str(self._kinds[kind])
            counts[name] = counts.get(name, 0) + int(self._counts[kind])
        return counts


def _names_of_kinds(plates: Sequence[str]) -> np.ndarray:
    """Return the names of the kinds of recorded events, by the solver's numbers."""
    names = np.zeros(PHASE_KIND + 1, dtype=EVENT_DTYPE["kind"])
    names[:len(MODE_EVENTS)] = MODE_EVENTS
    names[PHASE_KIND] = "motor_ramp_end"
    for k, side in enumerate(plates):
        names[MONITOR_KIND + k], names[RAMP_KIND + k] = f"{side}_contact", "gap_reached"
    return names
