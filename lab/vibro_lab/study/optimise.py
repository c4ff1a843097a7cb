"""``study optimise``: search for the best robot, verify it, and write the results.

A search proposes groups of robots by CMA-ES (`proposals`); group n is block n of a `table.Study`. A search that is
resumed proposes the same robots again, because every draw is seeded and scores are equal to the last bit, and reads
their values. A robot's score is a quartile over its starts. A second set of starts selects among the best robots, and a
third set verifies the optimum, with a row for each of its attractors under each reading of the forces.
"""

import argparse
import itertools
import json
import math
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cma
import numpy as np
import pyarrow as pa

from vibro_lab.orbits.starts import running
from vibro_lab.study.command import Progress, Results, StudyCommand, machine_of, settings_of
from vibro_lab.study.execution import Execution, computes_with
from vibro_lab.study.figures import BLACK, GRID, SKY, VERMILION, Axes, Figure, default_settings, new_figure, png
from vibro_lab.study.space import Space, chosen_variables
from vibro_lab.study.table import NUMBERS, Field, Study, are, stored
from vibro_lab.study.trials import (
    AIR,
    CHOOSING,
    DIRECTIONS,
    FAILED,
    MEASURED,
    OBJECTIVES,
    POWERS,
    QUANTILE,
    Mean,
    Reading,
    Trials,
    Verified,
    check_reaction,
    cost_of_transport,
    has_supply,
    readings,
    speed,
    values_of,
    values_of_many,
    verified,
    went_on,
)
from vibro_lab.study.variation import Range, at_the_edge, varied_in_words
from vibro_ros import PARAMETERS, Parser, Scene, scene_as_file

#: The objective with two numbers, speed and cost; `OBJECTIVES` have one.
FRONT = "front"


@dataclass(frozen=True)
class Effort:
    """Amount of simulation.

    Attributes
    ----------
    budget : int
        Number of candidates of the search.
    trials : Trials
        The runs of a candidate.
    finalists : int
        Number of best candidates among which other starts select.
    choosing, verifying : Trials
        The runs of a finalist, and of the optimum.
    """

    budget: int = 3000
    trials: Trials = Trials()
    finalists: int = 12
    choosing: Trials = Trials(starts=8, settling=4.0, duration=8.0)
    verifying: Trials = Trials(starts=16, settling=4.0, duration=10.0)


QUICK = Effort(budget=120, trials=Trials(starts=3, settling=1.5, duration=2.0), finalists=3,
               choosing=Trials(starts=4, settling=2.0, duration=4.0),
               verifying=Trials(starts=6, settling=2.0, duration=6.0))
"""A demonstration of all steps within a minute or two; it does not find the optimum."""


@dataclass(frozen=True)
class Plan:
    """Design of a search.

    Attributes
    ----------
    space : Space
        Search space of robots.
    objective : str
        Name in `OBJECTIVES`, or `FRONT`.
    reading : Reading
        Definition of speed and power.
    least_speed : float
        Least speed [m/s] of an accepted robot.
    most_air : float
        Largest share of the time in the air of an accepted robot; dimensionless.
    effort : Effort
        Amount of simulation.
    seed : int
        Seed of the search.
    """

    space: Space
    objective: str
    reading: Reading
    least_speed: float
    most_air: float
    effort: Effort
    seed: int

    def __post_init__(self) -> None:
        if self.reading.power == "supply" and not has_supply(self.space.scene):
            raise ValueError(f"--power supply: {self.space.scene.name} has no dc motor that the method exact solves; "
                             "give --power net or delivered, or a scene with effects.motor dc such as machine")
        if self.objective == FRONT:
            check_reaction(self.space.scene, "the cost of transport")
        elif OBJECTIVES[self.objective].needs_reaction:
            check_reaction(self.space.scene, "V/P")

    @property
    def unit(self) -> str:
        """Unit of `score`."""
        return OBJECTIVES[self.scored].unit

    @property
    def scored(self) -> str:
        """Name of the objective with one number that gives the score; for a front, V/P."""
        return "speed_per_power" if self.objective == FRONT else self.objective

    @property
    def run_time(self) -> float:
        """Simulated time of a candidate [s]."""
        return self.effort.trials.run_time

    def score(self, values: np.ndarray) -> float:
        """Score of a robot from its values; if it is too slow, or in the air for too long, minus the excess."""
        quartile = speed(values, self.reading)
        missing = self._flies(values) + (max(self.least_speed - quartile, 0.0) if self.least_speed > 0.0 else 0.0)
        if missing > 0.0:
            return max(-missing, FAILED)
        return OBJECTIVES[self.scored].score(values, self.reading)

    def _flies(self, values: np.ndarray) -> float:
        """Excess of the share of the time in the air over `most_air`, from the start with the largest share."""
        return max(float(values[:, AIR].max()) - self.most_air, 0.0) if self.most_air < 1.0 else 0.0

    def speed_and_cost(self, point: np.ndarray, values: np.ndarray) -> tuple[float, float]:
        """Speed [m/s] and cost of transport [-] of the robot at a point; infinite cost if it is not accepted."""
        if not went_on(values):
            return FAILED, np.inf
        if excess := self._flies(values):
            return -excess, np.inf
        robot = self.space.robot(point)
        weight = robot.total_mass * robot["gravity"]
        return speed(values, self.reading), cost_of_transport(values, self.reading, weight)

    def identity(self) -> dict[str, object]:
        """Everything that the candidates and their values depend on, as numbers and texts, without the budget."""
        return {"objective": self.objective, "reading": dict(self.reading._asdict()),
                "least_speed": self.least_speed, "most_air": self.most_air, "seed": self.seed,
                "trials": asdict(self.effort.trials),
                "variables": [[one.name, one.low, one.high, one.logarithmic] for one in self.space.variables],
                "scene": dict(self.space.scene.parameters), "cma": cma.__version__,
                "computed_with": computes_with()}


#: Largest number of groups of candidates of a search, each of which is a file.
MOST_GROUPS = 1_000_000
FIELDS = [
    Field("point", NUMBERS, "1", "coordinates in the unit cube of the varied parameters"),
    Field("values", NUMBERS, "1", f"{', '.join(MEASURED)} of each start, one after the other, in SI units; NaN where a "
          "run cannot go on")]
#: Initial standard deviation of CMA-ES, in units of the cube's edge.
SIGMA = 0.3
# A run of CMA-ES ends when its steps are shorter than this part of the edge, or when the scores of a group differ by
# less than this part of the first group's, because the noise is larger.
_FINE = 1e-3


class Candidates(NamedTuple):
    """Robots that were evaluated.

    Attributes
    ----------
    points : ndarray, shape (n, dimension)
        Points of the unit cube.
    values : ndarray, shape (n, starts, measures)
        Values of each start, with the columns `trials.MEASURED`.
    """

    points: np.ndarray
    values: np.ndarray


def proposals(dimension: int, seed: int) -> Generator[np.ndarray, np.ndarray, None]:
    """Generate groups of points of the unit cube, shape (n, dimension), by CMA-ES; send the scores to be maximised.

    A run begins in the middle of the cube. When it has ended, the next begins at a random point with twice as many
    points per group (A. Auger and N. Hansen, CEC 2005, 1769).
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
    """Search until the budget is spent; the last group is complete.

    For the front, groups use the `WEIGHTS` in turn, so that each weight gets a fifth of any budget.

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
    raise AssertionError  # not reached, because the loop has no end


def evaluated(plan: Plan, group: int, points: np.ndarray, folder: Path, execution: Execution) -> np.ndarray:
    """Values of a group of candidates, shape (n, starts, measures), read from its file, or computed and stored."""
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


#: Largest number of robots of a front.
SHOWN = 24
#: Weights of the logarithm of the speed; the logarithm of the cost has 1 minus the weight.
WEIGHTS = (0.5, 0.0, 1.0, 0.25, 0.75)


@dataclass(frozen=True)
class FrontRobot:
    """A robot of the front, evaluated from starts that the search has not used.

    Attributes
    ----------
    speed : float
        Lower quartile of the mean speeds [m/s].
    cost : float
        Upper quartile of the costs of transport [-].
    power : float
        Upper quartile of the powers [W], as defined by the plan's reading.
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
        own_speed, cost = plan.speed_and_cost(point, one)
        counts = own_speed > 0.0 and np.isfinite(cost)
        scores.append(float(weight * np.log(own_speed) - (1.0 - weight) * np.log(cost)) if counts else
                      FAILED + max(own_speed, FAILED))
    return np.array(scores)


def front_of(plan: Plan, candidates: Candidates, execution: Execution, progress: Progress) -> list[FrontRobot]:
    """Return the front of a search's candidates, the slowest first, verified from other starts.

    Parameters
    ----------
    plan : Plan
        Plan of the search.
    candidates : Candidates
        All candidates that it has evaluated.
    execution : Execution
        Workers that run the verification.
    progress : Progress
        Counts the robots.
    """
    pairs = [plan.speed_and_cost(*one) for one in zip(candidates.points, candidates.values, strict=True)]
    points = candidates.points[_spread(non_dominated(np.array(pairs)), pairs)]
    robots, found = [plan.space.robot(point) for point in points], []
    fresh = values_of_many(robots, replace(plan.effort.choosing, first=CHOOSING), execution)
    for point, robot, values in zip(points, robots, fresh, strict=True):
        power = float(np.quantile(values[:, POWERS[plan.reading.power]], 1.0 - QUANTILE))
        found.append(FrontRobot(*plan.speed_and_cost(point, values), power, robot))
        progress.add(1)
    still = non_dominated(np.array([(one.speed, one.cost) for one in found]).reshape(-1, 2))
    return [found[number] for number in still]


def non_dominated(pairs: np.ndarray) -> list[int]:
    """Indices of the rows (speed, cost) that no other row dominates, the slowest first.

    Parameters
    ----------
    pairs : ndarray, shape (n, 2)
        Speeds and costs. Rows whose speed is not positive or whose cost is not finite are left out.
    """
    counted = [number for number, (own_speed, cost) in enumerate(pairs) if own_speed > 0.0 and np.isfinite(cost)]
    found, cheapest = [], np.inf
    for number in sorted(counted, key=lambda one: (-pairs[one][0], pairs[one][1])):
        if pairs[number][1] < cheapest:
            found.append(number)
            cheapest = pairs[number][1]
    return found[::-1]


def _spread(numbers: list[int], pairs: list[tuple[float, float]]) -> list[int]:
    """Return at most `SHOWN` of the indices, spread evenly over the logarithm of their speeds."""
    if len(numbers) <= SHOWN:
        return numbers
    logs = np.log([pairs[number][0] for number in numbers])
    nearest = {int(np.argmin(np.abs(logs - wanted))) for wanted in np.linspace(logs[0], logs[-1], SHOWN)}
    return [numbers[place] for place in sorted(nearest)]


@dataclass(frozen=True)
class Result:
    """Result of a search.

    Attributes
    ----------
    plan : Plan
        Design of the search.
    robots : int
        Number of candidates.
    optimum : mapping
        Values of the varied parameters of the best robot.
    robot : Scene
        The best robot.
    on_bound : tuple of str
        Bound on which each variable lies, `low` or `high`, else an empty text.
    verified : tuple of Verified
        Attractors of the best robot under all readings of the forces, from other starts.
    front : tuple of FrontRobot
        Robots of which none is both faster and cheaper than another, from other starts; empty if the scene's energy
        does not balance.
    """

    plan: Plan
    robots: int
    optimum: Mapping[str, float]
    robot: Scene
    on_bound: tuple[str, ...]
    verified: tuple[Verified, ...]
    front: tuple[FrontRobot, ...]


def studied(plan: Plan, folder: Path, execution: Execution) -> tuple[Result, Candidates]:
    """Search and verify; returns the result and all candidates of the search.

    Parameters
    ----------
    plan : Plan
        Design of the search.
    folder : Path
        Folder of the search's files, from which it resumes; no other process may write into it.
    execution : Execution
        Workers that run the trials.

    Raises
    ------
    ValueError
        If the files belong to another search, or no candidate moves.
    OSError, RuntimeError
        If files cannot be read, or written.
    """
    with Progress("search", "robot", plan.effort.budget) as progress:
        candidates = searched(plan, folder, execution, progress)
    scores = np.array([plan.score(values) for values in candidates.values])
    point = _chosen(plan, candidates, scores, execution)
    optimum, effort, space = plan.space.parameters(point), plan.effort, plan.space
    with Progress("verification", "reading", len(readings(space.scene))) as progress:
        rows = verified(space, optimum, plan.reading, effort.verifying, execution, progress)
    front: list[FrontRobot] = []
    if space.scene["effects.reaction"]:
        with Progress("front", "robot", SHOWN) as progress:
            front = front_of(plan, candidates, execution, progress)
    return Result(plan, len(scores), optimum, space.robot(point), tuple(space.on_bound(point)), tuple(rows),
                  tuple(front)), candidates


def _chosen(plan: Plan, candidates: Candidates, scores: np.ndarray, execution: Execution) -> np.ndarray:
    """Return the point that is best from other starts among the best of the search, whose scores were partly luck."""
    scores = np.where(went_on(candidates.values), scores, -np.inf)
    finalists = _apart(candidates.points, scores, plan.effort.finalists)
    trials = replace(plan.effort.choosing, first=CHOOSING)
    robots, fresh = [plan.space.robot(point) for point in finalists], []
    with Progress("choice", "robot", len(robots)) as progress:
        for values in values_of_many(robots, trials, execution):
            fresh.append(plan.score(values))
            progress.add(1)
    best = int(np.argmax(fresh)) if fresh else 0
    if not fresh or fresh[best] <= 0.0:
        raise ValueError(f"--budget {plan.effort.budget}: no robot was found that goes the same way from all starts"
                         f"{' at the least speed' if plan.least_speed else ''}"
                         f"{' with so little time in the air' if plan.most_air < 1.0 else ''}; give a larger budget or "
                         "other bounds")
    return finalists[best]


def _apart(points: np.ndarray, scores: np.ndarray, count: int, distance: float = 0.05) -> list[np.ndarray]:
    """Return the `count` best points such that any two differ by at least `distance` in some coordinate."""
    found: list[np.ndarray] = []
    for number in np.argsort(-scores, kind="stable"):
        if scores[number] == -np.inf:
            break
        if all(np.abs(points[number] - other).max() >= distance for other in found):
            found.append(points[number])
        if len(found) == count:
            break
    return found


def result_file(result: Result) -> bytes:
    """Return a result as JSON: the data of its tables and sentences, without its plan."""
    front = [{"speed": one.speed, "cost": one.cost, "power": one.power,
              "parameters": {variable.name: one.robot[variable.name] for variable in result.plan.space.variables}}
             for one in result.front]
    whole = {"robots": result.robots, "optimum": dict(result.optimum),
             "verified": [asdict(row) for row in result.verified], "front": front}
    return (json.dumps(_finite(whole), indent=1, allow_nan=False) + "\n").encode()


def _finite(value: Any) -> Any:
    """Replace numbers that are not finite by None, because JSON does not have them."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


POWER = {"net": "the work of the motor less what the springs return to it, over time",
         "delivered": "the work that the motor delivers, over time; what the springs return to it is lost",
         "supply": "the energy that the supply gives to the dc motor, with the heat of its winding, over time"}
"""Definition of P for each reading of the power."""
_DIRECTIONS = {"either": "in either direction", "forward": "forwards only", "backward": "backwards only"}
_ENDS = {"low": "lower", "high": "upper", "": ""}


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def _number(value: float) -> str:
    """Format `value` with three digits; a dash if it is not finite."""
    if not math.isfinite(value):
        return "-"
    text = f"{value:.3g}"
    return f"{float(text):.0f}" if 1e3 <= abs(float(text)) < 1e6 else text


_SAME = 1e-5  # relative: a smaller interval belongs to starts of one periodic motion, and is not shown


def _with_spread(found: Mean, factor: float = 1.0) -> str:
    """Format a mean ± half its 95 % interval, times `factor`; a dash if it is not finite."""
    if not math.isfinite(found.mean):
        return "-"
    spread = f" ± {factor * found.spread:.2g}" if found.spread > _SAME * abs(found.mean) else ""
    return f"{_number(factor * found.mean)}{spread}"


def _speed(row: Verified) -> str:
    """Mean speed of a motion [mm/s], or the range of starts that have not settled; and its drift."""
    if row.turns is None and math.isfinite(row.least):
        ends = dict.fromkeys(_number(1e3 * speed) for speed in (row.least, row.largest))
        return f"{' to '.join(ends)}{_drift(row)}"
    return f"{_with_spread(row.speed, 1e3)}{_drift(row)}"


def _drift(row: Verified) -> str:
    return f", drifts by {_number(1e3 * row.drift)}" if row.drift else ""


def _motion(row: Verified) -> str:
    return "not settled" if row.turns is None else f"every {row.turns} turns" if row.turns else "no period"


def document(result: Result) -> str:
    """Return the summary of a search as Markdown."""
    parts = [f"# {title(result.plan)}", *_question_and_verdict(result), "## Parameters", *_parameters(result),
             "## Verification", *_verification(result)]
    if result.front:
        parts += ["## Speed against cost of transport", *_front(result.front)]
    return "\n\n".join(parts) + "\n"


def title(plan: Plan) -> str:
    """Heading of the summary, with the objective and the scene."""
    what = "the front of speed and cost of transport" if plan.objective == FRONT else OBJECTIVES[plan.objective].does
    return f"Optimum: {what}, scene {plan.space.scene.name}"


def _question_and_verdict(result: Result) -> list[str]:
    """Paragraphs on the method of the search, and on the speed of the optimum's attractors."""
    plan, trials = result.plan, result.plan.effort.trials
    floor = f" A robot slower than {_number(plan.least_speed * 1e3)} mm/s does not count." if plan.least_speed else ""
    if plan.most_air < 1.0:
        floor += f" A robot that is in the air for more than {100 * plan.most_air:g} % of the time does not count."
    how = "CMA-ES, one weight of speed and cost after the other," if plan.objective == FRONT else (
        "CMA-ES, restarted with twice as many robots a group,")
    asked = (f"P is mean power: {POWER[plan.reading.power]}. {how} tried {result.robots} robots, each "
            f"from the same {trials.starts} drawn starts over {trials.duration:g} s after {trials.settling:g} s. The "
            f"score is the lower quartile of these starts. Speed counts {_DIRECTIONS[plan.reading.direction]}, and all "
            f"starts must agree.{floor}")
    own = [row for row in result.verified if row.reading == result.verified[0].reading]
    moves = "; ".join(f"{_speed(row)} mm/s{_yield(row)} from {row.starts} of {plan.effort.verifying.starts} starts"
                      for row in own)
    return [asked, f"The optimum goes at {moves}, forward positive."]


def _yield(row: Verified) -> str:
    return f" and {_with_spread(row.ratio)} m/J" if math.isfinite(row.cost) else ""


def in_words(result: Result) -> list[str]:
    """Return the optimum in lines: what its robot does, and its parameters with units."""
    robot = ", ".join(f"{name} = {_number(value)}{f' {unit}' if (unit := PARAMETERS[name].unit) else ''}"
                      for name, value in result.optimum.items())
    return [_question_and_verdict(result)[-1], f"The optimum: {robot}."]


def on_bounds(result: Result) -> str:
    """Sentence that names the parameters of the optimum that lie on a bound, beyond which the score may still rise."""
    ends = [f"{variable.name} ({_ENDS[end]})" for variable, end in zip(
        result.plan.space.variables, result.on_bound, strict=True) if end]
    return at_the_edge("the best score", ends) or "The optimum lies within the range of every parameter."


def _parameters(result: Result) -> list[str]:
    """The sentence of `on_bounds`, and a table of all parameters."""
    rows = []
    for variable, end in zip(result.plan.space.variables, result.on_bound, strict=True):
        parameter = PARAMETERS[variable.name]
        rows.append([f"`{variable.name}`", variable.symbol, _number(result.optimum[variable.name]),
                     _number(parameter.default), parameter.unit,
                     f"{_number(variable.low)} to {_number(variable.high)}{', log' if variable.logarithmic else ''}",
                     _ENDS[end], variable.reason])
    heads = ["parameter", "symbol", "optimum", "paper", "unit", "bounds", "on bound", "why these bounds"]
    return [on_bounds(result), _table(heads, rows)]


def _verification(result: Result) -> list[str]:
    trials = result.plan.effort.verifying
    said = (f"{trials.starts} drawn starts that the search has not seen, {trials.duration:g} s each after "
            f"{trials.settling:g} s: a row for each motion that they settle to, with its mean ± half the 95 % interval "
            "where it has no period, and the least and the largest mean of starts that have not settled. Mean N over "
            "the weight must be 1 on a real ground; a robot with more is held down by the rule of its row, and would "
            "not do this.")
    return [said, _table(
        ["reading", "repeats itself", "starts", "speed, forward positive [mm/s]", "mean N over weight",
         "time with N <= 0 [%]", "in the air [%]", "P net [W]", "P delivered [W]", "P from the supply [W]", "V/P [m/J]",
         "cost of transport"],
        ([row.reading, _motion(row), f"{row.starts} of {trials.starts}", _speed(row),
          _number(row.load), f"{100 * row.unloaded:.0f}", f"{100 * row.air:.0f}", _with_spread(row.power),
          _with_spread(row.delivered), _with_spread(row.supply),
          _with_spread(row.ratio) if math.isfinite(row.cost) else "-", _number(row.cost)]
         for row in result.verified))]


def _front(front: Sequence[FrontRobot]) -> list[str]:
    """Sentence on the extent of a front, and a table of its robots."""
    text = (f"The front reaches from {_number(1e3 * front[0].speed)} mm/s at a cost of transport of "
            f"{_number(front[0].cost)} to {_number(1e3 * front[-1].speed)} mm/s at {_number(front[-1].cost)}: of each "
            "robot the poorer quarter of its starts.")
    heads = ["speed [mm/s]", "cost of transport", "P [W]", "V/P [m/J]", "motor speed [rad/s]", "crank [mm]",
             "guide angle [°]", "inclined mass [kg]"]
    return [text, _table(
        heads, ([_number(1e3 * one.speed), _number(one.cost), _number(one.power), _number(one.speed / one.power),
                   _number(one.robot["motor.speed"]), _number(1e3 * one.robot["crank.radius"]),
                   _number(math.degrees(one.robot["guide.angle"])), _number(one.robot["mass.inclined"])]
                  for one in front))]


# Speed [m/s] below which a robot is not drawn.
_SLOWEST = 1e-4
_COST = "cost of transport P / (M g V) [-]"
_ALL, _BEST, _OTHER = SKY, BLACK, VERMILION


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    figure = new_figure(width, height)
    axes = figure.subplots()
    axes.grid(color=GRID)
    axes.set_axisbelow(True)
    return figure, axes


@default_settings()
def draw_convergence(plan: Plan, candidates: Candidates, title: str) -> Figure:
    """Draw the score of every candidate in turn, and the best so far."""
    figure, axes = _figure(8.0, 4.5)
    scores = np.array([plan.score(values) for values in candidates.values])
    scores, turns = np.where(scores > 0.0, scores, np.nan), np.arange(1, len(scores) + 1)
    axes.plot(turns, scores, ".", ms=5.0, color=_ALL, label="a robot", rasterized=True)
    axes.plot(turns, np.fmax.accumulate(scores), color=_BEST, label="best so far")
    axes.set(xlabel="robots tried", ylabel=f"score [{plan.unit}]", title=title)
    axes.legend(frameon=False)
    return figure


@default_settings()
def draw_front(result: Result, candidates: Candidates, title: str) -> Figure:
    """Draw cost of transport over speed: all candidates, the front from other starts, the motions of the optimum."""
    figure, axes = _figure(8.0, 5.5)
    plan = result.plan
    every = np.array([plan.speed_and_cost(point, values)
                      for point, values in zip(candidates.points, candidates.values, strict=True)])
    every = every[np.isfinite(every[:, 1]) & (every[:, 0] > _SLOWEST)]
    axes.plot(1e3 * every[:, 0], every[:, 1], ".", ms=5.0, color=_ALL, label="a robot of the search", rasterized=True)
    front = result.front
    axes.plot([1e3 * one.speed for one in front], [one.cost for one in front], "-o", ms=3.0, color=_BEST,
              label="front, from fresh starts")
    for row in result.verified:
        if row.reading == result.verified[0].reading and row.cost > 0.0:
            axes.plot(1e3 * abs(row.speed.mean), row.cost, "*", ms=8.0, color=_OTHER, label=f"optimum, {_motion(row)}")
    axes.set(xscale="log", yscale="log", xlabel="mean speed [mm/s]", ylabel=_COST, title=title)
    axes.legend(frameon=False)
    return figure


FOLDER, TEXT, SCENE, NUMBERS = "candidates", "optimum.md", "optimum.yaml", "optimum.json"
_MOST = {"budget": 10**6, "starts": 1000, "seed": 2**31 - 2}
_LEAST = {"budget": 1, "starts": 2, "seed": 0}


def _results(plan: Plan, folder: Path, execution: Execution) -> Iterator[Results]:
    result, candidates = studied(plan, folder / FOLDER, execution)
    yield Results(files_of(result, candidates), [*in_words(result), on_bounds(result)])


def plan_of(options: argparse.Namespace) -> Plan:
    """Make the plan from the options.

    Raises
    ------
    ValueError
        For an option that is out of range or contradicts another.
    """
    for name in _MOST:
        value = getattr(options, name)
        if value is not None and not _LEAST[name] <= value <= _MOST[name]:
            raise ValueError(f"--{name} {value}: give a number from {_LEAST[name]} to {_MOST[name]}")
    if not 0.0 <= options.least_speed <= 100.0:
        raise ValueError(f"--least-speed {options.least_speed:g}: give a number from 0 to 100 m/s")
    if not 0.0 <= options.most_air <= 1.0:
        raise ValueError(f"--most-air {options.most_air:g}: give a share from 0 to 1")
    varied, fixed = _asked_varied(options.vary), [word.partition("=")[0] for word in options.fix]
    scene = sought(machine_of(options).with_parameters(settings_of([word for word in options.fix if "=" in word])))
    effort = QUICK if options.quick else Effort()
    starts = options.starts or effort.trials.starts
    effort = replace(effort, budget=options.budget or effort.budget, trials=replace(effort.trials, starts=starts))
    power = options.power or ("supply" if has_supply(scene) else "net")
    return Plan(Space(scene, chosen_variables(fixed, varied)), options.objective, Reading(power, options.direction),
                options.least_speed, options.most_air, effort, options.seed)


def sought(scene: Scene) -> Scene:
    """Return `scene` with its motor turning from the start, and without energy accounts, which cost time."""
    return running(scene).with_parameters({"solver.accounts": False})


def files_of(result: Result, candidates: Candidates) -> dict[str, bytes]:
    """Contents of a result's text, scene, numbers and pictures by file name."""
    head = title(result.plan)
    pictures = {"convergence.png": draw_convergence(result.plan, candidates, head)}
    if result.front:
        pictures["front.png"] = draw_front(result, candidates, head)
    return {TEXT: document(result).encode(), SCENE: scene_as_file(result.robot, f"{head}; found by `study optimise`."),
            NUMBERS: result_file(result), **{name: png(figure) for name, figure in pictures.items()}}


def _asked_varied(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Bounds of the options `--vary`, by parameter name."""
    found = {}
    for word in words:
        name, over = varied_in_words(word)
        if not isinstance(over, Range) or over.log:
            raise ValueError(f"--vary {word}: give NAME=LOW:HIGH, such as crank.radius=0.01:0.03")
        found[name] = over.low, over.high
    return found


def _add_options(own: Parser) -> None:
    default = Effort()
    objectives = "; ".join(f"{name}: {one.does}" for name, one in OBJECTIVES.items())
    own.add_argument("--objective", choices=[*OBJECTIVES, FRONT], default="speed_per_power", help=f"{objectives}; "
                        f"{FRONT}: speed and cost of transport (default: %(default)s)")
    own.add_argument("--power", choices=POWERS, help="what P is; net: work of the motor less what springs return to "
                        "it; delivered: without that; supply: what the supply gives to a dc motor (default: supply "
                        "with a dc motor, else net)")
    own.add_argument("--direction", choices=DIRECTIONS, default="either", help="which way counts; all starts must "
                        "agree (default: %(default)s)")
    own.add_argument("--least-speed", type=float, default=0.0, metavar="V", help="slower robots do not count [m/s] "
                        "(default: %(default)s)")
    own.add_argument("--most-air", type=float, default=1.0, metavar="SHARE", help="robots that are in the air for "
                        "a larger share of the time do not count (default: %(default)s)")
    own.add_argument("--fix", action="append", default=[], metavar="NAME[=VALUE]", help="do not vary this parameter")
    own.add_argument("--vary", action="append", default=[], metavar="NAME=LOW:HIGH", help="vary it between these "
                        "bounds, in its unit")
    own.add_argument("--budget", type=int, metavar="N", help=f"robots that are tried (default: {default.budget})")
    own.add_argument("--starts", type=int, metavar="N", help="drawn starts of each robot (default: "
                        f"{default.trials.starts})")
    own.add_argument("--seed", type=int, default=0, metavar="N", help="of the search (default: %(default)s)")
    own.add_argument("--quick", action="store_true", help="a look at everything within two minutes, not an optimum")


main = StudyCommand(
    "optimise", "Search for the fastest or thriftiest robot, verify the optimum from fresh starts, and write text, "
    "pictures and a scene file.", _add_options, plan_of, _results, failure="a run failed")
