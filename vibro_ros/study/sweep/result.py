"""What a sweep has found: the motions of every point, their means and intervals, as CSV, sentences and a picture."""

import csv
import io
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vibro_ros.accuracy.figures import new_figure, png, tidy, with_unit
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.attractors import Attractor, Attractors, grouped
from vibro_ros.orbits.chaos import half_interval, sign_of
from vibro_ros.orbits.recurrence import SettledMotion, tolerance_of
from vibro_ros.study.measures import EXPONENT, LYAPUNOV, MEASURES, SPREAD
from vibro_ros.study.sweep.design import KEPT_STATES, NO_SCENE, Design
from vibro_ros.study.variation import beyond_the_edge

SPEED = "mean_speed"


@dataclass(frozen=True)
class Summary:
    """A sweep, a row a point and attractor: several motions of a point have no mean in common.

    Attributes
    ----------
    design : Design
        What was run.
    parameters : dict of str to list
        By varied parameter, its value at each point, in SI units.
    attractors : list of Attractors
        Of each point; empty where no run has values.
    point, place : ndarray of int, shape (rows,)
        Point of each row, and the number of its attractor there, from 0.
    mean, spread : dict of str to ndarray, shape (rows,)
        By measure, in its unit: the mean over the starts of the attractor that have a value, and half of its 95 %
        interval by Student's distribution; NaN where fewer than one, or two, have one. The exponent of a single start,
        or of starts of which none parts, has the interval that was measured with it.
    count : dict of str to ndarray, shape (rows,)
        Starts that have a value.
    failed, refused : ndarray, shape (points,)
        Runs that could not go on, and runs of scenes that are refused.
    errors, warnings : list of str
        What was said of rows, each text once.
    """

    design: Design
    parameters: dict[str, list]
    attractors: list[Attractors]
    point: np.ndarray
    place: np.ndarray
    mean: dict[str, np.ndarray]
    spread: dict[str, np.ndarray]
    count: dict[str, np.ndarray]
    failed: np.ndarray
    refused: np.ndarray
    errors: list[str]
    warnings: list[str]

    def of_row(self, row: int) -> Attractor:
        """The attractor of a row."""
        return self.attractors[self.point[row]][self.place[row]]

    def is_periodic(self, row: int) -> bool:
        """Whether the starts of a row repeat one motion, of which an interval would describe the draw."""
        return bool(self.of_row(row).turns)


def summary(design: Design, table: pa.Table) -> Summary:
    """Sum up the rows of a design."""
    errors, turns = table["error"].to_pylist(), table["turns"].to_pylist()
    states, starts = table["states"].to_pylist(), max(design.starts, 1)
    columns = {name: table[name].to_numpy() for name in design.measures}
    first_rows = list(range(0, design.rows, starts))
    parameters = {name: table[name].take(first_rows).to_pylist() for name in design.names}
    found: list[Attractors] = []
    groups: list[tuple[int, int, np.ndarray]] = []
    for point, first in enumerate(first_rows):
        rows = np.array([row for row in range(first, first + starts) if errors[row] is None], dtype=int)
        if not len(rows):
            found.append(Attractors())
            continue
        scene = design.scene.with_parameters(design.changes(point))
        speeds = columns[SPEED][rows] if SPEED in columns else np.full(len(rows), np.nan)
        motions = [None if turns[row] is None else SettledMotion(
            turns[row], np.array(states[row]).reshape(turns[row] or KEPT_STATES, -1), float(speed), 0,
            tolerance_of(scene)) for row, speed in zip(rows, speeds, strict=True)]
        own, places = grouped(motions, speeds.tolist())
        found.append(own)
        groups += [(point, place, rows[places == place]) for place in range(len(own))]
    mean, spread, count = {}, {}, {}
    for name, column in columns.items():
        values = [column[rows][~np.isnan(column[rows])] for _, _, rows in groups]
        count[name] = np.array([len(one) for one in values], dtype=int)
        mean[name] = np.array([one.mean() if len(one) else math.nan for one in values])
        spread[name] = np.array([float(half_interval(one)) if len(one) > 1 else math.nan for one in values])
    if EXPONENT in mean:
        own_interval = (count[EXPONENT] == 1) | (spread[EXPONENT] == 0.0)
        spread[EXPONENT] = np.where(own_interval, mean[SPREAD], spread[EXPONENT])
    refused = np.array([error is not None and error.startswith(NO_SCENE) for error in errors]).reshape(-1, starts)
    has_error = np.array([error is not None for error in errors]).reshape(-1, starts)
    return Summary(design, parameters, found, np.array([point for point, _, _ in groups], dtype=int),
                   np.array([place for _, place, _ in groups], dtype=int), mean, spread, count,
                   (has_error & ~refused).sum(axis=1), refused.sum(axis=1), _each_once(errors),
                   _each_once(table["warning"].to_pylist()))


def _each_once(texts: Sequence[str | None]) -> list[str]:
    return list(dict.fromkeys(text for text in texts if text is not None))


def as_csv(found: Summary) -> str:
    """The summary as a table: a row a point and attractor, units in the heading; a point without values has one row."""
    names, measures = found.design.names, found.design.measures
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heads = [[f"{name} [{MEASURES[name].unit}]", f"{name} 95 % ± [{MEASURES[name].unit}]", f"{name} starts"]
             for name in measures]
    writer.writerow(["point", *(f"{name} [{BY_NAME[name].unit or '1'}]" for name in names), "attractor", "turns",
                     "starts", "share", "share low", "share high", *(head for group in heads for head in group),
                     "failed", "refused"])
    row = 0
    for point, attractors in enumerate(found.attractors):
        place = [point, *(found.parameters[name][point] for name in names)]
        counts = [found.failed[point], found.refused[point]]
        for number, one in enumerate(attractors, 1):
            cells = [[found.mean[name][row], found.spread[name][row], found.count[name][row]] for name in measures]
            writer.writerow([*place, number, "" if one.turns is None else one.turns, one.starts, one.share, one.low,
                             one.high, *(cell for group in cells for cell in group), *counts])
            row += 1
        if not attractors:
            writer.writerow([*place, "", "", 0, "", "", "", *("nan", "nan", 0) * len(measures), *counts])
    return text.getvalue()


def in_words(found: Summary) -> list[str]:
    """What the sweep found, a line each."""
    design = found.design
    lines = [f"{design.points} points from {design.starts} drawn starts each" if design.starts else
             f"{design.points} points, each from the scene's own start"]
    if several := sum(len(own) > 1 for own in found.attractors):
        lines.append(f"{several} of {design.points} points have several motions, a row each in the summary")
    for name in _shown(design):
        if np.isnan(found.mean[name]).all():
            lines.append(f"{name}: no run has a value")
            continue
        least, most = int(np.nanargmin(found.mean[name])), int(np.nanargmax(found.mean[name]))
        lines.append(f"{name}: from {_at(found, name, least)} to {_at(found, name, most)}")
        for what, row in (("least", least), ("largest", most)):
            if edge := beyond_the_edge(f"the {what} {name}", found.parameters, int(found.point[row])):
                lines.append(edge)
        if name == EXPONENT and (unknown := _of_unknown_sign(found)):
            lines.append(f"{name}: sign not known at {unknown} of {design.points} points")
    for count, what, texts in ((found.failed.sum(), "runs could not go on", [
            text for text in found.errors if not text.startswith(NO_SCENE)]),
            (found.refused.sum(), "runs are of scenes that are refused", [
                text for text in found.errors if text.startswith(NO_SCENE)])):
        if count:
            lines.append(f"{count} {what}, such as: {texts[0]}")
    if found.warnings:
        lines.append(f"warning: {found.warnings[0]}")
    return lines


def _shown(design: Design) -> list[str]:
    """The measures, without the interval of another one, which stands there."""
    return [name for name in design.measures if name != SPREAD]


def _of_unknown_sign(found: Summary) -> int:
    """Points at which 0 lies within the interval of the exponent, or the interval is not known."""
    return sum(not math.isnan(mean) and not sign_of(mean, spread) for mean, spread in zip(
        found.mean[EXPONENT].tolist(), found.spread[EXPONENT].tolist(), strict=True))


def _at(found: Summary, name: str, row: int) -> str:
    point, own = int(found.point[row]), found.of_row(row)
    where = ", ".join(f"{parameter} = {value:.6g}" if isinstance(value, float) else f"{parameter} = {value}"
                      for parameter, value in ((one, found.parameters[one][point]) for one in found.design.names))
    spread = found.spread[name][row]
    same = found.is_periodic(row) and found.count[name][row] > 1 and name not in LYAPUNOV
    interval = f" ± {spread:.2g}" if spread > 0.0 and not same else ""
    unit = "" if MEASURES[name].unit == "1" else f" {MEASURES[name].unit}"
    of = len(found.attractors[point])
    starts = sum(one.starts for one in found.attractors[point])
    motion = f"; motion {found.place[row] + 1} of {of}, {own.starts} of {starts} starts" if of > 1 else ""
    return (f"{found.mean[name][row]:.4g}{interval}{unit}{' from every start' * bool(same and of == 1)} "
            f"({where}{motion})")


#: Most lines of a panel; further combinations are left to the table.
MOST_LINES = 6
# Okabe and Ito's colours, which the colour-blind can tell apart, and markers for everybody else who cannot.
_STYLES = (("#0072b2", "o"), ("#d55e00", "^"), ("#009e73", "s"), ("#cc79a7", "v"), ("#000000", "D"), ("#e69f00", "x"))
_WIDTH, _HEIGHT = 5.2, 3.6  # in, of a panel


def draw_sweep(found: Summary) -> bytes:
    """Draw every measure of a sweep, a row a measure; returns a PNG file."""
    numbers = [name for name in found.design.names if isinstance(BY_NAME[name].default, float)]
    on_grid = not found.design.ranges
    is_map = on_grid and len(numbers) == 2 and len(found.design.names) == 2
    columns = [tuple(numbers)] if is_map else [(name,) for name in numbers] or [(found.design.names[0],)]
    measures = _shown(found.design)
    figure = new_figure(_WIDTH * len(columns), _HEIGHT * len(measures), 100)
    axes = figure.subplots(len(measures), len(columns), squeeze=False)
    for row, measure in zip(axes, measures, strict=True):
        for axis, over in zip(row, columns, strict=True):
            if is_map:
                _draw_map(figure, axis, found, measure, over)
            elif on_grid and len(columns) == 1:
                _draw_lines(axis, found, measure, over[0], measure == measures[0])
            else:
                axis.plot([found.parameters[over[0]][point] for point in found.point], found.mean[measure], ".",
                          color=_STYLES[0][0], ms=4, alpha=0.6)
                _label(axis, over[0], measure)
    intervals = ", 95 % intervals" if on_grid and not is_map and len(columns) == 1 else ""
    several = ", of several motions the one of most starts" if is_map else ", a mark a motion"
    starts = f"{found.design.starts} starts{several}{intervals}" if found.design.starts > 1 else "one start"
    figure.suptitle(f"{found.design.scene.name}: {starts}, {found.design.duration:g} s after "
                    f"{found.design.settling:g} s", fontsize=11)
    return png(figure)


def _draw_lines(axes: Axes, found: Summary, measure: str, over: str, legend: bool) -> None:
    """A mark a motion, joined by lines where every point has one motion."""
    line = "-" if all(len(own) <= 1 for own in found.attractors) else "none"
    for (label, chosen), (colour, marker) in zip(_combinations(found, over), itertools.cycle(_STYLES), strict=False):
        rows = np.flatnonzero(np.isin(found.point, chosen))
        places = [found.parameters[over][found.point[row]] for row in rows]
        axes.errorbar(places, found.mean[measure][rows], yerr=np.nan_to_num(found.spread[measure][rows]), color=colour,
                      marker=marker, ms=4, lw=1.2, linestyle=line, capsize=2, label=label)
    if legend and len(found.design.names) > 1:
        axes.legend(fontsize=8, frameon=False)
    _label(axes, over, measure)


def _combinations(found: Summary, over: str) -> Iterator[tuple[str, np.ndarray]]:
    """Label and points of each combination of all parameters but one, at most `MOST_LINES`."""
    others = [name for name in found.design.names if name != over]
    keys = list(zip(*(found.parameters[name] for name in others), strict=True)) or [()] * found.design.points
    for key in list(dict.fromkeys(keys))[:MOST_LINES]:
        label = ", ".join(f"{name} = {value:.4g}" if isinstance(value, float) else f"{name} = {value}"
                          for name, value in zip(others, key, strict=True))
        yield label, np.array([point for point, own in enumerate(keys) if own == key])


def _draw_map(figure: Figure, axes: Axes, found: Summary, measure: str, over: tuple[str, ...]) -> None:
    first, second = found.design.axes
    values = np.full(found.design.points, np.nan)
    largest = found.place == 0
    values[found.point[largest]] = found.mean[measure][largest]
    order = np.ix_(np.argsort(first.values), np.argsort(second.values))
    cells = values.reshape(len(first.values), -1)[order]
    mesh = axes.pcolormesh(np.sort(second.values), np.sort(first.values), cells, shading="nearest", cmap="viridis")
    figure.colorbar(mesh, ax=axes, label=with_unit(measure, MEASURES[measure].unit))
    axes.set(xlabel=with_unit(second.name, BY_NAME[second.name].unit),
             ylabel=with_unit(first.name, BY_NAME[first.name].unit))


def _label(axes: Axes, over: str, measure: str) -> None:
    axes.set(xlabel=with_unit(over, BY_NAME[over].unit), ylabel=with_unit(measure, MEASURES[measure].unit))
    tidy(axes)
