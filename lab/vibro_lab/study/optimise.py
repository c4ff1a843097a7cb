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
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cma
import numpy as np
import pyarrow as pa

from vibro_lab.orbits.attractors import Attractor, group_starts
from vibro_lab.orbits.chaos import half_interval
from vibro_lab.orbits.starts import running
from vibro_lab.orbits.turn_map import whole_number
from vibro_lab.study import figures
from vibro_lab.study.command import Progress, Results, StudyCommand, machine_of, settings_of
from vibro_lab.study.execution import Execution, Rows
from vibro_lab.study.measures import MEASURES, drift_in, measure, measure_with_motion
from vibro_lab.study.table import Field, file_of, parameter_field, table_of
from vibro_lab.study.variation import Range, at_the_edge, values_at_shares, varied_in_words
from vibro_ros import PARAMETERS, Parser, Scene, SimulationError, load_scene, parameter_named, scene_as_file

VARIABLES = (
    # From the lightest to the heaviest mass of the paper's Fig. 3(a): m2, m3.
    Range("mass.upper", 0.02, 0.25, True),
    Range("mass.inclined", 0.02, 0.25, True),
    # Rods l_AB, l_AC from half to twice the paper's; a crank l_DA up to the longest of Fig. 3(b), or to a rod.
    Range("crank.upper_rod", 0.03, 0.12, True),
    Range("crank.inclined_rod", 0.03, 0.12, True),
    Range("crank.radius", 0.003, 0.06, True),
    # φ: beyond 90° the guide points into the ground; at 0° nothing drives the body.
    Range("guide.angle", math.radians(10.0), math.radians(90.0), False),
    # Plates k1, k4 from hard rubber to the paper's steel; springs k2, k3 a decade either way of the paper's.
    Range("inclined.plate.stiffness", 1e5, 1e7, True),
    Range("upper.spring.stiffness", 1e2, 1e4, True),
    Range("inclined.spring.stiffness", 1e2, 1e4, True),
    Range("upper.plate.stiffness", 1e5, 1e7, True),
    # c1 to c4 from a tenth to ten times those of `device`.
    Range("inclined.plate.damping", 10.0, 1000.0, True),
    Range("upper.spring.damping", 0.2, 20.0, True),
    Range("inclined.spring.damping", 0.2, 20.0, True),
    Range("upper.plate.damping", 10.0, 1000.0, True),
    # ω from a fifth to twice the paper's.
    Range("motor.speed", 20.0, 200.0, True),
    # ξ_H - l_AC, ζ_E - l_AB: a plate at the slider's mid-stroke, aside by one crank radius.
    Range("inclined.gap", -0.06, 0.06, False),
    Range("upper.gap", -0.06, 0.06, False),
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


MEASURED = ("mean_speed", "mean_power", "delivered_power", "air_share", "supply_power")
"""Measures of each start: the columns of a robot's values. The last one is NaN without a dc motor."""
AIR, SUPPLY = 3, 4
_LOADS = ("mean_load", "unloaded_share")  # measures of the verification alone
POWERS = {"net": 1, "delivered": 2, "supply": SUPPLY}
"""Column of `MEASURED` for each reading of P."""


class Trials(NamedTuple):
    """Runs of a robot: drawn starts from number `first` on, with times in s."""

    first: int
    starts: int
    settling: float
    duration: float

    @property
    def run_time(self) -> float:
        """Simulated time of all starts [s]."""
        return self.starts * (self.settling + self.duration)


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
    variables: tuple[Range, ...]  # the varied parameters, in the order of `VARIABLES`
    objective: str  # names in `OBJECTIVES`, `POWERS` and `DIRECTIONS`
    power: str
    direction: str
    least_speed: float  # least speed [m/s], and largest share of the time in the air, of an accepted robot
    most_air: float
    effort: SearchEffort  # amount of simulation
    seed: int  # seed of the search

    def bounds(self, variable: Range, values: Mapping[str, float]) -> tuple[float, float]:
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
                *self.bounds(variable, values), variable.log, np.array(share)))
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
        if not np.isfinite(values[:, [0, AIR]]).all():
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
        for number, weight in enumerate(weights):
            cma.fmin2(None, np.full(len(plan.variables), 0.5), _SIGMA, {
                "bounds": [0.0, 1.0], "verbose": -9, "verb_log": 0, "tolx": _FINE, "tolfunrel": _FINE,
                "eval_final_mean": False, "maxfevals": max(1, plan.effort.budget // len(weights)),
                "seed": plan.seed + 1 + 1000 * number},  # cma takes 0 for a seed of the clock
                parallel_objective=partial(losses, weight, progress), restarts=_RESTARTS)
    return Candidates(np.array(points), np.array(values))


def chosen(plan: SearchPlan, candidates: Candidates, execution: Execution) -> np.ndarray:
    """Return the point that is best from other starts among the best of the search, whose scores were partly luck."""
    scores, finalists = np.array([plan.score(values) for values in candidates.values]), list[np.ndarray]()
    for index in np.argsort(-scores, kind="stable"):
        point = candidates.points[index]
        if plan.speed(candidates.values[index]) > FAILED and len(finalists) < plan.effort.finalists and all(
                np.abs(point - finalist).max() >= _APART for finalist in finalists):
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
    indices, cheapest = list[int](), math.inf
    for index in sorted(range(len(pairs)), key=lambda k: (-pairs[k][0], pairs[k][1])):
        if pairs[index][0] > 0.0 and pairs[index][1] < cheapest:
            indices.append(index)
            cheapest = pairs[index][1]
    return indices[::-1]


def readings(scene: Scene) -> dict[str, Scene]:
    """Scenes for the verification by their descriptions: the scene itself, and variants with other effects or start."""
    other_start = "zero" if scene["start.state"] == "rest" else "rest"
    changes_of_readings: dict[str, dict[str, Any]] = {
        "the body is held on the ground by decree (`unilateral`)": {"effects.normal_force": "unilateral"},
        f"drawn starts that begin from `{other_start}`": {"start.state": other_start},
        "every effect of `device`": {name: value for name, value in load_scene("device").parameters.items()
                                     if name.startswith("effects.")}}
    scenes = {f"as sought (`{scene.name}`)": scene}
    for description, changes in changes_of_readings.items():
        if (changed_scene := scene.with_parameters(changes)) not in scenes.values():
            scenes[description] = changed_scene
    return scenes


def verified(scene: Scene, power: str, trials: Trials, execution: Execution) -> list[dict[str, Any]]:
    """Return a row for each attractor of a robot under each of `readings`, that of most starts first; SI units."""
    scenes, rows = readings(scene), list[dict[str, Any]]()
    runs = execution.rows(partial(_settled_at, tuple(scenes.values()), trials), range(len(scenes)),
                          trials.run_time)
    with closing(runs), Progress("verification", "reading", len(scenes)) as progress:
        for (description, reading_scene), starts in zip(scenes.items(), runs, strict=True):
            values, motions, drifts = map(list, zip(*starts, strict=True))
            attractors, indices = group_starts(motions, [row[0] for row in values])
            rows += [_row(description, reading_scene, attractor, np.array(values)[indices == index],
                          np.array(drifts)[indices == index], power) for index, attractor in enumerate(attractors)]
            progress.add(1)
    return rows


def _settled_at(scenes: tuple[Scene, ...], trials: Trials, number: int) -> list[tuple[list[float], Any, float]]:
    """Measures, settled motion or None, and drift from each start; NaN if the run cannot go on."""
    names, starts = (*MEASURED, *_LOADS), list[tuple[list[float], Any, float]]()
    for start in range(trials.first, trials.first + trials.starts):
        try:
            values, motion, drift = measure_with_motion(scenes[number], names, trials.settling, trials.duration, start)
            starts.append(([values[name] for name in names], motion, drift))
        except SimulationError:
            starts.append(([math.nan] * len(names), None, math.nan))
    return starts


def _row(description: str, scene: Scene, attractor: Attractor, values: np.ndarray, drifts: np.ndarray, power: str
         ) -> dict[str, Any]:
    """Row of an attractor from the values of its starts; means with half the 95 % interval, if the starts settled."""
    def mean(column: np.ndarray) -> dict[str, float]:
        return {"mean": float(column.mean()),
                "spread": math.nan if attractor.turns is None else float(half_interval(column))}

    powers, weight = values[:, POWERS[power]], scene.total_mass * scene["gravity"]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio, speed = mean(np.abs(values[:, 0]) / powers), mean(values[:, 0])
    has_cost = scene["effects.reaction"] and powers.mean() > 0.0 and speed["mean"] != 0.0 and weight > 0.0
    load, unloaded = values[:, len(MEASURED):].mean(axis=0).tolist()
    return {"reading": description, "words": attractor.in_words(), "turns": attractor.turns, "starts": attractor.starts,
            "share": attractor.share, "low": attractor.low, "high": attractor.high, "speed": speed,
            "least": attractor.least, "largest": attractor.largest, "power": mean(values[:, 1]),
            "delivered": mean(values[:, 2]), "supply": mean(values[:, SUPPLY]), "ratio": ratio,
            "cost": float(powers.mean() / (weight * abs(speed["mean"]))) if has_cost else math.nan,
            "drift": 0.0 if attractor.turns else drift_in(drifts, speed["mean"]),
            "load": load, "unloaded": unloaded, "air": float(values[:, AIR].mean())}


def motion_in_words(row: Mapping[str, Any]) -> str:
    """Speed and period of a row of `verified`, the drift of a transient, V/P, and the number of starts."""
    drift = f", drifts by {1e3 * row['drift']:.3g} mm/s" if row["drift"] else ""
    ratio = f", {row['ratio']['mean']:.3g} m/J" if math.isfinite(row["cost"]) else ""
    return f"{row['words']}{drift}{ratio} ({row['starts']} starts)"


def finite(value: Any) -> Any:
    """Replace numbers that are not finite by None, because JSON does not have them."""
    if isinstance(value, dict):
        return {name: finite(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


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
        """Heading of the picture and of the scene file."""
        return f"Optimum: {OBJECTIVES[self.plan.objective]}, scene {self.plan.scene.name}"

    def in_words(self) -> list[str]:
        """Return what the robot does, its parameters, and those on a bound, beyond which the score may still rise."""
        values = self.plan.parameters(self.point)
        robot = ", ".join(f"{name} = {float(f'{value:.3g}'):g} {PARAMETERS[name].unit}".strip()
                          for name, value in values.items())
        ends = [f"{name} ({'lower' if share < 0.5 else 'upper'})"
                for name, share in zip(values, self.point, strict=True) if min(share, 1.0 - share) < _ON_BOUND]
        does = "; ".join(motion_in_words(row) for row in self.rows if row["reading"] == self.rows[0]["reading"])
        return [f"The optimum goes at {does}; forward positive.", f"The optimum: {robot}.",
                at_the_edge("the best score", ends) or "The optimum lies within the range of every parameter."]

    def numbers(self) -> bytes:
        """Return all results as JSON, in SI units; numbers that are not finite are null."""
        document = {"robots": len(self.candidates.points), "optimum": self.plan.parameters(self.point),
                    "verified": self.rows, "front": self.front}
        return (json.dumps(finite(document), indent=1, allow_nan=False) + "\n").encode()

    def table(self) -> bytes:
        """Return a Parquet file with a row for each robot that was tried and each of its starts, in their order."""
        fields = [Field("robot", pa.int64(), "1", "number of the robot, in the order of the search"),
                  *(parameter_field(variable.name) for variable in self.plan.variables),
                  *(Field(name, pa.float64(), MEASURES[name].unit or "1", "NaN for a robot that cannot go on")
                    for name in MEASURED)]
        return file_of(table_of([
            {"robot": number, **self.plan.parameters(point), **dict(zip(MEASURED, start, strict=True))}
            for number, (point, values) in enumerate(zip(*self.candidates, strict=True)) for start in values.tolist()],
            fields))

    @figures.default_settings()
    def picture(self) -> bytes:
        """Draw cost of transport over speed: all robots, the front and the optimum from other starts; a PNG file."""
        figure = figures.new_figure(8.0, 5.5)
        axes = figure.subplots()
        pairs = [self.plan.speed_and_cost(*robot) for robot in zip(*self.candidates, strict=True)]
        best = [(abs(row["speed"]["mean"]), row["cost"]) for row in self.rows
                if row["reading"] == self.rows[0]["reading"] and row["cost"] > 0.0]
        for points, style, size, colour, label in (
                (pairs, ".", 5.0, figures.SKY, "a robot of the search"), (best, "*", 9.0, figures.VERMILION, "optimum"),
                ([(robot["speed"], robot["cost"]) for robot in self.front], "-o", 3.0, figures.BLACK, "front")):
            drawn = np.array([pair for pair in points if pair[0] > 1e-4 and math.isfinite(pair[1])]).reshape(-1, 2)
            axes.plot(1e3 * drawn[:, 0], drawn[:, 1], style, ms=size, color=colour, label=label)
        axes.set(xscale="log", yscale="log", xlabel="mean speed [mm/s]", ylabel="cost of transport P / (M g V)")
        axes.legend(frameon=False)
        figures.style_axes(axes)
        figures.set_heading(figure, self.title)
        return figures.png(figure)


def _results(plan: SearchPlan, folder: Path, execution: Execution) -> Iterator[Results]:
    candidates = searched(plan, execution)
    point = chosen(plan, candidates, execution)
    robot, pays = plan.robot(point), plan.scene["effects.reaction"]
    result = Result(plan, candidates, point, verified(robot, plan.power, plan.effort.verifying, execution),
                    front_of(plan, candidates, execution) if pays else [])
    files = {"optimum.json": result.numbers(),
             "optimum.yaml": scene_as_file(robot, f"{result.title}; found by `study optimise`."),
             "candidates.parquet": result.table()}
    yield Results({**files, **({"front.png": result.picture()} if result.front else {})}, result.in_words())


def chosen_variables(fixed: Sequence[str], words: Sequence[str]) -> tuple[Range, ...]:
    """Return `VARIABLES` without the fixed ones, and with the bounds of the options `--vary` (ValueError)."""
    variables = {variable.name: variable for variable in VARIABLES}
    ranges = {varied.name: varied for varied in map(varied_in_words, words)}
    for option, name in [*(("--fix", name) for name in fixed), *(("--vary", name) for name in ranges)]:
        if name not in variables:
            parameter_named(name, PARAMETERS)
            raise ValueError(f"{option} {name}: is not among the paper's parameters of F_opt, which are "
                             f"{', '.join(variables)}; write it into a scene file")
    for word, (name, varied) in zip(words, ranges.items(), strict=True):
        if not isinstance(varied, Range) or varied.log:
            raise ValueError(f"--vary {word}: give NAME=LOW:HIGH, such as crank.radius=0.01:0.03")
        if name in fixed:
            raise ValueError(f"--vary {name}: is fixed as well; leave out --fix or --vary")
        if variables[name].log and varied.low <= 0.0:
            raise ValueError(f"--vary {word}: is varied in equal ratios; give bounds above 0 {PARAMETERS[name].unit}")
        variables[name] = replace(variables[name], low=varied.low, high=varied.high)
    chosen = tuple(variable for name, variable in variables.items() if name not in fixed)
    if not chosen:
        raise ValueError("--fix: nothing is left to vary; fix fewer parameters")
    return chosen


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
    if options.objective != SPEED and scene["solver.method"] != "exact":
        raise ValueError(f"solver.method: {scene['solver.method']} keeps no accounts of energy; leave it at exact, or "
                         "give --objective speed")
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
    "optimise", "Search for the fastest or thriftiest robot, verify the optimum from fresh starts, and write a "
    "table, JSON, a picture and a scene file.", _add_options, plan_of, _results, failure="a run failed", goes_on=False)
