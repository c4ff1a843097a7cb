"""The search for the best robot: candidates in groups, proposed by a library and evaluated or replayed here.

Thousands of candidates of seventeen numbers, scores that chaos makes noisy, and several hills: CMA-ES with restarts in
two sizes of population (BIPOP, Hansen 2009) is made for this. Differential evolution is the baseline to be beaten.
"""

import itertools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import cma
import numpy as np
from scipy.optimize import differential_evolution

from vibro_ros.study.optimise.evaluation import Trials, values_of_many
from vibro_ros.study.optimise.record import Record
from vibro_ros.study.optimise.space import Space
from vibro_ros.study.progress import Progress

#: First standard deviation of CMA-ES in parts of the cube's edge.
SIGMA = 0.3
# A run of CMA-ES ends when its steps are shorter than this part of the edge, or the scores of a group differ by less
# than this part of the first group's: the noise is larger.
_FINE = 1e-3
# Candidates a coordinate of a population of differential evolution.
_POPULATION = 4

Scores = Callable[[np.ndarray], np.ndarray]


class Candidates(NamedTuple):
    """Robots that were evaluated.

    Attributes
    ----------
    points : ndarray, shape (n, dimension)
        In the unit cube.
    values : ndarray, shape (n, starts, measures)
        Columns as `objective.MEASURED`.
    """

    points: np.ndarray
    values: np.ndarray


class SpentError(Exception):
    """The budget is used up: ends a library's loop."""


class Evaluations:
    """The values of one group of candidates after another, until the budget is spent.

    Parameters
    ----------
    space : Space
        What a candidate means.
    trials : Trials
        The runs of a candidate.
    record : Record
        Gives the values of groups that it holds, and is given those of others.
    budget : int
        No group begins beyond so many candidates.
    workers : int
        Processes.
    progress : Progress
        Is told of every candidate that is done.
    """

    def __init__(self, space: Space, trials: Trials, record: Record, budget: int, workers: int, progress: Progress):
        self._space, self._trials, self._record = space, trials, record
        self._budget, self._workers, self._progress = budget, workers, progress
        self._groups: list[Candidates] = []
        self._count = 0

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Values of a group, shape (n, starts, measures); `SpentError` when there is no budget for one more.

        Raises
        ------
        SpentError, ValueError, OSError
            As `Record` for the last two.
        """
        if self._count >= self._budget:
            raise SpentError
        points = np.clip(points, 0.0, 1.0)
        values = self._record.recorded(len(self._groups), points)
        if values is None:
            values = np.array(list(self._computed(points)))
            self._record.append(points, values)
        else:
            self._progress.add(len(points))
        self._groups.append(Candidates(points, values))
        self._count += len(points)
        return values

    def gathered(self) -> Candidates:
        """Every candidate so far, in their order."""
        if not self._groups:
            return Candidates(np.empty((0, self._space.dimension)), np.empty((0, self._trials.starts, 0)))
        return Candidates(*map(np.concatenate, zip(*self._groups, strict=True)))

    def _computed(self, points: np.ndarray) -> Iterator[np.ndarray]:
        robots = [self._space.buildable(point) for point in points]
        for values in values_of_many(robots, self._trials, self._workers):
            self._progress.add(1)
            yield values


def descend(scores: Scores, begin: np.ndarray, sigma: float, seed: int) -> None:
    """CMA-ES with BIPOP restarts, until `scores` raises what ends it, or after nine restarts.

    Parameters
    ----------
    scores : callable
        Scores of points, shape (n, dimension); the larger the better.
    begin : ndarray, shape (dimension,)
        Where the first run begins; the others begin at drawn points.
    sigma : float
        First standard deviation, in parts of the cube's edge; dimensionless.
    seed : int
        Of all draws.
    """
    draw, first = np.random.default_rng(seed), [begin]
    # cma takes 0 for a seed of the clock
    options = {"bounds": [0.0, 1.0], "seed": seed + 1, "verbose": -9, "verb_log": 0, "tolx": _FINE, "tolfunrel": _FINE}
    cma.fmin2(None, lambda: first.pop() if first else draw.random(len(begin)), sigma, options, restarts=9, bipop=True,
              parallel_objective=lambda points, *_: list(-scores(np.array(points))))


def by_cma(scores: Scores, dimension: int, seed: int) -> None:
    """CMA-ES from the middle of the cube until `SpentError`."""
    for number in itertools.count(seed):
        descend(scores, np.full(dimension, 0.5), SIGMA, number)


def by_differential_evolution(scores: Scores, dimension: int, seed: int) -> None:
    """Differential evolution until `SpentError`, its population first a Sobol sequence, its steps those of scipy."""
    for number in itertools.count(seed):
        differential_evolution(lambda points: -scores(points.T), [(0.0, 1.0)] * dimension, vectorized=True, seed=number,
                               updating="deferred", polish=False, init="sobol", tol=_FINE, popsize=_POPULATION)


METHODS = {"cma": by_cma, "differential_evolution": by_differential_evolution}
"""Every method of search by its name."""


def search(method: str, evaluations: Evaluations, score: Callable[[np.ndarray], float], dimension: int,
           seed: int) -> None:
    """Search by a method of `METHODS` until the budget is spent; `score` makes a number of a candidate's values."""
    def scores(points: np.ndarray) -> np.ndarray:
        return np.array([score(values) for values in evaluations(points)])

    try:
        METHODS[method](scores, dimension, seed)
    except SpentError:
        pass
