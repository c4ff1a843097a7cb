"""``study map``: the motions of a machine over motor speed and gap, as Parquet and a picture.

Each row and column of the grid is swept up and down (`visits`). Each cell begins with the last state of the cell
before, so that coexisting motions are found (`motions`): two visits of one cell have the same motion by the rule of
`SettledMotion.is_same`. Random starts tell which share of them leads to each motion of a cell with several (`shares`).
"""

import argparse
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, replace
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
from vibro_lab.study.table import NUMBERS, Field, Study, computed, file_of, table_of
from vibro_lab.study.variation import limits_in_words
from vibro_ros import Parser, Scene, SimulationError, Simulator

SPEED, GAP = "motor_speed", "gap"
SIDES = ("upper", "inclined")
"""Sides whose gaps a map may vary."""
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
    # Longest period [turns] that characterises a motion. A longer one counts as none, because a small change of the
    # commands destroys it, and visits that settle slowly do not find it reliably.
    longest_period: int = 8
    # Random starts of each cell with several motions: their shares are known to an eighth.
    histories: int = 8


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
    # Shape (m, n): states at successive cuts, in units of the machine: one period, or the last `KEPT_STATES`; empty
    # if none was found.
    states: np.ndarray

    def period(self, longest: int) -> int:
        """Period [turns of the crank]; one of more than `longest` turns counts as none, which is 0."""
        return self.turns if self.turns <= longest else 0

    def settled(self, tolerance: float, longest: int) -> SettledMotion:
        """Return the motion for comparison within the cell."""
        return SettledMotion(self.period(longest), self.states, self.mean_speed, self.turns, tolerance)


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
            visited.append(VisitedCell(speed_index, gap_index, motion.turns, *quantities, motion.kept_states()))
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
    observation = observed(device, (WORK, REST), Window(0.0, period, turns, turns * period))
    landings = round(float(np.sum(observation.events["kind"] == "landing")) * motion.turns / turns)
    speed, cost, standing, airborne = (MEASURES[name].value(observation) for name in (
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
    return [{**visit._asdict(), "states": visit.states.ravel()} for visit in visits(design, design.lines()[number])]


def motions(visits: Iterable[VisitedCell], tolerance: float = SAME, settings: MapSettings = MapSettings()
            ) -> list[VisitedCell]:
    """Return a visit for each distinct motion of each cell, cell by cell, and within a cell by mean speed."""
    in_cell: dict[tuple[int, int], list[VisitedCell]] = defaultdict(list)
    for visit in visits:
        cell = in_cell[visit.speed_index, visit.gap_index]
        if visit.turns != UNSETTLED and number_among(visit.settled(tolerance, settings.longest_period), [
                known.settled(tolerance, settings.longest_period) for known in cell]) is None:
            cell.append(visit)
    return [visit for _, cell in sorted(in_cell.items()) for visit in sorted(cell, key=lambda visit: visit.mean_speed)]


_LONGEST_SETTLING = 40.0  # simulated time [s] of a start, about


def shares(design: MapDesign, distinct: Sequence[VisitedCell], execution: Execution) -> np.ndarray:
    """Share of `histories` random starts that lead to each of `motions`, shape (motions,); NaN for the only one of its
    cell.

    The shares of a cell's motions add up to less than 1 if a start leads to a motion that no sweep has found.
    """
    in_cell: dict[tuple[int, int], list[int]] = defaultdict(list)
    for number, visit in enumerate(distinct):
        in_cell[visit.speed_index, visit.gap_index].append(number)
    several = [numbers for numbers in in_cell.values() if len(numbers) > 1]
    known = tuple([distinct[number] for number in numbers] for numbers in several)
    histories, share = design.settings.histories, np.full(len(distinct), math.nan)
    with Progress("random starts of cells with several motions", "cell", len(known)) as progress, closing(
            execution.rows(partial(_led, design, known), range(len(known)), histories * _LONGEST_SETTLING)) as results:
        for numbers, counts in zip(several, results, strict=True):
            share[numbers] = np.array(counts) / histories
            progress.add(1)
    return share


def _led(design: MapDesign, known: Sequence[Sequence[VisitedCell]], number: int) -> list[int]:
    """Number of random starts that lead to each motion of a cell."""
    settings, tolerance, visits_of_cell = design.settings, tolerance_of(design.scene), known[number]
    motions_of_cell = [visit.settled(tolerance, settings.longest_period) for visit in visits_of_cell]
    turn_map = TurnMap(design.scene_at(visits_of_cell[0].speed_index, visits_of_cell[0].gap_index), settings.phase)
    counts = [0] * len(motions_of_cell)
    for start in range(settings.histories):
        stroboscope = Stroboscope(turn_map)
        with suppress(SimulationError):
            stroboscope.begin_with(steady_start(turn_map.scene, start))
            if motion := settle(stroboscope, most=settings.most_turns):
                turns = motion.turns if motion.turns <= settings.longest_period else 0
                index = number_among(replace(motion, turns=turns), motions_of_cell)
                if index is not None:
                    counts[index] += 1
    return counts


@dataclass(frozen=True)
class MotionMap:
    """The motions of a design, from `motions`; `share` has the shares of `shares`."""

    design: MapDesign
    motions: list[VisitedCell]
    share: np.ndarray

    def column(self, name: str) -> np.ndarray:
        """A field of `VisitedCell`, shape (motions,)."""
        return np.array([getattr(motion, name) for motion in self.motions])

    @property
    def periods(self) -> np.ndarray:
        """Period of each motion [turns], shape (motions,); 0 for none up to `longest_period`."""
        return np.array([motion.period(self.design.settings.longest_period) for motion in self.motions])

    def of_fastest(self, values: np.ndarray) -> np.ndarray:
        """Value of the fastest motion of each cell, forwards or backwards, shape (gaps, speeds); NaN without a motion.
        """
        order = np.argsort(np.abs(self.column("mean_speed")), kind="stable")
        cells = np.full((self.design.gaps.count, self.design.speeds.count), np.nan)
        cells[self.column("gap_index")[order], self.column("speed_index")[order]] = values[order]
        return cells


def map_in_words(motion_map: MotionMap, visits: list[VisitedCell]) -> list[str]:
    """Return lines of text about the map: numbers of motions, and mean speeds."""
    design, share, mean_speed = motion_map.design, motion_map.share, motion_map.column("mean_speed")
    histories = design.settings.histories
    cells = Counter((motion.speed_index, motion.gap_index) for motion in motion_map.motions)
    unsettled = sum(visit.turns == UNSETTLED for visit in visits)
    number, slowest = int(np.argmax(np.abs(mean_speed))), float(mean_speed[np.argmin(np.abs(mean_speed))])
    fastest = motion_map.motions[number]
    where = (f"{design.speeds.values[fastest.speed_index]:g} rad/s, gap "
             f"{design.gaps.values[fastest.gap_index] * 1e3:g} mm")
    if not math.isnan(share[number]):
        where += f", {round(share[number] * histories)} of {histories} random starts"
    share_of_fastest = motion_map.of_fastest(share)  # NaN for the only motion of a cell, which is not counted
    return [
        f"{len(cells)} of {design.speeds.count * design.gaps.count} cells have a motion, "
        f"{sum(count > 1 for count in cells.values())} have more than one; {unsettled} of {len(visits)} visits did not "
        "settle",
        f"the fastest of several motions has most of {histories} random starts in {np.sum(share_of_fastest > 0.5)} "
        f"cells, and none of them in {np.sum(share_of_fastest == 0.0)}",
        f"{np.mean(motion_map.periods > 0):.0%} of what was found repeats itself within "
        f"{design.settings.longest_period} turns",
        f"mean speeds from {slowest * 1e3:.1f} to {fastest.mean_speed * 1e3:.1f} mm/s ({where}); "
        f"{np.sum(mean_speed > 0.0)} go forwards",
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
    histories, turns = motion_map.design.settings.histories, motion_map.periods
    figures.draw_cells(upper, speeds, gaps, motion_map.of_fastest(motion_map.column("mean_speed") * 1e3),
                       "fastest mean speed [mm/s]")
    figures.draw_cells(middle, speeds, gaps, motion_map.of_fastest(motion_map.share * 100.0),
                       f"share of {histories} random starts [%]", "magma", (0.0, 100.0))
    mesh = figures.draw_classes(lower, speeds, gaps, motion_map.of_fastest(np.where(turns > 4, 5, turns).astype(float)),
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


TABLE, PICTURE = "motions.parquet", "map.png"


def _results(design: MapDesign, folder: Path, execution: Execution) -> Iterator[Results]:
    visits = visits_of(design, folder / LINES, execution)
    distinct = motions(visits, tolerance_of(design.scene), design.settings)
    if not distinct:
        raise RuntimeError("no visit has settled, so that there is no map; give another scene or other speeds")
    motion_map = MotionMap(design, distinct, shares(design, distinct, execution))
    yield Results({TABLE: motions_table(motion_map), PICTURE: draw_map(motion_map)}, map_in_words(motion_map, visits))


def motions_table(motion_map: MotionMap) -> bytes:
    """Return a Parquet file with a row for each motion."""
    speeds, gaps = motion_map.design.speeds.values, motion_map.design.gaps.values
    fields = [Field("motor_speed", pa.float64(), "rad/s", "of the cell"),
              Field("gap", pa.float64(), "m", "of the cell"),
              *(field for field in _VISIT if field.name not in ("speed_index", "gap_index", "states")),
              Field("share_of_starts", pa.float64(), "1", "of the random starts; NaN for the only motion of a cell")]
    return file_of(table_of([
        {**motion._asdict(), "motor_speed": speeds[motion.speed_index], "gap": gaps[motion.gap_index],
         "share_of_starts": share}
        for motion, share in zip(motion_map.motions, motion_map.share, strict=True)], fields))


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
