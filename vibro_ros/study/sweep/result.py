"""What a sweep has found: means and intervals of every point, as CSV, sentences and a picture."""

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
from scipy.stats import t as student

from vibro_ros.accuracy.figures import new_figure, png, tidy, with_unit
from vibro_ros.accuracy.starts import SAME
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.chaos import sign_of
from vibro_ros.study.measures import EXPONENT, MEASURES, SPREAD
from vibro_ros.study.sweep.design import NO_SCENE, Design
from vibro_ros.study.variation import beyond_the_edge


@dataclass(frozen=True)
class Summary:
    """A sweep, point by point.

    Attributes
    ----------
    design : Design
        What was run.
    parameters : dict of str to list
        By varied parameter, its value at each point, in SI units.
    mean, spread : dict of str to ndarray, shape (points,)
        By measure, in its unit: the mean over the starts that have a value, and half of its 95 % interval by Student's
        distribution; NaN where fewer than one, or two, have one. The exponent of a single start, or of starts of which
        none parts, has the interval that was measured with it.
    count : dict of str to ndarray, shape (points,)
        Starts that have a value.
    failed, refused : ndarray, shape (points,)
        Runs that could not go on, and runs of scenes that are refused.
    errors, warnings : list of str
        What was said of rows, each text once.
    """

    design: Design
    parameters: dict[str, list]
    mean: dict[str, np.ndarray]
    spread: dict[str, np.ndarray]
    count: dict[str, np.ndarray]
    failed: np.ndarray
    refused: np.ndarray
    errors: list[str]
    warnings: list[str]


def summary(design: Design, table: pa.Table) -> Summary:
    """Sum up the rows of a design."""
    shape = (design.points, -1)
    mean, spread, count = {}, {}, {}
    for name in design.measures:
        values = table[name].to_numpy().reshape(shape)
        count[name] = np.sum(~np.isnan(values), axis=1)
        mean[name], spread[name] = _mean_and_spread(values, count[name])
    if EXPONENT in mean:
        own = (count[EXPONENT] == 1) | (spread[EXPONENT] == 0.0)
        spread[EXPONENT] = np.where(own, mean[SPREAD], spread[EXPONENT])
    errors = table["error"].to_pylist()
    refused = np.array([error is not None and error.startswith(NO_SCENE) for error in errors]).reshape(shape)
    has_error = np.array([error is not None for error in errors]).reshape(shape)
    first_rows = range(0, design.rows, max(design.starts, 1))
    parameters = {name: table[name].take(list(first_rows)).to_pylist() for name in design.names}
    return Summary(design, parameters, mean, spread, count, (has_error & ~refused).sum(axis=1), refused.sum(axis=1),
                   _each_once(errors), _each_once(table["warning"].to_pylist()))


def _mean_and_spread(values: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    valid = np.where(np.isnan(values), 0.0, values)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(count > 0, valid.sum(axis=1) / count, np.nan)
        squares = np.where(np.isnan(values), 0.0, values - mean[:, None]) ** 2
        error = np.sqrt(squares.sum(axis=1) / (count - 1) / count)
        return mean, np.where(count > 1, student.ppf(0.975, np.maximum(count - 1, 1)) * error, np.nan)


def _each_once(texts: Sequence[str | None]) -> list[str]:
    return list(dict.fromkeys(text for text in texts if text is not None))


def as_csv(found: Summary) -> str:
    """The summary as a table: a row a point, units in the heading."""
    names, measures = found.design.names, found.design.measures
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heads = [[f"{name} [{MEASURES[name].unit}]", f"{name} 95 % ± [{MEASURES[name].unit}]", f"{name} starts"]
             for name in measures]
    writer.writerow(["point", *(f"{name} [{BY_NAME[name].unit or '1'}]" for name in names),
                     *(head for group in heads for head in group), "failed", "refused"])
    for point in range(found.design.points):
        cells = [[found.mean[name][point], found.spread[name][point], found.count[name][point]] for name in measures]
        writer.writerow([point, *(found.parameters[name][point] for name in names),
                         *(cell for group in cells for cell in group), found.failed[point], found.refused[point]])
    return text.getvalue()


def in_words(found: Summary) -> list[str]:
    """What the sweep found, a line each."""
    design = found.design
    lines = [f"{design.points} points from {design.starts} drawn starts each" if design.starts else
             f"{design.points} points, each from the scene's own start"]
    for name in _shown(design):
        if np.isnan(found.mean[name]).all():
            lines.append(f"{name}: no run has a value")
            continue
        least, most = int(np.nanargmin(found.mean[name])), int(np.nanargmax(found.mean[name]))
        lines.append(f"{name}: from {_at(found, name, least)} to {_at(found, name, most)}")
        for what, point in (("least", least), ("largest", most)):
            if edge := beyond_the_edge(f"the {what} {name}", found.parameters, point):
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


def _at(found: Summary, name: str, point: int) -> str:
    where = ", ".join(f"{parameter} = {value:.6g}" if isinstance(value, float) else f"{parameter} = {value}"
                      for parameter, value in ((one, found.parameters[one][point]) for one in found.design.names))
    spread = found.spread[name][point]
    # One motion repeated, whose interval would describe the draw.
    same = found.count[name][point] > 1 and spread <= SAME * abs(found.mean[name][point])
    interval = f" ± {spread:.2g}" if spread > 0.0 and not same else ""
    unit = "" if MEASURES[name].unit == "1" else f" {MEASURES[name].unit}"
    return f"{found.mean[name][point]:.4g}{interval}{unit}{' from every start' * bool(same)} ({where})"


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
                axis.plot(found.parameters[over[0]], found.mean[measure], ".", color=_STYLES[0][0], ms=4, alpha=0.6)
                _label(axis, over[0], measure)
    intervals = ", 95 % intervals" if on_grid and not is_map and len(columns) == 1 else ""
    starts = f"means of {found.design.starts} starts{intervals}" if found.design.starts > 1 else "one start"
    figure.suptitle(f"{found.design.scene.name}: {starts}, {found.design.duration:g} s after "
                    f"{found.design.settling:g} s", fontsize=11)
    return png(figure)


def _draw_lines(axes: Axes, found: Summary, measure: str, over: str, legend: bool) -> None:
    for (label, chosen), (colour, marker) in zip(_combinations(found, over), itertools.cycle(_STYLES), strict=False):
        places = [found.parameters[over][point] for point in chosen]
        spread = np.nan_to_num(found.spread[measure][chosen])
        axes.errorbar(places, found.mean[measure][chosen], yerr=spread, color=colour, marker=marker, ms=4, lw=1.2,
                      capsize=2, label=label)
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
    values = found.mean[measure].reshape(len(first.values), len(second.values))
    order = np.ix_(np.argsort(first.values), np.argsort(second.values))
    mesh = axes.pcolormesh(np.sort(second.values), np.sort(first.values), values[order], shading="nearest",
                           cmap="viridis")
    figure.colorbar(mesh, ax=axes, label=with_unit(measure, MEASURES[measure].unit))
    axes.set(xlabel=with_unit(second.name, BY_NAME[second.name].unit),
             ylabel=with_unit(first.name, BY_NAME[first.name].unit))


def _label(axes: Axes, over: str, measure: str) -> None:
    axes.set(xlabel=with_unit(over, BY_NAME[over].unit), ylabel=with_unit(measure, MEASURES[measure].unit))
    tidy(axes)
