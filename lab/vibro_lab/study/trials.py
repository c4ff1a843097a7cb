"""Trials of a robot: its values from random starts, its score, and the verification of an optimum.

A robot's values are the measures `MEASURED` from each start of its `Trials`; an `Objective` makes a score of them, a
quartile over the starts. `verified` finds the attractors of an optimum under several readings of the forces.
"""

import contextlib
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from vibro_lab.orbits.attractors import Attractor, group_starts
from vibro_lab.orbits.chaos import half_interval
from vibro_lab.study.command import Progress
from vibro_lab.study.execution import Execution
from vibro_lab.study.measures import drift_in, measure, measure_with_motion
from vibro_lab.study.space import Space
from vibro_ros import Scene, SimulationError, load_scene

#: Measures from which every score is computed: the columns of the values of a robot.
MEASURED = ("mean_speed", "mean_power", "delivered_power", "air_share", "supply_power")
#: Quantile over the starts that gives the score.
QUANTILE = 0.25
#: Score of a robot that cannot be simulated: below all others.
FAILED = -1e3
#: Columns of `MEASURED` with the share of the time in the air, and with the power from the supply.
AIR, SUPPLY = 3, 4
#: Column of `MEASURED` for each reading of P.
POWERS = {"net": 1, "delivered": 2, "supply": SUPPLY}
#: Sign of the mean speed for each direction; 0 for either.
DIRECTIONS = {"either": 0.0, "forward": 1.0, "backward": -1.0}


class Reading(NamedTuple):
    """Definition of the speed and power in a score.

    Attributes
    ----------
    power : str
        Name in `POWERS`.
    direction : str
        Name in `DIRECTIONS`.
    """

    power: str = "net"
    direction: str = "either"


def has_supply(scene: Scene) -> bool:
    """Whether the power from a motor's supply can be measured: for a dc motor, by the method `exact`."""
    return scene.has_rotor and scene["solver.method"] == "exact"


def went_on(values: np.ndarray) -> np.ndarray:
    """Whether all runs of a robot went on, from its values, shape (..., starts, measures): else all are NaN.

    The power from the supply does not count, because it is NaN without a dc motor.
    """
    return np.isfinite(values[..., :SUPPLY]).all(axis=(-2, -1))


def directed(speeds: np.ndarray, direction: str) -> np.ndarray:
    """Speeds [m/s], shape (starts,), positive in the given direction, or for `either` in that of their mean."""
    sign = DIRECTIONS[direction] or float(np.sign(np.mean(speeds))) or 1.0
    return sign * speeds


def speed(values: np.ndarray, reading: Reading) -> float:
    """Lower quartile of the speeds of a robot [m/s]; the least speed if one is not above 0.

    `values` has the shape (starts, measures), with columns `MEASURED`.
    """
    if not went_on(values):
        return FAILED
    speeds = directed(values[:, 0], reading.direction)
    return float(speeds.min() if speeds.min() <= 0.0 else np.quantile(speeds, QUANTILE))


def speed_per_power(values: np.ndarray, reading: Reading) -> float:
    """Lower quartile of V/P [m/J]; not above 0 if starts go in different directions or a power is not above 0."""
    quartile = speed(values, reading)
    if quartile <= 0.0:
        return quartile
    power = values[:, POWERS[reading.power]]
    if power.min() <= 0.0:
        return 0.0  # springs returned stored energy: the time was too short for a mean
    return float(np.quantile(directed(values[:, 0], reading.direction) / power, QUANTILE))


def cost_of_transport(values: np.ndarray, reading: Reading, weight: float) -> float:
    """Upper quartile over the starts of P / (M g V) [-], with M g = `weight` [N]; inf unless V, P and M g are above 0.
    """
    power = values[:, POWERS[reading.power]]
    if speed(values, reading) <= 0.0 or power.min() <= 0.0 or weight <= 0.0:
        return np.inf
    return float(np.quantile(power / (weight * np.abs(values[:, 0])), 1.0 - QUANTILE))


class Objective(NamedTuple):
    """Quantity that a search maximises.

    Attributes
    ----------
    unit : str
        Unit of the score.
    does : str
        Description for users.
    score : callable
        Returns the score from values and reading.
    needs_reaction : bool
        Whether it is meaningful only if energy balances.
    """

    unit: str
    does: str
    score: Callable[[np.ndarray, Reading], float]
    needs_reaction: bool


OBJECTIVES = {
    "speed": Objective("m/s", "mean speed", speed, False),
    "speed_per_power": Objective("m/J", "mean speed over mean power, the paper's F_opt = V/P", speed_per_power, True),
}
"""Every objective with one number, by its name."""


def check_reaction(scene: Scene, what: str) -> None:
    """Refuse a scene without reaction of the body's friction on the masses, in which power has no meaning.

    Raises
    ------
    ValueError
        If `effects.reaction` is false, with the remedy.
    """
    if not scene["effects.reaction"]:
        raise ValueError(f"--scene {scene.name}: has effects.reaction false, by which the masses do not pay for the "
                         f"body's friction, so that the mean power can be 0 and {what} has no bound; give a scene "
                         "with effects.reaction true such as device, or --objective speed")


#: Number of the first start for selection among the best candidates, and for verification; a search uses neither.
CHOOSING, VERIFYING = 10_000, 20_000


@dataclass(frozen=True)
class Trials:
    """Runs of a robot.

    Attributes
    ----------
    starts : int
        Number of random starts.
    settling, duration : float
        Settling time and measuring time of a run [s].
    first : int
        Number of the first start; those of a search begin at 0.
    """

    starts: int = 4
    settling: float = 2.0
    duration: float = 4.0
    first: int = 0

    @property
    def run_time(self) -> float:
        """Simulated time of all starts [s]."""
        return self.starts * (self.settling + self.duration)


def values_of(scene: Scene | None, trials: Trials) -> np.ndarray:
    """Values of `MEASURED` of a robot from each start, shape (starts, measures).

    All are NaN if a run cannot go on, and for a robot that cannot be built (None); the power from the supply also
    without a dc motor.
    """
    nothing = np.full((trials.starts, len(MEASURED)), np.nan)
    if scene is None:
        return nothing
    try:
        rows = [measure(scene, MEASURED, trials.settling, trials.duration, trials.first + number)
                for number in range(trials.starts)]
    except SimulationError:
        return nothing
    return np.array([[row[name] for name in MEASURED] for row in rows])


def values_of_many(scenes: Sequence[Scene], trials: Trials, execution: Execution) -> Generator[np.ndarray, None, None]:
    """Yield `values_of` for each of `scenes`, in their order."""
    return execution.rows(partial(_values_at, tuple(scenes), trials), range(len(scenes)), trials.run_time,
                          tuple({scene["solver.method"] for scene in scenes}))


def _values_at(scenes: tuple[Scene, ...], trials: Trials, number: int) -> np.ndarray:
    return values_of(scenes[number], trials)


_LOADS = ("mean_load", "unloaded_share")


class Mean(NamedTuple):
    """Mean over the starts of one attractor, and half the width of its 95 % interval, NaN for one start."""

    mean: float
    spread: float


@dataclass(frozen=True)
class Verified:
    """An attractor of the optimum under a reading of the forces.

    Attributes
    ----------
    reading : str
        Description of the reading.
    turns : int or None
        Turns after which the motion repeats itself; 0 without a period, None for starts that have not settled.
    starts : int
        Number of starts that lead to it.
    share, low, high : float
        Their share of all starts, and its 95 % confidence interval; dimensionless.
    speed : Mean
        Mean speed [m/s], forward positive. As all means, without an interval for starts that have not settled.
    least, largest : float
        Least and largest mean speed of its starts [m/s].
    power, delivered, supply : Mean
        Net and delivered mean power, and that from the supply of a dc motor, else NaN [W].
    ratio : Mean
        Absolute speed over the power of the reading of P [m/J].
    cost : float
        Cost of transport [-] with the same power; NaN if energy does not balance.
    drift : float
        Mean speed in the second half of the time minus that in the first [m/s], if significant, so that the means
        describe a transient; else 0, and for a periodic motion.
    load, unloaded, air : float
        `mean_load`, `unloaded_share` and `air_share` of `study.measures`; dimensionless.
    """

    reading: str
    turns: int | None
    starts: int
    share: float
    low: float
    high: float
    speed: Mean
    least: float
    largest: float
    power: Mean
    delivered: Mean
    supply: Mean
    ratio: Mean
    cost: float
    drift: float
    load: float
    unloaded: float
    air: float


def readings(scene: Scene) -> dict[str, Scene]:
    """Scenes for the verification by their descriptions: the scene itself, and variants with other effects or start."""
    of_device = load_scene("device").parameters
    others: dict[str, dict[str, object]] = {
        "the body is held on the ground by decree (`unilateral`)": {"effects.normal_force": "unilateral"},
        f"drawn starts that begin from `{'zero' if scene['start.state'] == 'rest' else 'rest'}`":
            {"start.state": "zero" if scene["start.state"] == "rest" else "rest"},
        "every effect of `device`": {name: value for name, value in of_device.items() if name.startswith("effects.")},
    }
    found = {f"as sought (`{scene.name}`)": scene}
    for words, changes in others.items():
        other = scene.with_parameters(changes)
        if other not in found.values():
            found[words] = other
    return found


def verified(space: Space, optimum: Mapping[str, float], reading: Reading, trials: Trials, execution: Execution,
             progress: Progress) -> list[Verified]:
    """Find the attractors of the optimum under each of `readings`, that of most starts first.

    Parameters
    ----------
    space : Space
        Search space, whose scene has the values of the other parameters.
    optimum : mapping
        Values of the varied parameters.
    reading : Reading
        Definition of the power.
    trials : Trials
        Number of starts, counted from `VERIFYING`, and times.
    execution : Execution
        Workers that run the trials.
    progress : Progress
        Counts the readings.
    """
    fresh = replace(trials, first=VERIFYING)
    scenes = {words: scene.with_parameters(optimum) for words, scene in readings(space.scene).items()}
    methods = tuple({scene["solver.method"]: None for scene in scenes.values()})
    runs = execution.rows(partial(_settled_at, tuple(scenes.values()), fresh), range(len(scenes)), fresh.run_time,
                          methods)
    rows: list[Verified] = []
    with contextlib.closing(runs):
        for (words, scene), found in zip(scenes.items(), runs, strict=True):
            values, motions, drifts = map(list, zip(*found, strict=True))
            table = np.column_stack([values, drifts])
            attractors, places = group_starts(motions, table[:, 0].tolist())
            rows += [_verified(words, scene, one, table[places == place], reading)
                     for place, one in enumerate(attractors)]
            progress.add(1)
    return rows


def _settled_at(scenes: tuple[Scene, ...], trials: Trials, number: int) -> list[tuple[list[float], Any, float]]:
    """Return for each start the values of `MEASURED` and `_LOADS`, the settled motion or None, and the drift.

    Values are NaN if the run cannot go on.
    """
    names, found = (*MEASURED, *_LOADS), []
    for start in range(trials.first, trials.first + trials.starts):
        try:
            values, motion, drift = measure_with_motion(
                scenes[number], names, trials.settling, trials.duration, start)
            found.append(([values[name] for name in names], motion, drift))
        except SimulationError:
            found.append(([math.nan] * len(names), None, math.nan))
    return found


def _verified(words: str, scene: Scene, attractor: Attractor, values: np.ndarray, reading: Reading) -> Verified:
    """Make a row from the values of one attractor's starts, shape (starts, measures + 1); the last column is the drift.
    """
    def mean(column: np.ndarray) -> Mean:
        settled = attractor.turns is not None  # else the starts may have different motions
        return Mean(float(column.mean()), float(half_interval(column)) if settled else math.nan)

    speed, power = values[:, 0], values[:, POWERS[reading.power]]
    net, delivered, supply = (mean(values[:, column]) for column in POWERS.values())
    weight = scene.total_mass * scene["gravity"]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = mean(np.abs(speed) / power)
    pays = scene["effects.reaction"] and power.mean() > 0.0 and speed.mean() != 0.0 and weight > 0.0
    return Verified(
        words, attractor.turns, attractor.starts, attractor.share, attractor.low, attractor.high, mean(speed),
        attractor.least, attractor.largest, net, delivered, supply, ratio,
        float(power.mean() / (weight * abs(speed.mean()))) if pays else math.nan,
        0.0 if attractor.turns else drift_in(values[:, -1], float(speed.mean())),
        *map(float, values[:, [len(MEASURED), len(MEASURED) + 1, AIR]].mean(axis=0)))
