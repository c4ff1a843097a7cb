"""``study basins``: which start leads to which motion, how many starts each has."""

import argparse
import os
import warnings
from collections.abc import Sequence
from pathlib import Path

from vibro_ros.accuracy.harness import running
from vibro_ros.orbits.turn_map import Stroboscope, free_cut
from vibro_ros.process.entry_point import FAILURE, Parser, say
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.basins.attractors import NOWHERE, basin_entropy, found_in
from vibro_ros.study.basins.result import attractors_table, draw_basins, in_words, starts_table
from vibro_ros.study.basins.starts import (
    FOLDER,
    NO_START,
    Design,
    Plane,
    chosen_starts,
    over_in_words,
    stroboscope_of,
    study_of,
)
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
from vibro_ros.study.table import computed
from vibro_ros.study.variation import whole_number

STARTS, ATTRACTORS, PICTURE = "starts.parquet", "attractors.parquet", "basins.png"
TURNS, MOST_TURNS, STARTS_DRAWN, QUICK_STARTS = 64, 4096, 1000, 300


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ToleranceWarning)  # `_design` says it once
        return run_study(_basins, _parser(), words)


def _basins(options: argparse.Namespace) -> int:
    execution = execution_of(options)
    design, begun = _design(options), _core_time()
    with locked(options.output):
        table = computed(study_of(design), _folder(options.output), execution)
        found = found_in(table, stroboscope_of(design.scene, design.phase))
        if (found.numbers == NOWHERE).all():
            reason = next(text for text in table["error"].to_pylist() if text)
            raise ValueError(f"none of {design.starts.count} starts can be simulated; the first one: {reason}")
        write_files(options.output, {STARTS: starts_table(table, found), ATTRACTORS: attractors_table(found),
                                     PICTURE: draw_basins(design, table, found)})
    entropy = None
    if isinstance(design.starts, Plane):
        grid = found.numbers.reshape([one.count for one in design.starts.over])
        entropy = basin_entropy(grid, outside=NOWHERE)
    print("\n".join(in_words(design, table, found, entropy)))
    if not options.scheduler:
        say("study", f"{_core_time() - begun:.1f} s of core time")
    failed = any(text and not text.startswith(NO_START) for text in table["error"].to_pylist())
    return FAILURE if failed else 0


def _folder(output: Path) -> Path:
    (output / FOLDER).mkdir(exist_ok=True)
    return output / FOLDER


def _design(options: argparse.Namespace) -> Design:
    scene = running(machine_of(options))
    if scene.broken_promise:
        say("study", f"warning: {scene.broken_promise}")
    count = options.starts if options.starts is not None else QUICK_STARTS if options.quick else STARTS_DRAWN
    phase = Stroboscope(free_cut(scene)).turn_map.phase  # refuses a scene in which nothing moves
    starts = chosen_starts(scene, tuple(over_in_words(scene, text) for text in options.over), count,
                           whole_number("--seed", options.seed, 0, 2**63 - 1))
    if isinstance(starts, Plane) and options.starts is not None:
        raise ValueError("--starts: a grid draws no starts; leave it out, or the counts of --over")
    return Design(scene, phase, starts, options.turns, options.most_turns)


def _core_time() -> float:
    """Processor time [s] of this process and of those that have ended."""
    return sum(os.times()[:4])


def _parser() -> Parser:
    parser = study_parser(
        "basins", "Let a machine begin from many states, tell the motions apart that it settles to, and say how many "
        "starts lead to each, and how mixed they are. Writes Parquet files and a picture.",
        "a start could not go on, or the disk is full")
    add_machine(parser, "device")
    parser.add_argument("--over", action="append", default=[], metavar="NAME=LOW:HIGH[:COUNT]", help="a coordinate of "
                        "the start, SI units: with counts two of them, a grid; without counts, from which starts are "
                        "drawn (default: all, within a crank radius l of rest, and l times motor speed)")
    parser.add_argument("--starts", type=int, metavar="N", help=f"drawn starts (default: {STARTS_DRAWN})")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the draws (default: %(default)s)")
    parser.add_argument("--turns", type=int, default=TURNS, metavar="N", help="turns of the crank after which a start "
                        "is looked at first; then after twice as many, and so on (default: %(default)s)")
    parser.add_argument("--most-turns", type=int, default=MOST_TURNS, metavar="N", help="turns after which a start is "
                        "given up (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_STARTS} starts unless you say otherwise")
    add_execution(parser)
    return parser
