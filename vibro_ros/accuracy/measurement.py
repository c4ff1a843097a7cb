"""What a work–precision study measures: one setting of one method in one scene, a line of the study's table."""

import math
from dataclasses import dataclass

from vibro_ros.accuracy.errors import Errors

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
