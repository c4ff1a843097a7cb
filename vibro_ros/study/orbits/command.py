"""``study orbits``: branches of periodic orbits over a parameter, as Parquet files, a picture and tables."""

import argparse
from collections.abc import Sequence
from typing import cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from vibro_ros.accuracy.harness import running
from vibro_ros.configuration.strict_yaml import read_scalar
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.branch import Branch
from vibro_ros.orbits.family import Family
from vibro_ros.orbits.turn_map import TurnMap
from vibro_ros.process.entry_point import Parser
from vibro_ros.study.command import (
    add_execution,
    add_machine,
    execution_of,
    locked,
    machine_of,
    run_study,
    study_parser,
    write_files,
)
from vibro_ros.study.orbits import curves
from vibro_ros.study.orbits.curve_result import curve_document, curves_in_words, draw_curves
from vibro_ros.study.orbits.result import document, draw_orbits, in_words, names_of
from vibro_ros.study.orbits.run import FOLDER, OrbitsRun, Plan, fields_of, rows_of
from vibro_ros.study.table import Field, file_of, table_of
from vibro_ros.study.variation import Range, varied_in_words, whole_number

BRANCHES, SPECIAL, PICTURE, TEXT = "branches.parquet", "special_points.parquet", "orbits.png", "orbits.md"
CURVES, CURVE_PICTURE = "curves.parquet", "curves.png"
MOST_TURNS = 32
_QUICK_VARY, _QUICK_FROM = "motor.speed=60:66", 65.0
# Default, default with --quick, least and most of the numbers that an option gives.
_COUNTS = {"turns": (8, 2, 1, MOST_TURNS), "starts": (4, 2, 1, 1000), "points": (400, 120, 2, 100_000)}


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    return run_study(_orbits, parser(), words)


def _orbits(options: argparse.Namespace) -> int:
    plan = plan_of(options)
    asked = curves_of(options, plan) if options.curves else None
    execution = execution_of(options)
    with locked(options.output / FOLDER):
        run = OrbitsRun(plan, options.output / FOLDER, execution)
        run.do()
        write_files(options.output, _files(plan, run))
    print("\n".join(in_words(run.done)) or "no orbit was found; give more --starts, --turns, or another --from")
    if asked:
        with locked(options.output / curves.FOLDER):
            names = names_of([branch for _, branch in run.done])
            found = curves.follow_curves(asked, run.done, names, options.output / curves.FOLDER, execution)
            write_files(options.output, _curve_files(asked, run, found))
        print("\n".join(curves_in_words(found)) or "no special point has a curve")
    return 0


def curves_of(options: argparse.Namespace, plan: Plan) -> curves.CurvePlan:
    """The second parameter that `--curves` names (ValueError for one that makes no sense)."""
    name, over = varied_in_words(options.curves)
    if not isinstance(over, Range) or over.log:
        raise ValueError(f"--curves {options.curves}: is no range; give NAME=LOW:HIGH, such as upper.gap=0:0.002")
    if name == plan.name:
        raise ValueError(f"--curves {options.curves}: {name} is the parameter of --vary; give another one")
    Family(plan.scene, {name: (over.low, over.high)}, 1, 0.0)  # refuses what is no range of a number
    if not over.low <= plan.scene[name] <= over.high:
        raise ValueError(f"--curves {options.curves}: does not hold the machine's {plan.scene[name]:g}; give a range "
                         "that holds it, or another --set")
    return curves.CurvePlan(plan, name, over.low, over.high)


def plan_of(options: argparse.Namespace) -> Plan:
    """What the command line asks for.

    Raises
    ------
    ValueError
        For an option that makes no sense, or a range that the scene refuses.
    """
    vary = options.vary or (_QUICK_VARY if options.quick else None)
    if vary is None:
        raise ValueError("--vary: is missing; give NAME=LOW:HIGH, such as motor.speed=60:130")
    name, over = varied_in_words(vary)
    if not isinstance(over, Range) or over.log:
        raise ValueError(f"--vary {vary}: is no range; give NAME=LOW:HIGH, such as motor.speed=60:130")
    scene = running(machine_of(options))
    if scene["solver.method"] not in ("exact", "auto"):
        raise ValueError(f"solver.method: {scene['solver.method']!r} is not exact to rounding, which derivatives of "
                         "orbits need; leave it at 'exact'")
    given = tuple(cast(float, BY_NAME[name].checked(read_scalar(word))) for word in options.begin)
    begin = given or ((_QUICK_FROM,) if options.quick and not options.vary else
                      tuple(over.at(np.array([0.25, 0.5, 0.75])).tolist()))
    for value in begin:
        if not over.low <= value <= over.high:
            raise ValueError(f"--from {value:g}: is not from {over.low:g} to {over.high:g}; give a value of the range")
        TurnMap(scene.with_parameters({name: value}))  # refuses a crank that stands
    turns, starts, points = (
        whole_number(f"--{key}", (quick if options.quick else usual) if getattr(options, key) is None else
                     getattr(options, key), least, most) for key, (usual, quick, least, most) in _COUNTS.items())
    plan = Plan(scene.with_parameters({name: begin[0]}), name, over.low, over.high, begin, turns, starts, points)
    plan.family(1, 0.0)  # refuses a range that the scene refuses
    return plan


def _files(plan: Plan, run: OrbitsRun) -> dict[str, bytes]:
    """Tables, text and picture by the names of their files; no tables without a branch."""
    branches, files = [branch for _, branch in run.done], {}
    rows: list[dict] = []
    for number, (branch, names) in enumerate(zip(branches, names_of(branches), strict=True)):
        left = iter(names)
        rows += [{"branch": number, "name": next(left) if "kind" in row else None, **row} for row in rows_of(branch)]
    if branches:
        own = [Field("branch", pa.int64(), "1", "number of the branch"),
               Field("name", pa.string(), "1", "of a special point, as in the picture", True)]
        whole = table_of(rows, [*own, *fields_of(plan)])
        files = {BRANCHES: file_of(whole), SPECIAL: file_of(whole.filter(pc.is_valid(whole["kind"])))}
    return {**files, TEXT: document(plan, run.done).encode(), PICTURE: draw_orbits(plan, branches)}


def _curve_files(asked: curves.CurvePlan, run: OrbitsRun,
                 found: Sequence[tuple[curves.CurveTask, Branch]]) -> dict[str, bytes]:
    """Table, text and picture of the curves by the names of their files; the text holds that of the branches, too."""
    files, rows = {}, list[dict]()
    for task, curve in found:
        rows += [{"through": task.name, "way": task.way, **row} for row in curves.rows_of(curve)]
    if rows:
        own = [Field("through", pa.string(), "1", "name of the special point that the curve begins with"),
               Field("way", pa.string(), "1", f"from there in {asked.name}")]
        files = {CURVES: file_of(table_of(rows, [*own, *curves.fields_of(asked)]))}
    text = document(asked.plan, run.done) + curve_document(asked, found)
    return {**files, TEXT: text.encode(), CURVE_PICTURE: draw_curves(asked, run.done, found)}


def parser() -> Parser:
    """The command line of the study."""
    own = study_parser(
        "orbits", "Look for periodic orbits, stable and unstable, follow their branches over a parameter, through "
        "folds, grazings and corners, and from period doublings on; locate and name special points.")
    add_machine(own, "device")
    own.add_argument("--vary", metavar="NAME=LOW:HIGH", help="the parameter that changes, and its range")
    own.add_argument("--curves", metavar="NAME=LOW:HIGH", help="a second parameter, over which the special points are "
                     "followed as curves, and its range")
    own.add_argument("--from", dest="begin", action="append", default=[], metavar="VALUE", help="where orbits are "
                     "looked for; repeatable (default: at a quarter, a half and three quarters of the range)")
    own.add_argument("--turns", type=int, metavar="N", help="most turns of the crank after which an orbit repeats "
                     f"itself, up to {MOST_TURNS} (default: 8)")
    own.add_argument("--starts", type=int, metavar="N", help="starts from which orbits are looked for, at each VALUE "
                     "(default: 4)")
    own.add_argument("--points", type=int, metavar="N", help="most orbits of a branch (default: 400)")
    add_execution(own)
    own.add_argument("--quick", action="store_true", help="the folds of `device` between 60 and 66 rad/s, in a minute; "
                     "options that are given win")
    return own
