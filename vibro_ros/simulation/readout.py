"""The fields of `Samples`, computed from the channels that the solver samples, by `solver.readout`."""

from collections.abc import MutableMapping

import numpy as np

from vibro_ros.model.modes import OUTPUTS
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import Model
from vibro_ros.simulation.samples import FIELDS, Trace
from vibro_ros.solver.readout import SPECIAL, STANDING, read_samples

_LINEAR, _SPECIAL = (np.array([FIELDS.index(name) for name in names]) for names in (OUTPUTS, SPECIAL))
_AT_ONCE = 4096  # instants; their values are small enough for the processor's cache
# Height [m] that rounding may give to a body that stands on the ground.
_STANDING_HEIGHT = 1e-15


class Readout:
    """Computes a compiled scene's samples; for use by one thread."""

    def __init__(self, model: Model):
        self._model = model
        forms = model.forms
        self._drives = np.array([(FIELDS.index(f"{side}_drive_force"), forms.channels.signal_rate(k))
                                 for k, side in enumerate(forms.guides)], dtype=np.int64).reshape(-1, 2)
        self._values = np.empty((len(FIELDS), 1))
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

    def quantities(self, times: np.ndarray, trace: Trace) -> dict[str, np.ndarray]:
        """Return the fields of `Samples` at instants [s], as separate arrays, so that each can be kept by itself."""
        quantities = {name: np.empty(len(times)) for name in FIELDS}
        for first in range(0, len(times), _AT_ONCE):
            part = slice(first, min(first + _AT_ONCE, len(times)))
            sampled, values = trace.part(part.start, part.stop), np.empty((len(FIELDS), part.stop - first))
            slopes = self._slopes_where_standing(sampled.phases)
            read_samples(*self._arguments(times[part], sampled, slopes, values))
            for name, row in zip(FIELDS, values, strict=True):
                quantities[name][part] = row
        return quantities

    def _arguments(self, times: np.ndarray, trace: Trace, slopes: np.ndarray, values: np.ndarray) -> tuple:
        model = self._model
        return (_LINEAR, _SPECIAL, model.output, model.output_terms, model.forms.pressed_only, self._drives,
                self._linkage, slopes, times, *trace, values)

    def _slopes_where_standing(self, phases: np.ndarray) -> np.ndarray:
        """ds/dtheta [m/rad] of each signal where the crank stands, elsewhere 0; shape (signals, n)."""
        slopes, stands = np.zeros((len(self._model.sliders), len(phases))), abs(phases[:, 2]) <= STANDING
        if stands.any():
            for k, slider in enumerate(self._model.sliders):
                slopes[k, stands] = slider.slope(phases[stands, 1])
        return slopes


def cut_to_laws(scene: Scene, pressed_only: bool, quantities: MutableMapping[str, np.ndarray]) -> None:
    """Limit the forces among `quantities`, fields of `Samples` by name, to values that the laws of `scene` allow.

    A step of fixed length that has not seen an event yet goes on in the old mode, whose forces may break the laws: a
    plate that cannot pull would pull, and ground that the body has left would push. `pressed_only` says that the ground
    of the scene never pulls.
    """
    if pressed_only:
        normal = _positive(quantities["normal_force"])
        quantities["normal_force"] = np.where(quantities["body_height"] > _STANDING_HEIGHT, 0.0, normal)
    bound = max(scene.resting_frictions) * np.abs(quantities["normal_force"])
    quantities["friction_force"] = np.clip(quantities["friction_force"], -bound, bound) + 0.0  # no -0.0
    for side in scene.plates:
        if scene[f"effects.{side}_contact"] == "restitution" or not (
                scene["effects.adhesion"] and scene[f"{side}.plate.damping"]):
            quantities[f"{side}_plate_force"] = _positive(quantities[f"{side}_plate_force"])


def _positive(values: np.ndarray) -> np.ndarray:
    """Return the values that are positive, and 0.0 for the others; numpy's maximum of 0.0 and -0.0 may be either."""
    return np.where(values > 0.0, values, 0.0)

