"""The front of speed and cost of transport: robots of which none is both faster and cheaper than another.

A search for one number finds a point of the front: the robot with the largest log V^w / C^(1 - w). So CMA-ES seeks one
weight w after the other, and every robot that any of these searches has tried may be on the front.
"""

import itertools
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.study.optimise.evaluation import CHOOSING, values_of_many
from vibro_ros.study.optimise.objective import FAILED, POWERS
from vibro_ros.study.optimise.plan import Plan
from vibro_ros.study.optimise.search import SIGMA, Candidates, Evaluations, SpentError, descend
from vibro_ros.study.progress import Progress

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
            turn, again = _Turn(evaluations, plan, weight), number >= len(WEIGHTS)
            begin = turn.best() if again else np.full(plan.space.dimension, 0.5)
            with suppress(_TurnOverError):
                descend(turn, begin, _NARROW if again else SIGMA, plan.seed + number)


class _TurnOverError(Exception):
    """It is the next weight's turn: ends the library's loop."""


class _Turn:
    """Scores of candidates by one weight, for `_TURN` candidates."""

    def __init__(self, evaluations: Evaluations, plan: Plan, weight: float):
        self._evaluations, self._plan, self._weight, self._left = evaluations, plan, weight, _TURN

    def __call__(self, points: np.ndarray) -> np.ndarray:
        if self._left <= 0:
            raise _TurnOverError
        self._left -= len(points)
        return self._scores(points, self._evaluations(points))

    def best(self) -> np.ndarray:
        """The best point so far of all candidates."""
        candidates = self._evaluations.gathered()
        return candidates.points[int(np.argmax(self._scores(candidates.points, candidates.values)))]

    def _scores(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.array([self._score(*self._plan.speed_and_cost(point, one))
                         for point, one in zip(points, values, strict=True)])

    def _score(self, pace: float, cost: float) -> float:
        if pace <= 0.0 or not np.isfinite(cost):
            return FAILED + max(pace, FAILED)
        return float(self._weight * np.log(pace) - (1.0 - self._weight) * np.log(cost))


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
        Is told of every robot.
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
