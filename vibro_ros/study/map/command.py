"""``study map``: the motions of a machine over motor speed and gap, as Parquet, pictures, and a file to command by."""

import argparse
from collections.abc import Sequence
from dataclasses import replace

import pyarrow as pa

from vibro_ros.configuration.command_map import LARGEST, SIDES, CommandMap, parameters_that_count, written
from vibro_ros.process.front_door import Parser
from vibro_ros.simulation.provenance import software
from vibro_ros.study.command import add_runner, locked, run_study, runner_of, study_parser, write_files
from vibro_ros.study.map.design import BOTH, MapDesign, add_grid, design_of
from vibro_ros.study.map.motions import curves, ends, motions
from vibro_ros.study.map.proof import PROOFS, QUICK_PROOFS, proved
from vibro_ros.study.map.record import ENDS, LINES, points_of, visits_of
from vibro_ros.study.map.result import draw_costs, draw_map, map_in_words, trials_in_words
from vibro_ros.study.map.visits import Visit
from vibro_ros.study.running.blocks import file_of

TABLE, PICTURE, COSTS = "motions.parquet", "map.png", "costs.png"
CURVES = 11
"""Gaps at which motions are followed to their ends, unless another number is given."""


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    return run_study(_map, _parser(), words)


def _map(options: argparse.Namespace) -> int:
    runner = runner_of(options)
    design = design_of(options)
    gap_indices = _rows_of_curves(design, min(CURVES, design.gaps.count) if options.curves is None else options.curves)
    with locked(options.output):
        for folder in (LINES, ENDS):
            (options.output / folder).mkdir(exist_ok=True)
        visits = visits_of(design, options.output / LINES, runner)
        command_map, rows = _without_curves(design, visits)
        if gap_indices:
            all_ends = tuple(ends(command_map.found, rows, design.speeds, gap_indices))
            points = points_of(design, all_ends, options.output / ENDS, runner)
            command_map = replace(command_map, curves=curves(design, points, gap_indices))
        command_map, trials = proved(command_map, design, QUICK_PROOFS if options.quick else PROOFS)
        write_files(options.output, _files(command_map, rows))
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


def _files(command_map: CommandMap, rows: list[Visit]) -> dict[str, bytes]:
    """Command map, table and pictures by the names of their files."""
    name, text = f"{command_map.scene}.json", written(command_map, f"vibro_ros {software()['version']}").encode()
    if len(text) > LARGEST:
        raise RuntimeError(f"{name}: {len(text)} bytes are more than the {LARGEST} that a controller reads; give a "
                           "coarser grid")
    return {name: text, TABLE: _table(command_map, rows), PICTURE: draw_map(command_map),
            COSTS: draw_costs(command_map)}


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
    return file_of(pa.Table.from_arrays(arrays, schema=pa.schema(fields)))


def _parser() -> Parser:
    parser = study_parser(
        "map", "Find the motions of a machine at each motor speed and gap: rows and columns of a grid are swept up and "
        "down, each cell beginning with the state of the one before, so that motions that exist together are found. "
        "Writes the motions as Parquet, two pictures, and a command map for `controller`.",
        "the disk is full, or nothing settles")
    add_grid(parser)
    parser.add_argument("--gaps", choices=(BOTH, *SIDES), default=BOTH, help="gaps that are varied: of both plates "
                        f"alike, or of one (default: {BOTH})")
    parser.add_argument("--curves", type=int, metavar="N", help="gaps at which folds, doublings, Neimark-Sacker points "
                        "and grazings are located, which takes the longest; 0: none (default: 11, or all if fewer)")
    add_runner(parser)
    return parser
