"""``study map``: the motions of a machine over motor speed and gap, as Parquet and a picture.

Each row and column of the grid is swept up and down (`visits`). Each cell begins with the last state of the cell
before, so that coexisting motions are found. Two visits of one cell have the same motion by the rule of
`SettledMotion.is_same`. Motions of neighbouring cells are the same if their periods and landings are equal and their
mean speeds are close. But two motions of one cell are never the same, even if a path through other cells connects them:
beyond the end of a fold, where its two sheets meet, nothing separates them.

Random starts tell which share of them leads to each motion of a cell with several (`shares`).
"""

import argparse
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from vibro_lab.orbits.attractors import steady_start
from vibro_lab.orbits.recurrence import SAME, SettledMotion, number_among, settle, tolerance_of
from vibro_lab.orbits.turn_map import Stroboscope, TurnMap, state_names
from vibro_lab.study import figures
from vibro_lab.study.command import Progress, Results, StudyCommand, machine_of
from vibro_lab.study.execution import Execution
from vibro_lab.study.measures import MEASURES, REST, WORK, Window, observed
from vibro_lab.study.table import NUMBERS, Field, Study, computed, file_of
from vibro_lab.study.variation import limits_in_words
from vibro_ros import Parser, Scene, SimulationError, Simulator

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
UNSETTLED = -1
"""Value of the period of a visit that has not settled."""


@dataclass(frozen=True)
class MapSettings:
    """Settings of the search for motions; `test_map_settings.py` halves and doubles each of them."""

    # Crank angle of the cut [rad]: both sliders are far from the plates there, so that no event lies at the cut. A cut
    # at 0, within contacts, finds other motions; one at a quarter turn finds the same.
    phase: float = math.pi
    # Turns after which a visit counts as not settled: a visit begins near its motion, and 98 % settle within 512.
    most_turns: int = 2048
    # Turns that are measured of a periodic motion, at least: a mean over fewer depends on the rounding of its period.
    least_turns: int = 16
    # Turns that are measured of a motion without a period: its mean speed is then known to about 1 %.
    turns_without_period: int = 256
    # States kept of a motion without a period: enough to tell two clouds apart, and a row stays small.
    kept_states: int = 32
    # Longest period [turns] that characterises a motion. A longer one counts as none, because a small change of the
    # commands destroys it, and visits that settle slowly do not find it reliably.
    longest_period: int = 8
    # Least number of cells of a numbered motion; smaller ones are `PATCHWORK`, most of them at edges of larger motions.
    least_cells: int = 8
    # Largest change of a motion's mean speed between neighbouring cells [m/s], and the share of the speed added to it:
    # larger than the change over a cell of the shipped grids, smaller than the distance between most two motions.
    speed_change: float = 3e-3
    speed_change_share: float = 0.25
    # Random starts of each cell with several motions: their shares are known to an eighth.
    histories: int = 8
    # Relative difference of mean speeds up to which a start has led to a motion of the same period.
    same_speed: float = 0.05



@dataclass(frozen=True)
class GridAxis:
    """At least two equally spaced values, in the unit of the command."""

    low: float
    high: float
    count: int

    @property
    def values(self) -> np.ndarray:
        """All values, shape (count,)."""
        return np.linspace(self.low, self.high, self.count)


@dataclass(frozen=True)
class Line:
    """A row or a column of the grid, swept from one end to the other."""

    along: str  # `SPEED` or `GAP`: the parameter that changes
    place: int  # index of the other parameter, which is constant
    upwards: bool  # whether the smallest value comes first


@dataclass(frozen=True)
class MapDesign:
    """Design of a map."""

    scene: Scene  # the machine; its own motor speed and gaps of `sides` are not used
    sides: tuple[str, ...]  # sides whose gaps are varied; two sides have equal gaps
    speeds: GridAxis  # motor speeds [rad/s] and gaps [m]
    gaps: GridAxis
    settings: MapSettings = MapSettings()

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
                "settings": asdict(self.settings),
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
    """Make the design of a map from the options."""
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


def _axis(option: str, text: str) -> GridAxis:
    axis = GridAxis(*limits_in_words(option, text))
    if not axis.count:
        raise ValueError(f"{option} {text}: give LOW:HIGH:COUNT")
    return axis


_NOTHING = (math.nan, math.nan, math.nan, math.nan)


class VisitedCell(NamedTuple):
    """The motion that a sweep found in a cell."""

    speed_index: int  # cell of the grid
    gap_index: int
    turns: int  # period [turns of the crank]; 0 for a motion without a period, `UNSETTLED` if none was found
    landings: int  # landings of the body within these turns; 0 without a period
    mean_speed: float  # mean speed of the body [m/s], forwards positive
    cost_of_transport: float  # measures as defined in `study.measures`, dimensionless
    stick_share: float
    air_share: float
    # Shape (m, n): states at successive cuts, in units of the machine: one period, or the last `kept_states`; empty
    # if none was found.
    states: np.ndarray

    def settled(self, tolerance: float, longest: int) -> SettledMotion:
        """Return the motion for comparison within the cell; a period of more than `longest` turns counts as none."""
        turns = self.turns if self.turns <= longest else 0
        return SettledMotion(turns, self.states, self.mean_speed, self.turns, tolerance)


def visits(design: MapDesign, line: Line) -> list[VisitedCell]:
    """Sweep a line: each cell begins with the last state of the cell before, the first one with the scene's own start.
    """
    visited, last_state, settings = list[VisitedCell](), None, design.settings
    for speed_index, gap_index in design.cells(line):
        turn_map = TurnMap(design.scene_at(speed_index, gap_index), settings.phase)
        stroboscope = Stroboscope(turn_map)
        try:
            try:
                if last_state is None:
                    stroboscope.begin_as()
                else:
                    stroboscope.begin(last_state / turn_map.units)
            except ValueError:  # the last state is not possible in this cell
                stroboscope.begin_as()
            motion = settle(stroboscope, most=settings.most_turns)
            quantities = motion and _measured(turn_map, motion, settings)
        except SimulationError:
            motion = quantities = None
        if motion and quantities:
            last_state = motion.states[-1] * turn_map.units
            states = motion.states[-(motion.turns or settings.kept_states):]
            visited.append(VisitedCell(speed_index, gap_index, motion.turns, *quantities, states))
        else:
            last_state = None
            visited.append(VisitedCell(speed_index, gap_index, UNSETTLED, 0, *_NOTHING, np.empty((0, 0))))
    return visited


def _measured(turn_map: TurnMap, motion: SettledMotion, settings: MapSettings
              ) -> tuple[int, float, float, float, float]:
    """Measure landings, mean speed [m/s], cost of transport, and shares of time in which the body stands and flies."""
    turns = (motion.turns * math.ceil(settings.least_turns / motion.turns) if motion.turns else
             settings.turns_without_period)
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
    Field("states", NUMBERS, "1", "at successive cuts, crank angle pi, one after the other, in crank radii and crank "
          "radii times motor speed"),
]
def visits_of(design: MapDesign, lines: Path, execution: Execution) -> list[VisitedCell]:
    """Return all visits of a map; lines that are missing in the folder `lines` are swept (see `computed`)."""
    lines_count, dimension = len(design.lines()), len(state_names(design.scene))
    run_time = _RUN_TIME * max(design.speeds.count, design.gaps.count)
    rows = computed(Study("lines visited", design.document(), _VISIT, partial(rows_of_line, design), run_time,
                          lines_count), lines, execution).to_pylist()
    return [VisitedCell(**{**row, "states": np.array(row["states"]).reshape(-1, dimension)}) for row in rows]


def rows_of_line(design: MapDesign, number: int) -> list[dict]:
    """Sweep a line by its number, and return one row for each visit."""
    return [{**one._asdict(), "states": one.states.ravel()} for one in visits(design, design.lines()[number])]


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


def motions(visits: Iterable[VisitedCell], tolerance: float = SAME, settings: MapSettings = MapSettings()
            ) -> tuple[MotionTable, list[VisitedCell]]:
    """Return the distinct motions of each cell, with their numbers, and for each a visit that found it."""
    in_cell: dict[tuple[int, int], list[VisitedCell]] = defaultdict(list)
    for visit in visits:
        cell = in_cell[visit.speed_index, visit.gap_index]
        if visit.turns != UNSETTLED and number_among(visit.settled(tolerance, settings.longest_period), [
                known.settled(tolerance, settings.longest_period) for known in cell]) is None:
            cell.append(visit)
    for cell in in_cell.values():
        cell.sort(key=lambda visit: visit.mean_speed)
    rows = [visit for _, cell in sorted(in_cell.items()) for visit in cell]
    numbers = _numbers(rows, settings)
    columns = {name: np.array([getattr(visit, name) for visit in rows]) for name in MotionTable._fields
               if name != "motion"}
    short = columns["turns"] <= settings.longest_period
    columns |= {name: np.where(short, columns[name], 0) for name in ("turns", "landings")}
    return MotionTable(motion=numbers, **columns), rows


def _continues(visit: VisitedCell, neighbour: VisitedCell, settings: MapSettings) -> bool:
    """Whether motions of neighbouring cells may be the same motion."""
    kinds = [(row.turns, row.landings) if 0 < row.turns <= settings.longest_period else (0, 0)
             for row in (visit, neighbour)]
    faster = max(abs(visit.mean_speed), abs(neighbour.mean_speed))
    change = abs(visit.mean_speed - neighbour.mean_speed)
    return kinds[0] == kinds[1] and change <= settings.speed_change + settings.speed_change_share * faster


def _numbers(rows: Sequence[VisitedCell], settings: MapSettings) -> np.ndarray:
    """Number of each row's motion; motion 0 has the most cells.

    Rows of neighbouring cells are merged into groups, in the order of the difference of their mean speeds. Two rows of
    one cell never get into one group.
    """
    at: dict[tuple[int, int], list[int]] = defaultdict(list)
    for row, visit in enumerate(rows):
        at[visit.speed_index, visit.gap_index].append(row)
    links = [(first, last) for (i, j), rows_of_cell in list(at.items())
             for beside in (at.get((i + 1, j), ()), at.get((i, j + 1), ())) for first in rows_of_cell for last in beside
             if _continues(rows[first], rows[last], settings)]
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
    numbered = [group for group in members.values() if len(group) >= settings.least_cells]
    for number, group in enumerate(sorted(numbered, key=len, reverse=True)):
        numbers[group] = number
    return numbers


_LONGEST_SETTLING = 40.0  # simulated time [s] of a start, about


def shares(design: MapDesign, table: MotionTable, execution: Execution) -> np.ndarray:
    """Share of `histories` random starts that lead to each motion, shape (rows,); NaN for the only motion of its cell.

    The shares of a cell's motions add up to less than 1 if a start leads to a motion that no sweep has found.
    """
    histories = design.settings.histories
    rows_of: dict[tuple[int, int], list[int]] = defaultdict(list)
    for row, cell in enumerate(zip(table.speed_index.tolist(), table.gap_index.tolist(), strict=True)):
        rows_of[cell].append(row)
    several = {cell: rows for cell, rows in rows_of.items() if len(rows) > 1}
    known = tuple((cell, [(int(table.turns[row]), float(table.mean_speed[row])) for row in rows])
                  for cell, rows in several.items())
    shares_of_rows = np.full(len(table.motion), math.nan)
    with Progress("random starts of cells with several motions", "cell", len(known)) as progress, closing(
            execution.rows(partial(_led, design, known), range(len(known)), histories * _LONGEST_SETTLING)) as led:
        for rows, counts in zip(several.values(), led, strict=True):
            shares_of_rows[rows] = np.array(counts) / histories
            progress.add(1)
    return shares_of_rows


def _led(design: MapDesign, known: Sequence[tuple[tuple[int, int], list[tuple[int, float]]]], number: int
         ) -> list[int]:
    """Number of random starts that lead to each known motion of a cell: period [turns] and mean speed [m/s]."""
    cell, motions = known[number]
    settings = design.settings
    turn_map, counts = TurnMap(design.scene_at(*cell), settings.phase), [0] * len(motions)
    for start in range(settings.histories):
        stroboscope = Stroboscope(turn_map)
        with suppress(SimulationError):
            stroboscope.begin_with(steady_start(turn_map.scene, start))
            motion = settle(stroboscope, most=settings.most_turns)
            place = None if motion is None else _place_among(motion, motions, settings)
            if place is not None:
                counts[place] += 1
    return counts


def _place_among(motion: SettledMotion, motions: Sequence[tuple[int, float]], settings: MapSettings) -> int | None:
    """Index of the motion of the same period whose mean speed is nearest; None if it differs by too much."""
    turns = motion.turns if motion.turns <= settings.longest_period else 0
    near = [(abs(speed - motion.mean_speed), place) for place, (other, speed) in enumerate(motions) if other == turns
            and abs(speed - motion.mean_speed) <= settings.same_speed * max(abs(speed), abs(motion.mean_speed))]
    return min(near)[1] if near else None


@dataclass(frozen=True)
class MotionMap:
    """The motions of a design; `share` has the shares of `shares`."""

    design: MapDesign
    table: MotionTable
    share: np.ndarray


def map_in_words(motion_map: MotionMap, visits: list[VisitedCell]) -> list[str]:
    """Return lines of text about the map: numbers of motions, and mean speeds."""
    design, table, share = motion_map.design, motion_map.table, motion_map.share
    histories = design.settings.histories
    cells, counts = np.unique(np.column_stack([table.speed_index, table.gap_index]), axis=0, return_counts=True)
    unsettled = sum(visit.turns == UNSETTLED for visit in visits)
    numbered = np.unique(table.motion[table.motion > PATCHWORK])
    periodic = float(np.mean(table.turns > 0))
    fastest, slowest = int(np.argmax(np.abs(table.mean_speed))), int(np.argmin(np.abs(table.mean_speed)))
    forwards = int(np.sum(table.mean_speed > 0.0))
    place = (f"{design.speeds.values[table.speed_index[fastest]]:g} rad/s, gap "
             f"{design.gaps.values[table.gap_index[fastest]] * 1e3:g} mm")
    if not math.isnan(share[fastest]):
        place += f", {round(share[fastest] * histories)} of {histories} random starts"
    tried = _fastest(motion_map, share)[~np.isnan(_fastest(motion_map, share))]
    return [
        f"{len(cells)} of {design.speeds.count * design.gaps.count} cells have a motion, "
        f"{np.sum(counts > 1)} have more than one; {unsettled} of {len(visits)} visits did not settle",
        f"the fastest of several motions has most of {histories} random starts in {np.sum(tried > 0.5)} cells, and "
        f"none of them in {np.sum(tried == 0.0)}",
        f"{len(numbered)} motions of neighbouring cells; {periodic:.0%} of what was found repeats itself within 8 "
        "turns",
        f"mean speeds from {table.mean_speed[slowest] * 1e3:.1f} to {table.mean_speed[fastest] * 1e3:.1f} mm/s "
        f"({place}); {forwards} go forwards",
    ]


WIDTH, HEIGHT = 9.6, 11.4  # in
_PERIODS = (("#dddddd", "none up to 8"), (figures.BLUE, "1"), (figures.SKY, "2"),
            (figures.GREEN, "3"), (figures.YELLOW, "4"), (figures.ORANGE, "5 to 8"))


@figures.default_settings()
def draw_map(motion_map: MotionMap) -> bytes:
    """Draw mean speed, share of the starts and period over motor speed and gap; returns a PNG file."""
    figure = figures.new_figure(WIDTH, HEIGHT)
    upper, middle, lower = figure.subplots(3, 1, sharex=True, sharey=True)
    speeds, gaps = motion_map.design.speeds.values, 1e3 * motion_map.design.gaps.values
    histories, turns = motion_map.design.settings.histories, motion_map.table.turns
    figures.draw_cells(upper, speeds, gaps, _fastest(motion_map, motion_map.table.mean_speed * 1e3),
               "fastest mean speed [mm/s]")
    figures.draw_cells(middle, speeds, gaps, _fastest(motion_map, motion_map.share * 100.0),
               f"share of {histories} random starts [%]", "magma", (0.0, 100.0))
    mesh = figures.draw_classes(lower, speeds, gaps, _fastest(motion_map, np.where(turns > 4, 5, turns).astype(float)),
                        [colour for colour, _ in _PERIODS])
    bar = figure.colorbar(mesh, ax=lower, pad=0.01, ticks=range(len(_PERIODS)), label="period [turns]")
    bar.ax.set_yticklabels([words for _, words in _PERIODS])
    for axes in (upper, middle, lower):
        axes.set(ylabel="gap [mm]", facecolor="white")
    sides = "both plates" if len(motion_map.design.sides) > 1 else f"the {motion_map.design.sides[0]} plate"
    upper.set_title(f"{motion_map.design.scene.name}: motions over motor speed and gap of {sides}", wrap=True)
    middle.set_title("cells with more than one motion: random starts that lead to the fastest", fontsize="medium")
    lower.set_xlabel("motor speed [rad/s]")
    return figures.png(figure)


def _fastest(motion_map: MotionMap, values: np.ndarray) -> np.ndarray:
    """Value of the fastest motion of each cell, forwards or backwards, shape (gaps, speeds); NaN without a motion."""
    order = np.argsort(np.abs(motion_map.table.mean_speed), kind="stable")
    cells = np.full((motion_map.design.gaps.count, motion_map.design.speeds.count), np.nan)
    cells[motion_map.table.gap_index[order], motion_map.table.speed_index[order]] = values[order]
    return cells


TABLE, PICTURE = "motions.parquet", "map.png"


def _results(design: MapDesign, folder: Path, execution: Execution) -> Iterator[Results]:
    visits = visits_of(design, folder / LINES, execution)
    table, rows = motions(visits, tolerance_of(design.scene), design.settings)
    if not rows:
        raise RuntimeError("no visit has settled, so that there is no map; give another scene or other speeds")
    motion_map = MotionMap(design, table, shares(design, table, execution))
    yield Results({TABLE: _table(motion_map, rows), PICTURE: draw_map(motion_map)}, map_in_words(motion_map, visits))


def _table(motion_map: MotionMap, rows: list[VisitedCell]) -> bytes:
    """Return a Parquet file of all motions, with motor speeds and gaps in place of indices."""
    table, speeds, gaps = motion_map.table, motion_map.design.speeds, motion_map.design.gaps
    columns = {"motor_speed": (speeds.values[table.speed_index], "rad/s"), "gap": (gaps.values[table.gap_index], "m"),
               "motion": (table.motion, "1"), "turns": ([visit.turns for visit in rows], "1"),
               "landings": ([visit.landings for visit in rows], "1"), "mean_speed": (table.mean_speed, "m/s"),
               "cost_of_transport": (table.cost_of_transport, "1"), "stick_share": (table.stick_share, "1"),
               "air_share": (table.air_share, "1"), "share_of_starts": (motion_map.share, "1")}
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


main = StudyCommand(
    "map", "Find the motions of a machine at each motor speed and gap: rows and columns of a grid are swept up and "
    "down, each cell beginning with the state of the one before, so that motions that exist together are found. "
    "Writes the motions as Parquet, and a picture.", _add_options, design_of, _results,
    failure="the disk is full, or nothing settles")
