"""A study of orbits at work: it looks for orbits, follows and keeps their branches, then those of doubled period."""

import contextlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.branch import Branch, Special, branch_from, doubled_branch_from, lies_on
from vibro_ros.orbits.continuation import DOUBLING, KINDS
from vibro_ros.orbits.family import Family
from vibro_ros.orbits.orbit import Seed, seeds_of
from vibro_ros.orbits.turn_map import coordinates, units_of
from vibro_ros.process.entry_point import say
from vibro_ros.simulation.given_state import STATE_UNITS
from vibro_ros.study.execution import Execution, Results
from vibro_ros.study.progress import Progress, SignsOfLife
from vibro_ros.study.table import NUMBERS, Field, Study, read, stored

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
