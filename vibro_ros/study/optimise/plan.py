"""What a search is asked for: scene, space, objective, effort; and what its record depends on."""

import hashlib
import pkgutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from vibro_ros.simulation.provenance import software
from vibro_ros.study.optimise.evaluation import Trials
from vibro_ros.study.optimise.objective import FAILED, OBJECTIVES, Reading, check_reaction, cost_of_transport, speed
from vibro_ros.study.optimise.space import Space

# Modules whose text decides the values of a candidate, beside those that `software` looks at.
_MEASURING = (("vibro_ros.accuracy", "starts"), *(("vibro_ros.study", name) for name in (
    "measures", "observation", "window")), ("vibro_ros.study.optimise", "evaluation"))

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
    method : str
        Of `search.METHODS`; the front has its own.
    reading : Reading
        How speed and power are read.
    least_speed : float
        Speed [m/s] below which a robot does not count.
    effort : Effort
        How much is simulated.
    seed : int
        Of the search.
    """

    space: Space
    objective: str
    method: str
    reading: Reading
    least_speed: float
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

    def score(self, values: np.ndarray) -> float:
        """Score of a robot from its values; a robot that is too slow is judged by how slow it is."""
        pace = speed(values, self.reading)
        if self.least_speed > 0.0 and pace < self.least_speed:
            return max(pace - self.least_speed, FAILED)
        return OBJECTIVES[self.scored].score(values, self.reading)

    def speed_and_cost(self, point: np.ndarray, values: np.ndarray) -> tuple[float, float]:
        """Speed [m/s] and cost of transport [-] of the robot at a point; infinite cost for one that has none."""
        if not np.isfinite(values).all():
            return FAILED, np.inf
        robot = self.space.robot(point)
        weight = robot.total_mass * robot["gravity"]
        return speed(values, self.reading), cost_of_transport(values, self.reading, weight)

    def identity(self) -> Mapping[str, object]:
        """All that the candidates and their values depend on, in numbers and texts; the budget is not among it."""
        return {"objective": self.objective, "method": self.method, "reading": dict(self.reading._asdict()),
                "least_speed": self.least_speed, "seed": self.seed, "trials": asdict(self.effort.trials),
                "variables": [[one.name, one.low, one.high, one.logarithmic] for one in self.space.variables],
                "scene": dict(self.space.scene.parameters), "software": software(), "measures": _measures()}


def _measures() -> str:
    """Digest of the modules that make values of runs: a record of other values must not be continued."""
    digest = hashlib.sha256()
    for package, name in _MEASURING:
        digest.update(b"\n".join((pkgutil.get_data(package, f"{name}.py") or b"").splitlines()))
    return digest.hexdigest()[:16]
