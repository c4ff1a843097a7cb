"""Trials of a robot: its values from drawn starts, its score, and what an optimum is worth.

A robot's values are `MEASURED` from each start of some `Trials`; an `Objective` makes a score of them, by the poorer
quarter of the starts. `verified` tells the attractors of an optimum under several readings of the forces.
"""

import contextlib
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.attractors import Attractor, grouped
from vibro_ros.orbits.chaos import half_interval
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.study.command import Progress
from vibro_ros.study.execution import Execution
from vibro_ros.study.measures import drift_in, measure, measure_with_motion
from vibro_ros.study.space import Space

#: Measures that every score is made of, the columns of the values of a robot.
MEASURED = ("mean_speed", "mean_power", "delivered_power", "air_share")
#: Quantile of the starts that counts.
QUANTILE = 0.25
#: Score of a robot that cannot be simulated: below every other.
FAILED = -1e3
#: Column of `MEASURED` that each reading of P takes.
POWERS = {"net": 1, "delivered": 2}
#: Column of `MEASURED` that has the share of the time in the air.
AIR = 3
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
    quartile = speed(values, reading)
    if quartile <= 0.0:
        return quartile
    power = values[:, POWERS[reading.power]]
    if power.min() <= 0.0:
        return 0.0  # springs returned stored energy: the time was too short to tell a mean
    return float(np.quantile(directed(values[:, 0], reading.direction) / power, QUANTILE))


def cost_of_transport(values: np.ndarray, reading: Reading, weight: float) -> float:
    """Upper quartile over the starts of P / (M g V) [-], with M g = `weight` [N]; inf where there is no such cost."""
    power = values[:, POWERS[reading.power]]
    if speed(values, reading) <= 0.0 or power.min() <= 0.0 or weight <= 0.0:
        return np.inf
    return float(np.quantile(power / (weight * np.abs(values[:, 0])), 1.0 - QUANTILE))


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


#: First of the starts that choose among the best candidates, and of those that verify: no search has seen them.
CHOOSING, VERIFYING = 10_000, 20_000


@dataclass(frozen=True)
class Trials:
    """The runs of a robot.

    Attributes
    ----------
    starts : int
        Number of drawn starts.
    settling, duration : float
        Time of a run that does not count, and time that does [s].
    first : int
        Number of the first start; those of a search begin at 0.
    """

    starts: int = 4
    settling: float = 2.0
    duration: float = 4.0
    first: int = 0

    @property
    def run_time(self) -> float:
        """Robot time of all starts [s]."""
        return self.starts * (self.settling + self.duration)


def values_of(scene: Scene | None, trials: Trials) -> np.ndarray:
    """`MEASURED` of a robot from each start, shape (starts, measures).

    NaN if a run cannot go on, and for a robot that cannot be built (None).
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
    """Yield `values_of` of each of `scenes`, which have one method, in their order."""
    return execution.rows(partial(_values_at, tuple(scenes), trials), range(len(scenes)), trials.run_time,
                          tuple({scene["solver.method"] for scene in scenes}))


def _values_at(scenes: tuple[Scene, ...], trials: Trials, number: int) -> np.ndarray:
    return values_of(scenes[number], trials)


_LOADS = ("mean_load", "unloaded_share")


class Mean(NamedTuple):
    """A mean over the starts of one attractor, and half the width of its 95 % interval; NaN of one start."""

    mean: float
    spread: float


@dataclass(frozen=True)
class Verified:
    """An attractor of the optimum under a reading.

    Attributes
    ----------
    reading : str
        Which forces act.
    turns : int or None
        Turns after which it repeats itself; 0 without a period, None for starts that have not settled.
    starts : int
        Starts that lead to it.
    share, low, high : float
        Their part of all starts, and its 95 % confidence interval; dimensionless.
    speed : Mean
        Mean speed [m/s], forward positive.
    power, delivered : Mean
        Net and delivered mean power [W].
    ratio : Mean
        Speed, in either direction, over the power that is read [m/J].
    cost : float
        Cost of transport [-] with the power that is read; NaN where energy does not balance.
    drift : float
        How much faster [m/s] the second half of the time was, by which the means are those of a transient; 0 where no
        drift is known, and of a periodic motion.
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
    power: Mean
    delivered: Mean
    ratio: Mean
    cost: float
    drift: float
    load: float
    unloaded: float
    air: float


def readings(scene: Scene) -> dict[str, Scene]:
    """The scene, and what of other forces differs from it, each by what is different."""
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
    """The attractors of the optimum under every one of `readings`, that of most starts first.

    Parameters
    ----------
    space : Space
        Its scene gives what is not varied.
    optimum : mapping
        Values of the varied parameters.
    reading : Reading
        How powers are read.
    trials : Trials
        Its starts are counted from `VERIFYING` on.
    execution : Execution
        Who computes.
    progress : Progress
        Counts every reading.
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
            attractors, places = grouped(motions, table[:, 0].tolist())
            rows += [_verified(words, scene, one, table[places == place], reading)
                     for place, one in enumerate(attractors)]
            progress.add(1)
    return rows


def _settled_at(scenes: tuple[Scene, ...], trials: Trials, number: int) -> list[tuple[list[float], Any, float]]:
    """Of each start `MEASURED` and `_LOADS`, NaN if a run cannot go on, the motion it has settled to, and the drift."""
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
    """A row from the values of the starts of one attractor, shape (starts, measures + 1), the drift in the last."""
    def mean(column: np.ndarray) -> Mean:
        return Mean(float(column.mean()), float(half_interval(column)))

    speed, power = values[:, 0], values[:, POWERS[reading.power]]
    weight = scene.total_mass * scene["gravity"]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = mean(np.abs(speed) / power)
    pays = scene["effects.reaction"] and power.mean() > 0.0 and speed.mean() != 0.0 and weight > 0.0
    return Verified(
        words, attractor.turns, attractor.starts, attractor.share, attractor.low, attractor.high, mean(speed),
        mean(values[:, 1]), mean(values[:, 2]), ratio,
        float(power.mean() / (weight * abs(speed.mean()))) if pays else math.nan,
        0.0 if attractor.turns else drift_in(values[:, -1], float(speed.mean())),
        *map(float, values[:, [len(MEASURED), len(MEASURED) + 1, AIR]].mean(axis=0)))
