"""Results of a motion: fields of `Samples` from the channels that the solver samples, events, and energy accounts."""

from collections.abc import Mapping, Sequence

import numpy as np

from vibro_ros.model.energy import ACCOUNTS, LOSSES, OF_DC_MOTOR
from vibro_ros.model.modes import MODE_EVENTS, OUTPUTS
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import Model
from vibro_ros.simulation.samples import EVENT_DTYPE, FIELDS, Trace
from vibro_ros.solver import event_loop
from vibro_ros.solver.energy import MOTOR, stored_on_accounts
from vibro_ros.solver.events import MONITOR_KIND, PHASE_KIND, RAMP_KIND
from vibro_ros.solver.layout import Laid
from vibro_ros.solver.readout import SPECIAL, STANDING, read_samples
from vibro_ros.solver.state import State
from vibro_ros.solver.vector import LENGTH

_LINEAR, _SPECIAL = (np.array([FIELDS.index(name) for name in names]) for names in (OUTPUTS, SPECIAL))
_NO_EVENTS = np.empty(0, dtype=EVENT_DTYPE)
#: Instants whose channels and fields are in memory at a time: 350 kB, for which a processor's second cache has room. No
#: power of two, because then all fields of an instant would compete for the same place in the cache.
AT_ONCE = 1000
# Height [m] that rounding may give to a body that stands on the ground.
_STANDING_HEIGHT = 1e-15


class Readout:
    """Computes a compiled scene's samples; for use by one thread."""

    def __init__(self, model: Model):
        self._model = model
        forms = model.forms
        self._drives = np.array([(FIELDS.index(f"{side}_drive_force"), forms.channels.signal_rate(k))
                                 for k, side in enumerate(forms.guides)], dtype=np.int64).reshape(-1, 2)
        self._values, self._form_values = np.empty((len(FIELDS), 1)), np.empty(LENGTH)
        # Rows of the outputs that are forces on masses of the linkage, with the channel of its speed, and its signal.
        self._linkage = np.array([(len(OUTPUTS) + k, forms.channels.signal_rate(part.signal), part.signal)
                                  for k, part in enumerate(forms.linkage)], dtype=np.int64).reshape(-1, 3)
        self._slopes, self._slopes_at = np.zeros((len(model.sliders), 1)), np.nan

    def values(self, times: np.ndarray, trace: Trace) -> np.ndarray:
        """Return the values of all `FIELDS` at one instant [s], shape (fields,); the next call overwrites them."""
        angle = trace.phases[0, 1]
        # Slopes count only where the crank stands, and stay the same as long as it stands at the same angle.
        if abs(trace.phases[0, 2]) <= STANDING and angle != self._slopes_at:
            self._slopes, self._slopes_at = self._slopes_where_standing(trace.phases), angle
        read_samples(*self._arguments(times, trace, self._slopes, self._values))
        return self._values[:, 0]

    def fill(self, times: np.ndarray, trace: Trace, values: np.ndarray) -> None:
        """Fill the leading columns of `values`, shape (fields, n), with all `FIELDS` at instants [s]."""
        read_samples(*self._arguments(times, trace, self._slopes_where_standing(trace.phases), values))

    def _arguments(self, times: np.ndarray, trace: Trace, slopes: np.ndarray, values: np.ndarray) -> tuple:
        model = self._model
        return (_LINEAR, _SPECIAL, model.output_by_channel, model.forms.pressed_only, self._drives, self._linkage,
                slopes, times, *trace, self._form_values, values)

    def _slopes_where_standing(self, phases: np.ndarray) -> np.ndarray:
        """ds/dtheta [m/rad] of each signal where the crank stands, elsewhere 0; shape (signals, n)."""
        slopes, stands = np.zeros((len(self._model.sliders), len(phases))), abs(phases[:, 2]) <= STANDING
        if stands.any():
            for k, slider in enumerate(self._model.sliders):
                slopes[k, stands] = slider.slope(phases[stands, 1])
        return slopes


def cut_to_laws(scene: Scene, pressed_only: bool, quantities: Mapping[str, np.ndarray]) -> None:
    """Limit the forces among `quantities`, fields of `Samples` by name, in place to values that the laws of `scene`
    allow.

    A step of fixed length that has not seen an event yet goes on in the old mode, whose forces may break the laws: a
    plate that cannot pull would pull, and ground that the body has left would push. `pressed_only` says that the ground
    of the scene never pulls.
    """
    if pressed_only:
        normal = _positive(quantities["normal_force"])
        quantities["normal_force"][:] = np.where(quantities["body_height"] > _STANDING_HEIGHT, 0.0, normal)
    bound = max(scene.resting_frictions) * np.abs(quantities["normal_force"])
    quantities["friction_force"][:] = np.clip(quantities["friction_force"], -bound, bound) + 0.0  # no -0.0
    for side in scene.plates:
        if scene[f"effects.{side}_contact"] == "restitution" or not (
                scene["effects.adhesion"] and scene[f"{side}.plate.damping"]):
            quantities[f"{side}_plate_force"][:] = _positive(quantities[f"{side}_plate_force"])


def _positive(values: np.ndarray) -> np.ndarray:
    """Return the values that are positive, and 0.0 for the others; numpy's maximum of 0.0 and -0.0 may be either."""
    return np.where(values > 0.0, values, 0.0)


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
            return _NO_EVENTS
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
