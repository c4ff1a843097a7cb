"""``study sweep``: parameters over lists, grids or samples; what the robot does at every point, as Parquet files."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from vibro_ros.process.front_door import FAILURE, Parser, exit_code, say
from vibro_ros.process.stop_signals import interrupted_code
from vibro_ros.process.untrusted import replace_file
from vibro_ros.study.locked_folder import locked
from vibro_ros.study.measures import MEASURES
from vibro_ros.study.options import add_runner, runner_of
from vibro_ros.study.progress import Progress
from vibro_ros.study.sweep.blocks import FOLDER
from vibro_ros.study.sweep.design import Design
from vibro_ros.study.sweep.design_file import (
    DEFAULTS,
    design_of,
    given_in_words,
    read_sweep,
    shipped_sweeps,
    sweep_path,
)
from vibro_ros.study.sweep.picture import draw_sweep
from vibro_ros.study.sweep.run import SweepRun
from vibro_ros.study.sweep.summary import Summary, as_csv, in_words, summary
from vibro_ros.study.sweep.variation import SAMPLERS

TABLE, PICTURE = "summary.csv", "sweep.png"


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    return exit_code("study", lambda: _sweep(_parser().parse_args(words)))


def _sweep(options: argparse.Namespace) -> int:
    runner = runner_of(options)
    file = {} if options.file is None else read_sweep(sweep_path(options.file))
    design = design_of(file, given_in_words(options))
    try:
        check_points(design)
    except KeyboardInterrupt:
        say("study", "interrupted before the first run")
        return interrupted_code()
    with locked(options.output / FOLDER):
        run = SweepRun(design, options.output / FOLDER)
        try:
            run.find_done()
            run.do_by(runner)
        except KeyboardInterrupt:
            say("study", f"interrupted; {run.in_words}")
            return interrupted_code()
        found = summary(design, [run.tables[block] for block in range(design.blocks)])
        _write(found, options.output)
    print("\n".join(in_words(found)))
    return FAILURE if found.failed.any() else 0


def _write(found: Summary, folder: Path) -> None:
    replace_file(folder / TABLE, as_csv(found).encode())
    replace_file(folder / PICTURE, draw_sweep(found))
    print(f"{folder / FOLDER}\n{folder / TABLE}\n{folder / PICTURE}")


def check_points(design: Design) -> None:
    """Refuse a grid of which a point is no scene, and samples of which none is (ValueError); say how many are not."""
    refused = 0
    with Progress("points checked", "point", design.points) as progress:
        for point, scene, reason in design.scenes():
            if scene is None and design.sampling is None:
                changes = ", ".join(f"{name} = {value}" for name, value in design.changes(point).items())
                raise ValueError(f"point {point} ({changes}) is no scene: {reason}")
            refused += scene is None
            progress.add(1)
    if refused == design.points:
        raise ValueError(f"none of {refused} points is a scene, such as the last one: {reason}")
    if refused:
        say("study", f"{refused} of {design.points} points are no scenes; their rows say why")


def _parser() -> Parser:
    parser = Parser(
        prog="study sweep",
        description="Vary parameters of a scene over lists, grids or samples, measure the robot at every point from "
        "several starts, and write one Parquet file a block, a summary and a picture. Ctrl-C keeps the blocks that are "
        "done; the same command goes on from there.",
        epilog=f"Measures: {', '.join(MEASURES)}. Exit code 0: done; 1: a run failed, or the disk is full; 2: bad "
        "input, or nowhere to write; 129, 130, 143: stopped by SIGHUP, SIGINT, SIGTERM, finished blocks are kept.")
    parser.add_argument("file", nargs="?", metavar="FILE", help="a sweep's YAML file, or one of "
                        f"{', '.join(shipped_sweeps())}; the options below change what it says")
    parser.add_argument("--scene", metavar="NAME", help="shipped scene or scene file")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter's value at every "
                        "point, SI units, angles in rad; repeatable")
    parser.add_argument("--vary", action="append", default=[], metavar="NAME=VALUES", help="LOW:HIGH:COUNT, a grid; "
                        "A,B,C, a list; LOW:HIGH, a range for --sample; `:log` behind a grid or a range spreads it by "
                        "its logarithm; repeatable, every combination is run")
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
    add_runner(parser)
    parser.add_argument("--output", type=Path, default=Path("out/study/sweep"), metavar="DIR",
                        help="where to write (default: out/study/sweep)")
    return parser
