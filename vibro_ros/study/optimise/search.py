"""The search for the best robot: groups of candidates, proposed by CMA-ES, evaluated here and kept.

Group n is block n of a `Study`. A search that goes on proposes the same robots again, because every draw is seeded and
scores are the same to the last bit, and reads their values instead of computing them.
"""

import itertools
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cma
import numpy as np
import pyarrow as pa

from vibro_ros.model.scene import Scene
from vibro_ros.study.execution import Execution
from vibro_ros.study.optimise.plan import (
    CHOOSING,
    FAILED,
    FRONT,
    MEASURED,
    POWERS,
    Plan,
    values_of,
    values_of_many,
)
from vibro_ros.study.progress import Progress
from vibro_ros.study.table import NUMBERS, Field, Study, are, stored

#: Most groups of candidates of a search, a file each.
MOST_GROUPS = 1_000_000
FIELDS = [
    Field("point", NUMBERS, "1", "coordinates in the unit cube of the varied parameters"),
    Field("values", NUMBERS, "1", f"{', '.join(MEASURED)} of each start, one after the other, in SI units; NaN where a "
          "run cannot go on")]
#: First standard deviation of CMA-ES in parts of the cube's edge.
SIGMA = 0.3
# A run of CMA-ES ends when its steps are shorter than this part of the edge, or the scores of a group differ by less
# than this part of the first group's: the noise is larger.
_FINE = 1e-3


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


def proposals(dimension: int, seed: int) -> Generator[np.ndarray, np.ndarray, None]:
    """Groups of points of the unit cube, shape (n, dimension), by CMA-ES; takes their scores, the larger the better.

    A run begins in the middle of the cube. When it has ended, the next begins at a drawn point with twice as many
    points a group (A. Auger and N. Hansen, CEC 2005, 1769).
    """
    draw, begin, options = np.random.default_rng(seed), np.full(dimension, 0.5), {
        "bounds": [0.0, 1.0], "verbose": -9, "verb_log": 0, "tolx": _FINE, "tolfunrel": _FINE}
    for number in itertools.count(seed + 1):  # cma takes 0 for a seed of the clock
        strategy = cma.CMAEvolutionStrategy(begin, SIGMA, {**options, "seed": number})
        while not strategy.stop():
            points = strategy.ask()
            strategy.tell(points, list(-(yield np.clip(points, 0.0, 1.0))))
        begin, options = draw.random(dimension), {**options, "popsize": 2 * strategy.popsize}


def searched(plan: Plan, folder: Path, execution: Execution, progress: Progress) -> Candidates:
    """Search until the budget is spent; the last group is not cut.

    The front takes one of `WEIGHTS` after the other, a group each, so that each gets a fifth of any budget.

    Raises
    ------
    ForeignBlockError
        For files of another search.
    OSError, RuntimeError
        As `table.computed`.
    """
    weights: Sequence[float | None] = WEIGHTS if plan.objective == FRONT else (None,)
    searches = [proposals(plan.space.dimension, plan.seed + 1000 * k) for k in range(len(weights))]
    points, found, count = [next(one) for one in searches], list[Candidates](), 0
    for group in itertools.count():
        if count >= plan.effort.budget:
            return Candidates(*map(np.concatenate, zip(*found, strict=True)))
        which = group % len(weights)
        own = points[which]
        values = evaluated(plan, group, own, folder, execution)
        found.append(Candidates(own, values))
        count += len(own)
        progress.add(len(own))
        points[which] = searches[which].send(_scores(plan, weights[which], own, values))
    raise AssertionError  # no group is the last


def evaluated(plan: Plan, group: int, points: np.ndarray, folder: Path, execution: Execution) -> np.ndarray:
    """Values of a group of candidates, shape (n, starts, measures), read or computed and kept."""
    width = plan.effort.trials.starts * len(MEASURED)

    def are_own(_: Sequence[int], rows: list[dict]) -> bool:
        return are(rows, [{"point": point} for point in points.tolist()]) and {
            len(row["values"]) for row in rows} == {width}

    study = Study("robots", plan.identity(), FIELDS, partial(_row_of, plan, points), are_own, plan.run_time,
                  (plan.space.scene["solver.method"],), MOST_GROUPS)
    table: pa.Table = stored(study, folder, {group: range(len(points))}, lambda numbers: execution.rows(
        study.rows, numbers, study.run_time, study.methods))[group]
    return np.array(table["values"].to_pylist()).reshape(len(points), plan.effort.trials.starts, -1)


def _row_of(plan: Plan, points: np.ndarray, number: int) -> list[dict]:
    values = values_of(plan.space.buildable(points[number]), plan.effort.trials)
    return [{"point": points[number], "values": values.ravel()}]


def _scores(plan: Plan, weight: float | None, points: np.ndarray, values: np.ndarray) -> np.ndarray:
    if weight is None:
        return np.array([plan.score(one) for one in values])
    return _weighted(plan, weight, points, values)


#: Most robots of a front that are shown.
SHOWN = 24
#: Weights of the logarithm of the speed against that of the cost.
WEIGHTS = (0.5, 0.0, 1.0, 0.25, 0.75)


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


def _weighted(plan: Plan, weight: float, points: np.ndarray, values: np.ndarray) -> np.ndarray:
    scores = []
    for point, one in zip(points, values, strict=True):
        pace, cost = plan.speed_and_cost(point, one)
        counts = pace > 0.0 and np.isfinite(cost)
        scores.append(float(weight * np.log(pace) - (1.0 - weight) * np.log(cost)) if counts else
                      FAILED + max(pace, FAILED))
    return np.array(scores)


def front_of(plan: Plan, candidates: Candidates, execution: Execution, progress: Progress) -> list[FrontRobot]:
    """The front of a search's candidates, the slowest first, verified from other starts.

    Parameters
    ----------
    plan : Plan
        Of the search.
    candidates : Candidates
        All that it has evaluated.
    execution : Execution
        Who computes.
    progress : Progress
        Counts every robot.
    """
    pairs = [plan.speed_and_cost(*one) for one in zip(candidates.points, candidates.values, strict=True)]
    points = candidates.points[_spread(non_dominated(np.array(pairs)), pairs)]
    robots, found = [plan.space.robot(point) for point in points], []
    fresh = values_of_many(robots, replace(plan.effort.choosing, first=CHOOSING), execution)
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
