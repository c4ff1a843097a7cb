"""``study diagram``: the states once a turn over a parameter, swept up and down, with periods and Lyapunov exponents.

A *visit* is the motion at one value in one direction. It begins with the last state of the visit before. So a motion is
followed as long as it is stable, and the value at which it is lost depends on the direction: this is hysteresis. Visits
depend on each other, and one process computes them (`visit_table`). Several processes compute the exponents, which are
independent (`period_table`).
"""

import argparse
import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa

from vibro_lab.orbits.chaos import LEAST_TURNS, sign_of, spectrum_of_cycle, spectrum_until_known
from vibro_lab.orbits.chaos import MOST_TURNS as MOST_MEASURED
from vibro_lab.orbits.recurrence import CLOUD, FIRST_TURNS, LONGEST_PERIOD, WATCHED, SettledMotion, settle, tolerance_of
from vibro_lab.orbits.turn_map import (
    TURN,
    Stroboscope,
    TurnMap,
    crank_speed,
    free_cut,
    has_sampled_controller,
    state_names,
    units_of,
    whole_number,
)
from vibro_lab.study import figures
from vibro_lab.study.command import Results, StudyCommand, machine_of
from vibro_lab.study.execution import Execution, Rows
from vibro_lab.study.table import Field, Study, computed, file_of, parameter_field, read_block, stored
from vibro_lab.study.variation import Axis, at_the_edge, ends_at, varied_in_words
from vibro_ros import PARAMETERS, STATE_UNITS, Parser, Scene

UP, DOWN = "up", "down"
#: Largest value of `--most-turns`.
MOST_SETTLING = 1_000_000
_BLOCK = 8  # visits of a block: the most that an interruption loses


@dataclass(frozen=True)
class DiagramDesign:
    """A checked design of a diagram."""

    scene: Scene  # scene whose parameter is varied, and whose start is used at the first value
    axis: Axis  # the parameter and its values, ascending
    phase: float  # crank angle [rad] of the cut, at which states are recorded
    coordinate: str  # coordinate of the state that the picture shows
    most_turns: int  # largest number of turns of the crank in which a motion may settle
    exponents: int  # turns over which Lyapunov exponents are measured; 0 for no exponents

    def __post_init__(self) -> None:
        whole_number("--most-turns", self.most_turns, FIRST_TURNS, MOST_SETTLING)
        if self.exponents:
            whole_number("--exponents (0: none)", self.exponents, LEAST_TURNS, MOST_MEASURED)
        for value in self.axis.values:
            try:
                scene = self.scene_at(value)
            except ValueError as error:
                raise ValueError(f"--vary {self.axis.name}: at {value:g} there is no scene ({error})") from error
            crank_speed(scene)  # refuses a crank that stands
            if self.exponents and has_sampled_controller(scene):
                raise ValueError(f"--exponents {self.exponents}: motor.control {scene['motor.control']} takes samples, "
                                 "with which the turns are not in step, so that the map of a turn has no derivative; "
                                 "give --exponents 0")
            if state_names(scene) != self.names:
                raise ValueError(f"--vary {self.axis.name}: at {value:g} the state has other coordinates than at "
                                 f"{self.axis.values[0]:g}; leave that value out")
        if self.coordinate not in self.names:
            raise ValueError(f"--coordinate {self.coordinate}: is none of the state; choose one of "
                             f"{', '.join(self.names)}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the state's coordinates, fields of `Samples`."""
        return state_names(self.scene_at(self.axis.values[0]))

    @property
    def visits(self) -> int:
        """Number of visits: each value upwards and downwards."""
        return 2 * len(self.axis.values)

    def direction(self, visit: int) -> str:
        """Direction of a visit, `UP` or `DOWN`."""
        return UP if visit < len(self.axis.values) else DOWN

    def index(self, visit: int) -> int:
        """Index of a visit's value among the values."""
        return min(visit, self.visits - 1 - visit)

    def value(self, visit: int) -> float:
        """Value of a visit, in the parameter's unit."""
        return float(self.axis.values[self.index(visit)])

    def scene_at(self, value: object) -> Scene:
        """Return the scene at a value of the parameter (ValueError if the scene refuses it)."""
        return self.scene.with_parameters({self.axis.name: value})

    def document(self) -> dict[str, object]:
        """Everything that determines the results, for JSON."""
        fixed = {name: value for name, value in self.scene.parameters.items() if name != self.axis.name}
        return {"scene": self.scene.name, "set": fixed, "vary": {self.axis.name: self.axis.document()},
                "phase": self.phase, "coordinate": self.coordinate, "most_turns": self.most_turns,
                "exponents": self.exponents}


@dataclass(frozen=True)
class VisitedValue:
    """The motion at a value in one direction."""

    number: int  # number of the visit
    motion: SettledMotion  # the motion, with states in units of the machine
    settled: bool  # false for a motion that still changes; its states are the last `CLOUD`
    states: np.ndarray  # shape (m, n): the same states in SI units


def visit_table(design: DiagramDesign, folder: Path) -> tuple[pa.Table, tuple[VisitedValue, ...]]:
    """Return the table of all states, and all visits; blocks that are missing in the folder are computed."""
    fields = [
        Field("visit", pa.int64(), "1", "number of the visit"),
        Field("direction", pa.string(), "1", "whether the values went up or down"),
        parameter_field(design.axis.name),
        Field("period", pa.int64(), "1", "turns of the crank after which the motion repeats itself; 0: none up "
              f"to {LONGEST_PERIOD}"),
        Field("settled", pa.bool_(), "1", "false: the motion still changes"),
        Field("after", pa.int64(), "1", "turns that the motion was watched for"),
        Field("mean_speed", pa.float64(), "m/s", "of the body, forwards positive"),
        Field("cut", pa.int64(), "1", "number of the turn"),
        *(Field(name, pa.float64(), STATE_UNITS[name], f"at the crank angle {design.phase:.17g}")
          for name in design.names)]

    def visits(numbers: Iterable[int]) -> Rows:
        visit: VisitedValue | None = None
        for number in numbers:
            if number and (visit is None or visit.number != number - 1):  # the block before was computed earlier
                block = cast(pa.Table, read_block(study, folder, number // _BLOCK - 1))
                visit = _visits_in(design, block)[-1]
            visit = _visit(design, number, visit.states[-1] if visit else None)
            yield _rows_of(design, visit)

    study = Study("values", design.document(), fields, lambda number: [], 0.0, design.visits, _BLOCK)
    blocks = {block: study.points(block) for block in range(study.blocks)}
    tables = stored(study, folder, blocks, visits)
    table = pa.concat_tables([tables[block] for block in blocks])
    return table, tuple(_visits_in(design, table))


def _visit(design: DiagramDesign, number: int, begin_state: np.ndarray | None) -> VisitedValue:
    """Compute a visit from the last state of the visit before, SI units, shape (n,); None is the scene's own start."""
    turn_map = TurnMap(design.scene_at(design.value(number)), design.phase)
    stroboscope = Stroboscope(turn_map)
    if begin_state is None:
        stroboscope.begin_as()
    else:
        stroboscope.begin(_within_plates(turn_map, begin_state) / turn_map.units)
    motion = settle(stroboscope, FIRST_TURNS, design.most_turns)
    settled = motion is not None
    if motion is None:
        cuts = stroboscope.turns(CLOUD)
        speed = float((cuts.positions[-1] - cuts.positions[0]) / (cuts.times[-1] - cuts.times[0]))
        motion = SettledMotion(0, cuts.states, speed, design.most_turns + CLOUD, tolerance_of(turn_map.scene))
    return VisitedValue(number, motion, settled, motion.states * turn_map.units)


def _within_plates(turn_map: TurnMap, state: np.ndarray) -> np.ndarray:
    """Return the state, moving each mass that lies inside its rigid plate at the new value onto the plate."""
    scene, moved = turn_map.scene, state.copy()
    for side in scene.plates:
        if scene[f"effects.{side}_contact"] == "restitution":
            k = turn_map.names.index(f"{side}_position")
            moved[k] = min(moved[k], scene[f"crank.{side}_rod"] + scene[f"{side}.gap"])
    return moved


def _rows_of(design: DiagramDesign, visit: VisitedValue) -> list[dict]:
    """Return the rows of a visit, one for each state."""
    cells = {"visit": visit.number, "direction": design.direction(visit.number),
             design.axis.name: design.value(visit.number), "period": visit.motion.turns, "settled": visit.settled,
             "after": visit.motion.after, "mean_speed": visit.motion.mean_speed}
    return [{**cells, "cut": cut, **dict(zip(design.names, state, strict=True))}
            for cut, state in enumerate(visit.states.tolist())]


def _visits_in(design: DiagramDesign, table: pa.Table) -> list[VisitedValue]:
    """Return the visits whose states a table contains."""
    columns = {name: table[name].to_numpy() for name in ("visit", "period", "settled", "after", "mean_speed",
                                                         *design.names)}
    visits = []
    for number in dict.fromkeys(columns["visit"].tolist()):
        rows = np.flatnonzero(columns["visit"] == number)
        states, first = np.column_stack([columns[name][rows] for name in design.names]), rows[0]
        scene = design.scene_at(design.value(number))
        motion = SettledMotion(int(columns["period"][first]), states / units_of(scene),
                               float(columns["mean_speed"][first]), int(columns["after"][first]), tolerance_of(scene))
        visits.append(VisitedValue(number, motion, bool(columns["settled"][first]), states))
    return visits


def exponents_of(design: DiagramDesign, settled: tuple[tuple[int, np.ndarray], ...], number: int) -> list[dict]:
    """Compute all Lyapunov exponents of a visit by its number, and return its row.

    `settled` has for each visit its period [turns], or 0, and its last state in SI units.
    """
    turn_map = TurnMap(design.scene_at(design.value(number)), design.phase)
    turns, state = settled[number][0], settled[number][1] / turn_map.units
    if turns:
        stroboscope = Stroboscope(turn_map)
        stroboscope.begin(state)
        spectrum = spectrum_of_cycle(turn_map, stroboscope.turns(turns).states)
    else:
        spectrum = spectrum_until_known(turn_map, state, design.exponents)
        turns = 0 if spectrum.spread.any() else spectrum.turns
    return [{"visit": number, "period": turns,
             **{f"exponent_{k}": exponent for k, exponent in enumerate(spectrum.exponents.tolist(), 1)},
             **{f"spread_{k}": spread for k, spread in enumerate(spectrum.spread.tolist(), 1)}}]


def period_table(design: DiagramDesign, visits: Sequence[VisitedValue], folder: Path, execution: Execution) -> pa.Table:
    """Table of periods and exponents, a row for each visit; blocks that are missing in the folder are computed."""
    numbers = range(1, len(design.names) + 1)
    fields = [
        Field("visit", pa.int64(), "1", "number of the visit"),
        Field("period", pa.int64(), "1", "turns after which the motion repeats itself, also many; 0: none found"),
        *(Field(f"exponent_{k}", pa.float64(), "1/s", "Lyapunov exponent; -inf: the direction is gone within a turn")
          for k in numbers),
        *(Field(f"spread_{k}", pa.float64(), "1/s", "half the width of the exponent's 95 % interval; 0 for a periodic "
                "motion") for k in numbers)]
    run_time = 300.0 * design.exponents * 0.06  # s, about: a derivative takes some fifteen restarted turns
    settled = tuple((visit.motion.turns, visit.states[-1]) for visit in visits)
    return computed(Study(
        "motions measured", design.document(), fields, partial(exponents_of, design, settled),
        run_time, design.visits, _BLOCK), folder, execution)


@dataclass(frozen=True)
class Diagram:
    """Results of a diagram."""

    design: DiagramDesign  # the design
    visits: tuple[VisitedValue, ...]  # all visits, in the order of their numbers
    exponents: pa.Table | None  # table of `period_table`; None if no exponents were measured

    def of(self, direction: str) -> tuple[VisitedValue, ...]:
        """Visits of a direction, in ascending order of the values."""
        count = len(self.design.axis.values)
        return self.visits[:count] if direction == UP else self.visits[:count - 1:-1]

    def value_of(self, column: str, visit: int) -> float:
        """Value in a column of `exponents` for the visit of a number; NaN if no exponents were measured."""
        return float(self.exponents[column][visit].as_py()) if self.exponents is not None else float("nan")

    def period(self, visit: VisitedValue) -> int:
        """Period of a motion [turns], which may be longer than `LONGEST_PERIOD`; 0 if none was found."""
        return visit.motion.turns if self.exponents is None else int(self.value_of("period", visit.number))

    def sign(self, visit: VisitedValue) -> int | None:
        """Sign of a visit's largest exponent, 0 if it is not known; None if no exponents were measured."""
        exponent = self.value_of("exponent_1", visit.number)
        return None if math.isnan(exponent) else sign_of(exponent, self.value_of("spread_1", visit.number))

    def has_two_motions(self) -> list[bool]:
        """Whether the motions that were found upwards and downwards are settled and different, for each value."""
        return [up.settled and down.settled and not up.motion.is_same(down.motion)
                for up, down in zip(self.of(UP), self.of(DOWN), strict=True)]

    def kind(self, visit: VisitedValue) -> str:
        """Description of a motion's period in words."""
        turns = self.period(visit)
        if not (visit.settled or turns):
            return "not settled"
        watched = LONGEST_PERIOD if self.exponents is None else WATCHED // 4
        return f"no period to {watched}" if not turns else "every turn" if turns == 1 else f"every {turns} turns"

    def hysteresis(self) -> list[list[int]]:
        """Regions of hysteresis: runs of indices of values at which the two directions found different motions."""
        two_motions = self.has_two_motions()
        return [list(indices) for is_two, indices in itertools.groupby(range(len(two_motions)), two_motions.__getitem__)
                if is_two]

    def ranges(self) -> list[list[VisitedValue]]:
        """Runs of visits at neighbouring values with equal direction, period and number of motions."""
        two_motions, runs = self.has_two_motions(), []
        for direction in (UP, DOWN):
            rows = zip(self.of(direction), two_motions, strict=True)
            for _, run in itertools.groupby(rows, lambda row: (self.kind(row[0]), row[1])):
                runs.append([visit for visit, _ in run])
        return runs


def values_table(diagram: Diagram, states: pa.Table) -> bytes:
    """Return a Parquet file with one row for each visit, from the table of all states."""
    design, two_motions, measured = diagram.design, diagram.has_two_motions(), diagram.exponents
    _, first = np.unique(states["visit"].to_numpy(), return_index=True)
    table = states.drop_columns(["cut", *design.names]).take(first)
    table = table.append_column("two_motions", pa.array(
        [two_motions[design.index(number)] for number in range(design.visits)]))
    if measured is not None:
        table = table.set_column(table.column_names.index("period"), "period", measured["period"])
        for name in measured.column_names[2:]:
            table = table.append_column(name, measured[name])
    return file_of(table)


_MOST_RANGES = 40  # rows of the printed table; the files contain all


def in_words(diagram: Diagram) -> Iterator[str]:
    """Yield the results as lines of text: a table of ranges, the regions of hysteresis, and what remains unknown."""
    design, name = diagram.design, diagram.design.axis.name
    unit = PARAMETERS[name].unit
    yield from _table_of_ranges(diagram)
    regions = diagram.hysteresis()
    for indices in regions:
        where = _between([float(design.axis.values[index]) for index in indices], ".6g")
        yield f"hysteresis: {where} {unit}".rstrip() + f" ({len(indices)} value{'s' * (len(indices) > 1)})"
    if not regions:
        yield f"hysteresis: none at the {len(design.axis.values)} values; both ways lead to the same motions"
    unknown = dict.fromkeys(f"{design.value(visit.number):.6g}" for visit in diagram.visits if diagram.sign(visit) == 0)
    if unknown:
        yield (f"sign of the largest exponent not known, 0 lies within its interval: at {', '.join(unknown)}"
               f"{f' {unit}' if unit else ''}")
    fastest = max(diagram.visits, key=lambda visit: abs(visit.motion.mean_speed))
    if edge := at_the_edge("the largest mean speed", ends_at({name: design.axis.values}, design.index(fastest.number))):
        yield edge
    if unsettled := sum(not visit.settled for visit in diagram.visits):
        yield (f"not settled: {unsettled} of {design.visits} visits within {design.most_turns} turns, of which nothing "
               "is said about hysteresis; give more --most-turns, or dampers")


def _table_of_ranges(diagram: Diagram) -> Iterator[str]:
    """Yield the lines of a table with period, mean speed and exponent of each range."""
    design, ranges = diagram.design, diagram.ranges()
    yield (f"{'':5} {figures.of_parameter(design.axis.name):>24}  {'repeats itself':17} {'mean speed [mm/s]':>18} "
           f"{'largest exponent [1/s]':>30}")
    for visits in ranges[:_MOST_RANGES]:
        numbers = [visit.number for visit in visits]
        where = _between([design.value(number) for number in numbers], ".6g")
        speeds = _between([1e3 * visit.motion.mean_speed for visit in visits], ".2f")
        exponents = _exponents(diagram, numbers)
        yield (f"{design.direction(numbers[0]):5} {where:>24}  {diagram.kind(visits[0]):17} {speeds:>18} "
               f"{exponents:>30}").rstrip()
    if len(ranges) > _MOST_RANGES:
        yield f"and {len(ranges) - _MOST_RANGES} ranges more; the files hold all"


def _exponents(diagram: Diagram, numbers: Sequence[int]) -> str:
    """Text of the least and the largest exponent of some visits; for a single visit with its interval."""
    values, spreads = ([diagram.value_of(column, number) for number in numbers]
                       for column in ("exponent_1", "spread_1"))
    if len(numbers) == 1 and spreads[0] > 0.0:
        return f"{values[0]:.2f} ± {spreads[0]:.2g}" + ", sign not known" * (not sign_of(values[0], spreads[0]))
    return _between(values, ".2f")


def _between(values: Sequence[float], form: str) -> str:
    """Text of the least and the largest of the finite values; empty if there are none."""
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return ""
    low, high = f"{min(finite):{form}}", f"{max(finite):{form}}"
    return low if low == high else f"{low} to {high}"


# Where both directions found the same motion, the dot of the downward visit lies within the ring of the upward one.
_COLOURS = {UP: figures.BLUE, DOWN: figures.VERMILION}
_MARKS: dict[str, dict[str, Any]] = {
    UP: {"marker": "o", "markerfacecolor": "none", "markeredgewidth": 0.8},
    DOWN: {"marker": ".", "markeredgewidth": 0.0}}
_HYSTERESIS_COLOUR = "#e4e4e4"
_FAINT = 0.3  # opacity of the many states of a motion without a period
_WIDTH, _STATES_HEIGHT, _PANEL_HEIGHT = 9.0, 3.8, 1.8  # in
_SMALLEST_MARK, _LARGEST_MARK, _ALL_MARKS = 2.0, 5.0, 450.0  # pt: a mark has its share of the last, within the limits


@figures.default_settings()
def draw_diagram(diagram: Diagram) -> bytes:
    """Draw a diagram; returns a PNG file."""
    design = diagram.design
    panels = [_draw_states, _draw_speed] + [_draw_exponents] * bool(design.exponents)
    heights = [_STATES_HEIGHT, *[_PANEL_HEIGHT] * (len(panels) - 1)]
    figure = figures.new_figure(_WIDTH, sum(heights), 100)
    rows = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    for axes, draw in zip(rows, panels, strict=True):
        draw(axes, diagram)
        _shade(axes, diagram)
        figures.style_axes(axes)
    rows[-1].set_xlabel(figures.of_parameter(design.axis.name))
    figures.set_heading(figure, f"{design.scene.name}: once a turn, at the crank angle {design.phase:.3f} rad; "
                f"{len(design.axis.values)} values up and down")
    return figures.png(figure)


def _draw_states(axes: figures.Axes, diagram: Diagram) -> None:
    design = diagram.design
    column, size = design.names.index(design.coordinate), _mark_size(diagram)
    for direction in (UP, DOWN):
        for is_periodic, opacity in ((False, _FAINT), (True, 1.0)):
            visits = [visit for visit in diagram.of(direction) if bool(visit.motion.turns) == is_periodic]
            values = [design.value(visit.number) for visit in visits for _ in visit.states]
            states = [1e3 * state for visit in visits for state in visit.states[:, column]]
            share = 1.0 if is_periodic and direction == UP else 0.8
            axes.plot(values, states, linestyle="none", ms=share * size, alpha=opacity, color=_COLOURS[direction],
                      **_MARKS[direction if is_periodic else DOWN])
        axes.plot([], [], linestyle="none", ms=6, label=f"{direction}wards", color=_COLOURS[direction],
                  **_MARKS[direction])
    axes.set_ylabel(f"{design.coordinate.replace('_', ' ')} [m{STATE_UNITS[design.coordinate]}]")
    axes.legend(fontsize=9, frameon=False, ncols=2, loc="best")


def _mark_size(diagram: Diagram) -> float:
    return min(_LARGEST_MARK, max(_SMALLEST_MARK, _ALL_MARKS / len(diagram.design.axis.values)))


def _draw_speed(axes: figures.Axes, diagram: Diagram) -> None:
    for direction in (UP, DOWN):
        speeds = np.array([visit.motion.mean_speed for visit in diagram.of(direction)])
        _draw_line(axes, diagram, direction, 1e3 * speeds)
    axes.set_ylabel("mean speed [mm/s]")


def _draw_exponents(axes: figures.Axes, diagram: Diagram) -> None:
    """Draw the largest exponent with its interval, and the second one as a thin line."""
    for direction in (UP, DOWN):
        rows = np.array([[diagram.value_of(column, visit.number) for visit in diagram.of(direction)]
                         for column in ("exponent_1", "exponent_2", "spread_1")])
        largest, second, spreads = np.where(np.isfinite(rows), rows, np.nan)
        _draw_line(axes, diagram, direction, largest)
        _draw_line(axes, diagram, direction, second, 0.4)
        axes.errorbar(diagram.design.axis.values, largest, yerr=spreads, fmt="none", lw=0.8, color=_COLOURS[direction])
    axes.axhline(0.0, color="black", lw=0.8)
    axes.set_ylabel("two largest exponents\n[1/s]")


def _draw_line(axes: figures.Axes, diagram: Diagram, direction: str, values: np.ndarray, share: float = 1.0) -> None:
    size, opacity = share * _mark_size(diagram), 0.4 + 0.6 * share
    axes.plot(diagram.design.axis.values, values, ms=size, lw=0.8 * share, alpha=opacity,
              color=_COLOURS[direction], **_MARKS[direction])


def _shade(axes: figures.Axes, diagram: Diagram) -> None:
    """Shade regions of hysteresis grey, up to halfway to the neighbouring values."""
    values = np.array(diagram.design.axis.values, dtype=float)
    middles = np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1]), values[-1:]])
    for indices in diagram.hysteresis():
        axes.axvspan(middles[indices[0]], middles[indices[-1] + 1], color=_HYSTERESIS_COLOUR, zorder=0, lw=0.0)


VISITS, EXPONENTS = "visits", "exponents"
STATES, VALUES, PICTURE = "states.parquet", "values.parquet", "diagram.png"
_VARY, _COUNT, _QUICK_COUNT = "motor.speed=60:240", 181, 31
_MOST_TURNS, _EXPONENTS = 4096, 100


def _results(design: DiagramDesign, folder: Path, execution: Execution) -> Iterator[Results]:
    states, visits = visit_table(design, folder / VISITS)
    periods = period_table(design, visits, folder / EXPONENTS, execution) if design.exponents else None
    diagram = Diagram(design, visits, periods)
    yield Results({STATES: file_of(states), VALUES: values_table(diagram, states),
                   PICTURE: draw_diagram(diagram)}, in_words(diagram))


def _axis(options: argparse.Namespace) -> Axis:
    """Return the varied parameter and its values, ascending."""
    default = f"{_VARY}:{_QUICK_COUNT if options.quick else _COUNT}"
    axis = varied_in_words(options.vary or default)
    if not isinstance(axis, Axis):
        raise ValueError(f"--vary {options.vary}: a range needs a count here; give NAME=LOW:HIGH:COUNT")
    if axis.name.startswith(("start.", "solver.")):
        raise ValueError(f"--vary {axis.name}: is no part of the machine, whose motions would stay the same; choose "
                         "another")
    if not isinstance(PARAMETERS[axis.name].default, float):
        raise ValueError(f"--vary {axis.name}: is {PARAMETERS[axis.name].type_name}; choose a number, which can go up "
                         "and down")
    if len(axis.values) < 2:
        raise ValueError(f"--vary {options.vary}: one value goes neither up nor down; give at least 2")
    return Axis(axis.name, tuple(sorted(axis.values)))


def _design(options: argparse.Namespace) -> DiagramDesign:
    """Make the design from the options; unless `--phase` is given, the cut is chosen at the first value."""
    scene, axis = machine_of(options), _axis(options)
    first = scene.with_parameters({axis.name: axis.values[0]})
    if options.phase is None:
        phase = float(free_cut(first).phase)
    elif 0.0 <= options.phase < TURN:
        phase = options.phase
    else:
        raise ValueError(f"--phase: {options.phase:g} is out of range; give a number from 0 to 6.28318 rad")
    names = state_names(first)
    if not names:
        raise ValueError(f"{scene.name}: has no mass whose motion could be shown; give one with effects.upper_mass")
    coordinate = options.coordinate or names[-1 if len(names) < 4 else 3]
    return DiagramDesign(scene, axis, phase, coordinate, options.most_turns, options.exponents)


def _add_options(parser: Parser) -> None:
    parser.add_argument("--vary", metavar="NAME=VALUES", help="LOW:HIGH:COUNT, a grid; A,B,C, a list; `:log` behind a "
                        f"grid spreads it by its logarithm (default: {_VARY}:{_COUNT})")
    parser.add_argument("--coordinate", metavar="NAME", help="of the state, in the picture (default: "
                        "inclined_velocity, or the last there is)")
    parser.add_argument("--phase", type=float, metavar="RAD", help="crank angle at which the states are seen (default: "
                        "where nothing touches at the first value)")
    parser.add_argument("--most-turns", type=int, default=_MOST_TURNS, metavar="N", help="turns of the crank that a "
                        "motion has to settle (default: %(default)d)")
    parser.add_argument("--exponents", type=int, default=_EXPONENTS, metavar="TURNS", help="turns over which the "
                        "exponents of a motion that is not periodic are measured, up to 16 times as many until the "
                        "sign of the largest is known; 0: no exponents (default: %(default)d)")
    parser.add_argument("--quick", action="store_true", help=f"{_QUICK_COUNT} values, where these are not given")


main = StudyCommand(
    "diagram", "Sweep a parameter up and down, each value beginning where the one before has ended; show the states "
    "once a turn, where the two ways lead to two motions, and all Lyapunov exponents. Writes two Parquet files and a "
    "picture.", _add_options, _design, _results)
