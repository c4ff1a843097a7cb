"""What an optimum is worth: fresh starts beside the paper's robots, its motion and energy, and its neighbourhood."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc, sobol_indices

from vibro_ros.accuracy.starts import Average, average, motions_of
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.study.execution import Execution
from vibro_ros.study.measures import device_at_start, measure
from vibro_ros.study.optimise.plan import (
    AIR,
    MEASURED,
    POWERS,
    VERIFYING,
    Reading,
    Trials,
    directed,
    values_of_many,
)
from vibro_ros.study.optimise.space import Space, Variable
from vibro_ros.study.progress import Progress

_LOADS = ("mean_load", "unloaded_share")
OPTIMUM, PAPER, SHIPPED = "optimum", "paper's optimum", "paper's parameters"
"""The robots that are compared."""

PAPERS_OPTIMUM: Mapping[str, float] = {
    "guide.angle": math.radians(80.0), "mass.inclined": 0.02, "crank.radius": 0.06}
"""What the paper's conclusions name; everything else as its parameters."""

#: Parts of a value, or of half a linear interval, by which a parameter is perturbed.
PERTURBATION = 0.05


@dataclass(frozen=True)
class Verified:
    """A robot under a reading, over starts.

    Attributes
    ----------
    reading, robot : str
        Which forces act, and which of `OPTIMUM`, `PAPER`, `SHIPPED`.
    speed : Average
        Mean speed [m/s], forward positive.
    motions : tuple of (float, float or None, int)
        Of each motion that the starts have: mean speed [m/s], half its interval, None for a single start, and starts.
    agree : bool
        Whether the robot goes the same way from all starts.
    power, delivered : Average
        Net and delivered mean power [W].
    ratio : Average
        Speed over the power that is read [m/J].
    cost : float
        Cost of transport [-] with the power that is read; NaN where energy does not balance.
    margin, ratio_margin : Average or None
        Speed and V/P of the optimum less those of this robot, each counted positive in its own direction, start by
        start; None for the optimum itself.
    load, unloaded, air : float
        Means over the starts of `mean_load`, `unloaded_share` and `air_share` of `study.measures`; dimensionless.
    """

    reading: str
    robot: str
    speed: Average
    motions: tuple[tuple[float, float | None, int], ...]
    agree: bool
    power: Average
    delivered: Average
    ratio: Average
    cost: float
    margin: Average | None
    ratio_margin: Average | None
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
    """The optimum, the paper's optimum and the paper's parameters under every one of `readings`.

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
        Counts every robot.
    """
    fresh = replace(trials, first=VERIFYING)
    robots = {OPTIMUM: dict(optimum), PAPER: dict(PAPERS_OPTIMUM), SHIPPED: {}}
    cases = [(words, robot, scene.with_parameters(changes)) for words, scene in readings(space.scene).items()
             for robot, changes in robots.items()]
    rows: list[Verified] = []
    best = np.empty(0)
    for (words, robot, scene), values in zip(cases, values_of_many([case[2] for case in cases], fresh, execution,
                                                                   (*MEASURED, *_LOADS)), strict=True):
        best = values if robot == OPTIMUM else best
        rows.append(_verified(words, robot, scene, values, best, reading))
        progress.add(1)
    return rows


def case_count(scene: Scene) -> int:
    """Number of robots that `verified` simulates."""
    return 3 * len(readings(scene))


def _verified(words: str, robot: str, scene: Scene, values: np.ndarray, best: np.ndarray,
              reading: Reading) -> Verified:
    speeds, column = directed(values[:, 0], reading.direction), POWERS[reading.power]
    ratios, is_best = _ratios(values, reading), values is best
    weight, mean_power = scene.total_mass * scene["gravity"], float(np.mean(values[:, column]))
    load, unloaded = (float(np.mean(one)) for one in values[:, len(MEASURED):].T)
    pays = scene["effects.reaction"] and mean_power > 0.0 and np.mean(speeds) > 0.0 and weight > 0.0
    return Verified(
        reading=words, robot=robot, speed=average(values[:, 0]), motions=tuple(
            (float(group.mean()), average(group).spread if len(group) > 1 else None, len(group))
            for group in motions_of(values[:, 0])), agree=bool((speeds > 0.0).all()),
        power=average(values[:, 1]), delivered=average(values[:, 2]), ratio=average(ratios),
        cost=mean_power / (weight * float(np.mean(speeds))) if pays else math.nan,
        margin=None if is_best else average(directed(best[:, 0], reading.direction) - speeds),
        ratio_margin=None if is_best else average(_ratios(best, reading) - ratios),
        load=load, unloaded=unloaded, air=float(np.mean(values[:, AIR])))


def _ratios(values: np.ndarray, reading: Reading) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return directed(values[:, 0], reading.direction) / values[:, POWERS[reading.power]]


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
