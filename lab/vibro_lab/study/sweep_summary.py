"""The summary of a sweep: a row for each point and motion, as CSV, as words and as a picture.

Several motions of a point have no common mean, so each has a row with the means over the starts that lead to it.
"""

import csv
import io
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from vibro_lab.orbits.attractors import Attractor, group_starts
from vibro_lab.orbits.chaos import half_interval, sign_of
from vibro_lab.orbits.recurrence import KEPT_STATES, SettledMotion, tolerance_of
from vibro_lab.study import figures
from vibro_lab.study.measures import DIRECTED, EXPONENT, LYAPUNOV, MEASURES, SPREAD, drift_in
from vibro_lab.study.sweep_design import NO_SCENE, SweepDesign
from vibro_lab.study.variation import Axis, Range, at_the_edge, ends_at
from vibro_ros import PARAMETERS, Value

MOST_LINES = 6
"""Largest number of lines of a panel; further combinations are only in the table."""
_WIDTH, _HEIGHT = 5.2, 3.6  # in, of a panel


class Statistic(NamedTuple):
    """A measure of a motion."""

    mean: float  # over the motion's starts that have a value, in the measure's unit; NaN without any
    # Half of its 95 % interval by Student's distribution, NaN for fewer than two starts. The exponent of a single
    # start, or of starts whose exponents are all equal, has the interval that was measured with it.
    spread: float
    starts: int  # that have a value


class MotionRow(NamedTuple):
    """A motion of a point."""

    point: int
    number: int  # of the motion at this point, from 1; that of most starts first
    attractor: Attractor
    measures: dict[str, Statistic]
    # Mean speed in the second half of the time minus that in the first [m/s], if significant, so that the mean
    # describes a transient; else 0, and for a periodic motion.
    drift: float


@dataclass(frozen=True)
class Summary:
    """Summary of a sweep."""

    design: SweepDesign
    parameters: dict[str, list[Value]]  # values of each varied parameter at all points, in SI units, by name
    motions: list[list[MotionRow]]  # those of each point; none if no run has values
    failed: np.ndarray  # shape (points,): number of runs that could not go on, and of runs whose scene was refused
    refused: np.ndarray
    errors: list[str]  # texts of all runs, without repetition
    warnings: list[str]

    @property
    def rows(self) -> list[MotionRow]:
        """The motions of all points."""
        return [row for rows in self.motions for row in rows]


def summarised(design: SweepDesign, table: pa.Table) -> Summary:
    """Summarise the runs in a sweep's table."""
    starts, errors = max(design.starts, 1), table["error"].to_pylist()
    columns = {name: table[name].to_numpy() for name in (*design.measures, "drift")}
    turns, states = table["turns"].to_pylist(), table["states"].to_pylist()
    motions = list[list[MotionRow]]()
    for point, first in enumerate(range(0, design.rows, starts)):
        runs = np.array([run for run in range(first, first + starts) if errors[run] is None], dtype=int)
        motions.append([])
        if not len(runs):
            continue
        tolerance = tolerance_of(design.scene.with_parameters(design.changes(point)))
        speeds = columns["mean_speed"][runs] if "mean_speed" in columns else np.full(len(runs), np.nan)
        settled = [None if turns[run] is None else SettledMotion(
            turns[run], np.array(states[run]).reshape(turns[run] or KEPT_STATES, -1), float(speed), 0, tolerance)
            for run, speed in zip(runs, speeds, strict=True)]
        attractors, indices = group_starts(settled, speeds.tolist())
        for index, attractor in enumerate(attractors):
            of_motion = runs[indices == index]
            drift = 0.0 if attractor.turns else drift_in(columns["drift"][of_motion], attractor.mean_speed)
            measures = _statistics({name: columns[name][of_motion] for name in design.measures})
            motions[-1].append(MotionRow(point, index + 1, attractor, measures, drift))
    is_refused = np.array([str(error).startswith(NO_SCENE) for error in errors]).reshape(-1, starts)
    has_error = np.array([error is not None for error in errors]).reshape(-1, starts)
    parameters = {name: table[name].to_pylist()[::starts] for name in design.names}
    return Summary(design, parameters, motions, (has_error & ~is_refused).sum(axis=1), is_refused.sum(axis=1),
                   _each_once(errors), _each_once(table["warning"].to_pylist()))


def _statistics(columns: dict[str, np.ndarray]) -> dict[str, Statistic]:
    """Statistics of each measure from its values at the starts of a motion."""
    statistics = dict[str, Statistic]()
    for name, column in columns.items():
        values = column[~np.isnan(column)]
        mean = float(values.mean()) if len(values) else math.nan
        statistics[name] = Statistic(mean, float(half_interval(values)), len(values))
    exponent = statistics.get(EXPONENT)
    if exponent and (exponent.starts == 1 or exponent.spread == 0.0):
        statistics[EXPONENT] = exponent._replace(spread=statistics[SPREAD].mean)
    return statistics


def _each_once(texts: Sequence[str | None]) -> list[str]:
    return list(dict.fromkeys(text for text in texts if text is not None))


def as_csv(summary: Summary) -> str:
    """Return the summary as CSV: a row for each point and motion, one for a point without values; units in the head."""
    names, measures, text = summary.design.names, summary.design.measures, io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    units = {name: MEASURES[name].unit for name in measures}
    writer.writerow(["point", *(f"{name} [{PARAMETERS[name].unit or '1'}]" for name in names), "attractor", "turns",
                     "starts", "share", "share low", "share high", "drift [m/s]",
                     *(f"{name}{head}" for name in measures
                       for head in (f" [{units[name]}]", f" 95 % ± [{units[name]}]", " starts")), "failed", "refused"])
    for point, motions in enumerate(summary.motions):
        point_cells = [point, *(summary.parameters[name][point] for name in names)]
        counts = [summary.failed[point], summary.refused[point]]
        for row in motions:
            attractor = row.attractor
            writer.writerow([*point_cells, row.number, "" if attractor.turns is None else attractor.turns,
                             attractor.starts, attractor.share, attractor.low, attractor.high, row.drift,
                             *itertools.chain.from_iterable(row.measures.values()), *counts])
        if not motions:
            writer.writerow([*point_cells, "", "", 0, "", "", "", "", *("nan", "nan", 0) * len(measures), *counts])
    return text.getvalue()


def in_words(summary: Summary) -> Iterator[str]:
    """Yield the results as lines of text."""
    design, rows = summary.design, summary.rows
    yield (f"{design.points} points from {design.starts} drawn starts each" if design.starts else
           f"{design.points} points, each from the scene's own start")
    if drifting := [row for row in rows if row.drift]:
        worst = max(drifting, key=lambda row: abs(row.drift))
        yield (f"the mean speed drifts at {len({row.point for row in drifting})} of {design.points} points, at most by "
               f"{worst.drift:.3g} m/s from one half of the time to the other at point {worst.point}: give more "
               "--settling")
    if several := sum(len(motions) > 1 for motions in summary.motions):
        yield f"{several} of {design.points} points have several motions, a row each in the summary"
    for name in shown_measures(design):
        yield from _measure_in_words(summary, name)
    for count, outcome, is_refused in ((summary.failed.sum(), "runs could not go on", False),
                                       (summary.refused.sum(), "runs are of scenes that are refused", True)):
        if count:
            text = next(text for text in summary.errors if text.startswith(NO_SCENE) == is_refused)
            yield f"{count} {outcome}, such as: {text}"
    if summary.warnings:
        yield f"warning: {summary.warnings[0]}"


def shown_measures(design: SweepDesign) -> list[str]:
    """The measures without the exponent's interval, which is shown together with the exponent."""
    return [name for name in design.measures if name != SPREAD]


def _measure_in_words(summary: Summary, name: str) -> Iterator[str]:
    """Yield the extremes of a measure, and whether they lie at the end of a range."""
    rows = [row for row in summary.rows if not math.isnan(row.measures[name].mean)]
    if not rows:
        yield f"{name}: no run has a value"
        return

    def size(row: MotionRow) -> float:
        return abs(row.measures[name].mean) if name in DIRECTED else row.measures[name].mean

    least, most = min(rows, key=size), max(rows, key=size)
    yield f"{name}: from {_row_in_words(summary, name, least)} to {_row_in_words(summary, name, most)}"
    quantity = f"magnitude of {name}" if name in DIRECTED else name
    for extreme, row, direction in (("least", least, "fall"), ("largest", most, "rise")):
        if edge := at_the_edge(f"the {extreme} {quantity}", ends_at(summary.parameters, row.point), direction):
            yield edge
    unknown = sum(not sign_of(row.measures[name].mean, row.measures[name].spread) for row in rows)
    if name == EXPONENT and unknown:
        yield f"{name}: sign not known of {unknown} of {len(summary.rows)} motions"


def _row_in_words(summary: Summary, measure: str, row: MotionRow) -> str:
    statistic, motions = row.measures[measure], summary.motions[row.point]
    where = ", ".join(f"{name} = {_value(values[row.point], 6)}" for name, values in summary.parameters.items())
    # The interval of a periodic motion would only describe the choice of starts.
    is_same = bool(row.attractor.turns) and statistic.starts > 1 and measure not in LYAPUNOV
    interval = f" ± {statistic.spread:.2g}" if statistic.spread > 0.0 and not is_same else ""
    unit = "" if MEASURES[measure].unit == "1" else f" {MEASURES[measure].unit}"
    if len(motions) > 1:
        starts = sum(motion.attractor.starts for motion in motions)
        where += f"; motion {row.number} of {len(motions)}, {row.attractor.starts} of {starts} starts"
    elif is_same:
        unit += " from every start"
    return f"{statistic.mean:.4g}{interval}{unit} ({where})"


def _value(value: Value, digits: int) -> str:
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


@figures.default_settings()
def draw_sweep(summary: Summary) -> bytes:
    """Draw every measure of a sweep in a row of panels; returns a PNG file.

    A grid is drawn over its first number, with a line for each combination of the other parameters; samples as marks
    over each number that is sampled.
    """
    design, measures = summary.design, shown_measures(summary.design)
    numbers = [axis for axis in design.axes if isinstance(PARAMETERS[axis.names[0]].default, float)]
    parameters: Sequence[Axis | Range] = design.ranges or numbers[:1] or design.axes[:1]
    figure = figures.new_figure(_WIDTH * len(parameters), _HEIGHT * len(measures), 100)
    panels = figure.subplots(len(measures), len(parameters), squeeze=False)
    for row, measure in zip(panels, measures, strict=True):
        for axes, parameter in zip(row, parameters, strict=True):
            _draw_panel(axes, summary, measure, parameter)
    if len(design.axes) > 1 and not design.ranges:
        panels[0, 0].legend(fontsize=8, frameon=False)
    starts = f"{design.starts} starts, a mark a motion, 95 % intervals" if design.starts > 1 else "one start"
    figures.set_heading(figure, f"{design.scene.name}: {starts}, {design.duration:g} s after {design.settling:g} s")
    return figures.png(figure)


def _draw_panel(axes: figures.Axes, summary: Summary, measure: str, parameter: Axis | Range) -> None:
    """Draw a mark for each motion; a line joins those of a grid if each of its points has one motion."""
    values = summary.parameters[parameter.names[0]]
    is_number = isinstance(PARAMETERS[parameter.names[0]].default, float)
    for (label, points), (colour, marker) in zip(_combinations(summary, parameter), figures.LINES, strict=False):
        rows = [row for row in summary.rows if row.point in points]
        if is_number:
            rows.sort(key=lambda row: values[row.point])  # a list has any order
        is_line = len({row.point for row in rows}) == len(rows) and not summary.design.ranges
        axes.errorbar([values[row.point] for row in rows], [row.measures[measure].mean for row in rows],
                      yerr=np.nan_to_num([row.measures[measure].spread for row in rows]), color=colour, marker=marker,
                      ms=4, lw=1.2, linestyle="-" if is_line else "none", capsize=2, label=label)
    axes.set(xlabel=figures.of_parameter(parameter.name), ylabel=figures.with_unit(measure, MEASURES[measure].unit))
    if is_number:
        axes.locator_params(axis="x", nbins=6)  # more would touch each other, of small numbers such as gaps
    figures.style_axes(axes)


def _combinations(summary: Summary, parameter: Axis | Range) -> list[tuple[str, set[int]]]:
    """Label and points of each combination of the parameters other than `parameter`, at most `MOST_LINES`.

    Samples have one combination, of all points.
    """
    design, labels = summary.design, dict[str, set[int]]()
    others = [] if design.ranges else [axis for axis in design.axes if axis is not parameter]
    for point in range(design.points):
        label = ", ".join(f"{axis.name} = {_value(summary.parameters[axis.names[0]][point], 4)}" for axis in others)
        labels.setdefault(label, set()).add(point)
    return list(labels.items())[:MOST_LINES]
