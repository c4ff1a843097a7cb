"""What a motion counts for `Simulator.statistics`: its events by kind, and its energy by accounts."""

from collections.abc import Sequence

import numpy as np

from vibro_ros.model.energy import ACCOUNTS, LOSSES, OF_DC_MOTOR
from vibro_ros.model.modes import MODE_EVENTS
from vibro_ros.model.tables import Model
from vibro_ros.simulation.samples import EVENT_DTYPE
from vibro_ros.solver import event_loop
from vibro_ros.solver.energy import MOTOR, stored_on_accounts
from vibro_ros.solver.events import MONITOR_KIND, PHASE_KIND, RAMP_KIND
from vibro_ros.solver.layout import Laid
from vibro_ros.solver.state import State


class EventLog:
    """The events that were not taken yet, and the counts of all events by kind; `plates` is `Forms.plates`."""

    def __init__(self, plates: Sequence[str]):
        self._kinds = np.zeros(PHASE_KIND + 1, dtype=EVENT_DTYPE["kind"])  # names by the solver's numbers
        self._kinds[:len(MODE_EVENTS)] = MODE_EVENTS
        self._kinds[PHASE_KIND] = "motor_ramp_end"
        for k, side in enumerate(plates):
            self._kinds[MONITOR_KIND + k], self._kinds[RAMP_KIND + k] = f"{side}_contact", "gap_reached"
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
            return np.empty(0, dtype=EVENT_DTYPE)
        raw = np.concatenate(self._untaken)
        self._untaken.clear()
        events = np.empty(len(raw), dtype=EVENT_DTYPE)
        events["time"], events["speed"], events["peak_force"], events["duration"] = raw[:, [0, 2, 3, 4]].T
        events["kind"] = self._kinds[raw[:, 1].astype(np.int64)]
        return events

    def mark(self) -> tuple[int, np.ndarray]:
        """Return a mark with which `drop_since` drops the events that are added from now on."""
        return len(self._untaken), self._counts.copy()

    def drop_since(self, mark: tuple[int, np.ndarray]) -> None:
        """Drop, and do not count, the events that were added since `mark`; none may have been taken since."""
        del self._untaken[mark[0]:]
        self._counts = mark[1]

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


def energy_accounts(model: Model, state: State, time: float) -> dict[str, float]:
    """Return the energy accounts since t = 0 [J] that `Simulator.statistics` describes.

    The scene has `solver.accounts`; `time` [s] lies within the present segment of `state`, which is not changed.
    """
    # Interrupting the state books all work up to this instant; a copy is interrupted.
    ended = state._replace(**{name: getattr(state, name).copy()
                              for name in state._fields if name not in ("library", "scratch")})
    point = np.zeros(model.forms.channels.count)
    event_loop.interrupt(model.laid.layout, Laid(ended).layout, time, point)
    accounts, mode = ended.now["accounts"][0], int(ended.now["automaton"]["mode"][0])
    work, magnitude = dict(zip(ACCOUNTS, map(float, accounts["work"]), strict=False)), float(accounts["magnitude"])
    stored = stored_on_accounts(model.system, mode, point) - float(accounts["stored"])
    net = work.pop(ACCOUNTS[MOTOR])
    if not model.forms.has_rotor:
        work = {name: amount for name, amount in work.items() if name not in OF_DC_MOTOR}
    # A dc motor gives the sliders energy that its rotor and winding get from the supply, which has its own account.
    received = 0.0 if model.forms.has_rotor else net
    return {"motor_delivered": 0.5 * (magnitude + net), "motor_taken_back": 0.5 * (magnitude - net),
            **{name: 0.0 - amount if name in LOSSES else amount for name, amount in work.items()},
            "stored": stored, "residual": received + sum(work.values()) - stored}
