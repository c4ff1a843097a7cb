"""``study sweep``: vary parameters over lists, grids or samples, and measure the robot at every point.

A `SweepDesign` determines the points, the starts of each, and the measures. Its rows are numbered point by point, and
within a point start by start. Points have the order of the product of the axes and the samples: the sample changes
fastest, then the last axis. The `Summary` has a row for each point and attractor.
"""

import argparse
import csv
import difflib
import functools
import io
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from vibro_lab.orbits.attractors import Attractor, Attractors, group_starts
from vibro_lab.orbits.chaos import half_interval, sign_of
from vibro_lab.orbits.recurrence import SettledMotion, tolerance_of
from vibro_lab.orbits.starts import SETTLING
from vibro_lab.study import figures
from vibro_lab.study.command import Progress, Results, StudyCommand, settings_of
from vibro_lab.study.execution import Execution
from vibro_lab.study.measures import (
    DIRECTED,
    EXPONENT,
    LYAPUNOV,
    MEASURES,
    SPREAD,
    checked_names,
    checked_times,
    drift_in,
    measure_with_motion,
)
from vibro_lab.study.table import NUMBERS, Field, Study, computed
from vibro_lab.study.variation import (
    SAMPLERS,
    Axis,
    Range,
    Sampling,
    at_the_edge,
    ends_at,
    parameter_names,
    sampling,
    sampling_in_words,
    varied,
    varied_in_words,
    whole_number,
)
from vibro_ros import (
    PARAMETERS,
    Parser,
    Scene,
    SimulationError,
    Value,
    find_file,
    load_scene,
    parameter_named,
    read_yaml,
    say,
    scene_origin,
    shipped,
)

#: Largest number of runs of a sweep.
MOST_RUNS = 100_000_000
#: Largest number of random starts of a point.
MOST_STARTS = 1_000_000
KEPT_STATES = 32
"""States of a motion without a period that a row keeps."""
PART = 16
"""Largest number of starts in a part of a point: runs of the same machine, whose equations are set up once."""
# Simulated time [s] of the runs of a block, a second or two of work, and its largest number of rows: the most that an
# interruption loses.
_BLOCK_TIME, _BLOCK_ROWS = 4096.0, 1024


@dataclass(frozen=True)
class SweepDesign:
    """A checked design of a sweep."""

    scene: Scene  # scene with the values of all other parameters
    varied: tuple[Axis | Range, ...]  # the varied parameters
    sampling: Sampling | None  # sampling of the ranges; None without a range
    measures: tuple[str, ...]  # names of the measures
    starts: int  # number of random starts of each point; 0 for one run from the scene's own start
    settling: float  # settling time and measuring time of a run [s]
    duration: float

    def __post_init__(self) -> None:
        checked_names(self.measures)
        checked_times(self.settling, self.duration, self.starts > 0)
        if not self.varied:
            raise ValueError("vary: nothing varies; give --vary NAME=LOW:HIGH:COUNT or NAME=A,B,C")
        if self.ranges and self.sampling is None:
            name = self.ranges[0].name
            raise ValueError(f"{name}: a range without a count needs --sample, such as sobol:64; or give a count")
        if self.sampling is not None and not self.ranges:
            raise ValueError("sample: no range to sample; give one without a count, as --vary NAME=LOW:HIGH")
        for name in self.names:
            if self.names.count(name) > 1:
                raise ValueError(f"{name}: is varied twice; keep one")
        if self.rows > MOST_RUNS:
            raise ValueError(f"{self.points} points from {max(self.starts, 1)} starts each are more than {MOST_RUNS} "
                             "runs; give fewer")
        name = self.scene.motor_command.replace("_", ".")
        if self.scene[name] == 0.0 and name not in self.names:
            raise ValueError(f"{name}: 0 in {self.scene.name}, where the motor stands until a command; "
                             f"give --set {name}={'15' if name == 'motor.voltage' else '100'}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the varied parameters, each of linked ones by itself."""
        return tuple(name for one in self.varied for name in one.names)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The parameters with lists of values."""
        return tuple(one for one in self.varied if isinstance(one, Axis))

    @property
    def ranges(self) -> tuple[Range, ...]:
        """The parameters that are sampled."""
        return tuple(one for one in self.varied if isinstance(one, Range))

    @property
    def points(self) -> int:
        """Number of combinations of parameter values."""
        return math.prod(len(axis.values) for axis in self.axes) * (self.sampling.count if self.sampling else 1)

    @property
    def rows(self) -> int:
        """Number of runs, each of which has a row."""
        return self.points * max(self.starts, 1)

    @property
    def parts(self) -> int:
        """Number of parts of a point, each of which has at most `PART` starts."""
        return max(1, -(-self.starts // PART))

    def runs(self, number: int) -> tuple[int, tuple[int | None, ...]]:
        """Point and numbers of the starts of part `number`, counted over all points; None for the scene's own start."""
        point, part = divmod(number, self.parts)
        return point, tuple(range(part * PART, min((part + 1) * PART, self.starts))) or (None,)

    def changes(self, point: int) -> dict[str, Value]:
        """Values of the varied parameters at a point."""
        sampled, rest = self._samples, point
        values: dict[str, Value] = {}
        if self.sampling:
            rest, sample = divmod(point, self.sampling.count)
            values = {name: float(sampled[sample, k])
                      for k, varied_range in enumerate(self.ranges) for name in varied_range.names}
        for axis in reversed(self.axes):
            rest, index = divmod(rest, len(axis.values))
            values |= dict.fromkeys(axis.names, axis.values[index])
        return {name: values[name] for name in self.names}

    def scenes(self) -> Iterator[tuple[int, Scene | None, str]]:
        """Yield number, scene and an empty text for each point; for values that are refused, None and the reason."""
        for point in range(self.points):
            try:
                yield point, self.scene.with_parameters(self.changes(point)), ""
            except ValueError as error:
                yield point, None, str(error)

    def document(self) -> dict[str, object]:
        """The design in the form of a sweep's file, with every parameter of the scene."""
        fixed = {name: value for name, value in self.scene.parameters.items() if name not in self.names}
        sample = {"sample": vars(self.sampling)} if self.sampling else {}
        return {"scene": self.scene.name, "set": fixed, "vary": {one.name: one.document() for one in self.varied},
                **sample, "measure": list(self.measures), "starts": self.starts, "settling": self.settling,
                "duration": self.duration}

    @functools.cached_property
    def _samples(self) -> np.ndarray:
        """Values of the ranges, shape (count, ranges)."""
        if self.sampling is None:
            return np.zeros((1, 0))
        shares = self.sampling.shares(len(self.ranges))
        return np.column_stack([one.at(shares[:, k]) for k, one in enumerate(self.ranges)])


#: Defaults of a sweep's file and command line; a scene and a varied parameter must be given.
DEFAULTS: Mapping[str, Any] = {"set": {}, "vary": {}, "sample": None, "measure": ["mean_speed"], "starts": 8,
                                  "settling": SETTLING, "duration": 10.0}
KEYS = ("scene", *DEFAULTS)


def read_sweep(path: Path) -> dict[str, Any]:
    """Read the checked entries of a sweep's file, for `design_of`; a relative path of its scene starts at the file."""
    document = read_yaml(path)
    try:
        if not isinstance(document, dict):
            raise ValueError(f"holds no mapping; give {', '.join(KEYS)}")
        for key in document:
            if key not in KEYS:
                near = difflib.get_close_matches(str(key), KEYS, n=1)
                raise ValueError(f"{key!r} is unknown; "
                                 f"{f'did you mean {near[0]}?' if near else 'give ' + ', '.join(KEYS)}")
        return {key: _checked_entry(key, value, path.parent) for key, value in document.items()}
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _checked_entry(key: str, value: object, folder: Path) -> Any:
    if key in ("set", "vary"):
        if not isinstance(value, dict):
            raise ValueError(f"{key}: {value!r} is no mapping; give parameters by name")
        check = varied if key == "vary" else (lambda name, given: parameter_named(name, PARAMETERS).checked(given))
        return {str(name): check(str(name), given) for name, given in value.items()}
    if key == "scene":
        if not isinstance(value, str):
            raise ValueError(f"scene: {value!r} is no text; give a shipped scene's name or a path")
        return scene_origin(value, folder)
    if key == "sample":
        if not isinstance(value, dict) or not {"method", "count"} <= set(value) <= {"method", "count", "seed"}:
            raise ValueError(f"sample: {value!r} says not how; give method and count, and perhaps seed")
        return sampling(value["method"], value["count"], value.get("seed", 0))
    if key == "measure":
        if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
            raise ValueError(f"measure: {value!r} is no list of names; write [mean_speed, mean_power]")
        return list(checked_names(value))
    if key == "starts":
        return whole_number("starts", value, 0, MOST_STARTS)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{key}: {value!r} is not a number; give seconds")
    return float(value)


def given_in_words(options: argparse.Namespace) -> dict[str, Any]:
    """Return the entries that the command line gives, for `design_of`."""
    given = {key: getattr(options, key) for key in ("scene", "measure", "settling", "duration")}
    given["starts"] = None if options.starts is None else whole_number("--starts", options.starts, 0, MOST_STARTS)
    given["sample"] = sampling_in_words(options.sample) if options.sample else None
    chosen = {key: value for key, value in given.items() if value is not None}
    chosen["set"] = settings_of(options.set)
    chosen["vary"] = dict(varied_in_words(text, linked=True) for text in options.vary)
    if len(chosen["vary"]) < len(options.vary):
        raise ValueError("--vary: a parameter is given twice; keep one")
    return chosen


def design_of(file: Mapping[str, Any], words: Mapping[str, Any]) -> SweepDesign:
    """Make the design from a sweep's file, or nothing, and the command line (`read_sweep` and `given_in_words`).

    A parameter that the command line sets or varies overrides its entry in the file; linked ones, if all of them are.
    """
    entries = {**DEFAULTS, **file, **words}
    given = {name for key in ("set", "vary") for linked in words.get(key, {}) for name in parameter_names(linked)}
    for key in ("set", "vary"):
        own = words.get(key, {})
        entries[key] = {name: value for name, value in file.get(key, {}).items()
                     if name in own or not given.issuperset(parameter_names(name))} | own
    varied_names = {name for linked in entries["vary"] for name in parameter_names(linked)}
    for name in entries["set"]:
        if name in varied_names:
            raise ValueError(f"{name}: is set and varied; keep one")
    if "scene" not in entries:
        raise ValueError("scene: none given; give --scene NAME, or a sweep's file that names one")
    scene = load_scene(entries["scene"]).with_parameters(entries["set"])
    return SweepDesign(scene, tuple(entries["vary"].values()), entries["sample"],
                       tuple(checked_names(entries["measure"])), entries["starts"], entries["settling"],
                       entries["duration"])


FOLDER = "blocks"
#: Prefix of a row's error if the scene refuses the point's values.
NO_SCENE = "no such scene: "
_TYPES = {float: pa.float64(), bool: pa.bool_(), str: pa.string()}


def study_of(design: SweepDesign) -> Study:
    """Return the study of a sweep, with one row for each run, point by point, and within a point start by start."""
    starts = min(max(design.starts, 1), PART)
    run_time = (design.settling + design.duration) * starts
    block = max(1, min(_BLOCK_ROWS // starts, int(_BLOCK_TIME / run_time)))
    return Study("sweep", design.document(), fields_of(design), partial(rows_of, design), run_time,
                 design.points * design.parts, block)


def rows_of(design: SweepDesign, number: int) -> list[dict]:
    """Run a part by its number, and return one row for each start, with NaN and the reason if the run cannot go on."""
    point, starts = design.runs(number)
    changes = design.changes(point)
    rows = [{"point": point, "start": start, **changes, **dict.fromkeys(design.measures, math.nan), "turns": None,
             "states": [], "drift": math.nan, "error": None, "warning": None} for start in starts]
    try:
        scene = design.scene.with_parameters(changes)
    except ValueError as error:
        return [{**row, "error": f"{NO_SCENE}{error}"} for row in rows]
    for row, start in zip(rows, starts, strict=True):
        row["warning"] = scene.broken_promise or None
        try:
            values, motion, drift = measure_with_motion(
                scene, design.measures, design.settling, design.duration, start)
            row |= {**values, "drift": drift}
            if motion is not None:
                row |= {"turns": motion.turns, "states": motion.states[-(motion.turns or KEPT_STATES):].ravel()}
        except SimulationError as error:
            row["error"] = str(error)
    return rows


def fields_of(design: SweepDesign) -> list[Field]:
    """Return the columns: varied parameters, measures, the settled motion, and errors."""
    return [
        Field("point", pa.int64(), "1", "number of the combination of parameters"),
        Field("start", pa.int64(), "1", "number of the drawn start; null for the scene's own", True),
        *(Field(name, _TYPES[type(PARAMETERS[name].default)], PARAMETERS[name].unit or "1",
                PARAMETERS[name].description) for name in design.names),
        *(Field(name, pa.float64(), MEASURES[name].unit, MEASURES[name].meaning) for name in design.measures),
        Field("turns", pa.int64(), "1", "turns of the crank after which the motion repeats itself, by the end of the "
              "run; 0: it does not; null: it has not settled", True),
        Field("states", NUMBERS, "1", "states of this motion at the cut, one after the other, in crank radii and crank "
              "radii times motor speed"),
        Field("drift", pa.float64(), "m/s", "mean speed of the body in the second half of the time less that in the "
              "first half"),
        Field("error", pa.string(), "1", "why the row has no values; else null", True),
        Field("warning", pa.string(), "1", "what is to be known about the values; else null", True),
    ]


SPEED = "mean_speed"


@dataclass(frozen=True)
class Summary:
    """Summary of a sweep, with one row for each point and attractor, because several motions have no common mean."""

    design: SweepDesign  # design of the sweep
    parameters: dict[str, list]  # values of each varied parameter at all points, in SI units, by name
    attractors: list[Attractors]  # attractors of each point; empty if no run has values
    point: np.ndarray  # shape (rows,): point of each row, and the index of its attractor there, from 0
    place: np.ndarray
    # Shape (rows,): by measure, in its unit: the mean over the attractor's starts that have a value, NaN without any;
    # and half of its 95 % interval by Student's distribution, NaN for fewer than two. The exponent of a single start,
    # or of starts whose exponents are all equal, has the interval that was measured with it.
    mean: dict[str, np.ndarray]
    spread: dict[str, np.ndarray]
    count: dict[str, np.ndarray]  # shape (rows,): number of starts that have a value, by measure
    # Shape (rows,): mean speed in the second half of the time minus that in the first [m/s], if significant, so that
    # the mean describes a transient; else 0, and for a periodic motion.
    drift: np.ndarray
    failed: np.ndarray  # shape (points,): number of runs that could not go on, and of runs whose scene was refused
    refused: np.ndarray
    errors: list[str]  # texts of all rows, without repetition
    warnings: list[str]

    def of_row(self, row: int) -> Attractor:
        """Return the attractor of a row."""
        return self.attractors[self.point[row]][self.place[row]]

    def is_periodic(self, row: int) -> bool:
        """Whether a row's motion is periodic, so that an interval would only describe the choice of starts."""
        return bool(self.of_row(row).turns)


def summarised(design: SweepDesign, table: pa.Table) -> Summary:
    """Summarise the rows of a sweep's table."""
    errors, turns = table["error"].to_pylist(), table["turns"].to_pylist()
    states, starts = table["states"].to_pylist(), max(design.starts, 1)
    columns = {name: table[name].to_numpy() for name in design.measures}
    first_rows = list(range(0, design.rows, starts))
    parameters = {name: table[name].take(first_rows).to_pylist() for name in design.names}
    attractors: list[Attractors] = []
    groups: list[tuple[int, int, np.ndarray]] = []
    for point, first in enumerate(first_rows):
        rows = np.array([row for row in range(first, first + starts) if errors[row] is None], dtype=int)
        if not len(rows):
            attractors.append(Attractors())
            continue
        scene = design.scene.with_parameters(design.changes(point))
        speeds = columns[SPEED][rows] if SPEED in columns else np.full(len(rows), np.nan)
        motions = [None if turns[row] is None else SettledMotion(
            turns[row], np.array(states[row]).reshape(turns[row] or KEPT_STATES, -1), float(speed), 0,
            tolerance_of(scene)) for row, speed in zip(rows, speeds, strict=True)]
        of_point, places = group_starts(motions, speeds.tolist())
        attractors.append(of_point)
        groups += [(point, place, rows[places == place]) for place in range(len(of_point))]
    mean, spread, count = {}, {}, {}
    for name, column in columns.items():
        values = [column[rows][~np.isnan(column[rows])] for _, _, rows in groups]
        count[name] = np.array([len(numbers) for numbers in values], dtype=int)
        mean[name] = np.array([numbers.mean() if len(numbers) else math.nan for numbers in values])
        spread[name] = np.array([float(half_interval(numbers)) if len(numbers) > 1 else math.nan for numbers in values])
    if EXPONENT in mean:
        own_interval = (count[EXPONENT] == 1) | (spread[EXPONENT] == 0.0)
        spread[EXPONENT] = np.where(own_interval, mean[SPREAD], spread[EXPONENT])
    drifts = table["drift"].to_numpy()
    drift = np.array([0.0 if attractors[point][place].turns else
                      drift_in(drifts[rows], attractors[point][place].mean_speed)
                      for point, place, rows in groups])
    refused = np.array([error is not None and error.startswith(NO_SCENE) for error in errors]).reshape(-1, starts)
    has_error = np.array([error is not None for error in errors]).reshape(-1, starts)
    return Summary(design, parameters, attractors, np.array([point for point, _, _ in groups], dtype=int),
                   np.array([place for _, place, _ in groups], dtype=int), mean, spread, count, drift,
                   (has_error & ~refused).sum(axis=1), refused.sum(axis=1), _each_once(errors),
                   _each_once(table["warning"].to_pylist()))


def _each_once(texts: Sequence[str | None]) -> list[str]:
    return list(dict.fromkeys(text for text in texts if text is not None))


def as_csv(summary: Summary) -> str:
    """Return the summary as CSV: a row for each point and attractor, one for a point without values; units in the head.
    """
    names, measures = summary.design.names, summary.design.measures
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heads = [[f"{name} [{MEASURES[name].unit}]", f"{name} 95 % ± [{MEASURES[name].unit}]", f"{name} starts"]
             for name in measures]
    writer.writerow(["point", *(f"{name} [{PARAMETERS[name].unit or '1'}]" for name in names), "attractor", "turns",
                     "starts", "share", "share low", "share high", "drift [m/s]",
                     *(head for group in heads for head in group), "failed", "refused"])
    row = 0
    for point, motions in enumerate(summary.attractors):
        place = [point, *(summary.parameters[name][point] for name in names)]
        counts = [summary.failed[point], summary.refused[point]]
        for number, attractor in enumerate(motions, 1):
            cells = [cell for name in measures
                     for cell in (summary.mean[name][row], summary.spread[name][row], summary.count[name][row])]
            writer.writerow([*place, number, "" if attractor.turns is None else attractor.turns, attractor.starts,
                             attractor.share, attractor.low, attractor.high, summary.drift[row], *cells, *counts])
            row += 1
        if not motions:
            writer.writerow([*place, "", "", 0, "", "", "", "", *("nan", "nan", 0) * len(measures), *counts])
    return text.getvalue()


def in_words(summary: Summary) -> list[str]:
    """Return the results as lines of text."""
    design = summary.design
    lines = [f"{design.points} points from {design.starts} drawn starts each" if design.starts else
             f"{design.points} points, each from the scene's own start"]
    if (drifting := np.flatnonzero(summary.drift)).size:
        row = int(drifting[np.argmax(np.abs(summary.drift[drifting]))])
        count = len(set(summary.point[drifting].tolist()))
        lines.append(f"the mean speed drifts at {count} of {design.points} points, at most by {summary.drift[row]:.3g} "
                     f"m/s from one half of the time to the other at point {summary.point[row]}: give more --settling")
    if several := sum(len(motions) > 1 for motions in summary.attractors):
        lines.append(f"{several} of {design.points} points have several motions, a row each in the summary")
    for name in _shown_measures(design):
        if np.isnan(summary.mean[name]).all():
            lines.append(f"{name}: no run has a value")
            continue
        sizes = np.abs(summary.mean[name]) if name in DIRECTED else summary.mean[name]
        least, most = int(np.nanargmin(sizes)), int(np.nanargmax(sizes))
        ends = [_extreme_in_words(summary, name, row) for row in (least, most)]
        lines.append(f"{name}: from {' to '.join(ends)}")
        for what, row, direction in (("least", least, "fall"), ("largest", most, "rise")):
            quantity = f"magnitude of {name}" if name in DIRECTED else name
            ends = ends_at(summary.parameters, int(summary.point[row]))
            lines.append(at_the_edge(f"the {what} {quantity}", ends, direction))
        if name == EXPONENT and (unknown := _of_unknown_sign(summary)):
            lines.append(f"{name}: sign not known of {unknown} of {len(summary.point)} motions")
    for count, what, texts in ((summary.failed.sum(), "runs could not go on", [
            text for text in summary.errors if not text.startswith(NO_SCENE)]),
            (summary.refused.sum(), "runs are of scenes that are refused", [
                text for text in summary.errors if text.startswith(NO_SCENE)])):
        if count:
            lines.append(f"{count} {what}, such as: {texts[0]}")
    if summary.warnings:
        lines.append(f"warning: {summary.warnings[0]}")
    return list(filter(None, lines))


def _shown_measures(design: SweepDesign) -> list[str]:
    """The measures without the exponent's interval, which is shown together with the exponent."""
    return [name for name in design.measures if name != SPREAD]


def _of_unknown_sign(summary: Summary) -> int:
    """Number of rows whose exponent has an unknown sign: 0 lies within its interval, or the interval is unknown."""
    return sum(not math.isnan(mean) and not sign_of(mean, spread) for mean, spread in zip(
        summary.mean[EXPONENT].tolist(), summary.spread[EXPONENT].tolist(), strict=True))


def _extreme_in_words(summary: Summary, name: str, row: int) -> str:
    point, attractor = int(summary.point[row]), summary.of_row(row)
    where = ", ".join(f"{parameter} = {value:.6g}" if isinstance(value, float) else f"{parameter} = {value}"
                      for parameter, value in (
                          (varied, summary.parameters[varied][point]) for varied in summary.design.names))
    spread = summary.spread[name][row]
    same = summary.is_periodic(row) and summary.count[name][row] > 1 and name not in LYAPUNOV
    interval = f" ± {spread:.2g}" if spread > 0.0 and not same else ""
    unit = "" if MEASURES[name].unit == "1" else f" {MEASURES[name].unit}"
    of = len(summary.attractors[point])
    starts = sum(motion.starts for motion in summary.attractors[point])
    motion = f"; motion {summary.place[row] + 1} of {of}, {attractor.starts} of {starts} starts" if of > 1 else ""
    return (f"{summary.mean[name][row]:.4g}{interval}{unit}{' from every start' * bool(same and of == 1)} "
            f"({where}{motion})")


#: Largest number of lines of a panel; further combinations are only in the table.
MOST_LINES = 6
_WIDTH, _HEIGHT = 5.2, 3.6  # in, of a panel


@figures.default_settings()
def draw_sweep(summary: Summary) -> bytes:
    """Draw every measure of a sweep in a row of panels; returns a PNG file.

    A grid of one number, alone or with others of few values, is drawn as lines with intervals; a grid of two numbers
    with many values each as a map. What is sampled, or has more dimensions, is drawn as dots over each number.
    """
    varied_ones, on_grid = summary.design.varied, not summary.design.ranges
    numbers = [parameter for parameter in varied_ones if isinstance(PARAMETERS[parameter.names[0]].default, float)]
    over = numbers or [varied_ones[0]]
    is_pair = on_grid and len(numbers) == 2 and len(varied_ones) == 2
    is_map = is_pair and len(summary.design.axes[1].values) > MOST_LINES
    is_lines = on_grid and (len(over) == 1 or is_pair) and not is_map
    columns = over if not is_pair else over[:1]
    measures = _shown_measures(summary.design)
    figure = figures.new_figure(_WIDTH * len(columns), _HEIGHT * len(measures), 100)
    axes = figure.subplots(len(measures), len(columns), squeeze=False)
    for row, measure in zip(axes, measures, strict=True):
        for axis, parameter in zip(row, columns, strict=True):
            if is_map:
                _draw_map(axis, summary, measure)
            elif is_lines:
                _draw_lines(axis, summary, measure, parameter, measure == measures[0])
            else:
                places = summary.parameters[parameter.names[0]]
                axis.plot([places[point] for point in summary.point], summary.mean[measure], ".",
                          color=figures.LINES[0][0], ms=4, alpha=0.6)
                _label(axis, parameter, measure)
    intervals = ", 95 % intervals" if is_lines else ""
    several = ", of several motions the one of most starts" if is_map else ", a mark a motion"
    starts = f"{summary.design.starts} starts{several}{intervals}" if summary.design.starts > 1 else "one start"
    figures.set_heading(figure, f"{summary.design.scene.name}: {starts}, {summary.design.duration:g} s after "
                f"{summary.design.settling:g} s")
    return figures.png(figure)


def _draw_lines(axes: figures.Axes, summary: Summary, measure: str, over: Axis | Range, legend: bool) -> None:
    """Draw a mark for each motion; a line joins the marks of a combination if each of its points has one motion."""
    places = summary.parameters[over.names[0]]
    styles = itertools.cycle(figures.LINES)
    for (label, chosen), (colour, marker) in zip(_combinations(summary, over), styles, strict=False):
        rows = np.flatnonzero(np.isin(summary.point, chosen))
        if isinstance(places[0], float):
            rows = np.array(sorted(rows, key=lambda row: places[summary.point[row]]), dtype=int)  # a list has any order
        one_motion = len(set(summary.point[rows])) == len(rows)
        axes.errorbar([places[summary.point[row]] for row in rows], summary.mean[measure][rows],
                      yerr=np.nan_to_num(summary.spread[measure][rows]), color=colour, marker=marker, ms=4, lw=1.2,
                      linestyle="-" if one_motion else "none", capsize=2, label=label)
    if legend and len(summary.design.varied) > 1:
        axes.legend(fontsize=8, frameon=False)
    _label(axes, over, measure)


def _combinations(summary: Summary, over: Axis | Range) -> Iterator[tuple[str, np.ndarray]]:
    """Yield label and points of each combination of the parameters other than `over`, at most `MOST_LINES`."""
    others = [parameter for parameter in summary.design.varied if parameter is not over]
    columns = [summary.parameters[parameter.names[0]] for parameter in others]
    keys = list(zip(*columns, strict=True)) or [()] * summary.design.points
    for key in list(dict.fromkeys(keys))[:MOST_LINES]:
        label = ", ".join(f"{parameter.name} = {f'{value:.4g}' if isinstance(value, float) else value}"
                          for parameter, value in zip(others, key, strict=True))
        yield label, np.array([point for point, own in enumerate(keys) if own == key])


def _draw_map(axes: figures.Axes, summary: Summary, measure: str) -> None:
    first, second = summary.design.axes
    values = np.full(summary.design.points, np.nan)
    largest = summary.place == 0
    values[summary.point[largest]] = summary.mean[measure][largest]
    order = np.ix_(np.argsort(first.values), np.argsort(second.values))
    cells = values.reshape(len(first.values), -1)[order]
    figures.draw_cells(axes, np.sort(second.values), np.sort(first.values), cells,
               figures.with_unit(measure, MEASURES[measure].unit))
    axes.set(xlabel=figures.of_parameter(second.name), ylabel=figures.of_parameter(first.name))


def _label(axes: figures.Axes, over: Axis | Range, measure: str) -> None:
    axes.set(xlabel=figures.of_parameter(over.name), ylabel=figures.with_unit(measure, MEASURES[measure].unit))
    if isinstance(PARAMETERS[over.names[0]].default, float):
        axes.locator_params(axis="x", nbins=6)  # more would touch each other, of small numbers such as gaps
    figures.style_axes(axes)


TABLE, PICTURE = "summary.csv", "sweep.png"


def _checked_design(options: argparse.Namespace) -> SweepDesign:
    file = {} if options.file is None else read_sweep(find_file("sweep", options.file))
    design = design_of(file, given_in_words(options))
    check_points(design)
    return design


def _results(design: SweepDesign, folder: Path, execution: Execution) -> Iterator[Results]:
    summary = summarised(design, computed(study_of(design), folder / FOLDER, execution))
    yield Results({TABLE: as_csv(summary).encode(), PICTURE: draw_sweep(summary)}, in_words(summary),
                  bool(summary.failed.any()))


def check_points(design: SweepDesign) -> None:
    """Check all points; print the number of refused ones."""
    refused = 0
    with Progress("points checked", "point", design.points) as progress:
        for point, scene, reason in design.scenes():
            if scene is None and design.sampling is None:
                changes = ", ".join(f"{name} = {value}" for name, value in design.changes(point).items())
                raise ValueError(f"point {point} ({changes}) is no scene: {reason}")
            refused += scene is None
            progress.add(1)
    if refused == design.points:
        raise ValueError(f"none of {refused} points is a scene; the last one is refused because {reason}")
    if refused:
        say("study", f"{refused} of {design.points} points are no scenes; their rows say why")


def _add_options(parser: Parser) -> None:
    parser.add_argument("file", nargs="?", metavar="FILE", help="a sweep's YAML file, or one of "
                        f"{', '.join(shipped('sweep'))}; the options below change what it says")
    parser.add_argument("--scene", metavar="NAME", help="shipped scene or scene file")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter's value at every "
                        "point, SI units, angles in rad; repeatable")
    parser.add_argument("--vary", action="append", default=[], metavar="NAME=VALUES", help="LOW:HIGH:COUNT, a grid; "
                        "A,B,C, a list; LOW:HIGH, a range for --sample; `:log` behind a grid or a range spreads it by "
                        "its logarithm; NAME+NAME gives linked parameters the same value; repeatable, every "
                        "combination is run")
    parser.add_argument("--sample", metavar="METHOD:COUNT[:SEED]", help="how ranges are sampled: "
                        f"{' or '.join(SAMPLERS)}; the seed is 0 unless given")
    parser.add_argument("--measure", nargs="+", metavar="NAME", help="what is measured (default: "
                        f"{' '.join(DEFAULTS['measure'])})")
    parser.add_argument("--starts", type=int, metavar="N", help="drawn starts of each point, the same for all points; "
                        f"0: the scene's own start alone (default: {DEFAULTS['starts']})")
    parser.add_argument("--settling", type=float, metavar="S", help="time of a run that does not count (default: "
                        f"{DEFAULTS['settling']:g})")
    parser.add_argument("--duration", type=float, metavar="S", help="time that counts, cut to whole turns (default: "
                        f"{DEFAULTS['duration']:g})")


main = StudyCommand(
    "sweep", "Vary parameters of a scene over lists, grids or samples, measure the robot at every point from several "
    f"starts, and write one Parquet file a block, a summary and a picture. Measures: {', '.join(MEASURES)}.",
    _add_options, _checked_design, _results, scene=None)
