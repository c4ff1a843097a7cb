"""Curves of special points over two parameters, as a study follows and keeps them."""

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.branch import Branch, Special
from vibro_ros.orbits.curve import Curve, CurveSpecial, has_curve, passes, whole_curve
from vibro_ros.process.front_door import say
from vibro_ros.study.orbits.run import (
    DOWN,
    LINES,
    RUN_TIME,
    UP,
    Plan,
    Task,
    array_of,
    followed,
    multiplier_columns,
    multipliers_of,
)
from vibro_ros.study.running.blocks import NUMBERS, Field, ParquetBlocks
from vibro_ros.study.running.runner import Piece, Runner

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
        Field("point", pa.string(), "1", "of codimension two, or a change of events; null for an orbit between them"),
        Field(first.name, pa.float64(), first.unit or "1", first.description),
        Field(second.name, pa.float64(), second.unit or "1", second.description),
        Field("turns", pa.int64(), "1", "of the crank, after which the motion repeats itself"),
        Field("mean_speed", pa.float64(), "m/s", "of the body, forwards positive"),
        Field("multipliers_real", NUMBERS, "1", "Floquet multipliers, the largest first; of a grazing those without "
              "the contact"),
        Field("multipliers_imag", NUMBERS, "1", "their imaginary parts"),
        Field("phase", pa.float64(), "rad", "crank angle at the cut"),
        Field("state", NUMBERS, "1", "at the cut, in units of the machine"),
        Field("change", pa.string(), "1", "of the events, at a change of events"),
        Field("end", pa.string(), "1", "why the curve was not followed further; in its last row"),
    ]


def rows_of(curve: Curve) -> list[dict]:
    """The rows of a curve of at least one orbit."""
    rows: list[dict] = [{
        **dict(zip(curve.names, curve.values[k], strict=True)), "mean_speed": curve.mean_speeds[k],
        "phase": curve.phases[k], "state": curve.states[k], **multiplier_columns(curve.multipliers[k])}
        for k in range(len(curve))]
    for number, one in enumerate(curve.special_points):
        rows.insert(one.at + number, {
            "point": one.kind, **dict(zip(curve.names, one.values, strict=True)), "mean_speed": one.mean_speed,
            "phase": one.phase, "state": one.state, **multiplier_columns(one.multipliers),
            "change": one.change or None})
    for row in rows:
        row |= {"kind": curve.kind, "turns": curve.turns}
    rows[-1]["end"] = curve.end
    return rows


def curve_of(asked: CurvePlan, table: pa.Table) -> Curve:
    """The curve of at least one row that a file of a plan holds."""
    rows = table.to_pylist()
    first, second = asked.ranges
    orbits, special = [row for row in rows if row["point"] is None], list[CurveSpecial]()
    before = 0
    for row in rows:
        if row["point"] is None:
            before += 1
        else:
            special.append(CurveSpecial(row["point"], np.array([row[first], row[second]]), row["mean_speed"],
                                        multipliers_of(row), row["change"] or "", row["phase"], np.array(row["state"]),
                                        before))
    return Curve(
        rows[0]["kind"], (first, second), int(rows[0]["turns"]),
        np.column_stack([array_of(orbits, first), array_of(orbits, second)]), array_of(orbits, "mean_speed"),
        np.array([multipliers_of(row) for row in orbits], dtype=complex), array_of(orbits, "phase"),
        array_of(orbits, "state"), tuple(special), rows[-1]["end"])


def curves_of_piece(asked: CurvePlan, tasks: dict[int, CurveTask], piece: Piece) -> list[Curve]:
    """The curve that a piece has the number of, as one result; now and then a line says how far it is."""
    said, task = time.monotonic(), tasks[piece.number]

    def notice(orbits: int, values: np.ndarray) -> None:
        nonlocal said
        if time.monotonic() - said > LINES:
            said = time.monotonic()
            where = ", ".join(f"{name} = {value:.6g}" for name, value in zip(asked.ranges, values, strict=True))
            say("study", f"curve of {task.name}, {task.way}: {orbits} orbits, {where}")

    return [whole_curve(task.branch, task.special, asked.ranges, task.way == UP, asked.plan.points, notice)]


def follow_curves(asked: CurvePlan, done: Sequence[tuple[Task, Branch]], names: Sequence[Sequence[str]], folder: Path,
                  runner: Runner) -> list[tuple[CurveTask, Curve]]:
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
    files = ParquetBlocks(folder, asked.document(), MOST_CURVES, fields_of(asked))
    found: list[tuple[CurveTask, Curve]] = []
    files.check_folder()
    for (_, branch), own in zip(done, names, strict=True):
        for name, special in zip(own, branch.special_points, strict=True):
            if not has_curve(special) or any(passes(curve, branch, special, asked.ranges) for _, curve in found):
                continue
            tasks = [CurveTask(name, branch, special, way) for way in (UP, DOWN)]
            if len(found) + len(tasks) > MOST_CURVES:
                raise RuntimeError(f"there are more than {MOST_CURVES} curves; give a smaller range")
            curves = followed(
                files, dict(enumerate(tasks, len(found))), partial(curve_of, asked), rows_of,
                lambda _, task: f"curve of {task.name}, {task.special.kind} at {asked.plan.name} = "
                f"{task.special.value:.9g}, {task.way} in {asked.name}, at most {asked.plan.points} orbits",
                lambda missing: runner(
                    partial(curves_of_piece, asked, missing), RUN_TIME, (asked.plan.scene["solver.method"],),
                    (Piece(number, {}, (number,)) for number in missing)))
            found += zip(tasks, curves, strict=True)
    return found
