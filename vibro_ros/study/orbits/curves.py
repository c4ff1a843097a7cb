"""Curves of special points over two parameters, as a study follows and keeps them."""

import math
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.branch import Branch, Special
from vibro_ros.orbits.continuation import KINDS
from vibro_ros.orbits.curve import has_curve, passes, whole_curve
from vibro_ros.orbits.turn_map import coordinates
from vibro_ros.process.entry_point import say
from vibro_ros.study.execution import Execution, Results
from vibro_ros.study.orbits.run import (
    DOWN,
    ORBIT_FIELDS,
    RUN_TIME,
    UP,
    Followed,
    Plan,
    Task,
    array_of,
    is_sequence,
    nothing,
    read_sequence,
    rows_of_sequence,
)
from vibro_ros.study.progress import SignsOfLife
from vibro_ros.study.table import Field, Study, stored

FOLDER = "curves"
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


def fields_of(asked: CurvePlan) -> list[Field]:
    """The columns of a curve."""
    first, second = (BY_NAME[name] for name in asked.ranges)
    return [
        Field("kind", pa.string(), "1", "of the special points that the curve is made of"),
        Field("point", pa.string(), "1", "change of events; null for an orbit between them", True),
        Field(first.name, pa.float64(), first.unit or "1", first.description),
        Field(second.name, pa.float64(), second.unit or "1", second.description),
        *ORBIT_FIELDS,
    ]


def study_of(asked: CurvePlan, tasks: dict[int, CurveTask]) -> Study:
    """The curves: a block a curve, a row an orbit or special point, in its order."""
    dimension = len(coordinates(asked.plan.scene))
    return Study("curves followed", asked.document(), fields_of(asked), partial(rows_of_task, asked, tasks),
                 lambda _, rows: is_sequence(rows, dimension) and {row["kind"] for row in rows} <= set(KINDS), RUN_TIME,
                 (asked.plan.scene["solver.method"],), MOST_CURVES)


def rows_of(curve: Branch) -> list[dict]:
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


def rows_of_task(asked: CurvePlan, tasks: dict[int, CurveTask], number: int) -> list[dict]:
    """The rows of the curve of a number; lines say how far it is."""
    task = tasks[number]
    with Followed(f"curve of {task.name}, {task.way}", list(asked.ranges)) as notice:
        curve = whole_curve(task.branch, task.special, asked.ranges, task.way == UP, asked.plan.points, notice)
    return rows_of(curve) or [{"kind": curve.kind, **dict.fromkeys(asked.ranges, math.nan), **nothing(curve)}]


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
    study = study_of(asked, tasks)

    def follow(numbers: Iterable[int]) -> Results:
        for task in map(tasks.__getitem__, numbers):
            say("study", f"curve of {task.name}, {task.special.kind} at {asked.plan.name} = {task.special.value:.9g}, "
                f"{task.way} in {asked.name}, at most {asked.plan.points} orbits")
        return execution.rows(study.rows, numbers, study.run_time, study.methods)

    tables = stored(study, folder, {number: [number] for number in tasks}, follow)
    return [(task, curve_of(asked, tables[number])) for number, task in tasks.items()]
