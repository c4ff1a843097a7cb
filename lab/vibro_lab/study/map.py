"""``study map``: the motions of a machine over motor speed and gap, as Parquet and a picture.

Each row and column of the grid is swept up and down (`visits`). Each cell begins with the last state of the cell
before, so that coexisting motions are found. Two visits of one cell have the same motion by the rule of
`SettledMotion.is_same`. Motions of neighbouring cells are the same if their periods and landings are equal and their
mean speeds are close. But two motions of one cell are never the same, even if a path through other cells connects them:
beyond the end of a fold, where its two sheets meet, nothing separates them.

Where a motion ends, its branch is followed to the special point there (`end_point`), and these points are joined to
curves. Random starts tell which share of them leads to each motion of a cell with several (`shares`).
"""

import argparse
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from vibro_lab.orbits.attractors import steady_start
from vibro_lab.orbits.continuation import CORNER, follow, special_points
from vibro_lab.orbits.family import Family, LostError
from vibro_lab.orbits.recurrence import SAME, SettledMotion, number_among, settle, tolerance_of
from vibro_lab.orbits.turn_map import Stroboscope, TurnMap, check_closes, has_sampled_controller, state_names
from vibro_lab.study.command import Progress, Results, StudyCommand, machine_of
from vibro_lab.study.execution import Execution
from vibro_lab.study.figures import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    SKY,
    VERMILION,
    YELLOW,
    Axes,
    BoundaryNorm,
    Figure,
    Line2D,
    ListedColormap,
    default_settings,
    new_figure,
    png,
)
from vibro_lab.study.measures import MEASURES, REST, WORK, Window, observed
from vibro_lab.study.table import NUMBERS, Field, Study, are, computed, file_of
from vibro_lab.study.variation import whole_number
from vibro_ros import Parser, Scene, SimulationError, Simulator, read_scalar

SPEED, GAP = "motor_speed", "gap"
SIDES = ("upper", "inclined")
"""Sides whose gaps a map may vary."""
PATCHWORK = -1
"""Motion number of cells that form no motion, because what was found changes from cell to cell."""
# A settled motion does not depend on how plates, and a motor whose speed is prescribed, reach their commands, nor on
# the commanded speed itself, nor on limits that only warn.
_FREE = ("start.", "solver.", "gap_actuator.")
_OF_MOTOR, _FREE_OF_DC = ("motor.", "effects.motor"), (
    "motor.speed", "motor.max_speed", "motor.acceleration", "motor.time_constant", "motor.voltage",
    "motor.continuous_current")
MOST_CELLS = 25_000
"""Largest number of cells of a grid. Each cell is visited four times."""


@dataclass(frozen=True)
class Axis:
    """At least two equally spaced values, in the unit of the command."""

    low: float
    high: float
    count: int

    @property
    def step(self) -> float:
        """Distance between neighbouring values, in the unit of the command."""
        return (self.high - self.low) / (self.count - 1)

    @property
    def values(self) -> np.ndarray:
        """All values, shape (count,)."""
        return np.linspace(self.low, self.high, self.count)


@dataclass(frozen=True)
class Line:
    """A row or a column of the grid, swept from one end to the other.

    Attributes
    ----------
    along : str
        `SPEED` or `GAP`: the parameter that changes.
    place : int
        Index of the other parameter, which is constant.
    upwards : bool
        Whether the smallest value comes first.
    """

    along: str
    place: int
    upwards: bool


@dataclass(frozen=True)
class MapDesign:
    """Design of a map.

    Attributes
    ----------
    scene : Scene
        The machine; its own motor speed and gaps of `sides` are not used.
    sides : tuple of str
        Sides whose gaps are varied; two sides have equal gaps.
    speeds, gaps : Axis
        Motor speeds [rad/s] and gaps [m].
    """

    scene: Scene
    sides: tuple[str, ...]
    speeds: Axis
    gaps: Axis

    def scene_at(self, speed_index: int, gap_index: int) -> Scene:
        """Return the scene in a cell (ValueError if the scene refuses the values)."""
        return self.scene_with(float(self.speeds.values[speed_index]), float(self.gaps.values[gap_index]))

    def scene_with(self, motor_speed: float, gap: float) -> Scene:
        """Return the scene at a motor speed [rad/s] and a gap [m] (ValueError if the scene refuses the values)."""
        return self.scene.with_parameters({"motor.speed": motor_speed, **{f"{side}.gap": gap for side in self.sides}})

    def lines(self) -> list[Line]:
        """All rows and columns, each in both directions."""
        return [Line(along, place, upwards) for along, other in ((SPEED, self.gaps), (GAP, self.speeds))
                for place in range(other.count) for upwards in (True, False)]

    def cells(self, line: Line) -> Iterator[tuple[int, int]]:
        """Yield speed and gap index of each cell of a line, in its direction."""
        axis = self.speeds if line.along == SPEED else self.gaps
        for index in range(axis.count) if line.upwards else reversed(range(axis.count)):
            yield (index, line.place) if line.along == SPEED else (line.place, index)

    def document(self) -> dict[str, object]:
        """Everything that the motions depend on, for JSON."""
        solver = {name: value for name, value in self.scene.parameters.items() if name.startswith("solver.")}
        return {"parameters": parameters_that_count(self.scene, self.sides), "solver": solver, "gaps": list(self.sides),
                **{name: [axis.low, axis.high, axis.count]
                   for name, axis in ((SPEED, self.speeds), (GAP, self.gaps))}}


def parameters_that_count(scene: Scene, sides: tuple[str, ...]) -> dict[str, object]:
    """Return the parameters that a scene's motions depend on: all but commands, actuators, start and solver.

    The parameters of a dc motor are included, because the motions depend on it.
    """
    free = (*_FREE, *(_FREE_OF_DC if scene.has_rotor else _OF_MOTOR), *(f"{side}.gap" for side in sides))
    return {name: value for name, value in scene.parameters.items() if not name.startswith(free)}


BOTH = "both"
MOTOR_SPEEDS, GAPS = "50:250:101", "-0.002:0.008:41"
QUICK = "60:180:13", "0:0.006:4"
"""Grids of a full and of a quick map."""


def design_of(options: argparse.Namespace) -> MapDesign:
    """Make the design of a map from the options.

    Raises
    ------
    ValueError
        For options that give no grid or no scene; the message names value, limit and remedy.
    """
    scene = machine_of(options)
    if scene["solver.method"] != "exact":
        raise ValueError(f"solver.method: {scene['solver.method']} has no map; take exact, whose states repeat to "
                         "rounding")
    if scene.motor_command != "motor_speed":
        raise ValueError("motor.control: voltage commands no motor speed, which a map has on its axis; choose "
                         "speed_by_voltage or speed_by_current")
    sides = SIDES if options.gaps == BOTH else (options.gaps,)
    for side in sides:
        if side not in scene.plates:
            raise ValueError(f"--gaps {options.gaps}: {scene.name} has no {side} plate; give another scene or side")
    speeds, gaps = QUICK if options.quick else (MOTOR_SPEEDS, GAPS)
    design = MapDesign(scene, sides, _axis("--motor-speed", options.motor_speed or speeds),
                       _axis("--gap", options.gap or gaps))
    if design.speeds.low <= 0.0:
        raise ValueError(f"--motor-speed: from {design.speeds.low:g} rad/s; a crank that stands has no motion: give "
                         "speeds above 0")
    if design.speeds.count * design.gaps.count > MOST_CELLS:
        raise ValueError(f"--motor-speed, --gap: {design.speeds.count} x {design.gaps.count} cells; give at most "
                         f"{MOST_CELLS}")
    for index in range(design.speeds.count):
        design.scene_at(index, 0)  # refuses values that the scene refuses
    for index in range(design.gaps.count):
        design.scene_at(0, index)
    return design


def _rows_of_curves(design: MapDesign, asked: int | None) -> range:
    """Indices of the gaps at which motions are followed to their ends: equally spaced, about as many as `asked`."""
    count = (0 if has_sampled_controller(design.scene) else min(CURVES, design.gaps.count)) if asked is None else asked
    if count:
        check_closes(design.scene)
    if not 0 <= count <= design.gaps.count:
        raise ValueError(f"--curves: {count} is out of range; give a number from 0 to {design.gaps.count}, the gaps")
    return range(0, design.gaps.count, max(1, (design.gaps.count - 1) // max(1, count - 1))) if count else range(0)


def _axis(option: str, text: str) -> Axis:
    parts = [read_scalar(part) for part in text.split(":")]
    if len(parts) != 3 or not all(isinstance(part, (int, float)) and not isinstance(part, bool) for part in parts[:2]):
        raise ValueError(f"{option} {text}: give LOW:HIGH:COUNT")
    low, high = float(parts[0]), float(parts[1])  # type: ignore[arg-type]
    if not (-1e9 < low < high < 1e9):
        raise ValueError(f"{option} {text}: is no range; give the smaller number first")
    return Axis(low, high, whole_number(f"{option}: count", parts[2], 2, 10_000))


PHASE = math.pi
"""Crank angle [rad] of the cut: both sliders are far from the plates there."""
MOST_TURNS = 2048
"""Turns of the crank after which a visit counts as not settled."""
UNSETTLED = -1
"""Value of the period of a visit that has not settled."""
# Turns that are measured: at least, if periodic; without a period. Number of states kept of a motion without a period.
_LEAST_TURNS, _WITHOUT_PERIOD, _KEPT = 16, 256, 32
_NOTHING = (math.nan, math.nan, math.nan, math.nan)


LONG = 8
"""Longest period [turns] that characterises a motion. A longer one counts as none, because a small change of the
commands destroys it, and visits that settle slowly do not find it reliably."""


class Visit(NamedTuple):
    """The motion that a sweep found in a cell.

    Attributes
    ----------
    speed_index, gap_index : int
        Cell of the grid.
    turns : int
        Period [turns of the crank]; 0 for a motion without a period, `UNSETTLED` if none was found.
    landings : int
        Landings of the body within these turns; 0 without a period.
    mean_speed : float
        Mean speed of the body [m/s], forwards positive.
    cost_of_transport, stick_share, air_share : float
        Measures as defined in `study.measures`, dimensionless.
    states : ndarray, shape (m, n)
        States at successive cuts, in units of the machine: one period, or the last `_KEPT`; empty if none was found.
    """

    speed_index: int
    gap_index: int
    turns: int
    landings: int
    mean_speed: float
    cost_of_transport: float
    stick_share: float
    air_share: float
    states: np.ndarray

    def settled(self, tolerance: float) -> SettledMotion:
        """Return the motion for comparison within the cell; a period longer than `LONG` counts as none."""
        turns = self.turns if self.turns <= LONG else 0
        return SettledMotion(turns, self.states, self.mean_speed, self.turns, tolerance)


def visits(design: MapDesign, line: Line) -> list[Visit]:
    """Sweep a line: each cell begins with the last state of the cell before, the first one with the scene's own start.
    """
    found, before = [], None
    for speed_index, gap_index in design.cells(line):
        turn_map = TurnMap(design.scene_at(speed_index, gap_index), PHASE)
        stroboscope = Stroboscope(turn_map)
        try:
            try:
                if before is None:
                    stroboscope.begin_as()
                else:
                    stroboscope.begin(before / turn_map.units)
            except ValueError:  # the last state is not possible in this cell
                stroboscope.begin_as()
            motion = settle(stroboscope, most=MOST_TURNS)
            seen = motion and _measured(turn_map, motion)
        except SimulationError:
            motion = seen = None
        if motion and seen:
            before = motion.states[-1] * turn_map.units
            found.append(Visit(speed_index, gap_index, motion.turns, *seen, motion.states[-(motion.turns or _KEPT):]))
        else:
            before = None
            found.append(Visit(speed_index, gap_index, UNSETTLED, 0, *_NOTHING, np.empty((0, 0))))
    return found


def _measured(turn_map: TurnMap, motion: SettledMotion) -> tuple[int, float, float, float, float]:
    """Measure landings, mean speed [m/s], cost of transport, and shares of time in which the body stands and flies."""
    turns = motion.turns * math.ceil(_LEAST_TURNS / motion.turns) if motion.turns else _WITHOUT_PERIOD
    device = Simulator(turn_map.scene.with_parameters({"solver.accounts": True}))
    device.set_state(crank_angle=turn_map.phase, **dict(zip(turn_map.names, motion.states[-1] * turn_map.units,
                                                             strict=True)))
    period = turn_map.turn_time(motion.states[-1], turns)
    seen = observed(device, (WORK, REST), Window(0.0, period, turns, turns * period))
    landings = round(float(np.sum(seen.events["kind"] == "landing")) * motion.turns / turns)
    speed, cost, standing, airborne = (MEASURES[name].value(seen) for name in (
        "mean_speed", "cost_of_transport", "stick_share", "air_share"))
    return landings, speed if motion.turns else motion.mean_speed, cost, standing, airborne


LINES = "lines"
_RUN_TIME = 20.0  # simulated time [s] of a visit, about
_VISIT = [
    Field("speed_index", pa.int64(), "1", "index of the motor speed in the grid"),
    Field("gap_index", pa.int64(), "1", "index of the gap in the grid"),
    Field("turns", pa.int64(), "1", "turns after which the motion repeats itself; 0: it does not; -1: it did not "
          "settle"),
    Field("landings", pa.int64(), "1", "landings of the body within these turns"),
    Field("mean_speed", pa.float64(), "m/s", "of the body, forwards positive"),
    Field("cost_of_transport", pa.float64(), "1", "mean power / (weight x speed)"),
    Field("stick_share", pa.float64(), "1", "share of the time in which the body stands on the ground"),
    Field("air_share", pa.float64(), "1", "share of the time in which the body is in the air"),
    Field("states", NUMBERS, "1", f"at successive cuts, crank angle {PHASE:.6g} rad, one after the other, in crank "
          "radii and crank radii times motor speed"),
]
def visits_of(design: MapDesign, lines: Path, execution: Execution) -> list[Visit]:
    """Return all visits of a map; lines that are missing in the folder `lines` are swept (see `computed`)."""
    every, dimension = design.lines(), len(state_names(design.scene))

    def are_own(numbers: Sequence[int], rows: list[dict]) -> bool:
        cells = [cell for number in numbers for cell in design.cells(every[number])]
        return are(rows, [{"speed_index": i, "gap_index": j} for i, j in cells]) and all(
            row["turns"] >= UNSETTLED and len(row["states"]) == dimension * (
                0 if row["turns"] == UNSETTLED else row["turns"] or _KEPT) for row in rows)

    run_time = _RUN_TIME * max(design.speeds.count, design.gaps.count)
    rows = computed(Study("lines visited", design.document(), _VISIT, partial(rows_of_line, design), are_own, run_time,
                          ("exact",), len(every)), lines, execution).to_pylist()
    return [Visit(**{**row, "states": np.array(row["states"]).reshape(-1, dimension)}) for row in rows]


def rows_of_line(design: MapDesign, number: int) -> list[dict]:
    """Sweep a line by its number, and return one row for each visit."""
    return [{**one._asdict(), "states": one.states.ravel()} for one in visits(design, design.lines()[number])]


LEAST_CELLS = 8
"""Least number of cells of a numbered motion; smaller ones are `PATCHWORK`."""
_FROM_CELL_TO_CELL = 3e-3, 0.25  # largest change of a motion's mean speed between cells: m/s, plus share of the speed


class MotionTable(NamedTuple):
    """The motions of a map, a row each: columns of shape (rows,)."""

    speed_index: np.ndarray  # cell of the grid
    gap_index: np.ndarray
    motion: np.ndarray  # its number, the same in neighbouring cells between which it changes little; or `PATCHWORK`
    turns: np.ndarray  # period in turns of the crank; 0 without a period
    landings: np.ndarray  # of the body in a period; 0 without a period
    mean_speed: np.ndarray  # of the body [m/s], forwards positive
    cost_of_transport: np.ndarray  # mean power / (weight x speed), dimensionless; NaN where it is not defined
    stick_share: np.ndarray  # share of the time in which the body sticks to the ground, dimensionless
    air_share: np.ndarray  # share of the time in which the body is in the air, dimensionless


def motions(visits: Iterable[Visit], tolerance: float = SAME) -> tuple[MotionTable, list[Visit]]:
    """Return the distinct motions of each cell, with their numbers, and for each a visit that found it."""
    in_cell: dict[tuple[int, int], list[Visit]] = defaultdict(list)
    for visit in visits:
        cell = in_cell[visit.speed_index, visit.gap_index]
        if visit.turns != UNSETTLED and number_among(visit.settled(tolerance), [
                other.settled(tolerance) for other in cell]) is None:
            cell.append(visit)
    for cell in in_cell.values():
        cell.sort(key=lambda visit: visit.mean_speed)
    rows = [visit for _, cell in sorted(in_cell.items()) for visit in cell]
    numbers = _numbers(rows)
    columns = {name: np.array([getattr(visit, name) for visit in rows]) for name in MotionTable._fields
               if name != "motion"}
    short = columns["turns"] <= LONG
    columns |= {name: np.where(short, columns[name], 0) for name in ("turns", "landings")}
    return MotionTable(motion=numbers, **columns), rows


def _continues(one: Visit, other: Visit) -> bool:
    """Whether motions of neighbouring cells may be the same motion."""
    most, (least, share) = max(abs(one.mean_speed), abs(other.mean_speed)), _FROM_CELL_TO_CELL
    return _kind(one) == _kind(other) and abs(one.mean_speed - other.mean_speed) <= least + share * most


def _kind(visit: Visit) -> tuple[int, int]:
    return (visit.turns, visit.landings) if 0 < visit.turns <= LONG else (0, 0)


def _numbers(rows: Sequence[Visit]) -> np.ndarray:
    """Number of each row's motion; motion 0 has the most cells.

    Rows of neighbouring cells are merged into groups, in the order of the difference of their mean speeds. Two rows of
    one cell never get into one group.
    """
    at: dict[tuple[int, int], list[int]] = defaultdict(list)
    for row, visit in enumerate(rows):
        at[visit.speed_index, visit.gap_index].append(row)
    links = [(first, last) for (i, j), here in list(at.items())
             for beside in (at.get((i + 1, j), ()), at.get((i, j + 1), ())) for first in here for last in beside
             if _continues(rows[first], rows[last])]
    group_of = list(range(len(rows)))
    members = {row: [row] for row in range(len(rows))}
    cells = {row: {(visit.speed_index, visit.gap_index)} for row, visit in enumerate(rows)}
    for first, last in sorted(links, key=lambda pair: abs(rows[pair[0]].mean_speed - rows[pair[1]].mean_speed)):
        small, large = sorted((group_of[first], group_of[last]), key=lambda group: len(members[group]))
        if small == large or cells[small] & cells[large]:
            continue
        for row in members[small]:
            group_of[row] = large
        members[large] += members.pop(small)
        cells[large] |= cells.pop(small)
    numbers = np.full(len(rows), PATCHWORK)
    numbered = [group for group in members.values() if len(group) >= LEAST_CELLS]
    for number, group in enumerate(sorted(numbered, key=len, reverse=True)):
        numbers[group] = number
    return numbers


LONGEST = 4
"""Longest period [turns] of motions that are followed to their ends."""
BEYOND = 3.0
"""Number of cells over which a motion is followed beyond its last cell."""
_MOST_STEPS = 60  # along a branch
_LEAST_RUN = 3  # least number of neighbouring cells of a motion whose ends are followed
_TILT = 8.0  # rad/s per mm of gap: largest slope of a curve between two gaps


class End(NamedTuple):
    """The last cell of a motion in a row of the grid, in one direction of the motor speed.

    Attributes
    ----------
    gap_index, turns : int
        Row of the grid, and period [turns].
    motion : int
        Number of the motion.
    speed_index : int
        Index of the last cell's motor speed.
    direction : int
        Direction in which the motion ends: 1 upwards, -1 downwards.
    state : tuple of float
        State in the last cell, at the cut, in units of the machine.
    """

    gap_index: int
    turns: int
    motion: int
    speed_index: int
    direction: int
    state: tuple[float, ...]


class Point(NamedTuple):
    """Special point at which a motion ends.

    Attributes
    ----------
    kind : str
        Kind of special point, one of `orbits.continuation.KINDS`.
    turns, motion, direction : int
        Fields of the `End`.
    gap_index : int
        Row of the grid.
    motor_speed : float
        Motor speed of the special point [rad/s].
    """

    kind: str
    turns: int
    motion: int
    direction: int
    gap_index: int
    motor_speed: float


def ends(found: MotionTable, rows: list[Visit], speeds: Axis, gap_indices: range) -> list[End]:
    """Find the ends of motions in some rows of the grid, in both directions of the motor speed; not at its borders."""
    listed = []
    for gap_index in gap_indices:
        for motion in np.unique(found.motion[(found.gap_index == gap_index) & (found.motion > PATCHWORK)]).tolist():
            own = np.flatnonzero((found.gap_index == gap_index) & (found.motion == motion))
            turns = int(found.turns[own[0]])
            if not 0 < turns <= LONGEST:
                continue
            for run in np.split(own, np.flatnonzero(np.diff(found.speed_index[own]) > 1) + 1):
                if len(run) >= _LEAST_RUN:
                    listed += [End(gap_index, turns, motion, int(found.speed_index[row]), direction,
                                   tuple(rows[row].states[-1].tolist()))
                               for row, direction, border in ((run[0], -1, 0), (run[-1], 1, speeds.count - 1))
                               if found.speed_index[row] != border]
    return listed


def end_point(design: MapDesign, end: End) -> Point | None:
    """Return the special point at which a motion ends; None if none is found within `BEYOND`, or the branch is lost."""
    span = BEYOND * design.speeds.step
    here = float(design.speeds.values[end.speed_index])
    low, high = (here, here + span) if end.direction > 0 else (max(here - span, 0.1 * here), here)
    try:
        family = Family(design.scene_at(end.speed_index, end.gap_index), {"motor.speed": (low, high)}, end.turns, PHASE)
        branch = follow(family, np.append(end.state, family.scaled(here)), float(end.direction))
        for _, (before, after) in zip(range(_MOST_STEPS), branch, strict=False):
            for special in special_points(before, after):
                if special.kind == CORNER:  # the motion goes on
                    continue
                return Point(special.kind, end.turns, end.motion, end.direction, end.gap_index, special.point.value)
    except (LostError, SimulationError, ValueError):
        pass
    return None


def points_of(design: MapDesign, ends: Sequence[End], execution: Execution) -> list[Point]:
    """Return the special points of all ends that have one."""
    with Progress("ends of motions followed", "end", len(ends)) as progress, closing(execution.rows(
            partial(_point_at, design, tuple(ends)), range(len(ends)), 20.0 * _RUN_TIME, ("exact",))) as found:
        points = []
        for point in found:
            progress.add(1)
            if point is not None:
                points.append(point)
        return points


def _point_at(design: MapDesign, ends: tuple[End, ...], number: int) -> Point | None:
    return end_point(design, ends[number])


class Curve(NamedTuple):
    """Curve on which the motions with a period of `turns` turns end; `kind` is one of `orbits.continuation.KINDS`."""

    kind: str
    turns: int
    motor_speed: tuple[float, ...]  # of its points [rad/s]
    gap: tuple[float, ...]  # of its points [m]


def curves(design: MapDesign, points: list[Point], gap_indices: range) -> tuple[Curve, ...]:
    """Join points of neighbouring gaps to curves, each of at least two points."""
    lines: list[list[Point]] = []
    open_lines: list[list[Point]] = []
    reach = _TILT * 1e3 * gap_indices.step * design.gaps.step + design.speeds.step
    for gap_index in gap_indices:
        left = [point for point in points if point.gap_index == gap_index]
        still_open = []
        near = [(abs(line[-1].motor_speed - point.motor_speed), line, point) for line in open_lines for point in left
                if (line[-1].kind, line[-1].motion, line[-1].direction) == (point.kind, point.motion, point.direction)]
        for distance, line, point in sorted(near, key=lambda one: one[0]):
            if distance <= reach and point in left and line not in still_open:
                left.remove(point)
                line.append(point)
                still_open.append(line)
        fresh = [[point] for point in left]
        lines += fresh
        open_lines = still_open + fresh
    values = design.gaps.values
    return tuple(Curve(line[0].kind, line[0].turns, tuple(float(f"{point.motor_speed:.9g}") for point in line),
                       tuple(float(f"{values[point.gap_index]:.9g}") for point in line))
                 for line in lines if len(line) > 1)


HISTORIES = 8
"""Random starts of each cell with several motions (`orbits.starts`)."""
_SAME_SPEED = 0.05  # relative difference of mean speeds up to which a start has led to a motion of the same period
_LONGEST_SETTLING = 40.0  # simulated time [s] of a start, about


def shares(design: MapDesign, found: MotionTable, execution: Execution) -> np.ndarray:
    """Share of `HISTORIES` random starts that lead to each motion, shape (rows,); NaN for the only motion of its cell.

    The shares of a cell's motions add up to less than 1 if a start leads to a motion that no sweep has found.
    """
    rows_of: dict[tuple[int, int], list[int]] = defaultdict(list)
    for row, cell in enumerate(zip(found.speed_index.tolist(), found.gap_index.tolist(), strict=True)):
        rows_of[cell].append(row)
    several = {cell: rows for cell, rows in rows_of.items() if len(rows) > 1}
    known = tuple((cell, [(int(found.turns[row]), float(found.mean_speed[row])) for row in rows])
                  for cell, rows in several.items())
    table = np.full(len(found.motion), math.nan)
    with Progress("random starts of cells with several motions", "cell", len(known)) as progress, closing(
            execution.rows(partial(_led, design, known), range(len(known)), HISTORIES * _LONGEST_SETTLING,
                           ("exact",))) as led:
        for rows, counts in zip(several.values(), led, strict=True):
            table[rows] = np.array(counts) / HISTORIES
            progress.add(1)
    return table


def _led(design: MapDesign, known: Sequence[tuple[tuple[int, int], list[tuple[int, float]]]], number: int
         ) -> list[int]:
    """Number of random starts that lead to each known motion of a cell: period [turns] and mean speed [m/s]."""
    cell, motions = known[number]
    turn_map, counts = TurnMap(design.scene_at(*cell), PHASE), [0] * len(motions)
    for start in range(HISTORIES):
        stroboscope = Stroboscope(turn_map)
        with suppress(SimulationError):
            stroboscope.begin_with(steady_start(turn_map.scene, start))
            motion = settle(stroboscope, most=MOST_TURNS)
            place = None if motion is None else _place_among(motion, motions)
            if place is not None:
                counts[place] += 1
    return counts


def _place_among(motion: SettledMotion, motions: Sequence[tuple[int, float]]) -> int | None:
    """Index of the motion of the same period whose mean speed is nearest; None if it differs by too much."""
    turns = motion.turns if motion.turns <= LONG else 0
    near = [(abs(speed - motion.mean_speed), place) for place, (other, speed) in enumerate(motions) if other == turns
            and abs(speed - motion.mean_speed) <= _SAME_SPEED * max(abs(speed), abs(motion.mean_speed))]
    return min(near)[1] if near else None


@dataclass(frozen=True)
class MotionMap:
    """The motions of a design, and the curves on which they end; `share` has the shares of `shares`."""

    design: MapDesign
    found: MotionTable
    curves: tuple[Curve, ...]
    share: np.ndarray


def map_in_words(motion_map: MotionMap, visits: list[Visit]) -> list[str]:
    """Return lines of text about the map: numbers of motions, mean speeds and curves."""
    design, found, share = motion_map.design, motion_map.found, motion_map.share
    cells, counts = np.unique(np.column_stack([found.speed_index, found.gap_index]), axis=0, return_counts=True)
    unsettled = sum(visit.turns == UNSETTLED for visit in visits)
    numbered = np.unique(found.motion[found.motion > PATCHWORK])
    periodic = float(np.mean(found.turns > 0))
    fastest, slowest = int(np.argmax(np.abs(found.mean_speed))), int(np.argmin(np.abs(found.mean_speed)))
    forwards = int(np.sum(found.mean_speed > 0.0))
    place = (f"{design.speeds.values[found.speed_index[fastest]]:g} rad/s, gap "
             f"{design.gaps.values[found.gap_index[fastest]] * 1e3:g} mm")
    if not math.isnan(share[fastest]):
        place += f", {round(share[fastest] * HISTORIES)} of {HISTORIES} random starts"
    tried = _fastest(motion_map, share)[~np.isnan(_fastest(motion_map, share))]
    kinds = [curve.kind for curve in motion_map.curves]
    curves = ", ".join(f"{kinds.count(kind)} of {kind}" for kind in dict.fromkeys(kinds))
    return [
        f"{len(cells)} of {design.speeds.count * design.gaps.count} cells have a motion, "
        f"{np.sum(counts > 1)} have more than one; {unsettled} of {len(visits)} visits did not settle",
        f"the fastest of several motions has most of {HISTORIES} random starts in {np.sum(tried > 0.5)} cells, and "
        f"none of them in {np.sum(tried == 0.0)}",
        f"{len(numbered)} motions of neighbouring cells; {periodic:.0%} of what was found repeats itself within 8 "
        "turns",
        f"mean speeds from {found.mean_speed[slowest] * 1e3:.1f} to {found.mean_speed[fastest] * 1e3:.1f} mm/s "
        f"({place}); {forwards} go forwards",
        f"curves: {curves or 'none'}",
    ]


WIDTH, HEIGHT = 9.6, 11.4  # in
_PERIODS = (("#dddddd", "none up to 8"), (BLUE, "1"), (SKY, "2"), (GREEN, "3"), (YELLOW, "4"), (ORANGE, "5 to 8"))
_STYLES = {"fold": (BLACK, "-"), "period doubling": (BLACK, "--"), "Neimark-Sacker": (BLACK, ":"),
           "grazing": (VERMILION, "-")}


@default_settings()
def draw_map(motion_map: MotionMap) -> bytes:
    """Draw mean speed, share of the starts and period over motor speed and gap; returns a PNG file."""
    figure = new_figure(WIDTH, HEIGHT)
    upper, middle, lower = figure.subplots(3, 1, sharex=True, sharey=True)
    _draw_quantity(figure, upper, motion_map, motion_map.found.mean_speed * 1e3, "fastest mean speed [mm/s]",
                   "viridis")
    _draw_quantity(figure, middle, motion_map, motion_map.share * 100.0, f"share of {HISTORIES} random starts [%]",
                   "magma", (0.0, 100.0))
    _draw_periods(figure, lower, motion_map)
    for axes in (upper, middle, lower):
        _draw_curves(axes, motion_map)
    handles = [Line2D([], [], color=colour, linestyle=style, label=kind) for kind, (colour, style) in _STYLES.items()
               if any(curve.kind == kind for curve in motion_map.curves)]
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    sides = "both plates" if len(motion_map.design.sides) > 1 else f"the {motion_map.design.sides[0]} plate"
    upper.set_title(f"{motion_map.design.scene.name}: motions over motor speed and gap of {sides}", wrap=True)
    middle.set_title("cells with more than one motion: random starts that lead to the fastest", fontsize="medium")
    lower.set_xlabel("motor speed [rad/s]")
    return png(figure)


def _fastest(motion_map: MotionMap, values: np.ndarray) -> np.ndarray:
    """Value of the fastest motion of each cell, forwards or backwards, shape (gaps, speeds); NaN without a motion."""
    order = np.argsort(np.abs(motion_map.found.mean_speed), kind="stable")
    cells = np.full((motion_map.design.gaps.count, motion_map.design.speeds.count), np.nan)
    cells[motion_map.found.gap_index[order], motion_map.found.speed_index[order]] = values[order]
    return cells


def _edges(axis: Axis, factor: float = 1.0) -> np.ndarray:
    return factor * np.linspace(axis.low - axis.step / 2.0, axis.high + axis.step / 2.0, axis.count + 1)


def _draw_quantity(figure: Figure, axes: Axes, motion_map: MotionMap, values: np.ndarray, name: str,
                   colours: str, limits: tuple[float | None, float | None] = (None, None)) -> None:
    mesh = axes.pcolormesh(_edges(motion_map.design.speeds), _edges(motion_map.design.gaps, 1e3),
                           _fastest(motion_map, values), cmap=colours, vmin=limits[0],
                           vmax=limits[1], rasterized=True)
    figure.colorbar(mesh, ax=axes, label=name, pad=0.01)
    axes.set_ylabel("gap [mm]")
    axes.set_facecolor("white")


def _draw_periods(figure: Figure, axes: Axes, motion_map: MotionMap) -> None:
    turns = motion_map.found.turns
    classes = _fastest(motion_map, np.where(turns > 4, 5, turns).astype(float))
    colours = ListedColormap([colour for colour, _ in _PERIODS])
    mesh = axes.pcolormesh(_edges(motion_map.design.speeds), _edges(motion_map.design.gaps, 1e3), classes, cmap=colours,
                           norm=BoundaryNorm(np.arange(-0.5, len(_PERIODS)), len(_PERIODS)), rasterized=True)
    axes.set_ylabel("gap [mm]")
    bar = figure.colorbar(mesh, ax=axes, pad=0.01, ticks=range(len(_PERIODS)), label="period [turns]")
    bar.ax.set_yticklabels([words for _, words in _PERIODS])


def _draw_curves(axes: Axes, motion_map: MotionMap) -> None:
    for curve in motion_map.curves:
        colour, style = _STYLES[curve.kind]
        gaps = np.array(curve.gap) * 1e3
        axes.plot(curve.motor_speed, gaps, color="white", linewidth=2.6)  # else black lines vanish in dark cells
        axes.plot(curve.motor_speed, gaps, color=colour, linestyle=style, linewidth=1.1)
    axes.set_xlim(*_edges(motion_map.design.speeds)[[0, -1]])
    axes.set_ylim(*_edges(motion_map.design.gaps, 1e3)[[0, -1]])


TABLE, PICTURE = "motions.parquet", "map.png"
CURVES = 11
"""Default number of gaps at which motions are followed to their ends."""


class Asked(NamedTuple):
    """Design of the study: the map, and the indices of the gaps of its curves."""

    design: MapDesign
    gap_indices: range


def _asked(options: argparse.Namespace) -> Asked:
    design = design_of(options)
    return Asked(design, _rows_of_curves(design, options.curves))


def _results(asked: Asked, folder: Path, execution: Execution) -> Iterator[Results]:
    design = asked.design
    visits = visits_of(design, folder / LINES, execution)
    found, rows = motions(visits, tolerance_of(design.scene))
    if not rows:
        raise RuntimeError("no visit has settled, so that there is no map; give another scene or other speeds")
    points = points_of(design, ends(found, rows, design.speeds, asked.gap_indices), execution)
    motion_map = MotionMap(design, found, curves(design, points, asked.gap_indices), shares(design, found, execution))
    yield Results({TABLE: _table(motion_map, rows), PICTURE: draw_map(motion_map)}, map_in_words(motion_map, visits))


def _table(motion_map: MotionMap, rows: list[Visit]) -> bytes:
    """Return a Parquet file of all motions, with motor speeds and gaps in place of indices."""
    found, speeds, gaps = motion_map.found, motion_map.design.speeds, motion_map.design.gaps
    columns = {"motor_speed": (speeds.values[found.speed_index], "rad/s"), "gap": (gaps.values[found.gap_index], "m"),
               "motion": (found.motion, "1"), "turns": ([visit.turns for visit in rows], "1"),
               "landings": ([visit.landings for visit in rows], "1"), "mean_speed": (found.mean_speed, "m/s"),
               "cost_of_transport": (found.cost_of_transport, "1"), "stick_share": (found.stick_share, "1"),
               "air_share": (found.air_share, "1"), "share_of_starts": (motion_map.share, "1")}
    arrays = [pa.array(values) for values, _ in columns.values()]
    fields = [pa.field(name, array.type, metadata={"unit": unit})
              for (name, (_, unit)), array in zip(columns.items(), arrays, strict=True)]
    return file_of(pa.Table.from_arrays(arrays, schema=pa.schema(fields)))


def _add_options(parser: Parser) -> None:
    parser.add_argument("--motor-speed", metavar="LOW:HIGH:COUNT",
                        help=f"motor speeds [rad/s] (default: {MOTOR_SPEEDS})")
    parser.add_argument("--gap", metavar="LOW:HIGH:COUNT", help=f"gaps [m] (default: {GAPS})")
    parser.add_argument("--quick", action="store_true", help=f"a coarse grid, {QUICK[0]} rad/s and {QUICK[1]} m: "
                        "a look within a minute")
    parser.add_argument("--gaps", choices=(BOTH, *SIDES), default=BOTH, help="gaps that are varied: of both plates "
                        f"alike, or of one (default: {BOTH})")
    parser.add_argument("--curves", type=int, metavar="N", help="gaps at which folds, doublings, Neimark-Sacker points "
                        "and grazings are located, which takes the longest; 0: none, as with a dc motor, whose orbits "
                        "do not close (default: 11, or all if fewer)")


main = StudyCommand(
    "map", "Find the motions of a machine at each motor speed and gap: rows and columns of a grid are swept up and "
    "down, each cell beginning with the state of the one before, so that motions that exist together are found. "
    "Writes the motions as Parquet, and a picture.", _add_options, _asked, _results,
    failure="the disk is full, or nothing settles")
