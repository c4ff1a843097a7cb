"""What a sweep costs: time and bytes of a run, how much faster all cores are than one, and what a million runs take.

    python -m tools.study_cost

prints the table in docs/guide/studies.md. One core and all cores run the same sweep in turn, and as many processes that
share nothing and write nothing tell what the machine allows meanwhile. Beside other work, cores are not there to be
gained; the processor time of all processes still tells what sharing costs.
"""

if __name__ == "__main__":  # before all imports, as in every executable
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("study_cost"))

import argparse
import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vibro_ros.accuracy.timing import seconds
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code
from vibro_ros.simulation.processes import core_count, in_processes
from vibro_ros.study.running.runner import on_this_machine
from vibro_ros.study.sweep.design import Design
from vibro_ros.study.sweep.rows import pieces, work_of
from vibro_ros.study.sweep.run import SweepRun
from vibro_ros.study.sweep.variation import Range, sampling

_MILLION = 1_000_000


class Cost(NamedTuple):
    """What a sweep costs.

    Attributes
    ----------
    run : float
        Processor time of a run on one core [s].
    size : float
        Bytes of a run in the files [B].
    gain : float
        How many times faster all cores are than one [-].
    possible : float
        How many times faster the machine allows [-].
    efficiency : float
        Processor time on one core over that of all processes on all cores [-].
    """

    run: float
    size: float
    gain: float
    possible: float
    efficiency: float


def measured_cost(design: Design, repeats: int, cores: int) -> Cost:
    """Medians over `repeats` rounds of one core, all cores, and processes that share nothing, in turn."""
    with tempfile.TemporaryDirectory() as folder:
        def sweep(workers: int) -> int:
            with tempfile.TemporaryDirectory(dir=folder) as own:
                SweepRun(design, Path(own)).do_by(on_this_machine(workers))
                return sum(file.stat().st_size for file in Path(own).iterdir())

        size = sweep(cores)
        rounds = np.array([[*_times(sweep, 1), *_times(sweep, cores), *_times(_apart, design, cores)]
                           for _ in range(repeats)])
    one, alone, all_cores, together, apart, _ = rounds.T
    gain, possible, efficiency = (float(np.median(ratio)) for ratio in (one / all_cores, one / apart, alone / together))
    return Cost(float(np.median(alone)) / design.rows, size / design.rows, gain, possible, efficiency)


def _times(function: Callable, *arguments: object) -> tuple[float, float]:
    """Time [s] that a call takes, and the processor time [s] of this process and those that have ended."""
    before = sum(os.times()[:4])
    wall_time = seconds(function, *arguments)
    return wall_time, sum(os.times()[:4]) - before


def _apart(design: Design, cores: int) -> None:
    """Run the pieces of a design in processes of which each does its part of them alone."""
    everything = [piece for block in range(design.blocks) for piece in pieces(design, block)]
    shares = [everything[core::cores] for core in range(cores)]
    for job in in_processes(lambda share: [work_of(design)(piece) for piece in share] and None, shares, cores):
        job.outcome()


def in_words(name: str, cost: Cost, cores: int) -> str:
    """A row of the table."""
    hours, megabytes = _MILLION * cost.run / cores / cost.efficiency / 3600.0, _MILLION * cost.size / 1e6
    return (f"| {name} | {cost.run * 1e3:.1f} ms | {cost.size:.0f} B | {cost.gain:.2f} | {cost.possible:.2f} | "
            f"{cost.efficiency:.2f} | {hours:.2g} h, {megabytes:.2g} MB |")


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
    print(f"| runs of `{scene.name}` | processor time of a run | bytes of a run | {cores} cores, times faster | "
          f"what the machine allows | efficiency | a million runs, {cores} free cores |\n|---|---|---|---|---|---|---|")
    for name, design in designs.items():
        print(in_words(name, measured_cost(design, options.repeats, cores), cores), flush=True)
    return 0


def _parser() -> Parser:
    parser = Parser(prog="study_cost", description=EXECUTABLES["study_cost"].does)
    parser.add_argument("--scene", default="unilateral", metavar="NAME", help="shipped scene or scene file (default: "
                        "%(default)s)")
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="rounds (default: %(default)d)")
    return parser
