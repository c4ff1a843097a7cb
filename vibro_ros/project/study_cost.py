"""What a sweep costs: time and bytes of a run, how much faster all cores are than one, and what a million runs take.

    python -m vibro_ros.project.study_cost

prints the table in docs/guide/studies.md. One core and all cores run the same sweep in turn, and as many processes that
share nothing and write nothing tell what the machine allows meanwhile.
"""

if __name__ == "__main__":  # before all imports, as in every executable
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("study_cost"))

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vibro_ros.accuracy.timing import seconds
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code
from vibro_ros.simulation.processes import core_count, in_processes
from vibro_ros.study.sweep.design import Design
from vibro_ros.study.sweep.rows import pieces, work_of
from vibro_ros.study.sweep.run import SweepRun, on_this_machine
from vibro_ros.study.sweep.variation import Range, sampling

_MILLION = 1_000_000


class Cost(NamedTuple):
    """What a sweep costs.

    Attributes
    ----------
    run : float
        Time of a run on one core [s].
    size : float
        Bytes of a run in the files [B].
    gain : float
        How many times faster all cores are than one [-].
    possible : float
        How many times faster the machine allows [-].
    """

    run: float
    size: float
    gain: float
    possible: float


def measured_cost(design: Design, repeats: int, cores: int) -> Cost:
    """Medians over `repeats` rounds of one core, all cores, and processes that share nothing, in turn."""
    with tempfile.TemporaryDirectory() as folder:
        def sweep(workers: int) -> int:
            with tempfile.TemporaryDirectory(dir=folder) as own:
                SweepRun(design, Path(own)).do_missing(on_this_machine(workers))
                return sum(file.stat().st_size for file in Path(own).iterdir())

        size = sweep(cores)
        rounds = np.array([[seconds(sweep, 1), seconds(sweep, cores), seconds(_apart, design, cores)]
                           for _ in range(repeats)])
    gain, possible = np.median(rounds[:, :1] / rounds[:, 1:], axis=0)
    return Cost(float(np.median(rounds[:, 0])) / design.rows, size / design.rows, float(gain), float(possible))


def _apart(design: Design, cores: int) -> None:
    """Run the pieces of a design in processes of which each does its part of them alone."""
    everything = [piece for block in range(design.blocks) for piece in pieces(design, block)]
    shares = [everything[core::cores] for core in range(cores)]
    for job in in_processes(lambda share: [work_of(design)(piece) for piece in share] and None, shares, cores):
        job.outcome()


def in_words(name: str, cost: Cost, cores: int) -> str:
    """A row of the table."""
    hours, gigabytes = _MILLION * cost.run / cost.gain / 3600.0, _MILLION * cost.size / 1e9
    return (f"| {name} | {cost.run * 1e3:.1f} ms | {cost.size:.0f} B | {cost.gain:.2f} | {cost.possible:.2f} | "
            f"{cost.gain / cores:.2f} | {hours:.2g} h, {gigabytes:.2g} GB |")


def main(words: Sequence[str]) -> int:
    """Measure and print; 0 when done; see `front_door.exit_code` for errors."""
    return exit_code("study_cost", lambda: _print(_parser().parse_args(words)))


def _print(options: argparse.Namespace) -> int:
    cores, scene = core_count(), load_scene(options.scene)
    if not 1 <= options.repeats <= 1000:
        raise ValueError(f"--repeats {options.repeats}: give a number from 1 to 1000")
    angle = (Range("guide.angle", 0.7, 1.57, False),)
    designs = {
        "10 s after 4 s, from 8 drawn starts of each point":
            Design(scene, angle, sampling("sobol", 64, 0), ("mean_speed",), 8, 4.0, 10.0),
        "1 s from the scene's own start, every point another machine":
            Design(scene, angle, sampling("sobol", 1024, 0), ("mean_speed",), 0, 0.0, 1.0)}
    print(f"| runs of `{scene.name}` | a run, one core | bytes of a run | {cores} cores, times faster | "
          f"what the machine allows | of {cores} cores | a million runs |\n|---|---|---|---|---|---|---|")
    for name, design in designs.items():
        print(in_words(name, measured_cost(design, options.repeats, cores), cores), flush=True)
    return 0


def _parser() -> Parser:
    parser = Parser(prog="study_cost", description=EXECUTABLES["study_cost"].does)
    parser.add_argument("--scene", default="unilateral", metavar="NAME", help="shipped scene or scene file (default: "
                        "%(default)s)")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="rounds (default: %(default)d)")
    return parser
