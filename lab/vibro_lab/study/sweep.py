"""``study sweep``: vary parameters over lists, grids or samples, and measure the robot at every point.

A `SweepDesign` has the points, `rows_of` runs the starts of one of them, and `sweep_summary` says what came of all.
"""

import argparse
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pyarrow as pa

from vibro_lab.orbits.starts import SETTLING
from vibro_lab.study.command import Progress, Results, StudyCommand
from vibro_lab.study.execution import Execution
from vibro_lab.study.measures import MEASURES, measure_with_motion
from vibro_lab.study.sweep_design import NO_SCENE, PART, SweepDesign, design_of
from vibro_lab.study.sweep_summary import as_csv, draw_sweep, in_words, summarised
from vibro_lab.study.table import NUMBERS, Field, Study, computed
from vibro_lab.study.variation import SAMPLERS
from vibro_ros import PARAMETERS, Parser, SimulationError, say

# Simulated time [s] of the runs of a block, a second or two of work, and its largest number of rows: the most that an
# interruption loses.
_BLOCK_TIME, _BLOCK_ROWS = 4096.0, 1024
FOLDER = "blocks"
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
                row |= {"turns": motion.turns, "states": motion.kept_states().ravel()}
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


TABLE, PICTURE = "summary.csv", "sweep.png"


def _checked_design(options: argparse.Namespace) -> SweepDesign:
    design = design_of(options)
    check_points(design)
    return design


def _results(design: SweepDesign, folder: Path, execution: Execution) -> Iterator[Results]:
    summary = summarised(design, computed(study_of(design), folder / FOLDER, execution))
    yield Results({TABLE: as_csv(summary).encode(), PICTURE: draw_sweep(summary)}, in_words(summary),
                  bool(summary.failed.any()))


def check_points(design: SweepDesign) -> None:
    """Refuse a grid with a point that is no scene, and samples none of which is one; print the number of the others."""
    refused, reason = 0, ""
    with Progress("points checked", "point", design.points) as progress:
        for point in range(design.points):
            changes = design.changes(point)
            try:
                design.scene.with_parameters(changes)
            except ValueError as error:
                if design.sampling is None:
                    values = ", ".join(f"{name} = {value}" for name, value in changes.items())
                    raise ValueError(f"point {point} ({values}) is no scene: {error}") from error
                refused, reason = refused + 1, str(error)
            progress.add(1)
    if refused == design.points:
        raise ValueError(f"none of {refused} points is a scene; the last one is refused because {reason}")
    if refused:
        say("study", f"{refused} of {design.points} points are no scenes; their rows say why")


def _add_options(parser: Parser) -> None:
    parser.add_argument("--vary", action="append", default=[], metavar="NAME=VALUES", help="LOW:HIGH:COUNT, a grid; "
                        "A,B,C, a list; LOW:HIGH, a range for --sample; `:log` behind a grid or a range spreads it by "
                        "its logarithm; NAME+NAME gives linked parameters the same value; repeatable, every "
                        "combination is run")
    parser.add_argument("--sample", metavar="METHOD:COUNT[:SEED]", help="how ranges are sampled: "
                        f"{' or '.join(SAMPLERS)}; the seed is 0 unless given")
    parser.add_argument("--measure", nargs="+", metavar="NAME", default=["mean_speed"], help="what is measured "
                        "(default: mean_speed)")
    parser.add_argument("--starts", type=int, metavar="N", default=8, help="drawn starts of each point, the same for "
                        "all points; 0: the scene's own start alone (default: %(default)s)")
    parser.add_argument("--settling", type=float, metavar="S", default=SETTLING, help="time of a run that does not "
                        "count (default: %(default)g)")
    parser.add_argument("--duration", type=float, metavar="S", default=10.0, help="time that counts, cut to whole "
                        "turns (default: %(default)g)")


main = StudyCommand(
    "sweep", "Vary parameters of a scene over lists, grids or samples, measure the robot at every point from several "
    f"starts, and write one Parquet file a block, a summary and a picture. Measures: {', '.join(MEASURES)}.",
    _add_options, _checked_design, _results)
