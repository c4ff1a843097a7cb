"""``study basins``: which start leads to which motion, how many starts each has, and what upsets it."""

import argparse
import itertools
import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import pyarrow as pa

from vibro_ros.orbits.cut import free_cut
from vibro_ros.orbits.stroboscope import Stroboscope
from vibro_ros.process.front_door import FAILURE, Parser, exit_code, say
from vibro_ros.process.stop_signals import interrupted_code
from vibro_ros.process.untrusted import replace_file
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.basins.attractors import NOWHERE, Found, found_in
from vibro_ros.study.basins.blocks import FOLDER, Blocks
from vibro_ros.study.basins.design import Design
from vibro_ros.study.basins.fractions import BasinEntropy, basin_entropy
from vibro_ros.study.basins.picture import draw_basins
from vibro_ros.study.basins.result import attractors_table, starts_table
from vibro_ros.study.basins.rows import NO_START, Rows, pieces, stroboscope_of, work_of
from vibro_ros.study.basins.shocks import FOLDER as SHOCKS
from vibro_ros.study.basins.shocks import ShockBlocks, ShockWork, Upset
from vibro_ros.study.basins.starts import Plane, chosen_starts, over_in_words
from vibro_ros.study.basins.words import in_words
from vibro_ros.study.locked_folder import locked
from vibro_ros.study.options import add_machine, add_runner, machine_of, runner_of
from vibro_ros.study.running.block_run import BlockRun
from vibro_ros.study.running.pieces import Piece
from vibro_ros.study.running.runner import Runner
from vibro_ros.study.sweep.variation import whole_number

STARTS, ATTRACTORS, PICTURE = "starts.parquet", "attractors.parquet", "basins.png"
TURNS, MOST_TURNS, STARTS_DRAWN, TRIES = 64, 4096, 1000, 600
_QUICK = {"starts": 300, "shocks": 100}
_MOST_TRIES = 1_000_000


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ToleranceWarning)  # `_design` says it once
        return exit_code("study", lambda: _basins(_parser().parse_args(words)))


def _basins(options: argparse.Namespace) -> int:
    runner = runner_of(options)
    design, begun = _design(options), _core_time()
    with locked(options.output):
        (options.output / FOLDER).mkdir(exist_ok=True)
        run = _StartsRun(design, options.output / FOLDER)
        try:
            run.find_done()
            run.do_by(runner)
            table = pa.concat_tables([run.tables[block].replace_schema_metadata() for block in range(design.blocks)])
            found = found_in(table, stroboscope_of(design.scene, design.phase))
            upsets = _upsets(design, found, options.output, runner)
        except KeyboardInterrupt:
            say("study", f"interrupted; {run.in_words}")
            return interrupted_code()
        _write(design, run.tables[0].schema, table, found, upsets, options.output)
    if not options.scheduler:
        say("study", f"{_core_time() - begun:.1f} s of core time")
    failed = any(text and not text.startswith(NO_START) for text in table["error"].to_pylist())
    return FAILURE if failed else 0


class _StartsRun(BlockRun[Rows]):
    """Where the starts of a design lead, in a folder."""

    def __init__(self, design: Design, folder: Path):
        super().__init__("starts", Blocks(folder, design),
                         [len(design.rows_of_block(block)) for block in range(design.blocks)])
        self._design = design

    def do_by(self, runner: Runner) -> None:
        """Have a runner do the blocks that are missing."""
        design = self._design

        def compute(missing: list[int]) -> Iterator[Rows]:
            items = itertools.chain.from_iterable(pieces(design, block) for block in missing)
            return runner(work_of(design), (design.scene["solver.method"],), items)
        self.do_missing(compute)


def _upsets(design: Design, found: Found, folder: Path, runner: Runner) -> list[pa.Table]:
    """What upsets each motion, where there are several."""
    motions = tuple(one.motion for one in found.attractors)
    if not design.shocks or len(motions) < 2:
        return []
    own = folder / f"{SHOCKS}_{design.shocks}"
    own.mkdir(exist_ok=True)
    run: BlockRun[list[Upset]] = BlockRun("shocks", ShockBlocks(own, design, len(motions)), [1] * len(motions))
    run.find_done()
    work = ShockWork(design.scene, design.phase, motions, design.shocks, design.shocks * design.run_time)
    run.do_missing(lambda missing: runner(work, (design.scene["solver.method"],),
                                          (Piece({"motion": number + 1}, (number,)) for number in missing)))
    return [run.tables[number] for number in range(len(motions))]


def _write(design: Design, schema: pa.Schema, table: pa.Table, found: Found, upsets: list[pa.Table],
           folder: Path) -> None:
    if (found.numbers == NOWHERE).all():
        reason = next(text for text in table["error"].to_pylist() if text)
        raise ValueError(f"none of {design.starts.count} starts can be, such as the first: {reason}")
    replace_file(folder / STARTS, starts_table(pa.table(table.columns, schema=schema), found))
    replace_file(folder / ATTRACTORS, attractors_table(found, upsets))
    replace_file(folder / PICTURE, draw_basins(design, table, found))
    print("\n".join(map(str, (folder / STARTS, folder / ATTRACTORS, folder / PICTURE))))
    print("\n".join(in_words(design, table, found, _entropy(design, found), upsets)))


def _entropy(design: Design, found: Found) -> BasinEntropy | None:
    if not isinstance(design.starts, Plane):
        return None
    return basin_entropy(found.numbers.reshape([one.count for one in design.starts.over]), outside=NOWHERE)


def _design(options: argparse.Namespace) -> Design:
    scene = machine_of(options)
    if scene.broken_promise:
        say("study", f"warning: {scene.broken_promise}")
    quick = _QUICK if options.quick else {}
    count = options.starts if options.starts is not None else quick.get("starts", STARTS_DRAWN)
    tries = options.shocks if options.shocks is not None else quick.get("shocks", TRIES)
    phase = Stroboscope(free_cut(scene)).turn_map.phase  # refuses a scene in which nothing moves
    starts = chosen_starts(scene, tuple(over_in_words(scene, text) for text in options.over), count,
                           whole_number("--seed", options.seed, 0, 2**63 - 1), options.ball)
    if isinstance(starts, Plane) and (options.starts is not None or options.ball):
        raise ValueError("--starts and --ball: a grid draws no starts; leave them out, or the counts of --over")
    return Design(scene, phase, starts, options.turns, options.most_turns,
                  whole_number("--shocks", tries, 0, _MOST_TRIES))


def _core_time() -> float:
    """Processor time [s] of this process and of those that have ended."""
    return sum(os.times()[:4])


def _parser() -> Parser:
    parser = Parser(
        prog="study basins",
        description="Let a machine begin from many states, tell the motions apart that it settles to, and say how many "
        "starts lead to each, how mixed they are, and which smallest shock turns one motion into another. Writes "
        "Parquet files and a picture. Ctrl-C keeps what is done; the same command goes on from there.",
        epilog="Exit code 0: done; 1: a start could not go on, or the disk is full; 2: bad input, or nowhere to "
        "write; 129, 130, 143: stopped by SIGHUP, SIGINT, SIGTERM, finished blocks are kept.")
    add_machine(parser, "device")
    parser.add_argument("--over", action="append", default=[], metavar="NAME=LOW:HIGH[:COUNT]", help="a coordinate of "
                        "the start, SI units: with counts two of them, a grid; without counts, from which starts are "
                        "drawn (default: all, within a crank radius l of rest, and l times motor speed)")
    parser.add_argument("--starts", type=int, metavar="N", help=f"drawn starts (default: {STARTS_DRAWN})")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the draws (default: %(default)s)")
    parser.add_argument("--ball", action="store_true", help="draw from the ellipsoid inside the box")
    parser.add_argument("--turns", type=int, default=TURNS, metavar="N", help="turns of the crank after which a start "
                        "is looked at first; then after twice as many, and so on (default: %(default)s)")
    parser.add_argument("--most-turns", type=int, default=MOST_TURNS, metavar="N", help="turns after which a start is "
                        "given up (default: %(default)s)")
    parser.add_argument("--shocks", type=int, metavar="N", help="shocks that are tried on each motion; 0: none "
                        f"(default: {TRIES})")
    parser.add_argument("--quick", action="store_true", help=f"{_QUICK['starts']} starts and {_QUICK['shocks']} shocks "
                        "unless you say otherwise")
    add_runner(parser)
    parser.add_argument("--output", type=Path, default=Path("out/study/basins"), metavar="DIR",
                        help="where to write (default: %(default)s)")
    return parser
