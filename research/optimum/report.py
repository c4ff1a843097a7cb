"""docs/optimum.md: what `study optimise` finds, and why V/P has no bound by the paper's equations.

Each search is a command line that a reader can run. A search that was interrupted goes on when the report is made
again.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from matplotlib.figure import Figure

from research.optimum.lasting import DURATIONS, Lasting, lasting
from research.optimum.result_file import read_result
from research.optimum.text import (
    FOLDER,
    FRONTS,
    LASTING_TRIALS,
    SEARCHES,
    document,
    front_of_all,
    of_device,
    plan,
)
from vibro_ros.accuracy.figures import new_figure, tidy
from vibro_ros.accuracy.starts import Average
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.process.front_door import Parser, exit_code
from vibro_ros.simulation.preparation import prepare_kernels
from vibro_ros.simulation.processes import core_count
from vibro_ros.study.command import write_files
from vibro_ros.study.optimise.command import NUMBERS, RECORD, SCENE, files_of, shown
from vibro_ros.study.optimise.result import Result, studied

TEXT, LASTING = "optimum.md", "lasting.json"


def main(words: Sequence[str]) -> int:
    """Search and write; 0 when done; see `front_door.exit_code` for errors."""
    return exit_code("optimum_report", lambda: _report(words))


def _report(words: Sequence[str]) -> int:
    own = Parser(prog="optimum_report", description=__doc__)
    own.add_argument("docs", type=Path, nargs="?", default=Path("docs"), help="where (default: %(default)s)")
    own.add_argument("--work", type=Path, default=Path("out/study/optimum"), help="records of the searches, from which "
                     "they go on (default: %(default)s)")
    options = own.parse_args(words)
    folder = options.docs / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    prepare_kernels("optimum_report", "exact")
    results = {name: _search(name, options.work / name, folder) for name in SEARCHES}
    scenes = {"paper": load_scene("paper"), **{name: result.robot for name, result in results.items()
                                               if not result.robot["effects.reaction"]}}
    watched = {}
    for name, scene in scenes.items():
        with shown(f"{name} for long", len(DURATIONS)) as progress:
            watched[name] = lasting(scene, LASTING_TRIALS, DURATIONS, progress)
    (folder / LASTING).write_text(json.dumps({name: [asdict(row) for row in rows] for name, rows in watched.items()},
                                             indent=1) + "\n", encoding="utf-8")
    draw_all_fronts(results).savefig(folder / FRONTS)
    (options.docs / TEXT).write_text(document(results, watched), encoding="utf-8")
    print(options.docs / TEXT)
    return 0


def _search(name: str, work: Path, folder: Path) -> Result:
    """Search, or go on; what the document needs goes into `folder`."""
    work.mkdir(parents=True, exist_ok=True)
    result, candidates = studied(plan(name), work / RECORD, core_count(), shown)
    write_files(work, files_of(result, candidates))
    for file, ending in ((NUMBERS, ".json"), (SCENE, ".yaml")):
        (folder / f"{name}{ending}").write_bytes((work / file).read_bytes())
    return read_result(work / NUMBERS, plan(name))


def draw_all_fronts(results: Mapping[str, Result]) -> Figure:
    """The picture of `about_front`: the front of each search, the front of them all, and the paper's robots."""
    figure = new_figure(8.0, 5.5)
    axes = figure.subplots()
    tidy(axes)
    for name, result in of_device(results).items():
        speeds, costs = [1e3 * one.speed for one in result.front], [one.cost for one in result.front]
        axes.plot(speeds, costs, "o", ms=4.0, label=name)
    whole = front_of_all(results)
    axes.plot([1e3 * one.speed for one in whole], [one.cost for one in whole], "-o", ms=3.0, color="#000000",
              label="front, from fresh starts")
    for row, mark in zip(results["front"].verified[1:3], "sD", strict=True):
        axes.plot(1e3 * row.speed.mean, row.cost, mark, ms=8.0, color="#009e73", label=row.robot)
    axes.set(xscale="log", yscale="log", xlabel="mean speed [mm/s]", ylabel="cost of transport P / (M g V) [-]")
    axes.legend(frameon=False, fontsize=8)
    return figure


def watched_of(path: Path) -> dict[str, list[Lasting]]:
    """Rows of `lasting` by robot, from a file of this report."""
    return {name: [Lasting(**{**row, "speed": Average(**row["speed"]), "delivered": Average(**row["delivered"])})
                   for row in rows] for name, rows in json.loads(path.read_text(encoding="utf-8")).items()}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
