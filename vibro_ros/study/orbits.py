"""A study of orbits at work: it looks for orbits, follows and keeps their branches, then those of doubled period."""

import argparse
import contextlib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from vibro_ros.configuration.strict_yaml import read_scalar
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.branch import Branch, Special, branch_from, doubled_branch_from, lies_on
from vibro_ros.orbits.continuation import CORNER, DOUBLING, FOLD, GRAZING, KINDS, TORUS
from vibro_ros.orbits.curve import has_curve, passes, whole_curve
from vibro_ros.orbits.family import Family
from vibro_ros.orbits.orbit import Seed, seeds_of
from vibro_ros.orbits.starts import running
from vibro_ros.orbits.turn_map import TurnMap, coordinates, units_of
from vibro_ros.process.entry_point import Parser, say
from vibro_ros.simulation.given_state import STATE_UNITS
from vibro_ros.study.command import (
    Progress,
    SignsOfLife,
    add_execution,
    add_machine,
    execution_of,
    locked,
    machine_of,
    run_study,
    study_parser,
    write_files,
)
from vibro_ros.study.execution import Execution, Results
from vibro_ros.study.figures import new_figure, png, tidy, with_unit
from vibro_ros.study.table import NUMBERS, Field, Study, file_of, read, stored, table_of
from vibro_ros.study.variation import Range, varied_in_words, whole_number

UP, DOWN, DOUBLED = "upwards", "downwards", "doubled"


class Task(NamedTuple):
    """One branch to follow.

    Attributes
    ----------
    way : str
        `UP` or `DOWN` from an orbit, or `DOUBLED` from a period doubling.
    turns : int
        Of the orbit that it begins with.
    phase : float
        Crank angle at the cut [rad].
    state : ndarray, shape (n,)
        At the cut, in units of the machine.
    value : float
        The parameter there, in its unit.
    parent : int or None
        Number of the branch whose period doubles.
    """

    way: str
    turns: int
    phase: float
    state: np.ndarray
    value: float
    parent: int | None


@dataclass(frozen=True)
class Plan:
    """What is asked for.

    Attributes
    ----------
    scene : Scene
        The machine, its motor running.
    name : str
        The parameter that changes.
    low, high : float
        Its range, in its unit.
    begin : tuple of float
        Values at which orbits are looked for, in its unit.
    turns : int
        Turns after which orbits repeat themselves at most.
    starts : int
        Starts at each of these values.
    points : int
        Most orbits of a branch.
    """

    scene: Scene
    name: str
    low: float
    high: float
    begin: tuple[float, ...]
    turns: int
    starts: int
    points: int

    def document(self) -> dict[str, object]:
        """All that decides the branches."""
        fixed = {name: value for name, value in self.scene.parameters.items() if name != self.name}
        return {"scene": self.scene.name, "set": fixed, "vary": {self.name: {"from": self.low, "to": self.high}},
                "units_at": self.scene[self.name], "begin": list(self.begin), "turns": self.turns,
                "starts": self.starts, "points": self.points}

    def family(self, turns: int, phase: float) -> Family:
        """The orbits over the range; ValueError for a range that the scene refuses."""
        return Family(self.scene, {self.name: (self.low, self.high)}, turns, phase)


def seeds_at(plan: Plan, number: int) -> list[Seed]:
    """Orbits at the value of a number of those at which they are looked for, in the units of their families."""
    scene, found = plan.scene.with_parameters({plan.name: plan.begin[number]}), []
    with SignsOfLife(f"orbits at {plan.name} = {scene[plan.name]:g}"):
        seeds = seeds_of(scene, plan.starts, plan.turns)
    for seed in seeds:
        family = plan.family(seed.turns, seed.phase)
        ratio = units_of(scene) / family.units
        found.append(Seed(seed.turns, float(seed.phase), seed.state * ratio))
    return found


def rows_of_task(plan: Plan, tasks: dict[int, Task], number: int) -> list[dict]:
    """The rows of the branch of a number; lines say how far it is."""
    task = tasks[number]
    family = plan.family(task.turns, task.phase)
    begin = np.append(task.state, family.shares(task.value))
    with Followed(f"branch {number}", [plan.name]) as notice:
        if task.way == DOUBLED:
            branch = doubled_branch_from(family, begin, plan.points, notice)
        else:
            branch = branch_from(family, begin, 1.0 if task.way == UP else -1.0, plan.points, notice)
    return rows_of(branch) or [{plan.name: task.value, **nothing(branch)}]


def nothing(sequence: Branch) -> dict:
    """The row of a branch or curve without an orbit: why there is none."""
    return {"turns": sequence.turns, "mean_speed": math.nan, "phase": math.nan, "state": [], "multipliers_real": [],
            "multipliers_imag": [], "end": sequence.end}


class Followed(SignsOfLife):
    """How far a branch or curve over some parameters is."""

    def __init__(self, what: str, names: Sequence[str]):
        super().__init__(what)
        self._names = names

    def __call__(self, orbits: int, values: float | np.ndarray) -> None:
        """Note how many orbits are found, and the parameters at the last."""
        where = ", ".join(f"{name} = {value:.6g}" for name, value in
                          zip(self._names, np.atleast_1d(values).tolist(), strict=True))
        self.where = f"{orbits} orbits, {where}"


FOLDER = "branches"
MOST_BRANCHES = 10_000


def study_of(plan: Plan, tasks: dict[int, Task]) -> Study:
    """The branches of a plan: a block a branch, a row an orbit or special point, in its order."""
    names = coordinates(plan.scene)

    def are_own(_: Sequence[int], rows: list[dict]) -> bool:
        return is_sequence(rows, len(names)) and all(row["kind"] in (None, *KINDS) for row in rows) and all(
            len(row[name] or ()) == (row["turns"] if row["kind"] is None and row["state"] else 0)
            for row in rows for name in names)

    return Study("branches followed", plan.document(), fields_of(plan), partial(rows_of_task, plan, tasks), are_own,
                 RUN_TIME, (plan.scene["solver.method"],), MOST_BRANCHES)


def is_sequence(rows: list[dict], dimension: int) -> bool:
    """Whether rows are one branch or curve of states with so many coordinates."""
    ends = [row["end"] is not None for row in rows]
    return ends == [*[False] * (len(rows) - 1), True] and len({row["turns"] for row in rows}) == 1 and all(
        len(row[name]) == (dimension if rows[0]["state"] else 0)
        for row in rows for name in ("state", "multipliers_real", "multipliers_imag"))


def fields_of(plan: Plan) -> list[Field]:
    """The columns of a branch."""
    parameter, each = BY_NAME[plan.name], "each time the crank passes the angle 0; null for a special point"
    return [
        Field("kind", pa.string(), "1", "of a special point; null for an orbit between them", True),
        Field(plan.name, pa.float64(), parameter.unit or "1", parameter.description),
        Field("width", pa.float64(), parameter.unit or "1", "of the interval that holds the special point", True),
        Field("stable", pa.bool_(), "1", "whether small disturbances die out; null for a special point",
              True),
        *(Field(name, NUMBERS, STATE_UNITS[name], each, True) for name in coordinates(plan.scene)),
        *ORBIT_FIELDS,
    ]


ORBIT_FIELDS = (
    Field("turns", pa.int64(), "1", "of the crank, after which the motion repeats itself"),
    Field("mean_speed", pa.float64(), "m/s", "of the body, forwards positive"),
    Field("multipliers_real", NUMBERS, "1", "Floquet multipliers, the largest first; along a curve of grazings those "
          "without the contact"),
    Field("multipliers_imag", NUMBERS, "1", "their imaginary parts"),
    Field("phase", pa.float64(), "rad", "crank angle at the cut"),
    Field("state", NUMBERS, "1", "at the cut, in units of the machine"),
    Field("change", pa.string(), "1", "of the events, where their order changes", True),
    Field("end", pa.string(), "1", "why the orbits were not followed further; in the last row", True))
"""The columns that a branch and a curve have, last in their tables."""


def rows_of(branch: Branch) -> list[dict]:
    """The rows of a branch."""
    return rows_of_sequence(
        branch,
        [{branch.name: branch.values[k], "stable": bool(branch.stable[k]),
          **{name: values[k] for name, values in branch.strobe.items()}} for k in range(len(branch))],
        [{"kind": one.kind, branch.name: one.value, "width": one.width} for one in branch.special_points])


def rows_of_sequence(sequence: Branch, orbits: list[dict], special: list[dict]) -> list[dict]:
    """The rows of a branch or curve, given what rows of its orbits and of its special points have besides
    `ORBIT_FIELDS`; each special point stands between the orbits that it lies between."""
    rows = [{**own, "mean_speed": sequence.mean_speeds[k], "phase": sequence.phases[k], "state": sequence.states[k],
             **_multiplier_columns(sequence.multipliers[k])} for k, own in enumerate(orbits)]
    for number, (one, own) in enumerate(zip(sequence.special_points, special, strict=True)):
        rows.insert(one.at + number, {
            **own, "mean_speed": one.mean_speed, "phase": one.phase, "state": one.state,
            **_multiplier_columns(one.multipliers), "change": one.change or None})
    for row in rows:
        row["turns"] = sequence.turns
    if rows:
        rows[-1]["end"] = sequence.end
    return rows


def _multiplier_columns(multipliers: np.ndarray) -> dict:
    return {"multipliers_real": multipliers.real, "multipliers_imag": multipliers.imag}


def branch_of(plan: Plan, table: pa.Table) -> Branch:
    """The branch of at least one row that a file of a plan holds."""
    orbits, special, common = read_sequence(table, "kind")
    name, names = plan.name, coordinates(plan.scene)
    return Branch(
        scene=plan.scene, names=(name,), kind="", values=array_of(orbits, name),
        strobe={one: array_of(orbits, one).reshape(-1, common["turns"]) for one in names},
        special_points=tuple(Special(values=np.array([row[name]]), width=row["width"], **own) for row, own in special),
        **common)


def read_sequence(table: pa.Table, kind: str) -> tuple[list[dict], list[tuple[dict, dict]], dict[str, Any]]:
    """What a table of at least one row holds, whose column `kind` is null for an orbit.

    Returns
    -------
    list of dict
        The rows of the orbits.
    list of (dict, dict)
        Each row of a special point, and the attributes of its `Special`.
    dict
        The attributes of their `Branch`, without what depends on the parameters.
    """
    rows = table.to_pylist()
    turns, end = int(rows[0]["turns"]), rows[-1]["end"]
    n = len(rows[0]["state"]) or 1
    rows = [row for row in rows if row["state"]]
    orbits, special = list[dict](), list[tuple[dict, dict]]()
    for row in rows:
        if row[kind] is None:
            orbits.append(row)
        else:
            special.append((row, {
                "kind": row[kind], "mean_speed": row["mean_speed"], "multipliers": _multipliers_of(row),
                "change": row["change"] or "", "phase": row["phase"], "state": np.array(row["state"]),
                "at": len(orbits)}))
    return orbits, special, {
        "turns": turns, "mean_speeds": array_of(orbits, "mean_speed"),
        "multipliers": np.array([_multipliers_of(row) for row in orbits], dtype=complex).reshape(-1, n),
        "phases": array_of(orbits, "phase"), "states": array_of(orbits, "state").reshape(-1, n), "end": end}


def array_of(rows: Sequence[dict[str, Any]], key: str) -> np.ndarray:
    """A column of rows."""
    return np.array([row[key] for row in rows], dtype=float)


def _multipliers_of(row: dict[str, Any]) -> np.ndarray:
    return np.array(row["multipliers_real"]) + 1j * np.array(row["multipliers_imag"])


_SAME = 1e-6  # share of the range within which a period doubling that two branches have is one
RUN_TIME = 1000.0  # robot time [s] of a search or a branch, about: so long that each is handed out alone
_JOINS = 0.05  # share of the range within which a branch that joins another one ends at its period doubling


class OrbitsRun:
    """The branches of a plan in a folder that nobody else writes into.

    Parameters
    ----------
    plan : Plan
        What is asked for.
    folder : Path
        Of the branches' files.
    execution : Execution
        Who computes.

    Attributes
    ----------
    done : list of (Task, Branch)
        The branches so far, by their numbers.
    """

    def __init__(self, plan: Plan, folder: Path, execution: Execution):
        self._plan, self._folder, self._execution = plan, folder, execution
        self._doubled: set[tuple[int, int]] = set()  # number of a branch and of its special point
        self.done: list[tuple[Task, Branch]] = []

    def do(self) -> None:
        """Follow every branch.

        Raises
        ------
        ForeignBlockError
            For files of another study.
        RuntimeError
            When the disk is full or refuses, or a run cannot go on; finished branches are kept.
        """
        plan, begin, found = self._plan, self._plan.begin, list[list[Seed]]()
        read(study_of(plan, {}), self._folder, 0, [0])  # refuses another study before the search, which is long
        with contextlib.closing(self._execution.rows(partial(seeds_at, plan), range(len(begin)), RUN_TIME, (
                plan.scene["solver.method"],))) as results, Progress("orbits looked for", "value", len(begin)) as bar:
            for seeds in results:
                found.append(seeds)
                bar.add(1)
        for value, seeds in zip(begin, found, strict=True):
            for seed in seeds:
                family = plan.family(seed.turns, seed.phase)
                with SignsOfLife(f"an orbit at {plan.name} = {value:g} compared with branches"):
                    known = any(lies_on(family, seed, value, branch) for _, branch in self.done)
                if not known:
                    self._follow([Task(way, seed.turns, seed.phase, seed.state, value, None) for way in (UP, DOWN)])
        while tasks := self._doublings():
            self._follow(tasks)

    def _follow(self, tasks: Sequence[Task]) -> None:
        """Do the tasks, or read what was done before; their branches come in the order of the tasks."""
        if len(self.done) + len(tasks) > MOST_BRANCHES:
            raise RuntimeError(f"there are more than {MOST_BRANCHES} branches; give fewer --turns or a smaller range")
        plan, numbered = self._plan, dict(enumerate(tasks, len(self.done)))
        study = study_of(plan, numbered)

        def follow(numbers: Iterable[int]) -> Results:
            for number in numbers:
                task = numbered[number]
                say("study", f"branch {number}: {task.turns} turn{'s' * (task.turns > 1)}, {task.way} from "
                    f"{plan.name} = {task.value:.9g}, at most {plan.points} orbits")
            return self._execution.rows(study.rows, numbers, study.run_time, study.methods)

        tables = stored(study, self._folder, {number: [number] for number in numbered}, follow)
        self.done += [(task, branch_of(plan, tables[number])) for number, task in numbered.items()]

    def _doublings(self) -> list[Task]:
        """The first period doubling of each branch whose branch of doubled period is not known yet."""
        tasks: list[Task] = []
        span = self._plan.high - self._plan.low
        for parent, (_, branch) in enumerate(self.done):
            if 2 * branch.turns > self._plan.turns:
                continue
            for number, special in enumerate(branch.special_points):
                if special.kind != DOUBLING or (parent, number) in self._doubled:
                    continue
                self._doubled.add((parent, number))
                begun = any(task.way == DOUBLED and task.turns == branch.turns
                            and abs(task.value - special.value) < _SAME * span
                            for task in (*tasks, *(task for task, _ in self.done)))
                ended = any(other.turns == 2 * branch.turns and other.end.startswith("joins")
                            and abs(other.values[-1] - special.value) < _JOINS * span for _, other in self.done)
                if not (begun or ended):
                    tasks.append(Task(DOUBLED, branch.turns, special.phase, special.state, special.value, parent))
                    break
        return tasks


CURVES_FOLDER = "curves"
MOST_CURVES = 10_000


class CurveTask(NamedTuple):
    """One direction of a curve.

    Attributes
    ----------
    name : str
        Of the special point, as in the table of special points.
    branch : Branch
        Which has the special point.
    special : Special
        Where the curve begins.
    way : str
        `UP` or `DOWN`, of the second parameter.
    """

    name: str
    branch: Branch
    special: Special
    way: str


class CurvePlan(NamedTuple):
    """What is asked for.

    Attributes
    ----------
    plan : Plan
        Of the branches.
    name : str
        The second parameter.
    low, high : float
        Its range, in its unit.
    """

    plan: Plan
    name: str
    low: float
    high: float

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Both parameters and their ranges."""
        return {self.plan.name: (self.plan.low, self.plan.high), self.name: (self.low, self.high)}

    def document(self) -> dict[str, object]:
        """All that decides the curves."""
        return {**self.plan.document(), "curves": {self.name: {"from": self.low, "to": self.high}}}


def curve_fields(asked: CurvePlan) -> list[Field]:
    """The columns of a curve."""
    first, second = (BY_NAME[name] for name in asked.ranges)
    return [
        Field("kind", pa.string(), "1", "of the special points that the curve is made of"),
        Field("point", pa.string(), "1", "change of events; null for an orbit between them", True),
        Field(first.name, pa.float64(), first.unit or "1", first.description),
        Field(second.name, pa.float64(), second.unit or "1", second.description),
        *ORBIT_FIELDS,
    ]


def curves_study(asked: CurvePlan, tasks: dict[int, CurveTask]) -> Study:
    """The curves: a block a curve, a row an orbit or special point, in its order."""
    dimension = len(coordinates(asked.plan.scene))
    return Study("curves followed", asked.document(), curve_fields(asked), partial(rows_of_curve_task, asked, tasks),
                 lambda _, rows: is_sequence(rows, dimension) and {row["kind"] for row in rows} <= set(KINDS), RUN_TIME,
                 (asked.plan.scene["solver.method"],), MOST_CURVES)


def rows_of_curve(curve: Branch) -> list[dict]:
    """The rows of a curve."""
    rows = rows_of_sequence(
        curve, [dict(zip(curve.names, values, strict=True)) for values in curve.values],
        [{"point": one.kind, **dict(zip(curve.names, one.values, strict=True))} for one in curve.special_points])
    return [{"kind": curve.kind, **row} for row in rows]


def curve_of(asked: CurvePlan, table: pa.Table) -> Branch:
    """The curve of at least one row that a file of a plan holds."""
    orbits, special, common = read_sequence(table, "point")
    first, second = asked.ranges
    return Branch(
        scene=asked.plan.scene, kind=table["kind"][0].as_py(), names=(first, second), strobe={},
        values=np.column_stack([array_of(orbits, first), array_of(orbits, second)]),
        special_points=tuple(Special(values=np.array([row[first], row[second]]), **own) for row, own in special),
        **common)


def rows_of_curve_task(asked: CurvePlan, tasks: dict[int, CurveTask], number: int) -> list[dict]:
    """The rows of the curve of a number; lines say how far it is."""
    task = tasks[number]
    with Followed(f"curve of {task.name}, {task.way}", list(asked.ranges)) as notice:
        curve = whole_curve(task.branch, task.special, asked.ranges, task.way == UP, asked.plan.points, notice)
    return rows_of_curve(curve) or [{"kind": curve.kind, **dict.fromkeys(asked.ranges, math.nan), **nothing(curve)}]


def follow_curves(asked: CurvePlan, done: Sequence[tuple[Task, Branch]], names: Sequence[Sequence[str]], folder: Path,
                  execution: Execution) -> list[tuple[CurveTask, Branch]]:
    """The curves through all special points of branches that have one, in both directions of the second parameter.

    A special point that lies on a curve which is known already has none of its own. `names` are those of the special
    points; `folder` exists, and nobody else writes into it.

    Raises
    ------
    ForeignBlockError
        For files of another study.
    RuntimeError
        When the disk is full or refuses, or a run cannot go on; finished curves are kept.
    """
    found: list[tuple[CurveTask, Branch]] = []
    for (_, branch), own in zip(done, names, strict=True):
        for name, special in zip(own, branch.special_points, strict=True):
            if not has_curve(special):
                continue
            with SignsOfLife(f"{name} compared with curves"):
                known = any(passes(curve, branch, special, asked.ranges) for _, curve in found)
            if known:
                continue
            tasks = [CurveTask(name, branch, special, way) for way in (UP, DOWN)]
            if len(found) + len(tasks) > MOST_CURVES:
                raise RuntimeError(f"there are more than {MOST_CURVES} curves; give a smaller range")
            found += _followed(asked, dict(enumerate(tasks, len(found))), folder, execution)
    return found


def _followed(asked: CurvePlan, tasks: dict[int, CurveTask], folder: Path,
              execution: Execution) -> list[tuple[CurveTask, Branch]]:
    study = curves_study(asked, tasks)

    def follow(numbers: Iterable[int]) -> Results:
        for task in map(tasks.__getitem__, numbers):
            say("study", f"curve of {task.name}, {task.special.kind} at {asked.plan.name} = {task.special.value:.9g}, "
                f"{task.way} in {asked.name}, at most {asked.plan.points} orbits")
        return execution.rows(study.rows, numbers, study.run_time, study.methods)

    tables = stored(study, folder, {number: [number] for number in tasks}, follow)
    return [(task, curve_of(asked, tables[number])) for number, task in tasks.items()]


#: By kind of special point, the letter that begins its name in picture and table.
LETTERS = {FOLD: "F", DOUBLING: "P", TORUS: "N", GRAZING: "G", CORNER: "C"}


def names_of(branches: Sequence[Branch]) -> list[list[str]]:
    """A name for each special point of each branch: the letter of its kind and a number, counted over all branches."""
    counts, found = dict.fromkeys(LETTERS, 0), []
    for branch in branches:
        own = []
        for special in branch.special_points:
            counts[special.kind] += 1
            own.append(f"{LETTERS[special.kind]}{counts[special.kind]}")
        found.append(own)
    return found


def document(plan: Plan, done: Sequence[tuple[Task, Branch]]) -> str:
    """The tables as a page."""
    unit = BY_NAME[plan.name].unit
    branches = [branch for _, branch in done]
    head = with_unit(plan.name, unit)
    lines = [
        f"# Orbits of {plan.scene.name} over {plan.name}", "",
        f"{plan.name} from {plan.low:g} to {plan.high:g} {unit}".rstrip(" 1") + f"; orbits of at most {plan.turns} "
        f"turns of the crank; looked for at {', '.join(f'{value:g}' for value in plan.begin)}, from {plan.starts} "
        "starts each.", "",
        "![Branches](orbits.png)", "", "## Branches", "",
        f"| branch | turns | begins | orbits | {head} | stable for | mean speed, mm/s | ends |",
        "|---|---|---|---|---|---|---|---|"]
    lines += [_row(number, task, branch) for number, (task, branch) in enumerate(done)]
    lines += ["", "## Special points", "",
              f"| name | kind | branch | turns | {head} | known to | mean speed, mm/s | multipliers | what happens |",
              "|---|---|---|---|---|---|---|---|---|"]
    for number, (branch, names) in enumerate(zip(branches, names_of(branches), strict=True)):
        lines += [
            f"| {name} | {one.kind} | {number} | {branch.turns} | {one.value:.10g} | {one.width:.1g} | "
            f"{1e3 * one.mean_speed:.4f} | {_multipliers(one.multipliers)} | {one.change} |"
            for name, one in zip(names, branch.special_points, strict=True)]
    return "\n".join(lines) + "\n"


def in_words(done: Sequence[tuple[Task, Branch]]) -> Iterator[str]:
    """One line a branch."""
    branches = [branch for _, branch in done]
    for number, ((task, branch), names) in enumerate(zip(done, names_of(branches), strict=True)):
        special = ", ".join(f"{name} {one.kind} at {one.value:.9g}" for name, one in
                            zip(names, branch.special_points, strict=True) if one.kind != CORNER)
        yield (f"branch {number}, {branch.turns} turn{'s' * (branch.turns > 1)}: {len(branch)} orbits {_begin(task)}; "
               f"{special + '; ' if special else ''}{branch.end}")


def stable_ranges(branch: Branch) -> list[tuple[float, float]]:
    """Ranges of the parameter [its unit] over which neighbours on the branch are stable, in its order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], branch.stable.astype(int), [0]]))).reshape(-1, 2)
    return [(float(branch.values[first:last].min()), float(branch.values[first:last].max())) for first, last in edges]


def _begin(task: Task) -> str:
    if task.parent is not None:
        return f"from a period doubling of branch {task.parent} at {task.value:.6g}"
    return f"{task.way} from {task.value:g}"


def _row(number: int, task: Task, branch: Branch) -> str:
    if not len(branch):
        return f"| {number} | {branch.turns} | {_begin(task)} | 0 | | | | {branch.end} |"
    stable = ", ".join(f"{low:.6g} to {high:.6g}" for low, high in stable_ranges(branch))
    speeds = 1e3 * branch.mean_speeds
    return (f"| {number} | {branch.turns} | {_begin(task)} | {len(branch)} | {branch.values.min():.6g} to "
            f"{branch.values.max():.6g} | {stable} | {speeds.min():.2f} to {speeds.max():.2f} | {branch.end} |")


def _multipliers(values: np.ndarray) -> str:
    """The two largest, a pair as one."""
    shown = []
    for value in values[:2]:
        if value.imag == 0.0:
            shown.append(f"{value.real:.6f}")
        elif value.imag > 0.0:
            shown.append(f"{value.real:.6f} ± {value.imag:.6f}i")
    return ", ".join(shown)


# Okabe and Ito's colours, which the colour-blind can tell apart, by the turns of a branch; the last one for all others.
_COLOURS = {1: "#000000", 2: "#0072b2", 3: "#d55e00", 4: "#009e73", 8: "#cc79a7", 0: "#e69f00"}
MARKS = {FOLD: ("s", 5.0), DOUBLING: ("o", 5.0), TORUS: ("D", 5.0), GRAZING: ("^", 5.5), CORNER: (".", 3.5)}
_MOST_NAMES = 24  # places whose names are written into the picture
_CELLS = 50.0  # of a panel along each axis: names of one cell stand together


def draw_orbits(plan: Plan, branches: Sequence[Branch]) -> bytes:
    """Draw all branches; returns a PNG file."""
    figure = new_figure(9.0, 8.4)
    upper, lower = figure.subplots(2, 1, sharex=True)
    coordinate = next((name for name in ("inclined_position", "upper_position")
                       if any(name in branch.strobe for branch in branches)), None)
    for branch in branches:
        _draw_line(upper, branch, 1e3 * branch.mean_speeds[:, None])
        if coordinate:
            _draw_line(lower, branch, 1e3 * branch.strobe[coordinate])
    lower.set_xlim(plan.low, plan.high)
    _draw_special(upper, branches)
    unit = BY_NAME[plan.name].unit
    upper.set(ylabel="mean speed [mm/s]")
    lower.set(xlabel=with_unit(plan.name, unit), ylabel=f"{(coordinate or '').replace('_', ' ')} at crank angle 0 [mm]")
    for axes in (upper, lower):
        tidy(axes)
    figure.legend(handles=_legend(branches), loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    figure.suptitle(f"{plan.scene.name}: periodic orbits over {plan.name}, unstable ones dashed", fontsize=11)
    return png(figure)


def _draw_line(axes: Axes, branch: Branch, values: np.ndarray) -> None:
    """Stable parts solid, unstable ones dashed; neighbours of which one is unstable are joined by a dashed line."""
    colour = _COLOURS.get(branch.turns, _COLOURS[0])
    stable = branch.stable
    both = np.flatnonzero(stable[1:] & stable[:-1])
    either = np.flatnonzero(~(stable[1:] & stable[:-1]))
    for chosen, style in ((both, "-"), (either, (0, (3.0, 1.5)))):
        for run in np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1):
            if len(run):
                part = slice(run[0], run[-1] + 2)
                axes.plot(branch.values[part], values[part], color=colour, ls=style, lw=1.2)


def _draw_special(axes: Axes, branches: Sequence[Branch]) -> None:
    named = [(name, one, branch) for branch, names in zip(branches, names_of(branches), strict=True)
             for name, one in zip(names, branch.special_points, strict=True)]
    cells: dict[tuple[int, int], list[str]] = {}
    for _, one, branch in named:
        mark, size = MARKS[one.kind]
        axes.plot(one.value, 1e3 * one.mean_speed, mark, ms=size, color=_COLOURS.get(branch.turns, _COLOURS[0]),
                  mfc="white" if one.kind != CORNER else None, zorder=3)
    # What lies together shares a label.
    for name, one, _ in named:
        if one.kind != CORNER:
            across, up = axes.transLimits.transform((one.value, 1e3 * one.mean_speed))
            cells.setdefault((round(_CELLS * across), round(_CELLS * up)), []).append(name)
    if len(cells) <= _MOST_NAMES:
        for (across, up), names in cells.items():
            axes.annotate(", ".join(names), (across / _CELLS, up / _CELLS), xycoords="axes fraction", xytext=(4, 4),
                          textcoords="offset points", fontsize=7)


def _legend(branches: Sequence[Branch]) -> list[Line2D]:
    turns = sorted({branch.turns for branch in branches if len(branch)})
    kinds = {one.kind for branch in branches for one in branch.special_points}
    lines = [Line2D([], [], color=_COLOURS.get(one, _COLOURS[0]), label=f"{one} turn{'s' * (one > 1)}")
             for one in turns]
    return lines + [Line2D([], [], color="#000000", ls="", marker=mark, ms=size, mfc="white", label=kind)
                    for kind, (mark, size) in MARKS.items() if kind in kinds]


_CURVE_COLOURS = {FOLD: "#d55e00", DOUBLING: "#0072b2", GRAZING: "#000000"}
_CURVE_CELLS = 50.0  # of the first parameter's range: names of one cell stand together
_STYLES = {FOLD: "-", DOUBLING: "--", GRAZING: ":"}


def curve_document(asked: CurvePlan, found: Sequence[tuple[CurveTask, Branch]]) -> str:
    """The tables as the last part of a page."""
    heads = [with_unit(name, BY_NAME[name].unit) for name in asked.ranges]
    lines = ["", f"## Curves over {' and '.join(asked.ranges)}", "", "![Curves](curves.png)", "",
             f"| through | kind | turns | {asked.name} | orbits | {heads[0]} | {heads[1]} | ends |",
             "|---|---|---|---|---|---|---|---|"]
    for task, curve in found:
        ranges = [f"{column.min():.6g} to {column.max():.6g}" for column in curve.values.T] if len(curve) else ["", ""]
        lines.append(f"| {task.name} | {task.special.kind} | {task.branch.turns} | {task.way} | {len(curve)} | "
                     f"{' | '.join(ranges)} | {curve.end} |")
    lines += ["", f"| on the curve through | point | {heads[0]} | {heads[1]} | what happens |", "|---|---|---|---|---|"]
    lines += [f"| {task.name} | {one.kind} | {one.values[0]:.9g} | {one.values[1]:.9g} | {one.change} |"
              for task, curve in found for one in curve.special_points]
    return "\n".join(lines) + "\n"


def curves_in_words(found: Sequence[tuple[CurveTask, Branch]]) -> Iterator[str]:
    """One line a curve and direction."""
    for task, curve in found:
        yield f"{task.special.kind} curve through {task.name}, {task.way}: {len(curve)} orbits; {curve.end}"


def draw_curves(asked: CurvePlan, done: Sequence[tuple[Task, Branch]],
                found: Sequence[tuple[CurveTask, Branch]]) -> bytes:
    """Draw all curves, and the special points of the branches that they begin with; returns a PNG file."""
    figure = new_figure(8.0, 5.4)
    axes = figure.subplots()
    for _, curve in found:
        if len(curve):
            axes.plot(*curve.values.T, _STYLES[curve.kind], color=_CURVE_COLOURS[curve.kind], lw=1.4)
    branches, base = [branch for _, branch in done], asked.plan.scene[asked.name]
    cells: dict[int, list[tuple[float, str]]] = {}
    for branch, names in zip(branches, names_of(branches), strict=True):
        for name, special in zip(names, branch.special_points, strict=True):
            if has_curve(special):
                mark, size = MARKS[special.kind]
                axes.plot(special.value, base, mark, ms=size, color=_CURVE_COLOURS[special.kind], mfc="white", zorder=4)
                near = round(_CURVE_CELLS * (special.value - asked.plan.low) / (asked.plan.high - asked.plan.low))
                cells.setdefault(near, []).append((special.value, name))
    for named in cells.values():  # what lies together shares a label
        axes.annotate(", ".join(name for _, name in named), (named[0][0], base), xytext=(5, -9),
                      textcoords="offset points", fontsize=7)
    kinds = [kind for kind in _CURVE_COLOURS if any(curve.kind == kind for _, curve in found)]
    axes.set_xlim(asked.plan.low, asked.plan.high)
    margin = 0.02 * (asked.high - asked.low)
    axes.set_ylim(asked.low - margin, asked.high + margin)
    axes.set(**{f"{axis}label": with_unit(name, BY_NAME[name].unit)
                for axis, name in zip("xy", asked.ranges, strict=True)})
    tidy(axes)
    if kinds:
        axes.legend(handles=[Line2D([], [], ls=_STYLES[kind], color=_CURVE_COLOURS[kind], marker=MARKS[kind][0],
                                    ms=MARKS[kind][1], mfc="white", label=kind) for kind in kinds], frameon=False)
    figure.suptitle(f"{asked.plan.scene.name}: special points over {' and '.join(asked.ranges)}", fontsize=11)
    return png(figure)


BRANCHES, SPECIAL, PICTURE, TEXT = "branches.parquet", "special_points.parquet", "orbits.png", "orbits.md"
CURVES, CURVE_PICTURE = "curves.parquet", "curves.png"
MOST_TURNS = 32
_QUICK_VARY, _QUICK_FROM = "motor.speed=60:66", 65.0
# Default, default with --quick, least and most of the numbers that an option gives.
_COUNTS = {"turns": (8, 2, 1, MOST_TURNS), "starts": (4, 2, 1, 1000), "points": (400, 120, 2, 100_000)}


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    return run_study(_orbits, parser(), words)


def _orbits(options: argparse.Namespace) -> int:
    plan = plan_of(options)
    asked = curves_of(options, plan) if options.curves else None
    execution = execution_of(options)
    with locked(options.output / FOLDER):
        run = OrbitsRun(plan, options.output / FOLDER, execution)
        run.do()
        write_files(options.output, _files(plan, run))
    print("\n".join(in_words(run.done)) or "no orbit was found; give more --starts, --turns, or another --from")
    if asked:
        with locked(options.output / CURVES_FOLDER):
            names = names_of([branch for _, branch in run.done])
            found = follow_curves(asked, run.done, names, options.output / CURVES_FOLDER, execution)
            write_files(options.output, _curve_files(asked, run, found))
        print("\n".join(curves_in_words(found)) or "no special point has a curve")
    return 0


def curves_of(options: argparse.Namespace, plan: Plan) -> CurvePlan:
    """The second parameter that `--curves` names (ValueError for one that makes no sense)."""
    name, over = varied_in_words(options.curves)
    if not isinstance(over, Range) or over.log:
        raise ValueError(f"--curves {options.curves}: is no range; give NAME=LOW:HIGH, such as upper.gap=0:0.002")
    if name == plan.name:
        raise ValueError(f"--curves {options.curves}: {name} is the parameter of --vary; give another one")
    Family(plan.scene, {name: (over.low, over.high)}, 1, 0.0)  # refuses what is no range of a number
    if not over.low <= plan.scene[name] <= over.high:
        raise ValueError(f"--curves {options.curves}: does not hold the machine's {plan.scene[name]:g}; give a range "
                         "that holds it, or another --set")
    return CurvePlan(plan, name, over.low, over.high)


def plan_of(options: argparse.Namespace) -> Plan:
    """What the command line asks for.

    Raises
    ------
    ValueError
        For an option that makes no sense, or a range that the scene refuses.
    """
    vary = options.vary or (_QUICK_VARY if options.quick else None)
    if vary is None:
        raise ValueError("--vary: is missing; give NAME=LOW:HIGH, such as motor.speed=60:130")
    name, over = varied_in_words(vary)
    if not isinstance(over, Range) or over.log:
        raise ValueError(f"--vary {vary}: is no range; give NAME=LOW:HIGH, such as motor.speed=60:130")
    scene = running(machine_of(options))
    if scene["solver.method"] != "exact":
        raise ValueError(f"solver.method: {scene['solver.method']!r} is not exact to rounding, which derivatives of "
                         "orbits need; leave it at 'exact'")
    given = tuple(cast(float, BY_NAME[name].checked(read_scalar(word))) for word in options.begin)
    begin = given or ((_QUICK_FROM,) if options.quick and not options.vary else
                      tuple(over.at(np.array([0.25, 0.5, 0.75])).tolist()))
    for value in begin:
        if not over.low <= value <= over.high:
            raise ValueError(f"--from {value:g}: is not from {over.low:g} to {over.high:g}; give a value of the range")
        TurnMap(scene.with_parameters({name: value}))  # refuses a crank that stands
    turns, starts, points = (
        whole_number(f"--{key}", (quick if options.quick else usual) if getattr(options, key) is None else
                     getattr(options, key), least, most) for key, (usual, quick, least, most) in _COUNTS.items())
    plan = Plan(scene.with_parameters({name: begin[0]}), name, over.low, over.high, begin, turns, starts, points)
    plan.family(1, 0.0)  # refuses a range that the scene refuses
    return plan


def _files(plan: Plan, run: OrbitsRun) -> dict[str, bytes]:
    """Tables, text and picture by the names of their files; no tables without a branch."""
    branches, files = [branch for _, branch in run.done], {}
    rows: list[dict] = []
    for number, (branch, names) in enumerate(zip(branches, names_of(branches), strict=True)):
        left = iter(names)
        rows += [{"branch": number, "name": next(left) if "kind" in row else None, **row} for row in rows_of(branch)]
    if branches:
        own = [Field("branch", pa.int64(), "1", "number of the branch"),
               Field("name", pa.string(), "1", "of a special point, as in the picture", True)]
        whole = table_of(rows, [*own, *fields_of(plan)])
        files = {BRANCHES: file_of(whole), SPECIAL: file_of(whole.filter(pc.is_valid(whole["kind"])))}
    return {**files, TEXT: document(plan, run.done).encode(), PICTURE: draw_orbits(plan, branches)}


def _curve_files(asked: CurvePlan, run: OrbitsRun,
                 found: Sequence[tuple[CurveTask, Branch]]) -> dict[str, bytes]:
    """Table, text and picture of the curves by the names of their files; the text holds that of the branches, too."""
    files, rows = {}, list[dict]()
    for task, curve in found:
        rows += [{"through": task.name, "way": task.way, **row} for row in rows_of_curve(curve)]
    if rows:
        own = [Field("through", pa.string(), "1", "name of the special point that the curve begins with"),
               Field("way", pa.string(), "1", f"from there in {asked.name}")]
        files = {CURVES: file_of(table_of(rows, [*own, *curve_fields(asked)]))}
    text = document(asked.plan, run.done) + curve_document(asked, found)
    return {**files, TEXT: text.encode(), CURVE_PICTURE: draw_curves(asked, run.done, found)}


def parser() -> Parser:
    """The command line of the study."""
    own = study_parser(
        "orbits", "Look for periodic orbits, stable and unstable, follow their branches over a parameter, through "
        "folds, grazings and corners, and from period doublings on; locate and name special points.")
    add_machine(own, "device")
    own.add_argument("--vary", metavar="NAME=LOW:HIGH", help="the parameter that changes, and its range")
    own.add_argument("--curves", metavar="NAME=LOW:HIGH", help="a second parameter, over which the special points are "
                     "followed as curves, and its range")
    own.add_argument("--from", dest="begin", action="append", default=[], metavar="VALUE", help="where orbits are "
                     "looked for; repeatable (default: at a quarter, a half and three quarters of the range)")
    own.add_argument("--turns", type=int, metavar="N", help="most turns of the crank after which an orbit repeats "
                     f"itself, up to {MOST_TURNS} (default: 8)")
    own.add_argument("--starts", type=int, metavar="N", help="starts from which orbits are looked for, at each VALUE "
                     "(default: 4)")
    own.add_argument("--points", type=int, metavar="N", help="most orbits of a branch (default: 400)")
    add_execution(own)
    own.add_argument("--quick", action="store_true", help="the folds of `device` between 60 and 66 rad/s, in a minute; "
                     "options that are given win")
    return own
