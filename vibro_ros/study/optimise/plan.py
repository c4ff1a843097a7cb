"""What a search is asked for: objective, effort and runs of a robot; and the values that come of these runs."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import NamedTuple

import cma
import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.study.execution import Execution, computes_with
from vibro_ros.study.measures import measure
from vibro_ros.study.optimise.space import Space

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


#: The objective of two numbers, beside those of `OBJECTIVES`.
FRONT = "front"


@dataclass(frozen=True)
class Effort:
    """How much is simulated.

    Attributes
    ----------
    budget : int
        Candidates of the search.
    trials : Trials
        The runs of a candidate.
    finalists : int
        Candidates among which fresh starts choose.
    choosing, verifying, perturbing : Trials
        The runs of a finalist, of the optimum and those it is compared with, and of a perturbed optimum.
    samples : int
        Points of the Sobol sequence around the optimum, a power of two.
    """

    budget: int = 3000
    trials: Trials = Trials()
    finalists: int = 12
    choosing: Trials = Trials(starts=8, settling=4.0, duration=8.0)
    verifying: Trials = Trials(starts=16, settling=4.0, duration=10.0)
    perturbing: Trials = Trials(starts=4)
    samples: int = 32


QUICK = Effort(budget=120, trials=Trials(starts=3, settling=1.5, duration=2.0), finalists=3,
               choosing=Trials(starts=4, settling=2.0, duration=4.0),
               verifying=Trials(starts=6, settling=2.0, duration=6.0),
               perturbing=Trials(starts=2, settling=1.5, duration=2.0), samples=4)
"""For a look at everything within a minute or two; the optimum is not found."""


@dataclass(frozen=True)
class Plan:
    """What is searched for.

    Attributes
    ----------
    space : Space
        The robots.
    objective : str
        Of `OBJECTIVES`, or `FRONT`.
    reading : Reading
        How speed and power are read.
    least_speed : float
        Speed [m/s] below which a robot does not count.
    most_air : float
        Share of the time in the air above which a robot does not count; dimensionless.
    effort : Effort
        How much is simulated.
    seed : int
        Of the search.
    """

    space: Space
    objective: str
    reading: Reading
    least_speed: float
    most_air: float
    effort: Effort
    seed: int

    def __post_init__(self) -> None:
        if self.objective == FRONT:
            check_reaction(self.space.scene, "the cost of transport")
        elif OBJECTIVES[self.objective].needs_reaction:
            check_reaction(self.space.scene, "V/P")

    @property
    def unit(self) -> str:
        """Of `score`."""
        return OBJECTIVES[self.scored].unit

    @property
    def scored(self) -> str:
        """The objective of one number that a robot is judged by; of a front, V/P."""
        return "speed_per_power" if self.objective == FRONT else self.objective

    @property
    def run_time(self) -> float:
        """Robot time of a candidate [s]."""
        return self.effort.trials.run_time

    def score(self, values: np.ndarray) -> float:
        """Score of a robot from its values; a robot that is too slow, or flies too long, is judged by how much so."""
        pace = speed(values, self.reading)
        missing = self._flies(values) + (max(self.least_speed - pace, 0.0) if self.least_speed > 0.0 else 0.0)
        if missing > 0.0:
            return max(-missing, FAILED)
        return OBJECTIVES[self.scored].score(values, self.reading)

    def _flies(self, values: np.ndarray) -> float:
        """Share of the time that a robot flies beyond what counts, from the start with most of it."""
        return max(float(values[:, AIR].max()) - self.most_air, 0.0) if self.most_air < 1.0 else 0.0

    def speed_and_cost(self, point: np.ndarray, values: np.ndarray) -> tuple[float, float]:
        """Speed [m/s] and cost of transport [-] of the robot at a point; infinite for one that does not count."""
        if not np.isfinite(values).all():
            return FAILED, np.inf
        if excess := self._flies(values):
            return -excess, np.inf
        robot = self.space.robot(point)
        weight = robot.total_mass * robot["gravity"]
        return speed(values, self.reading), cost_of_transport(values, self.reading, weight)

    def identity(self) -> dict[str, object]:
        """All that the candidates and their values depend on, in numbers and texts; the budget is not among it."""
        return {"objective": self.objective, "reading": dict(self.reading._asdict()),
                "least_speed": self.least_speed, "most_air": self.most_air, "seed": self.seed,
                "trials": asdict(self.effort.trials),
                "variables": [[one.name, one.low, one.high, one.logarithmic] for one in self.space.variables],
                "scene": dict(self.space.scene.parameters), "cma": cma.__version__,
                "computed_with": computes_with()}
