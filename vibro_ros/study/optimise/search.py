"""The search for the best robot: candidates in groups, proposed by a library, evaluated here and recorded."""

import itertools
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import cma
import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.study.optimise.plan import CHOOSING, FAILED, MEASURED, POWERS, Plan, Trials, values_of_many
from vibro_ros.study.optimise.space import Space
from vibro_ros.study.progress import Progress
from vibro_ros.study.running.blocks import NUMBERS, Field, ParquetBlocks

#: Most groups of candidates of a search, a file each.
MOST_GROUPS = 1_000_000
FIELDS = [
    Field("point", NUMBERS, "1", "coordinates in the unit cube of the varied parameters"),
    Field("values", NUMBERS, "1", f"{', '.join(MEASURED)} of each start, one after the other, in SI units; NaN where a "
          "run cannot go on")]


def candidate_files(folder: Path, search: dict, dimension: int, starts: int) -> ParquetBlocks:
    """The files of a `search` in a folder that exists: one a group of candidates, a row a candidate.

    A candidate has so many coordinates, and is simulated from so many starts.

    Raises
    ------
    ForeignBlockError
        For files of another search.
    """
    files = ParquetBlocks(folder, search, MOST_GROUPS, FIELDS, lambda _, rows: {
        (len(row["point"]), len(row["values"])) for row in rows} == {(dimension, starts * len(MEASURED))})
    files.check_folder()
    files.read(0)  # later, a library would catch the error
    return files


#: First standard deviation of CMA-ES in parts of the cube's edge.
SIGMA = 0.3
# A run of CMA-ES ends when its steps are shorter than this part of the edge, or the scores of a group differ by less
# than this part of the first group's: the noise is larger.
_FINE = 1e-3

Scores = Callable[[np.ndarray], np.ndarray]


class Candidates(NamedTuple):
    """Robots that were evaluated.

    Attributes
    ----------
    points : ndarray, shape (n, dimension)
        In the unit cube.
    values : ndarray, shape (n, starts, measures)
        Columns as `plan.MEASURED`.
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
    files : ParquetBlocks
        Groups whose values are known are read there, and others written.
    budget : int
        No group begins beyond so many candidates.
    workers : int
        Processes.
    progress : Progress
        Counts every candidate that is done.
    """

    def __init__(self, space: Space, trials: Trials, files: ParquetBlocks, budget: int, workers: int,
                 progress: Progress):
        self._space, self._trials, self._files = space, trials, files
        self._budget, self._workers, self._progress = budget, workers, progress
        self._groups: list[Candidates] = []
        self._count = 0

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Values of a group, shape (n, starts, measures); `SpentError` when there is no budget for one more.

        Raises
        ------
        SpentError
            When the budget is spent.
        OSError, RuntimeError
            For files that cannot be read or written, or are of other candidates.
        """
        if self._count >= self._budget:
            raise SpentError
        points, number = np.clip(points, 0.0, 1.0), len(self._groups)
        table = self._files.read(number)
        if table is None:
            found, robots = [], [self._space.buildable(point) for point in points]
            for one in values_of_many(robots, self._trials, self._workers):
                found.append(one)
                self._progress.add(1)
            values = np.array(found)
            self._files.write(number, [{"point": point, "values": one.ravel()}
                                       for point, one in zip(points, values, strict=True)])
        else:
            if not np.array_equal(np.array(table["point"].to_pylist()), points):
                raise RuntimeError(f"{self._files.path(number)}: is of other candidates than this version proposes on "
                                   "this machine; give another --output")
            values = np.array(table["values"].to_pylist()).reshape(len(points), self._trials.starts, -1)
            self._progress.add(len(points))
        self._groups.append(Candidates(points, values))
        self._count += len(points)
        return values

    def gathered(self) -> Candidates:
        """Every candidate so far, in their order."""
        if not self._groups:
            return Candidates(np.empty((0, self._space.dimension)), np.empty((0, self._trials.starts, 0)))
        return Candidates(*map(np.concatenate, zip(*self._groups, strict=True)))


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


def search(evaluations: Evaluations, score: Callable[[np.ndarray], float], dimension: int, seed: int) -> None:
    """Search until the budget is spent; `score` makes a number of a candidate's values."""
    def scores(points: np.ndarray) -> np.ndarray:
        return np.array([score(values) for values in evaluations(points)])

    with suppress(SpentError):
        by_cma(scores, dimension, seed)


#: Most robots of a front that are shown.
SHOWN = 24
#: Weights of the logarithm of the speed against that of the cost, in the order in which they are sought.
WEIGHTS = (0.5, 0.0, 1.0, 0.25, 0.75)
# Robots of a weight's turn; first standard deviation of a later turn, which begins at the best robot so far.
_TURN, _NARROW = 300, 0.1


@dataclass(frozen=True)
class FrontRobot:
    """A robot of the front, from starts that the search has not seen.

    Attributes
    ----------
    speed : float
        Lower quartile of the mean speeds [m/s].
    cost : float
        Cost of transport [-].
    power : float
        Mean power that is read [W].
    robot : Scene
        The robot.
    """

    speed: float
    cost: float
    power: float
    robot: Scene


def by_weights(evaluations: Evaluations, plan: Plan) -> None:
    """Seek one of `WEIGHTS` after the other, again and again, until the budget is spent."""
    with suppress(SpentError):
        for number, weight in enumerate(itertools.cycle(WEIGHTS)):
            begin, sigma = np.full(plan.space.dimension, 0.5), SIGMA
            if number >= len(WEIGHTS):
                known = evaluations.gathered()
                begin, sigma = known.points[int(np.argmax(_weighted(plan, weight, *known)))], _NARROW
            with suppress(_TurnOverError):
                descend(_turn(evaluations, plan, weight), begin, sigma, plan.seed + number)


class _TurnOverError(Exception):
    """It is the next weight's turn: ends the library's loop."""


def _turn(evaluations: Evaluations, plan: Plan, weight: float) -> Scores:
    """Scores of candidates by one weight, for `_TURN` candidates."""
    left = _TURN

    def scores(points: np.ndarray) -> np.ndarray:
        nonlocal left
        if left <= 0:
            raise _TurnOverError
        left -= len(points)
        return _weighted(plan, weight, points, evaluations(points))

    return scores


def _weighted(plan: Plan, weight: float, points: np.ndarray, values: np.ndarray) -> np.ndarray:
    scores = []
    for point, one in zip(points, values, strict=True):
        pace, cost = plan.speed_and_cost(point, one)
        counts = pace > 0.0 and np.isfinite(cost)
        scores.append(float(weight * np.log(pace) - (1.0 - weight) * np.log(cost)) if counts else
                      FAILED + max(pace, FAILED))
    return np.array(scores)


def front_of(plan: Plan, candidates: Candidates, workers: int, progress: Progress) -> list[FrontRobot]:
    """The front of a search's candidates, the slowest first, verified from other starts.

    Parameters
    ----------
    plan : Plan
        Of the search.
    candidates : Candidates
        All that it has evaluated.
    workers : int
        Processes.
    progress : Progress
        Counts every robot.
    """
    pairs = [plan.speed_and_cost(*one) for one in zip(candidates.points, candidates.values, strict=True)]
    points = candidates.points[_spread(non_dominated(np.array(pairs)), pairs)]
    robots, found = [plan.space.robot(point) for point in points], []
    fresh = values_of_many(robots, replace(plan.effort.choosing, first=CHOOSING), workers)
    for point, robot, values in zip(points, robots, fresh, strict=True):
        power = float(values[:, POWERS[plan.reading.power]].mean())
        found.append(FrontRobot(*plan.speed_and_cost(point, values), power, robot))
        progress.add(1)
    still = non_dominated(np.array([(one.speed, one.cost) for one in found]).reshape(-1, 2))
    return [found[number] for number in still]


def non_dominated(pairs: np.ndarray) -> list[int]:
    """Numbers of the rows (speed, cost) that no other row beats in both, the slowest first.

    Parameters
    ----------
    pairs : ndarray, shape (n, 2)
        Speeds that are not positive, and costs that are not finite, do not count.
    """
    counted = [number for number, (pace, cost) in enumerate(pairs) if pace > 0.0 and np.isfinite(cost)]
    found, cheapest = [], np.inf
    for number in sorted(counted, key=lambda one: (-pairs[one][0], pairs[one][1])):
        if pairs[number][1] < cheapest:
            found.append(number)
            cheapest = pairs[number][1]
    return found[::-1]


def _spread(numbers: list[int], pairs: list[tuple[float, float]]) -> list[int]:
    """At most `SHOWN` of `numbers`, spread evenly over the logarithm of their speeds."""
    if len(numbers) <= SHOWN:
        return numbers
    logs = np.log([pairs[number][0] for number in numbers])
    nearest = {int(np.argmin(np.abs(logs - wanted))) for wanted in np.linspace(logs[0], logs[-1], SHOWN)}
    return [numbers[place] for place in sorted(nearest)]
