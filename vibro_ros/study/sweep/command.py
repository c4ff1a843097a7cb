"""``study sweep``: parameters over lists, grids or samples; what the robot does at every point, as Parquet files."""

import argparse
from collections.abc import Sequence

from vibro_ros.configuration.shipped import find_file, shipped
from vibro_ros.process.entry_point import FAILURE, Parser, say
from vibro_ros.study.command import add_execution, execution_of, locked, run_study, study_parser, write_files
from vibro_ros.study.measures import MEASURES
from vibro_ros.study.progress import Progress
from vibro_ros.study.sweep.design import (
    DEFAULTS,
    FOLDER,
    Design,
    design_of,
    given_in_words,
    read_sweep,
    study_of,
)
from vibro_ros.study.sweep.result import as_csv, draw_sweep, in_words, summary
from vibro_ros.study.table import computed
from vibro_ros.study.variation import SAMPLERS

TABLE, PICTURE = "summary.csv", "sweep.png"


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    return run_study(_sweep, _parser(), words)


def _sweep(options: argparse.Namespace) -> int:
    execution = execution_of(options)
    file = {} if options.file is None else read_sweep(find_file("sweep", options.file))
    design = design_of(file, given_in_words(options))
    check_points(design)
    with locked(options.output / FOLDER):
        found = summary(design, computed(study_of(design), options.output / FOLDER, execution))
        print(options.output / FOLDER)
        write_files(options.output, {TABLE: as_csv(found).encode(), PICTURE: draw_sweep(found)})
    print("\n".join(in_words(found)))
    return FAILURE if found.failed.any() else 0


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
        raise ValueError(f"none of {refused} points is a scene; the last one is refused because {reason}")
    if refused:
        say("study", f"{refused} of {design.points} points are no scenes; their rows say why")


def _parser() -> Parser:
    parser = study_parser(
        "sweep", "Vary parameters of a scene over lists, grids or samples, measure the robot at every point from "
        "several starts, and write one Parquet file a block, a summary and a picture. Measures: "
        f"{', '.join(MEASURES)}.")
    parser.add_argument("file", nargs="?", metavar="FILE", help="a sweep's YAML file, or one of "
                        f"{', '.join(shipped('sweep'))}; the options below change what it says")
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
    add_execution(parser)
    return parser
