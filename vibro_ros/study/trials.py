"""Trials of a robot: its values from drawn starts, its score, and what an optimum is worth.

A robot's values are `MEASURED` from each start of some `Trials`; an `Objective` makes a score of them, by the poorer
quarter of the starts. `verified` tells the attractors of an optimum under several readings of the forces,
`neighbourhood` perturbs it, and `behaviour_of` says how it moves and where its energy goes.
"""

import contextlib
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import qmc, sobol_indices

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.attractors import Attractor, grouped
from vibro_ros.orbits.chaos import half_interval
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.study.command import (
    Progress,
)
from vibro_ros.study.execution import Execution
from vibro_ros.study.measures import device_at_start, measure, measure_with_motion
from vibro_ros.study.space import Space, Variable

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


def values_of(scene: Scene | None, trials: Trials, measures: Sequence[str] = MEASURED) -> np.ndarray:
    """Measures of a robot from each start, shape (starts, measures).

    NaN if a run cannot go on, and for a robot that cannot be built (None).
    """
    nothing = np.full((trials.starts, len(measures)), np.nan)
    if scene is None:
        return nothing
    try:
        rows = [measure(scene, measures, trials.settling, trials.duration, trials.first + number)
                for number in range(trials.starts)]
    except SimulationError:
        return nothing
    return np.array([[row[name] for name in measures] for row in rows])


def values_of_many(scenes: Sequence[Scene | None], trials: Trials, execution: Execution,
                   measures: Sequence[str] = MEASURED) -> Generator[np.ndarray, None, None]:
    """Yield `values_of` of each of `scenes`, in their order."""
    methods = {scene["solver.method"]: None for scene in scenes if scene is not None}
    return execution.rows(partial(_values_at, tuple(scenes), trials, measures), range(len(scenes)), trials.run_time,
                          tuple(methods))


def _values_at(scenes: tuple[Scene | None, ...], trials: Trials, measures: Sequence[str], number: int) -> np.ndarray:
    return values_of(scenes[number], trials, measures)


PERTURBATION = 0.05
"""Parts of a value, or of half a linear interval, by which a parameter is perturbed."""
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
            values, motions = np.array([one for one, _ in found]), [motion for _, motion in found]
            attractors, places = grouped(motions, values[:, 0].tolist())
            rows += [_verified(words, scene, one, values[places == place], reading)
                     for place, one in enumerate(attractors)]
            progress.add(1)
    return rows


def _settled_at(scenes: tuple[Scene, ...], trials: Trials, number: int) -> list[tuple[list[float], Any]]:
    """`MEASURED` and `_LOADS` of a robot from each start, NaN if a run cannot go on, and the motion it has settled to.
    """
    names, found = (*MEASURED, *_LOADS), []
    for start in range(trials.first, trials.first + trials.starts):
        try:
            values, motion = measure_with_motion(scenes[number], names, trials.settling, trials.duration, start)
            found.append(([values[name] for name in names], motion))
        except SimulationError:
            found.append(([math.nan] * len(names), None))
    return found


def _verified(words: str, scene: Scene, attractor: Attractor, values: np.ndarray, reading: Reading) -> Verified:
    """A row from the values of the starts of one attractor, shape (starts, measures)."""
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
        *map(float, values[:, [len(MEASURED), len(MEASURED) + 1, AIR]].mean(axis=0)))


def perturbed(space: Space, parameters: Mapping[str, float], shifts: Mapping[str, float]) -> Scene | None:
    """The robot with some parameters perturbed, also beyond their bounds; None where limits that join them refuse it.

    Parameters
    ----------
    space : Space
        Of the robot.
    parameters : mapping
        Its varied parameters.
    shifts : mapping
        Name to the shift, -1 to 1, in `PERTURBATION`s.
    """
    by_name = {variable.name: variable for variable in space.variables}
    values = {name: _shifted(space, by_name[name], value, shifts.get(name, 0.0), parameters)
              for name, value in parameters.items()}
    values = {name: min(max(value, BY_NAME[name].minimum), BY_NAME[name].maximum) for name, value in values.items()}
    full = {**space.scene.parameters, **values}
    upper, inclined = full["crank.upper_rod"], full["crank.inclined_rod"]
    lengths = {"crank.radius": min(full["crank.radius"], upper, inclined),
               "upper.gap": min(max(full["upper.gap"], -upper), upper),
               "inclined.gap": min(max(full["inclined.gap"], -inclined), inclined)}
    try:
        return space.scene.with_parameters({**values, **lengths})
    except ValueError:
        return None


def _shifted(space: Space, variable: Variable, value: float, shift: float, parameters: Mapping[str, float]) -> float:
    if variable.logarithmic:
        return value * (1.0 + PERTURBATION * shift)
    low, high = space.interval(variable, parameters)
    return value + PERTURBATION * shift * (high - low) / 2.0


def one_at_a_time(space: Space, parameters: Mapping[str, float]) -> Sequence[tuple[str, float, Scene | None]]:
    """Each varied parameter perturbed downwards and upwards: its name, the shift, the robot."""
    return [(variable.name, shift, perturbed(space, parameters, {variable.name: shift}))
            for variable in space.variables for shift in (-1.0, 1.0)]


_QUANTILES = (0.05, 0.5)
_RESAMPLES, _NORMAL = 100, 1.959963984540054  # of the bootstrap, and 95 % of the normal distribution


@dataclass(frozen=True)
class Sensitivity:
    """What a parameter of the optimum does to the score.

    Attributes
    ----------
    name : str
        Of the parameter.
    lower, upper : float
        Score with this parameter alone perturbed downwards and upwards, over that of the optimum; dimensionless.
    first, first_spread : float
        First-order index, and half the width of its 95 % interval; dimensionless.
    total, total_spread : float
        Total index, and half the width of its 95 % interval; dimensionless.
    """

    name: str
    lower: float
    upper: float
    first: float
    first_spread: float
    total: float
    total_spread: float


@dataclass(frozen=True)
class Neighbourhood:
    """The robots around an optimum.

    Attributes
    ----------
    score : float
        Of the optimum from the same starts, in the objective's unit.
    sensitivities : tuple of Sensitivity
        One a varied parameter.
    robots : int
        Number of robots that were drawn.
    poorest, median : float
        Score that 95 %, and half, of the robots around exceed, over that of the optimum; dimensionless.
    """

    score: float
    sensitivities: tuple[Sensitivity, ...]
    robots: int
    poorest: float
    median: float


def robot_count(space: Space, samples: int) -> int:
    """Number of robots that `neighbourhood` simulates."""
    return 1 + 2 * space.dimension + samples * (space.dimension + 2)


def neighbourhood(space: Space, optimum: Mapping[str, float], score: Callable[[np.ndarray], float], trials: Trials,
                  samples: int, seed: int, execution: Execution, progress: Progress) -> Neighbourhood:
    """Perturb an optimum.

    Parameters
    ----------
    space : Space
        What is varied.
    optimum : mapping
        Values of the varied parameters.
    score : callable
        Of a robot's values; a robot that cannot be built, or whose score is below 0, counts as 0.
    trials : Trials
        Its starts are counted from `VERIFYING` on.
    samples : int
        Points of a Sobol sequence, a power of two; each makes dimension + 2 robots.
    seed : int
        Of the sequence's scrambling.
    execution : Execution
        Who computes.
    progress : Progress
        Counts every robot.
    """
    names, dimension = [variable.name for variable in space.variables], space.dimension
    shifts = _saltelli_sample(dimension, samples, seed)
    robots = [perturbed(space, optimum, {}), *(robot for _, _, robot in one_at_a_time(space, optimum)),
              *(perturbed(space, optimum, dict(zip(names, shift, strict=True)))
                for shift in shifts.reshape(-1, dimension))]
    scores = []
    for values in values_of_many(robots, replace(trials, first=VERIFYING), execution):
        scores.append(max(score(values), 0.0))
        progress.add(1)
    alone, together = np.array(scores[1:1 + 2 * dimension]), np.array(scores[1 + 2 * dimension:])
    rows = zip(names, alone.reshape(-1, 2) / scores[0], _indices(together.reshape(dimension + 2, samples), seed),
               strict=True)
    poorest, median = np.quantile(together, _QUANTILES) / scores[0]
    return Neighbourhood(
        float(scores[0]), tuple(Sensitivity(name, *map(float, (*pair, *index))) for name, pair, index in rows),
        len(together), float(poorest), float(median))


def _saltelli_sample(dimension: int, samples: int, seed: int) -> np.ndarray:
    """Points from -1 to 1 for `_indices`, shape (dimension + 2, samples, dimension): two independent sets, then the
    first one with each column in turn that of the second."""
    first, second = np.split(2.0 * qmc.Sobol(2 * dimension, seed=seed).random(samples) - 1.0, 2, axis=1)
    mixed = np.repeat(first[None], dimension, axis=0)
    for column in range(dimension):
        mixed[column, :, column] = second[:, column]
    return np.concatenate([first[None], second[None], mixed])


def _indices(scores: np.ndarray, seed: int) -> np.ndarray:
    """First-order and total indices of the scores at the points of `_saltelli_sample`, and half their 95 % intervals by
    a seeded bootstrap: shape (dimension, 4), in the order first, its half, total, its half; all 0 of equal scores."""
    def indices(of: np.ndarray) -> np.ndarray:
        found = sobol_indices(func={"f_A": of[:1], "f_B": of[1:2], "f_AB": of[2:, None]}, n=of.shape[1])
        return np.nan_to_num(np.stack([np.ravel(found.first_order), np.ravel(found.total_order)]))

    draw, count = np.random.default_rng(seed), scores.shape[1]
    with np.errstate(all="ignore"):
        found = indices(scores)
        again = np.array([indices(scores[:, draw.integers(0, count, count)]) for _ in range(_RESAMPLES)])
    halves = _NORMAL * again.std(axis=0)
    return np.column_stack([found[0], halves[0], found[1], halves[1]])


_MEASURES = ("upper_impacts", "inclined_impacts", "upper_peak_force", "inclined_peak_force", "stick_share", "air_share")
#: The accounts of energy that are shown, in the words of the tables.
ACCOUNTS = {"motor_delivered": "motor delivers", "motor_taken_back": "springs return to the motor",
            "unpaid": "unpaid (artefact without reaction)", "drive_dampers": "lost in drive dampers",
            "plate_dampers": "lost in plate dampers", "friction": "lost by ground friction", "blows": "lost in blows",
            "landings": "lost in landings", "stored": "stored"}


@dataclass(frozen=True)
class Behaviour:
    """A robot from one start.

    Attributes
    ----------
    measures : mapping
        Values of `study.measures` by name.
    powers : mapping
        Mean power [W] of each of `ACCOUNTS`; empty where the scene's method keeps no accounts.
    """

    measures: Mapping[str, float]
    powers: Mapping[str, float]


def behaviour_of(scene: Scene, trials: Trials) -> Behaviour:
    """Behaviour of a robot from the first start of `VERIFYING`; times as in `trials`.

    Raises
    ------
    SimulationError
        If a run cannot go on.
    """
    measures = measure(scene, _MEASURES, trials.settling, trials.duration, VERIFYING)
    if scene["solver.method"] != "exact":
        return Behaviour(measures, {})
    device = device_at_start(scene.with_parameters({"solver.accounts": True}), VERIFYING)
    booked = []
    for time in (trials.settling, trials.settling + trials.duration):
        device.advance_to(time)
        booked.append(device.statistics["energy_accounts"])
    return Behaviour(measures, {name: (booked[1][name] - booked[0][name]) / trials.duration for name in ACCOUNTS})
