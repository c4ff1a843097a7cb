"""What is sought: a score of a robot from its speeds and powers over several starts.

A robot that was lucky in one start must not win. So all candidates have the same starts, and the score is the lower
quartile over these. The robot may go either way, but the same way from all starts: the score of a robot whose starts
disagree is the speed of the worst against the others, which is not above 0, so that a search is led back to robots
that agree.

Power is mean mechanical power: the work of the motor less what the springs return to it (`mean_power`), or only the
work that the motor delivers, as of a drive that cannot brake usefully (`delivered_power`).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene

#: Measures that every score is made of, the columns of the values of a robot.
MEASURED = ("mean_speed", "mean_power", "delivered_power")
#: Quantile of the starts that counts.
QUANTILE = 0.25
#: Score of a robot that cannot be simulated: below every other.
FAILED = -1e3
#: Column of `MEASURED` that each reading of P takes.
POWERS = {"net": 1, "delivered": 2}
#: Sign of the mean speed that counts; 0 for either.
DIRECTIONS = {"either": 0.0, "forward": 1.0, "backward": -1.0}


class Reading(NamedTuple):
    """How speeds and powers are read.

    Attributes
    ----------
    power : str
        Of `POWERS`.
    direction : str
        Of `DIRECTIONS`.
    """

    power: str = "net"
    direction: str = "either"


def directed(speeds: np.ndarray, direction: str) -> np.ndarray:
    """Speeds [m/s], shape (starts,), counted positive in the direction asked for, or in that of their mean."""
    sign = DIRECTIONS[direction] or float(np.sign(np.mean(speeds))) or 1.0
    return sign * speeds


def speed(values: np.ndarray, reading: Reading) -> float:
    """Lower quartile [m/s] of the speeds of a robot; `values` of shape (starts, measures), columns `MEASURED`."""
    if not np.isfinite(values).all():
        return FAILED
    speeds = directed(values[:, 0], reading.direction)
    return float(speeds.min() if speeds.min() <= 0.0 else np.quantile(speeds, QUANTILE))


def speed_per_power(values: np.ndarray, reading: Reading) -> float:
    """Lower quartile of V/P [m/J]; not above 0 where starts disagree or a power is not above 0."""
    pace = speed(values, reading)
    if pace <= 0.0:
        return pace
    power = values[:, POWERS[reading.power]]
    if power.min() <= 0.0:
        return 0.0  # springs returned stored energy: the time was too short to tell a mean
    return float(np.quantile(directed(values[:, 0], reading.direction) / power, QUANTILE))


def cost_of_transport(values: np.ndarray, reading: Reading, weight: float) -> float:
    """P / (M g V) [-] with means over the starts, and M g = `weight` [N]; inf where there is no such cost."""
    if speed(values, reading) <= 0.0 or values[:, POWERS[reading.power]].mean() <= 0.0 or weight <= 0.0:
        return np.inf
    return float(values[:, POWERS[reading.power]].mean() / (weight * abs(values[:, 0].mean())))


class Objective(NamedTuple):
    """What a search maximises.

    Attributes
    ----------
    unit : str
        Of the score.
    does : str
        In words, for users.
    score : callable
        Score from values and reading.
    needs_reaction : bool
        Whether it has a meaning only where energy balances.
    """

    unit: str
    does: str
    score: Callable[[np.ndarray, Reading], float]
    needs_reaction: bool


OBJECTIVES = {
    "speed": Objective("m/s", "mean speed", speed, False),
    "speed_per_power": Objective("m/J", "mean speed over mean power, the paper's F_opt = V/P", speed_per_power, True),
}
"""Every objective of one number by its name."""


def check_reaction(scene: Scene, what: str) -> None:
    """Refuse a scene in which the masses do not pay for the body's friction, so that power measures nothing.

    Raises
    ------
    ValueError
        Naming the remedy.
    """
    if not scene["effects.reaction"]:
        raise ValueError(f"--scene {scene.name}: has effects.reaction false, by which the masses do not pay for the "
                         f"body's friction, so that the mean power can be 0 and {what} has no bound; give a scene "
                         "with effects.reaction true such as device, or --objective speed")
