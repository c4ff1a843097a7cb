"""`study paper`: every figure and claim of the paper, under each of its readings."""

import argparse
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from research.paper.claims import Verdict, verdicts
from research.paper.figures import draw_figures
from research.paper.readings import points
from research.paper.runs import Effort, RowFile, batches, full_effort, quick_effort, run_batches
from research.paper.verdicts import read_verdicts, write_verdicts
from research.paper.words import page
from research.paper.work import work_of_a_second
from vibro_ros.process.front_door import Parser, exit_code, say
from vibro_ros.process.stop_signals import interrupted_code
from vibro_ros.process.untrusted import replace_file
from vibro_ros.simulation.preparation import prepare_kernels
from vibro_ros.study.command import locked
from vibro_ros.study.progress import Progress

ROWS, VERDICTS, TEXT = "rows.csv", "verdicts.csv", "paper.md"
#: A word that begins what the study says on stderr.
_PROGRAM = "study"


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    options = _parser().parse_args(words)
    try:
        return exit_code(_PROGRAM, lambda: _study(options))
    except KeyboardInterrupt:
        say(_PROGRAM, f"interrupted; the same command goes on from {options.output / ROWS}")
        return interrupted_code()


def _study(options: argparse.Namespace) -> int:
    effort = quick_effort() if options.quick else full_effort()
    with locked(options.output):
        write_verdicts(options.output / VERDICTS, judged(effort, options.output))
        say(_PROGRAM, "drawing the figures")
        pictures = list(draw_figures(options.output))
        replace_file(options.output / TEXT, written(options.output, effort, pictures).encode())
    print("\n".join(map(str, (*(options.output / name for name in (ROWS, VERDICTS, TEXT)), *pictures))))
    return 0


def written(folder: Path, effort: Effort, pictures: Sequence[Path]) -> str:
    """The page of the verdicts in `folder`, with `pictures` that lie beside it."""
    return page(read_verdicts(folder / VERDICTS), (effort.exact_starts, effort.worksheet_starts), work_of_a_second(),
                [path.name for path in pictures])


def judged(effort: Effort, folder: Path) -> list[Verdict]:
    """Verdicts on every claim under every reading of `effort`, from rows in `folder` that are there or are added.

    Raises
    ------
    ValueError
        If the rows that are there are another study's.
    RuntimeError
        If a run cannot go on.
    OSError
        If the rows cannot be written.
    """
    rows, results = RowFile(folder / ROWS, effort), iter(list[np.ndarray]())
    results = chain(done := rows.done(), _computed(rows, effort, len(done)))
    count = len(list(points()))
    told: list[Verdict] = []
    for reading in effort.readings:
        told += verdicts(reading, {point: next(results) for point, _ in zip(points(), range(count), strict=True)})
    return told


def _computed(rows: RowFile, effort: Effort, first: int) -> Iterator[np.ndarray]:
    """Displacements of the batches from number `first` on, with a progress bar; each is on disk when it is yielded."""
    every = batches(effort)
    if first == len(every):
        return
    prepare_kernels(_PROGRAM, "exact")
    say(_PROGRAM, "compiling the worksheets: some seconds")
    with Progress("paper", "robot", len(every), first) as bar:
        for values in rows.append(run_batches(every[first:]), first):
            bar.add(1)
            yield values


def _parser() -> Parser:
    parser = Parser(
        prog="study paper", description="Run every figure and claim of the paper under each of its readings. "
        "Ctrl-C keeps what is done; the same command goes on.",
        epilog="Exit code 0: done; 1: a run failed; 2: bad input, or rows of another study; 129, 130, 143: stopped by "
        "SIGHUP, SIGINT, SIGTERM, what was done is kept.")
    parser.add_argument("--output", type=Path, default=Path("out/study/paper"), metavar="DIR",
                        help="where to write, and to go on (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help="few starts, Runge-Kutta of one step: two minutes")
    return parser
