"""``study orbits``: branches of periodic orbits over a parameter, and their special points.

Orbits are searched for at some values of the parameter. The branch through each orbit that does not lie on a known
branch is followed in both directions; afterwards the branches of doubled period are followed from period doublings
(`followed_branches`). A branch is a block of a `table.Study`, with a row for each orbit or special point.
"""

import argparse
import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import pyarrow as pa

from vibro_lab.orbits.branch import Branch, Special, branch_from, doubled_branch_from, lies_on
from vibro_lab.orbits.continuation import CORNER, DOUBLING, FOLD, GRAZING, TORUS
from vibro_lab.orbits.family import Family
from vibro_lab.orbits.orbit import Seed, seeds_of
from vibro_lab.orbits.starts import running
from vibro_lab.orbits.turn_map import TurnMap, state_names, units_of, whole_number
from vibro_lab.study import figures
from vibro_lab.study.command import Progress, Results, StudyCommand, machine_of
from vibro_lab.study.execution import Execution, Rows
from vibro_lab.study.table import NUMBERS, Field, Study, check_folder, file_of, parameter_field, stored, table_of
from vibro_lab.study.variation import Range, varied_in_words
from vibro_ros import PARAMETERS, STATE_UNITS, Parser, Scene, read_scalar, say

BRANCHES, PICTURE = "branches.parquet", "orbits.png"
FOLDER = "branches"
MOST_TURNS, MOST_BRANCHES = 32, 10_000
_QUICK_VARY, _QUICK_FROM = "motor.speed=60:66", 65.0
# Default, default with --quick, least and largest value of options with a count.
_COUNTS = {"turns": (8, 2, 1, MOST_TURNS), "starts": (4, 2, 1, 1000), "points": (400, 120, 2, 100_000)}
_RUN_TIME = 1000.0  # approximate simulated time [s] of a search or a branch: so long that each is a task of its own
UP, DOWN, DOUBLED = "upwards", "downwards", "doubled"


@dataclass(frozen=True)
class BranchPlan:
    """Design of a study of branches."""

    scene: Scene  # the machine, its motor running
    name: str  # name of the varied parameter
    low: float  # its range, in its unit
    high: float
    begin: tuple[float, ...]  # values at which orbits are searched for, in its unit
    turns: int  # longest period of orbits [turns]
    starts: int  # number of starts at each of these values
    points: int  # largest number of orbits of a branch

    def document(self) -> dict[str, object]:
        """Everything that determines the branches, for JSON."""
        fixed = {name: value for name, value in self.scene.parameters.items() if name != self.name}
        return {"scene": self.scene.name, "set": fixed, "vary": {self.name: {"from": self.low, "to": self.high}},
                "units_at": self.scene[self.name], "begin": list(self.begin), "turns": self.turns,
                "starts": self.starts, "points": self.points}

    def family(self, turns: int, phase: float) -> Family:
        """Return the equations of orbits over the range (ValueError for a range that the scene refuses)."""
        return Family(self.scene, self.name, (self.low, self.high), turns, phase)


class BranchTask(NamedTuple):
    """A branch to follow."""

    direction: str  # `UP` or `DOWN` from an orbit, or `DOUBLED` from a period doubling
    turns: int  # period of the first orbit [turns]
    phase: float  # crank angle at the cut [rad]
    state: np.ndarray  # shape (n,): state of the first orbit at the cut, in units of the machine
    value: float  # value of the parameter there, in its unit
    parent: int | None  # number of the branch whose period doubles


def seeds_at(plan: BranchPlan, number: int) -> list[Seed]:
    """Search for orbits at the value `plan.begin[number]`; their states are in the units of their families."""
    scene, seeds = plan.scene.with_parameters({plan.name: plan.begin[number]}), []
    for seed in seeds_of(scene, plan.starts, plan.turns):
        ratio = units_of(scene) / plan.family(seed.turns, seed.phase).units
        seeds.append(Seed(seed.turns, float(seed.phase), seed.state * ratio))
    return seeds


def branch_of_task(plan: BranchPlan, task: BranchTask) -> Branch:
    """Follow the branch of a task."""
    family = plan.family(task.turns, task.phase)
    begin = np.append(task.state, family.scaled(task.value))
    if task.direction == DOUBLED:
        return doubled_branch_from(family, begin, plan.points)
    return branch_from(family, begin, 1.0 if task.direction == UP else -1.0, plan.points)


def rows_of(branch: Branch) -> list[dict]:
    """Return the rows of a branch; one row with the reason if it has no orbit."""
    def row(value: float, mean_speed: float, phase: float, state: Sequence[float] | np.ndarray,
            multipliers: np.ndarray, **others: object) -> dict:
        return {branch.name: value, "turns": branch.turns, "mean_speed": mean_speed, "phase": phase, "state": state,
                "multipliers_real": multipliers.real, "multipliers_imag": multipliers.imag, **others}

    rows = [row(branch.values[k], branch.mean_speeds[k], branch.phases[k], branch.states[k], branch.multipliers[k],
                stable=bool(branch.stable[k]), **{name: values[k] for name, values in branch.strobe.items()})
            for k in range(len(branch))]
    for number, special in enumerate(branch.special_points):
        rows.insert(special.at + number, row(
            special.value, special.mean_speed, special.phase, special.state, special.multipliers, kind=special.kind,
            width=special.width, change=special.change or None))
    if not rows:
        rows = [row(math.nan, math.nan, math.nan, [], np.empty(0))]
    rows[-1]["end"] = branch.end
    return rows


def branch_in(table: pa.Table, scene: Scene, name: str) -> Branch:
    """Return the branch that a block's table contains."""
    rows = table.to_pylist()
    turns, n = int(rows[0]["turns"]), len(rows[0]["state"]) or 1
    orbits, special = list[dict](), list[Special]()
    for row in rows:
        if row["kind"] is not None:
            special.append(Special(
                row["kind"], row["mean_speed"], _multipliers_of(row), row["change"] or "", row["phase"],
                np.array(row["state"]), len(orbits), row[name], row["width"]))
        elif row["state"]:
            orbits.append(row)

    def column(key: str) -> np.ndarray:
        return np.array([row[key] for row in orbits], dtype=float)

    return Branch(
        scene, name, turns, column(name), column("mean_speed"),
        np.array([_multipliers_of(row) for row in orbits], dtype=complex).reshape(-1, n), column("phase"),
        column("state").reshape(-1, n), {key: column(key).reshape(-1, turns) for key in state_names(scene)},
        tuple(special), rows[-1]["end"])


def _multipliers_of(row: dict[str, Any]) -> np.ndarray:
    return np.array(row["multipliers_real"]) + 1j * np.array(row["multipliers_imag"])


def fields_of(plan: BranchPlan) -> list[Field]:
    """Return the columns of a branch."""
    each = "each time the crank passes the angle 0; null for a special point"
    return [
        Field("kind", pa.string(), "1", "of a special point; null for an orbit between them", True),
        parameter_field(plan.name),
        Field("width", pa.float64(), PARAMETERS[plan.name].unit or "1", "of the interval that holds the special point",
              True),
        Field("stable", pa.bool_(), "1", "whether small disturbances die out; null for a special point", True),
        *(Field(name, NUMBERS, STATE_UNITS[name], each, True) for name in state_names(plan.scene)),
        Field("turns", pa.int64(), "1", "of the crank, after which the motion repeats itself"),
        Field("mean_speed", pa.float64(), "m/s", "of the body, forwards positive"),
        Field("multipliers_real", NUMBERS, "1", "Floquet multipliers, the largest first"),
        Field("multipliers_imag", NUMBERS, "1", "their imaginary parts"),
        Field("phase", pa.float64(), "rad", "crank angle at the cut"),
        Field("state", NUMBERS, "1", "at the cut, in units of the machine"),
        Field("change", pa.string(), "1", "of the events, where their order changes", True),
        Field("end", pa.string(), "1", "why the orbits were not followed further; in the last row", True)]


def study_of(plan: BranchPlan, tasks: Mapping[int, BranchTask]) -> Study:
    """Return the study of a plan's branches, each of which is a block."""
    return Study("branches followed", plan.document(), fields_of(plan), partial(_rows_of_task, plan, tasks), _RUN_TIME,
                 MOST_BRANCHES)


def _rows_of_task(plan: BranchPlan, tasks: Mapping[int, BranchTask], number: int) -> list[dict]:
    return rows_of(branch_of_task(plan, tasks[number]))


_SAME_DOUBLING = 1e-6  # share of the range within which period doublings of two branches are the same
# Share of the range within which a branch that joins another one ends at a period doubling of that one.
_JOINING_SHARE = 0.05


FollowedBranches = list[tuple[BranchTask, Branch]]
"""Tasks and their branches; the index is a branch's number."""


def followed_branches(plan: BranchPlan, folder: Path, execution: Execution) -> FollowedBranches:
    """Return every branch of a plan with its task, stored in a folder into which no other process writes."""
    check_folder(study_of(plan, {}), folder)  # refuses files of another study before the search
    followed: FollowedBranches = []
    for value, seeds in zip(plan.begin, _searched_seeds(plan, execution), strict=True):
        for seed in seeds:
            family = plan.family(seed.turns, seed.phase)
            if not any(lies_on(family, seed, value, branch) for _, branch in followed):
                tasks = [BranchTask(direction, seed.turns, seed.phase, seed.state, value, None)
                         for direction in (UP, DOWN)]
                followed += _followed(plan, tasks, len(followed), folder, execution)
    examined: set[tuple[int, int]] = set()
    while tasks := _doublings(plan, followed, examined):
        followed += _followed(plan, tasks, len(followed), folder, execution)
    return followed


def _searched_seeds(plan: BranchPlan, execution: Execution) -> list[list[Seed]]:
    """Search for orbits at each of `plan.begin`."""
    seeds_of_values = list[list[Seed]]()
    with contextlib.closing(execution.rows(partial(seeds_at, plan), range(len(plan.begin)), _RUN_TIME)) as results, \
            Progress("orbits looked for", "value", len(plan.begin)) as bar:
        for seeds in results:
            seeds_of_values.append(seeds)
            bar.add(1)
    return seeds_of_values


def _followed(plan: BranchPlan, tasks: Sequence[BranchTask], first: int, folder: Path, execution: Execution
              ) -> FollowedBranches:
    """Return the branches of some tasks, which are numbered from `first` on; stored ones are read."""
    numbered = dict(enumerate(tasks, first))
    if max(numbered) >= MOST_BRANCHES:
        raise RuntimeError(f"there are more than {MOST_BRANCHES} branches; give fewer --turns or a smaller range")
    study = study_of(plan, numbered)

    def rows_of_blocks(numbers: Iterable[int]) -> Rows:
        for number in numbers:
            task = numbered[number]
            say("study", f"branch {number}: {_turns(task.turns)}, {task.direction} from {plan.name} = "
                         f"{task.value:.9g}, at most {plan.points} orbits")
        return execution.rows(study.rows, numbers, study.run_time)

    tables = stored(study, folder, {number: [number] for number in numbered}, rows_of_blocks)
    return [(task, branch_in(tables[number], plan.scene, plan.name)) for number, task in numbered.items()]


def _doublings(plan: BranchPlan, followed: FollowedBranches, examined: set[tuple[int, int]]) -> list[BranchTask]:
    """Return tasks for the first period doubling of each branch whose branch of doubled period is not known yet.

    `examined` has the numbers of the branches and special points that were examined before; new ones are added.
    """
    tasks, span = list[BranchTask](), plan.high - plan.low
    for parent, (_, branch) in enumerate(followed):
        if 2 * branch.turns > plan.turns:
            continue
        for number, special in enumerate(branch.special_points):
            if special.kind != DOUBLING or (parent, number) in examined:
                continue
            examined.add((parent, number))
            is_known = any(task.direction == DOUBLED and task.turns == branch.turns
                           and abs(task.value - special.value) < _SAME_DOUBLING * span
                           for task in (*tasks, *(task for task, _ in followed)))
            ends_there = any(other.turns == 2 * branch.turns and other.end.startswith("joins")
                             and abs(other.values[-1] - special.value) < _JOINING_SHARE * span for _, other in followed)
            if not (is_known or ends_there):
                tasks.append(BranchTask(DOUBLED, branch.turns, special.phase, special.state, special.value, parent))
                break
    return tasks


LETTERS = {FOLD: "F", DOUBLING: "P", TORUS: "N", GRAZING: "G", CORNER: "C"}
"""First letter of a special point's name in picture and files, by its kind."""


def special_points_of(followed: FollowedBranches) -> Iterator[tuple[int, Branch, str, Special]]:
    """Yield each special point with the number of its branch, the branch, and its name.

    The name is the letter of its kind and a number, counted over all branches.
    """
    counts = dict.fromkeys(LETTERS, 0)
    for number, (_, branch) in enumerate(followed):
        for special in branch.special_points:
            counts[special.kind] += 1
            yield number, branch, f"{LETTERS[special.kind]}{counts[special.kind]}", special


def in_words(followed: FollowedBranches) -> Iterator[str]:
    """Yield one line of text for each branch."""
    named_points = list(special_points_of(followed))
    for number, (task, branch) in enumerate(followed):
        special = ", ".join(f"{name} {point.kind} at {point.value:.9g}" for of_branch, _, name, point in named_points
                            if of_branch == number and point.kind != CORNER)
        stable = ", ".join(f"{low:.6g} to {high:.6g}" for low, high in stable_ranges(branch))
        begin = f"{task.direction} from {task.value:.6g}" if task.parent is None else (
            f"from a period doubling of branch {task.parent} at {task.value:.6g}")
        yield (f"branch {number}, {_turns(branch.turns)}: {len(branch)} orbits {begin}; "
               f"{f'stable for {stable}; ' if stable else ''}{special + '; ' if special else ''}{branch.end}")


def stable_ranges(branch: Branch) -> list[tuple[float, float]]:
    """Ranges of the parameter [its unit] in which consecutive orbits of a branch are stable, in its order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], branch.stable.astype(int), [0]]))).reshape(-1, 2)
    return [(float(branch.values[first:last].min()), float(branch.values[first:last].max())) for first, last in edges]


def _turns(turns: int) -> str:
    return f"{turns} turn{'s' * (turns > 1)}"


# Colours of branches by their turns, with 0 for all others.
_COLOURS = {1: figures.BLACK, 2: figures.BLUE, 3: figures.VERMILION, 4: figures.GREEN, 8: figures.PURPLE,
            0: figures.ORANGE}
MARKS = {FOLD: ("s", 5.0), DOUBLING: ("o", 5.0), TORUS: ("D", 5.0), GRAZING: ("^", 5.5), CORNER: (".", 3.5)}
_MOST_NAMES = 24  # largest number of labels in the picture
_CELLS = 50.0  # cells along each axis of a panel; special points of one cell share a label


@figures.default_settings()
def draw_orbits(plan: BranchPlan, followed: FollowedBranches) -> bytes:
    """Draw all branches; returns a PNG file."""
    figure, branches = figures.new_figure(9.0, 8.4), [branch for _, branch in followed]
    upper, lower = figure.subplots(2, 1, sharex=True)
    coordinate = next((name for name in ("inclined_position", "upper_position")
                       if any(name in branch.strobe for branch in branches)), None)
    for branch in branches:
        _draw_line(upper, branch, 1e3 * branch.mean_speeds[:, None])
        if coordinate:
            _draw_line(lower, branch, 1e3 * branch.strobe[coordinate])
    lower.set_xlim(plan.low, plan.high)
    labels = list[tuple[str, float, float]]()
    for _, branch, name, special in special_points_of(followed):
        mark, size = MARKS[special.kind]
        speed, colour = 1e3 * special.mean_speed, _COLOURS.get(branch.turns, _COLOURS[0])
        if special.kind == CORNER:
            upper.plot(special.value, speed, mark, ms=size, color=colour, zorder=3)
        else:
            upper.plot(special.value, speed, mark, ms=size, color=colour, zorder=3, mfc="white")
            labels.append((name, special.value, speed))
    _write_names(upper, labels)
    upper.set(ylabel="mean speed [mm/s]")
    lower.set(xlabel=figures.of_parameter(plan.name),
              ylabel=f"{(coordinate or '').replace('_', ' ')} at crank angle 0 [mm]")
    for axes in (upper, lower):
        figures.style_axes(axes)
    figure.legend(handles=_legend(branches), loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    figures.set_heading(figure, f"{plan.scene.name}: periodic orbits over {plan.name}, unstable ones dashed")
    return figures.png(figure)


def _draw_line(axes: figures.Axes, branch: Branch, values: np.ndarray) -> None:
    """Draw a branch: solid between two stable neighbours, dashed if one of them is unstable."""
    colour, stable = _COLOURS.get(branch.turns, _COLOURS[0]), branch.stable
    is_stable = stable[1:] & stable[:-1]
    for chosen, style in ((np.flatnonzero(is_stable), "-"), (np.flatnonzero(~is_stable), (0, (3.0, 1.5)))):
        for run in np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1):
            if len(run):
                part = slice(run[0], run[-1] + 2)
                axes.plot(branch.values[part], values[part], color=colour, ls=style, lw=1.2)


def _write_names(axes: figures.Axes, labels: Sequence[tuple[str, float, float]]) -> None:
    """Write names of special points at their places in the picture; those that lie close together share a label."""
    cells: dict[tuple[int, int], list[str]] = {}
    for name, *place in labels:
        across, up = axes.transLimits.transform(place)
        cells.setdefault((round(_CELLS * across), round(_CELLS * up)), []).append(name)
    if len(cells) <= _MOST_NAMES:
        for (across, up), names in cells.items():
            axes.annotate(", ".join(names), (across / _CELLS, up / _CELLS), xycoords="axes fraction", xytext=(4, 4),
                          textcoords="offset points", fontsize=7)


def _legend(branches: Sequence[Branch]) -> list[figures.Line2D]:
    kinds = {special.kind for branch in branches for special in branch.special_points}
    lines = [figures.Line2D([], [], color=_COLOURS.get(turns, _COLOURS[0]), label=_turns(turns))
             for turns in sorted({branch.turns for branch in branches if len(branch)})]
    return lines + [figures.Line2D([], [], color=figures.BLACK, ls="", marker=mark, ms=size, mfc="white", label=kind)
                    for kind, (mark, size) in MARKS.items() if kind in kinds]


def _results(plan: BranchPlan, folder: Path, execution: Execution) -> Iterator[Results]:
    followed = followed_branches(plan, folder / FOLDER, execution)
    yield Results(_files(plan, followed), list(in_words(followed)) or [
        "no orbit was found; give more --starts, --turns, or another --from"])


def plan_of(options: argparse.Namespace) -> BranchPlan:
    """Make the plan from the options."""
    vary = options.vary or (_QUICK_VARY if options.quick else None)
    if vary is None:
        raise ValueError("--vary: is missing; give NAME=LOW:HIGH, such as motor.speed=60:130")
    varied = varied_in_words(vary)
    if not isinstance(varied, Range) or varied.log:
        raise ValueError(f"--vary {vary}: is no range; give NAME=LOW:HIGH, such as motor.speed=60:130")
    name, scene = varied.name, running(machine_of(options))
    if scene["solver.method"] != "exact":
        raise ValueError(f"solver.method: {scene['solver.method']!r} is not exact to rounding, which derivatives of "
                         "orbits need; leave it at 'exact'")
    begin = tuple(cast(float, PARAMETERS[name].checked(read_scalar(word))) for word in options.begin)
    if not begin:
        is_quick = options.quick and not options.vary
        begin = (_QUICK_FROM,) if is_quick else tuple(varied.at(np.array([0.25, 0.5, 0.75])).tolist())
    for value in begin:
        if not varied.low <= value <= varied.high:
            raise ValueError(f"--from {value:g}: is not from {varied.low:g} to {varied.high:g}; give a value of the "
                             "range")
        TurnMap(scene.with_parameters({name: value}))  # refuses a crank that stands
    turns, starts, points = (
        whole_number(f"--{key}", (quick if options.quick else usual) if getattr(options, key) is None else
                     getattr(options, key), least, most) for key, (usual, quick, least, most) in _COUNTS.items())
    plan = BranchPlan(scene.with_parameters({name: begin[0]}), name, varied.low, varied.high, begin, turns, starts,
                      points)
    plan.family(1, 0.0)  # refuses a range that the scene refuses
    return plan


def _files(plan: BranchPlan, followed: FollowedBranches) -> dict[str, bytes]:
    """Contents of tables, text and picture by file name; no tables without a branch."""
    names = iter([name for _, _, name, _ in special_points_of(followed)])
    rows = [{"branch": number, "name": next(names) if "kind" in row else None, **row}
            for number, (_, branch) in enumerate(followed) for row in rows_of(branch) if len(branch)]
    files = {}
    if rows:
        files = {BRANCHES: file_of(table_of(rows, [
            Field("branch", pa.int64(), "1", "number of the branch"),
            Field("name", pa.string(), "1", "of a special point, as in the picture", True), *fields_of(plan)]))}
    return {**files, PICTURE: draw_orbits(plan, followed)}


def _add_options(parser: Parser) -> None:
    parser.add_argument("--vary", metavar="NAME=LOW:HIGH", help="the parameter that changes, and its range")
    parser.add_argument("--from", dest="begin", action="append", default=[], metavar="VALUE", help="where orbits are "
                        "looked for; repeatable (default: at a quarter, a half and three quarters of the range)")
    parser.add_argument("--turns", type=int, metavar="N", help="most turns of the crank after which an orbit repeats "
                        f"itself, up to {MOST_TURNS} (default: 8)")
    parser.add_argument("--starts", type=int, metavar="N", help="starts from which orbits are looked for, at each "
                        "VALUE (default: 4)")
    parser.add_argument("--points", type=int, metavar="N", help="most orbits of a branch (default: 400)")
    parser.add_argument("--quick", action="store_true", help="the folds of `device` between 60 and 66 rad/s, in a "
                        "minute; options that are given win")


main = StudyCommand(
    "orbits", "Look for periodic orbits, stable and unstable, follow their branches over a parameter, through folds, "
    "grazings and corners, and from period doublings on; locate and name special points.", _add_options, plan_of,
    _results)
