"""``study map``: the motions of a machine over motor speed and gap, as Parquet, pictures, and a file to command by."""

import argparse
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from vibro_ros.configuration.command_map import LARGEST, SIDES, CommandMap, parameters_that_count, written
from vibro_ros.process.front_door import Parser, exit_code, say
from vibro_ros.process.stop_signals import interrupted_code
from vibro_ros.process.untrusted import replace_file
from vibro_ros.study.locked_folder import locked
from vibro_ros.study.map.curves import curves, ends
from vibro_ros.study.map.design import MapDesign
from vibro_ros.study.map.motions import motions
from vibro_ros.study.map.options import BOTH, add_grid, design_of
from vibro_ros.study.map.picture import draw_costs, draw_map
from vibro_ros.study.map.proof import PROOFS, QUICK_PROOFS, proved
from vibro_ros.study.map.record import ENDS, LINES, STUDY, end_run, follow_ends, line_run, sweep_lines
from vibro_ros.study.map.visit import Visit
from vibro_ros.study.map.words import map_in_words, trials_in_words
from vibro_ros.study.options import add_runner, runner_of
from vibro_ros.study.running.origin import sources

TABLE, PICTURE, COSTS = "motions.parquet", "map.png", "costs.png"
CURVES = 11
"""Gaps at which motions are followed to their ends, unless another number is given."""


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    return exit_code("study", lambda: _map(_parser().parse_args(words)))


def _map(options: argparse.Namespace) -> int:
    runner = runner_of(options)
    design = design_of(options)
    gap_indices = _rows_of_curves(design, min(CURVES, design.gaps.count) if options.curves is None else options.curves)
    with locked(options.output):
        for folder in (LINES, ENDS):
            (options.output / folder).mkdir(exist_ok=True)
        under_way = [line_run(design, options.output / LINES)]
        try:
            under_way[0].find_done()
            visits = sweep_lines(under_way[0], design, runner)
            command_map, rows = _without_curves(design, visits)
            if gap_indices:
                all_ends = ends(command_map.found, rows, design.speeds, gap_indices)
                under_way.append(end_run(design, all_ends, options.output / ENDS))
                under_way[1].find_done()
                points = follow_ends(under_way[1], design, all_ends, runner)
                command_map = replace(command_map, curves=curves(design, points, gap_indices))
            command_map, trials = proved(command_map, design, QUICK_PROOFS if options.quick else PROOFS)
        except KeyboardInterrupt:
            say("study", f"interrupted; {under_way[-1].in_words}")
            return interrupted_code()
        _write(command_map, rows, options.output)
    print("\n".join([*map_in_words(command_map, visits), *trials_in_words(trials)]))
    return 0


def _without_curves(design: MapDesign, visits: list[Visit]) -> tuple[CommandMap, list[Visit]]:
    found, rows = motions(visits, design.speeds, design.gaps)
    if not rows:
        raise RuntimeError("no visit has settled, so that there is no map; give another scene or other motor speeds")
    parameters = parameters_that_count(design.scene, design.sides)
    return CommandMap(design.scene.name, parameters, design.sides, design.speeds, design.gaps, found, ()), rows


def _rows_of_curves(design: MapDesign, count: int) -> range:
    """Gaps, equally spaced and about as many as `count`, at which motions are followed to their ends."""
    if not 0 <= count <= design.gaps.count:
        raise ValueError(f"--curves: {count} is out of range; give a number from 0 to {design.gaps.count}, the gaps")
    return range(0, design.gaps.count, max(1, (design.gaps.count - 1) // max(1, count - 1))) if count else range(0)


def _write(command_map: CommandMap, rows: list[Visit], folder: Path) -> None:
    file = folder / f"{command_map.scene}.json"
    text = written(command_map, f"vibro_ros {sources(STUDY)['version']}").encode()
    if len(text) > LARGEST:
        raise RuntimeError(f"{file}: {len(text)} bytes are more than the {LARGEST} that a controller reads; give a "
                           "coarser grid")
    for path, content in ((file, text), (folder / TABLE, _table(command_map, rows)),
                          (folder / PICTURE, draw_map(command_map)), (folder / COSTS, draw_costs(command_map))):
        replace_file(path, content)
        print(path)


def _table(command_map: CommandMap, rows: list[Visit]) -> bytes:
    """All motions, with the values of the commands in place of indices."""
    found, speeds, gaps = command_map.found, command_map.speeds, command_map.gaps
    columns = {"motor_speed": (speeds.values[found.speed_index], "rad/s"), "gap": (gaps.values[found.gap_index], "m"),
               "motion": (found.motion, "1"), "turns": ([visit.turns for visit in rows], "1"),
               "landings": ([visit.landings for visit in rows], "1"), "mean_speed": (found.mean_speed, "m/s"),
               "cost_of_transport": (found.cost_of_transport, "1"), "stick_share": (found.stick_share, "1"),
               "air_share": (found.air_share, "1")}
    arrays = [pa.array(values) for values, _ in columns.values()]
    fields = [pa.field(name, array.type, metadata={"unit": unit})
              for (name, (_, unit)), array in zip(columns.items(), arrays, strict=True)]
    sink = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), sink, compression="zstd")
    return sink.getvalue()


def _parser() -> Parser:
    parser = Parser(
        prog="study map",
        description="Which motions a machine has at each motor speed and gap: rows and columns of a grid are swept up "
        "and down, each cell beginning with the state of the one before, so that motions that exist together are "
        "found. Writes the motions as Parquet, two pictures, and a command map for `controller`. Ctrl-C keeps what is "
        "done; the same command goes on from there.",
        epilog="Exit code 0: done; 1: the disk is full, or nothing settles; 2: bad input, or nowhere to write; 129, "
        "130, 143: stopped by SIGHUP, SIGINT, SIGTERM, finished lines are kept.")
    add_grid(parser)
    parser.add_argument("--gaps", choices=(BOTH, *SIDES), default=BOTH, help="gaps that are varied: of both plates "
                        f"alike, or of one (default: {BOTH})")
    parser.add_argument("--curves", type=int, metavar="N", help="gaps at which folds, doublings, Neimark-Sacker points "
                        "and grazings are located, which takes the longest; 0: none (default: 11, or all if fewer)")
    add_runner(parser)
    parser.add_argument("--output", type=Path, default=Path("out/study/map"), metavar="DIR",
                        help="where to write (default: out/study/map)")
    return parser
