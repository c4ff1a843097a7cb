"""What the starts of each point of a sweep say together: means, 95 % intervals, and how many runs have a value."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from scipy.stats import t as student

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.study.measures import MEASURES
from vibro_ros.study.sweep.design import Design
from vibro_ros.study.sweep.rows import NO_SCENE


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
        distribution; NaN where fewer than one, or two, have one.
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


def summary(design: Design, tables: Sequence[pa.Table]) -> Summary:
    """Sum up all blocks of a design."""
    table, shape = pa.concat_tables([one.replace_schema_metadata() for one in tables]), (design.points, -1)
    mean, spread, count = {}, {}, {}
    for name in design.measures:
        values = table[name].to_numpy().reshape(shape)
        count[name] = np.sum(~np.isnan(values), axis=1)
        mean[name], spread[name] = _mean_and_spread(values, count[name])
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
    for name in design.measures:
        if np.isnan(found.mean[name]).all():
            lines.append(f"{name}: no run has a value")
            continue
        least, most = int(np.nanargmin(found.mean[name])), int(np.nanargmax(found.mean[name]))
        lines.append(f"{name}: from {_at(found, name, least)} to {_at(found, name, most)}")
    for count, what, texts in ((found.failed.sum(), "runs could not go on", [
            text for text in found.errors if not text.startswith(NO_SCENE)]),
            (found.refused.sum(), "runs are of scenes that are refused", [
                text for text in found.errors if text.startswith(NO_SCENE)])):
        if count:
            lines.append(f"{count} {what}, such as: {texts[0]}")
    if found.warnings:
        lines.append(f"warning: {found.warnings[0]}")
    return lines


def _at(found: Summary, name: str, point: int) -> str:
    where = ", ".join(f"{parameter} = {value:.6g}" if isinstance(value, float) else f"{parameter} = {value}"
                      for parameter, value in ((one, found.parameters[one][point]) for one in found.design.names))
    spread = found.spread[name][point]
    interval = "" if np.isnan(spread) else f" ± {spread:.2g}"
    unit = "" if MEASURES[name].unit == "1" else f" {MEASURES[name].unit}"
    return f"{found.mean[name][point]:.4g}{interval}{unit} ({where})"
