"""What a study of accuracy measures: distances from a reference, and the row of a table that holds them."""

import math
from dataclasses import astuple, dataclass

import numpy as np
from scipy.spatial.distance import directed_hausdorff

from vibro_ros.accuracy.methods import COLUMNS, Answer

_BODY, _HEIGHT = COLUMNS.index("body_position"), COLUMNS.index("body_height")
_MASSES = [COLUMNS.index("upper_position"), COLUMNS.index("inclined_position")]
# Contacts that a scene begins with may count as events or not [s].
_BEGINNING = 1e-3


@dataclass(frozen=True)
class Errors:
    """Distances of an answer from a reference.

    Attributes
    ----------
    body : float
        Largest error of the body's position along the ground [m].
    height : float
        Largest error of its height above it [m].
    masses : float
        Largest error of a mass's position along its guide [m].
    events : float
        Largest distance in time [s] of a contact from the nearest of its kind in the other answer, both ways, so that
        a contact too many or too few counts too; infinite where one answer has none of a kind; NaN where the
        method has no events at all or nothing touches.
    speed : float
        Error of the mean speed from t = 0 to the end [m/s].
    """

    body: float
    height: float
    masses: float
    events: float
    speed: float

    @property
    def path(self) -> float:
        """Largest error [m] of the body's path: along the ground or above it."""
        return float(np.maximum(self.body, self.height))

    @property
    def positions(self) -> float:
        """Largest error of any position [m]: of the body, its height or a mass; NaN if one is no number."""
        return float(np.maximum(self.path, self.masses))

    @property
    def finite(self) -> bool:
        """Whether the positions are numbers at all."""
        return math.isfinite(self.positions)

    def __iter__(self):
        return iter(astuple(self))


def errors(answer: Answer, reference: Answer) -> Errors:
    """Errors of `answer` at the instants that it shares with `reference`."""
    off = np.abs(answer.samples - reference.samples)
    ends = answer.samples[[0, -1], _BODY] - reference.samples[[0, -1], _BODY]
    duration = reference.times[-1] - reference.times[0]
    return Errors(float(off[:, _BODY].max()), float(off[:, _HEIGHT].max()), float(off[:, _MASSES].max()),
                  _event_error(answer, reference), float(abs(ends[1] - ends[0]) / duration))


def _event_error(answer: Answer, reference: Answer) -> float:
    found, expected = _contacts(answer), _contacts(reference)
    if len(answer.events) == 0 or not expected:
        return math.nan
    if found.keys() != expected.keys():
        return math.inf
    return max(max(directed_hausdorff(some, others)[0], directed_hausdorff(others, some)[0])
               for kind in expected for some, others in [(found[kind][:, None], expected[kind][:, None])])


def _contacts(answer: Answer) -> dict[str, np.ndarray]:
    """Instants [s] of contacts by kind, ascending; kinds without one are left out."""
    events = answer.events[answer.events["time"] > _BEGINNING]
    kinds = (kind for kind in np.unique(events["kind"]) if kind.endswith("_contact"))
    return {str(kind): np.sort(events["time"][events["kind"] == kind]) for kind in kinds}


TRAJECTORY, NEED, AVERAGE, REFERENCE = "trajectory", "need", "mean speed", "reference"


@dataclass(frozen=True)
class Measurement:
    """One setting of one method in one scene; NaN where a number does not apply.

    `compared` is `TRAJECTORY` (the errors are distances within `horizon`), `NEED` (the same, within `SHORT` or `LONG`),
    `AVERAGE` (`mean_speed` and its 95 % interval, over `repeats` starts of `horizon` seconds, of which
    `starts_forwards` have a positive one) or `REFERENCE` (the errors are those of the exact method against the
    independent method named). `cost` is a ratio to the baseline's, `wall_time` in seconds; lengths in m, times in s,
    speeds in m/s.
    """

    scene: str
    compared: str
    method: str
    setting: str
    value: float
    horizon: float
    repeats: int
    wall_time: float = math.nan
    cost: float = math.nan
    body_error: float = math.nan
    height_error: float = math.nan
    mass_error: float = math.nan
    event_error: float = math.nan
    speed_error: float = math.nan
    mean_speed: float = math.nan
    mean_speed_spread: float = math.nan
    starts_forwards: int = 0
    note: str = ""

    @property
    def errors(self) -> Errors:
        """All errors together."""
        return Errors(self.body_error, self.height_error, self.mass_error, self.event_error, self.speed_error)

    @property
    def path_error(self) -> float:
        """Largest error [m] of the body's path: along the ground or above it."""
        return self.errors.path

    @property
    def position_error(self) -> float:
        """Largest error [m] of any position: of body, height or a mass."""
        return self.errors.positions
