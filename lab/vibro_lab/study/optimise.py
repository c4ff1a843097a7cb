"""``study optimise``: search for the best robot, verify it, and write the results.

The search is `cma.fmin2` as it is, CMA-ES with its restarts at twice as many points a group (A. Auger and N. Hansen,
CEC 2005, 1769), in the unit cube of the paper's seventeen parameters. A robot that cannot be built, or that cannot go
on, has the score `FAILED`. A robot's values are the measures `MEASURED` from each of the same drawn starts, and its
score is a quartile over these starts, so that a lucky start does not decide. A second set of starts selects among the
best robots, and a third set verifies the optimum, with a row for each of its attractors under each reading of the
forces.
"""

import argparse
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cma
import numpy as np
import pyarrow as pa

from vibro_lab.orbits.starts import running
from vibro_lab.study import figures
from vibro_lab.study.command import Progress, Results, StudyCommand, machine_of, settings_of
from vibro_lab.study.execution import Execution, Rows
from vibro_lab.study.measures import MEASURES, measure
from vibro_lab.study.page import finite, markdown_table, mean_in_words, number
from vibro_lab.study.table import Field, file_of, parameter_field, table_of
from vibro_lab.study.variation import Range, at_the_edge, values_at_shares, varied_in_words, whole_number
from vibro_lab.study.verification import AIR, MEASURED, POWERS, SUPPLY, Trials, verified
from vibro_ros import PARAMETERS, Parser, Scene, SimulationError, parameter_named, scene_as_file


class Variable(NamedTuple):
    """A parameter that is varied from `low` to `high`, in equal ratios if `logarithmic`; `reason` is of its bounds."""

    name: str
    symbol: str
    low: float
    high: float
    logarithmic: bool
    reason: str


_TWICE, _MASS = "from half to twice the paper's", "from the lightest to the heaviest mass of the paper's Fig. 3(a)"
_SPRING, _DAMPER = "a decade either way of the paper's", "from a tenth to ten times that of `device`"
_PLATE, _GAP = "from hard rubber to the paper's steel", "a plate at the slider's mid-stroke, aside by one crank radius"
VARIABLES = (
    Variable("mass.upper", "m2", 0.02, 0.25, True, _MASS),
    Variable("mass.inclined", "m3", 0.02, 0.25, True, _MASS),
    Variable("crank.upper_rod", "l_AB", 0.03, 0.12, True, _TWICE),
    Variable("crank.inclined_rod", "l_AC", 0.03, 0.12, True, _TWICE),
    Variable("crank.radius", "l_DA", 0.003, 0.06, True, "up to the longest of the paper's Fig. 3(b), or to a rod"),
    Variable("guide.angle", "φ", math.radians(10.0), math.radians(90.0), False, "beyond 90° the guide points into the "
             "ground; at 0° nothing drives the body"),
    Variable("inclined.plate.stiffness", "k1", 1e5, 1e7, True, _PLATE),
    Variable("upper.spring.stiffness", "k2", 1e2, 1e4, True, _SPRING),
    Variable("inclined.spring.stiffness", "k3", 1e2, 1e4, True, _SPRING),
    Variable("upper.plate.stiffness", "k4", 1e5, 1e7, True, _PLATE),
    Variable("inclined.plate.damping", "c1", 10.0, 1000.0, True, _DAMPER),
    Variable("upper.spring.damping", "c2", 0.2, 20.0, True, _DAMPER),
    Variable("inclined.spring.damping", "c3", 0.2, 20.0, True, _DAMPER),
    Variable("upper.plate.damping", "c4", 10.0, 1000.0, True, _DAMPER),
    Variable("motor.speed", "ω", 20.0, 200.0, True, "from a fifth to twice the paper's"),
    Variable("inclined.gap", "ξ_H - l_AC", -0.06, 0.06, False, _GAP),
    Variable("upper.gap", "ζ_E - l_AB", -0.06, 0.06, False, _GAP),
)
"""The paper's parameters of F_opt; the rods come before the crank, and the crank before the gaps that it limits."""
_MEANING = {"net": "the work of the motor less what the springs return to it, over time",
            "delivered": "the work that the motor delivers, over time; what the springs return to it is lost",
            "supply": "the energy that the supply gives to the dc motor, with the heat of its winding, over time"}
DIRECTIONS = {"either": 0.0, "forward": 1.0, "backward": -1.0}
SPEED, RATIO, FRONT = "speed", "speed_per_power", "front"
OBJECTIVES = {SPEED: "mean speed", RATIO: "mean speed over mean power, the paper's F_opt = V/P",
              FRONT: "the front of speed and cost of transport"}
WEIGHTS = (0.5, 0.0, 1.0, 0.25, 0.75)
"""Weights of the logarithm of the speed in a search for the front, each with a fifth of the budget."""
QUANTILE, FAILED = 0.25, -1e3
"""Quantile over the starts that gives the score, and the score of a robot that cannot be simulated."""
_SIGMA, _FINE, _RESTARTS = 0.3, 1e-3, 99  # of CMA-ES, as shares of the cube's edge; the budget ends the restarts
_ON_BOUND, _APART = 0.01, 0.05  # shares: a value on its bound; the least distance between two finalists
_SHOWN = 24  # largest number of robots of a front


class SearchEffort(NamedTuple):
    """Number of robots of a search and of its finalists, and the trials of each robot, each finalist, the optimum."""

    budget: int = 3000
    finalists: int = 12
    trials: Trials = Trials(0, 4, 2.0, 4.0)
    choosing: Trials = Trials(10_000, 8, 4.0, 8.0)
    verifying: Trials = Trials(20_000, 16, 4.0, 10.0)


QUICK = SearchEffort(120, 3, Trials(0, 3, 1.5, 2.0), Trials(10_000, 4, 2.0, 4.0), Trials(20_000, 6, 2.0, 6.0))
"""A demonstration of all steps within a minute or two; it does not find the optimum."""


@dataclass(frozen=True)
class SearchPlan:
    """Design of a search."""

    scene: Scene  # scene with the values of all parameters that are not varied
    variables: tuple[Variable, ...]  # the varied parameters, in the order of `VARIABLES`
    objective: str  # names in `OBJECTIVES`, `POWERS` and `DIRECTIONS`
    power: str
    direction: str
    least_speed: float  # least speed [m/s], and largest share of the time in the air, of an accepted robot
    most_air: float
    effort: SearchEffort  # amount of simulation
    seed: int  # seed of the search

    def bounds(self, variable: Variable, values: Mapping[str, float]) -> tuple[float, float]:
        """Bounds of a variable where other parameters have `values`: a crank longer than a rod jams, and a plate more
        than a crank radius aside is never touched (ValueError if nothing is left).
        """
        length = {name: values.get(name, self.scene[name])
                  for name in ("crank.radius", "crank.upper_rod", "crank.inclined_rod")}
        low, high = variable.low, variable.high
        if variable.name == "crank.radius":
            high = min(high, length["crank.upper_rod"], length["crank.inclined_rod"])
        elif variable.name.endswith(".gap"):
            low, high = max(low, -length["crank.radius"]), min(high, length["crank.radius"])
        if low > high:
            raise ValueError(f"--vary {variable.name}: from {variable.low:g} to {variable.high:g} leaves no value "
                             "where rods and crank are shortest; give bounds that the shortest rod and crank allow")
        return low, high

    def parameters(self, point: Sequence[float] | np.ndarray) -> dict[str, float]:
        """Values of the varied parameters at a point of the unit cube, shape (variables,)."""
        values: dict[str, float] = {}
        for variable, share in zip(self.variables, point, strict=True):
            values[variable.name] = float(values_at_shares(
                *self.bounds(variable, values), variable.logarithmic, np.array(share)))
        return values

    def robot(self, point: Sequence[float] | np.ndarray) -> Scene:
        """Return the scene at a point (ValueError where limits on combinations of parameters refuse it)."""
        return self.scene.with_parameters(self.parameters(point))

    def values_at(self, points: Sequence[np.ndarray], trials: Trials, number: int) -> np.ndarray:
        """Values of the robot at a point, shape (starts, measures); all are NaN if it cannot be built, or go on."""
        try:
            robot = self.robot(points[number])
            rows = [measure(robot, MEASURED, trials.settling, trials.duration, trials.first + start)
                    for start in range(trials.starts)]
        except (ValueError, SimulationError):
            return np.full((trials.starts, len(MEASURED)), np.nan)
        return np.array([[row[name] for name in MEASURED] for row in rows])

    def speeds(self, values: np.ndarray) -> np.ndarray:
        """Mean speeds [m/s] of a robot's starts, positive in the direction that counts, shape (starts,)."""
        return (DIRECTIONS[self.direction] or float(np.sign(values[:, 0].mean())) or 1.0) * values[:, 0]

    def speed(self, values: np.ndarray) -> float:
        """Lower quartile of the speeds of a robot [m/s]; the least speed if one is not above 0."""
        if not np.isfinite(values[:, :SUPPLY]).all():
            return FAILED
        speeds = self.speeds(values)
        return float(speeds.min() if speeds.min() <= 0.0 else np.quantile(speeds, QUANTILE))

    def score(self, values: np.ndarray) -> float:
        """Score of a robot from its values: speed or V/P; if it is too slow or flies too long, minus the excess."""
        speed, excess = self.speed(values), self.excess(values)
        missing = excess + (max(self.least_speed - speed, 0.0) if self.least_speed > 0.0 else 0.0)
        if missing > 0.0 or speed <= 0.0 or self.objective == SPEED:
            return max(-missing, FAILED) if missing > 0.0 else speed
        power = values[:, POWERS[self.power]]
        # Springs that returned stored energy: the time was too short for a mean.
        return float(np.quantile(self.speeds(values) / power, QUANTILE)) if power.min() > 0.0 else 0.0

    def excess(self, values: np.ndarray) -> float:
        """Excess of the share of the time in the air over `most_air`, from the start with the largest share."""
        return max(float(values[:, AIR].max()) - self.most_air, 0.0) if self.most_air < 1.0 else 0.0

    def speed_and_cost(self, point: np.ndarray, values: np.ndarray) -> tuple[float, float]:
        """Speed [m/s] of the robot at a point, and the upper quartile of its costs of transport P / (M g V).

        The cost is infinite if the robot is not accepted, or if V, P or M g is not above 0.
        """
        speed, power = self.speed(values), values[:, POWERS[self.power]]
        if speed == FAILED or (excess := self.excess(values)):
            return (FAILED if speed == FAILED else -excess), math.inf
        robot = self.robot(point)
        weight = robot.total_mass * robot["gravity"]
        if speed <= 0.0 or power.min() <= 0.0 or weight <= 0.0:
            return speed, math.inf
        return speed, float(np.quantile(power / (weight * np.abs(values[:, 0])), 1.0 - QUANTILE))

    def weighted(self, weight: float, point: np.ndarray, values: np.ndarray) -> float:
        """Score of a robot for the front: weighted logarithms of speed and cost."""
        speed, cost = self.speed_and_cost(point, values)
        if speed <= 0.0 or not math.isfinite(cost):
            return FAILED + max(speed, FAILED)
        return weight * math.log(speed) - (1.0 - weight) * math.log(cost)


def values_of(plan: SearchPlan, points: Sequence[np.ndarray], trials: Trials, execution: Execution) -> Rows:
    """Yield the values of the robot at each point."""
    return execution.rows(partial(plan.values_at, tuple(points), trials), range(len(points)),
                          trials.run_time)


class Candidates(NamedTuple):
    """Robots of a search."""

    points: np.ndarray  # of the cube, shape (n, variables)
    values: np.ndarray  # shape (n, starts, measures)


def searched(plan: SearchPlan, execution: Execution) -> Candidates:
    """Search until the budget is spent; the last group is complete."""
    points, values = list[np.ndarray](), list[np.ndarray]()
    weights: Sequence[float | None] = WEIGHTS if plan.objective == FRONT else (None,)

    def losses(weight: float | None, progress: Progress, group: Sequence[np.ndarray]) -> list[float]:
        group = [np.clip(point, 0.0, 1.0) for point in group]
        first = len(values)
        with closing(values_of(plan, group, plan.effort.trials, execution)) as results:
            for robot in results:
                values.append(robot)
                progress.add(1)
        points.extend(group)
        return [-(plan.score(robot) if weight is None else plan.weighted(weight, point, robot))
                for point, robot in zip(group, values[first:], strict=True)]

    with Progress("search", "robot", plan.effort.budget) as progress:
        for place, weight in enumerate(weights):
            cma.fmin2(None, np.full(len(plan.variables), 0.5), _SIGMA, {
                "bounds": [0.0, 1.0], "verbose": -9, "verb_log": 0, "tolx": _FINE, "tolfunrel": _FINE,
                "eval_final_mean": False, "maxfevals": max(1, plan.effort.budget // len(weights)),
                "seed": plan.seed + 1 + 1000 * place},  # cma takes 0 for a seed of the clock
                parallel_objective=partial(losses, weight, progress), restarts=_RESTARTS)
    return Candidates(np.array(points), np.array(values))


def chosen(plan: SearchPlan, candidates: Candidates, execution: Execution) -> np.ndarray:
    """Return the point that is best from other starts among the best of the search, whose scores were partly luck."""
    scores, finalists = np.array([plan.score(values) for values in candidates.values]), list[np.ndarray]()
    for place in np.argsort(-scores, kind="stable"):
        point = candidates.points[place]
        if plan.speed(candidates.values[place]) > FAILED and len(finalists) < plan.effort.finalists and all(
                np.abs(point - other).max() >= _APART for other in finalists):
            finalists.append(point)
    fresh = [plan.score(values) for values in values_of(plan, finalists, plan.effort.choosing, execution)]
    if not fresh or max(fresh) <= 0.0:
        raise ValueError(f"--budget {plan.effort.budget}: no robot was found that goes the same way from all starts"
                         f"{' at the least speed' if plan.least_speed else ''}"
                         f"{' with so little time in the air' if plan.most_air < 1.0 else ''}; give a larger budget or "
                         "other bounds")
    return finalists[int(np.argmax(fresh))]


def front_of(plan: SearchPlan, candidates: Candidates, execution: Execution) -> list[dict[str, Any]]:
    """Return the robots of which none is both faster and cheaper than another, from other starts, the slowest first.

    A robot has its speed [m/s], cost of transport, power [W] and parameters.
    """
    pairs = np.array([plan.speed_and_cost(*robot) for robot in zip(*candidates, strict=True)])
    numbers = non_dominated(pairs)
    if len(numbers) > _SHOWN:  # spread evenly over the logarithm of their speeds
        logs = np.log(pairs[numbers, 0])
        numbers = [numbers[k] for k in sorted({int(np.argmin(np.abs(logs - wanted)))
                                               for wanted in np.linspace(logs[0], logs[-1], _SHOWN)})]
    points, robots = [candidates.points[k] for k in numbers], list[dict[str, Any]]()
    for point, values in zip(points, values_of(plan, points, plan.effort.choosing, execution), strict=True):
        speed, cost = plan.speed_and_cost(point, values)
        robots.append({"speed": speed, "cost": cost, "parameters": plan.parameters(point), "power": float(
            np.quantile(values[:, POWERS[plan.power]], 1.0 - QUANTILE))})
    return [robots[k] for k in non_dominated(np.array([(robot["speed"], robot["cost"]) for robot in robots]))]


def non_dominated(pairs: np.ndarray) -> list[int]:
    """Indices of the pairs (speed, cost) that no other dominates, the slowest first, with speed > 0 and finite cost."""
    kept, cheapest = list[int](), math.inf
    for place in sorted(range(len(pairs)), key=lambda k: (-pairs[k][0], pairs[k][1])):
        if pairs[place][0] > 0.0 and pairs[place][1] < cheapest:
            kept.append(place)
            cheapest = pairs[place][1]
    return kept[::-1]




def speed_in_words(row: Mapping[str, Any]) -> str:
    """Mean speed of a motion [mm/s], or the range of starts that have not settled; and its drift."""
    ends = dict.fromkeys(number(row[end], 1e3) for end in ("least", "largest"))
    settled = row["turns"] is not None or not math.isfinite(row["least"])
    return (mean_in_words(row["speed"], 1e3) if settled else " to ".join(ends)) + (
        f", drifts by {number(row['drift'], 1e3)}" if row["drift"] else "")


@dataclass(frozen=True)
class Result:
    """Result of a search: the best point, the rows of its verification, and the robots of the front."""

    plan: SearchPlan
    candidates: Candidates
    point: np.ndarray
    rows: list[dict[str, Any]]
    front: list[dict[str, Any]]

    @property
    def title(self) -> str:
        """Heading of page and pictures."""
        return f"Optimum: {OBJECTIVES[self.plan.objective]}, scene {self.plan.scene.name}"

    def in_words(self) -> list[str]:
        """Return what the robot does, its parameters, and those on a bound, beyond which the score may still rise."""
        values, effort = self.plan.parameters(self.point), self.plan.effort
        ratios = [f" and {mean_in_words(row['ratio'])} m/J" if math.isfinite(row["cost"]) else "" for row in self.rows]
        does = "; ".join(
            f"{speed_in_words(row)} mm/s{ratio} from {row['starts']} of {effort.verifying.starts} starts"
            for row, ratio in zip(self.rows, ratios, strict=True) if row["reading"] == self.rows[0]["reading"])
        robot = ", ".join(f"{name} = {number(value)} {PARAMETERS[name].unit}".strip() for name, value in values.items())
        ends = [f"{name} ({_end(share)})" for name, share in zip(values, self.point, strict=True) if _end(share)]
        return [f"The optimum goes at {does}, forward positive.", f"The optimum: {robot}.",
                at_the_edge("the best score", ends) or "The optimum lies within the range of every parameter."]

    def document(self) -> str:
        """Return the page."""
        plan, (does, _, ends) = self.plan, self.in_words()
        trials, verifying = plan.effort.trials, plan.effort.verifying
        asked = (
            f"P is mean power: {_MEANING[plan.power]}. CMA-ES tried {len(self.candidates.points)} robots from the same "
            f"{trials.starts} drawn starts, over {trials.duration:g} s after {trials.settling:g} s. The score is the "
            f"lower quartile of these starts. Direction: {plan.direction}; all starts must agree. Least speed: "
            f"{number(plan.least_speed, 1e3)} mm/s. Most time in the air: {100 * plan.most_air:g} %.")
        values = plan.parameters(self.point)
        parameters = [[f"`{one.name}`", one.symbol, number(values[one.name]), number(PARAMETERS[one.name].default),
                       PARAMETERS[one.name].unit, f"{number(one.low)} to {number(one.high)}", _end(share), one.reason]
                      for one, share in zip(plan.variables, self.point, strict=True)]
        motions = [[row["reading"], "not settled" if row["turns"] is None else f"{row['turns'] or 'no'} turns",
                    f"{row['starts']} of {verifying.starts}", speed_in_words(row), number(row["load"]),
                    f"{100 * row['unloaded']:.0f}", f"{100 * row['air']:.0f}",
                    *(mean_in_words(row[name]) for name in ("power", "delivered", "supply")),
                    mean_in_words(row["ratio"]) if math.isfinite(row["cost"]) else "-", number(row["cost"])]
                   for row in self.rows]
        said = (
            f"{verifying.starts} drawn starts that the search has not seen, {verifying.duration:g} s each after "
            f"{verifying.settling:g} s: a row for each motion, with its mean ± half the 95 % interval, or the range of "
            "starts that have not settled. Mean N over the weight must be 1 on a real ground; a robot with more is "
            "held down by the rule of its row, and would not do this.")
        return "\n\n".join([
            f"# {self.title}", asked, does, "## Parameters", ends, markdown_table(
            ["parameter", "symbol", "optimum", "paper", "unit", "bounds", "on bound", "why these bounds"], parameters),
            "## Verification", said, markdown_table(
            ["reading", "repeats itself after", "starts", "speed, forward positive [mm/s]", "mean N over weight",
             "time with N <= 0 [%]", "in the air [%]", "P net [W]", "P delivered [W]", "P from the supply [W]",
             "V/P [m/J]", "cost of transport"], motions)]) + "\n"

    def numbers(self) -> bytes:
        """Return the data of the page as JSON, in SI units; numbers that are not finite are null."""
        whole = {"robots": len(self.candidates.points), "optimum": self.plan.parameters(self.point),
                 "verified": self.rows, "front": self.front}
        return (json.dumps(finite(whole), indent=1, allow_nan=False) + "\n").encode()

    def table(self) -> bytes:
        """Return a Parquet file with a row for each robot that was tried and each of its starts, in their order."""
        fields = [Field("robot", pa.int64(), "1", "number of the robot, in the order of the search"),
                  *(parameter_field(variable.name) for variable in self.plan.variables),
                  *(Field(name, pa.float64(), MEASURES[name].unit or "1", "NaN for a robot that cannot go on")
                    for name in MEASURED)]
        return file_of(table_of([
            {"robot": place, **self.plan.parameters(point), **dict(zip(MEASURED, start, strict=True))}
            for place, (point, values) in enumerate(zip(*self.candidates, strict=True)) for start in values.tolist()],
            fields))

    @figures.default_settings()
    def picture(self) -> bytes:
        """Draw cost of transport over speed: all robots, the front and the optimum from other starts; a PNG file."""
        figure = figures.new_figure(8.0, 5.5)
        axes = figure.subplots()
        pairs = [self.plan.speed_and_cost(*robot) for robot in zip(*self.candidates, strict=True)]
        best = [(abs(row["speed"]["mean"]), row["cost"]) for row in self.rows
                if row["reading"] == self.rows[0]["reading"] and row["cost"] > 0.0]
        for shown, style, size, colour, label in (
                (pairs, ".", 5.0, figures.SKY, "a robot of the search"), (best, "*", 9.0, figures.VERMILION, "optimum"),
                ([(robot["speed"], robot["cost"]) for robot in self.front], "-o", 3.0, figures.BLACK, "front")):
            drawn = np.array([pair for pair in shown if pair[0] > 1e-4 and math.isfinite(pair[1])]).reshape(-1, 2)
            axes.plot(1e3 * drawn[:, 0], drawn[:, 1], style, ms=size, color=colour, label=label)
        axes.set(xscale="log", yscale="log", xlabel="mean speed [mm/s]", ylabel="cost of transport P / (M g V)")
        axes.legend(frameon=False)
        figures.style_axes(axes)
        figures.set_heading(figure, self.title)
        return figures.png(figure)


def _end(share: float) -> str:
    return "lower" if share < _ON_BOUND else "upper" if share > 1.0 - _ON_BOUND else ""


def _results(plan: SearchPlan, folder: Path, execution: Execution) -> Iterator[Results]:
    candidates = searched(plan, execution)
    point = chosen(plan, candidates, execution)
    robot, pays = plan.robot(point), plan.scene["effects.reaction"]
    result = Result(plan, candidates, point, verified(robot, plan.power, plan.effort.verifying, execution),
                    front_of(plan, candidates, execution) if pays else [])
    files = {"optimum.md": result.document().encode(), "optimum.json": result.numbers(),
             "optimum.yaml": scene_as_file(robot, f"{result.title}; found by `study optimise`."),
             "candidates.parquet": result.table()}
    yield Results({**files, **({"front.png": result.picture()} if result.front else {})}, result.in_words())


def chosen_variables(fixed: Sequence[str], words: Sequence[str]) -> tuple[Variable, ...]:
    """Return `VARIABLES` without the fixed ones, and with the bounds of the options `--vary` (ValueError)."""
    variables = {variable.name: variable for variable in VARIABLES}
    ranges = dict(map(varied_in_words, words))
    for option, name in [*(("--fix", name) for name in fixed), *(("--vary", name) for name in ranges)]:
        if name not in variables:
            parameter_named(name, PARAMETERS)
            raise ValueError(f"{option} {name}: is not among the paper's parameters of F_opt, which are "
                             f"{', '.join(variables)}; write it into a scene file")
    for word, (name, over) in zip(words, ranges.items(), strict=True):
        if not isinstance(over, Range) or over.log:
            raise ValueError(f"--vary {word}: give NAME=LOW:HIGH, such as crank.radius=0.01:0.03")
        if name in fixed:
            raise ValueError(f"--vary {name}: is fixed as well; leave out --fix or --vary")
        if variables[name].logarithmic and over.low <= 0.0:
            raise ValueError(f"--vary {word}: is varied in equal ratios; give bounds above 0 {PARAMETERS[name].unit}")
        variables[name] = variables[name]._replace(low=over.low, high=over.high, reason="as asked for")
    kept = tuple(variable for name, variable in variables.items() if name not in fixed)
    if not kept:
        raise ValueError("--fix: nothing is left to vary; fix fewer parameters")
    return kept


def plan_of(options: argparse.Namespace) -> SearchPlan:
    """Make the plan from the options (ValueError for one that is out of range or contradicts another)."""
    for name, least, most in (("budget", 1, 10**6), ("starts", 2, 1000), ("seed", 0, 2**31 - 10_000)):
        if (value := getattr(options, name)) is not None:
            whole_number(f"--{name}", value, least, most)
    for name, limit, unit in (("least_speed", 100.0, " m/s"), ("most_air", 1.0, "")):
        if not 0.0 <= (value := getattr(options, name)) <= limit:
            raise ValueError(f"--{name.replace('_', '-')} {value:g}: give a number from 0 to {limit:g}{unit}")
    scene = running(machine_of(options).with_parameters(settings_of([word for word in options.fix if "=" in word])))
    variables = chosen_variables([word.partition("=")[0] for word in options.fix], options.vary)
    effort = QUICK if options.quick else SearchEffort()
    effort = effort._replace(budget=options.budget or effort.budget,
                             trials=effort.trials._replace(starts=options.starts or effort.trials.starts))
    has_supply = scene.has_rotor and scene["solver.method"] == "exact"
    if options.power == "supply" and not has_supply:
        raise ValueError(f"--power supply: {scene.name} has no dc motor that the method exact solves; give --power net "
                         "or delivered, or a scene with effects.motor dc such as machine")
    if options.objective != SPEED and not scene["effects.reaction"]:
        raise ValueError(f"--scene {scene.name}: has effects.reaction false, by which the masses do not pay for the "
                         "body's friction, so that power can be 0 and V/P or the cost of transport has no bound; give "
                         "a scene with effects.reaction true such as device, or --objective speed")
    power = options.power or ("supply" if has_supply else "net")
    plan = SearchPlan(scene.with_parameters({"solver.accounts": False}), variables, options.objective, power,
                      options.direction, options.least_speed, options.most_air, effort, options.seed)
    for corner in (0.0, 1.0):
        plan.robot([corner] * len(variables))  # refuses bounds within which no robot can be built
    return plan


def _add_options(parser: Parser) -> None:
    add, default = parser.add_argument, SearchEffort()
    add("--objective", choices=OBJECTIVES, default=RATIO, help=(
        "; ".join(f"{name}: {does}" for name, does in OBJECTIVES.items()) + " (default: %(default)s)"))
    add("--power", choices=POWERS, help="what P is; " + "; ".join(f"{name}: {does}" for name, does in _MEANING.items())
        + " (default: supply with a dc motor, else net)")
    add("--direction", choices=DIRECTIONS, default="either", help="which way counts; all starts must agree (default: "
        "%(default)s)")
    add("--least-speed", type=float, default=0.0, metavar="V", help="slower robots do not count [m/s] (default: "
        "%(default)s)")
    add("--most-air", type=float, default=1.0, metavar="SHARE", help="robots that are in the air for a larger share of "
        "the time do not count (default: %(default)s)")
    add("--fix", action="append", default=[], metavar="NAME[=VALUE]", help="do not vary this parameter")
    add("--vary", action="append", default=[], metavar="NAME=LOW:HIGH", help="vary it between these bounds [its unit]")
    add("--budget", type=int, metavar="N", help=f"robots that are tried (default: {default.budget})")
    add("--starts", type=int, metavar="N", help=f"drawn starts of each robot (default: {default.trials.starts})")
    add("--seed", type=int, default=0, metavar="N", help="of the search (default: %(default)s)")
    add("--quick", action="store_true", help="a look at everything within two minutes, not an optimum")


main = StudyCommand(
    "optimise", "Search for the fastest or thriftiest robot, verify the optimum from fresh starts, and write text, "
    "a table, a picture and a scene file.", _add_options, plan_of, _results, failure="a run failed", goes_on=False)
