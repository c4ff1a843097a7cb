"""What becomes of an optimum whose parameters are not quite those that were sought.

One parameter after the other is made a little smaller and a little larger; then all vary together, and Sobol's indices
tell which of them the score depends on: alone (first order) and with all its interactions (total).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from SALib.analyze import sobol as sobol_analysis
from SALib.sample import sobol as sobol_sample

from vibro_ros.study.optimise.evaluation import VERIFYING, Trials, values_of_many
from vibro_ros.study.optimise.space import Space
from vibro_ros.study.optimise.verification import one_at_a_time, perturbed
from vibro_ros.study.progress import Progress

_QUANTILES = (0.05, 0.5)


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
                  samples: int, seed: int, workers: int, progress: Progress) -> Neighbourhood:
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
    workers : int
        Processes.
    progress : Progress
        Is told of every robot.
    """
    names = [variable.name for variable in space.variables]
    problem = {"num_vars": space.dimension, "names": names, "bounds": [[-1.0, 1.0]] * space.dimension}
    shifts = sobol_sample.sample(problem, samples, calc_second_order=False, seed=seed)
    robots = [perturbed(space, optimum, {}), *(robot for _, _, robot in one_at_a_time(space, optimum)),
              *(perturbed(space, optimum, dict(zip(names, shift, strict=True))) for shift in shifts)]
    scores = []
    for values in values_of_many(robots, replace(trials, first=VERIFYING), workers):
        scores.append(max(score(values), 0.0))
        progress.add(1)
    alone, together = np.array(scores[1:1 + 2 * space.dimension]), np.array(scores[1 + 2 * space.dimension:])
    indices = sobol_analysis.analyze(problem, together, calc_second_order=False, seed=seed)
    rows = zip(names, alone.reshape(-1, 2) / scores[0], indices["S1"], indices["S1_conf"], indices["ST"],
               indices["ST_conf"], strict=True)
    poorest, median = np.quantile(together, _QUANTILES) / scores[0]
    return Neighbourhood(
        float(scores[0]), tuple(Sensitivity(name, *map(float, (*pair, *index))) for name, pair, *index in rows),
        len(together), float(poorest), float(median))
