"""``study map``: the motions of a machine over motor speed and gap, as Parquet, pictures, and a file to command by."""

import argparse
import hashlib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import pyarrow as pa

from vibro_ros.configuration.command_map import LARGEST, SIDES, CommandMap, parameters_that_count, written
from vibro_ros.orbits.continuation import KINDS
from vibro_ros.orbits.turn_map import check_closes, coordinates, is_sampled
from vibro_ros.process.entry_point import Parser
from vibro_ros.simulation.provenance import software
from vibro_ros.study.command import add_execution, execution_of, locked, run_study, study_parser, write_files
from vibro_ros.study.execution import Execution
from vibro_ros.study.map.motions import PROOFS, QUICK_PROOFS, End, Point, curves, end_point, ends, motions, proved
from vibro_ros.study.map.result import draw_costs, draw_map, map_in_words, trials_in_words
from vibro_ros.study.map.visits import BOTH, PHASE, UNSETTLED, MapDesign, Visit, add_grid, design_of, visits
from vibro_ros.study.table import Field, Study, are, computed, file_of

TABLE, PICTURE, COSTS = "motions.parquet", "map.png", "costs.png"
CURVES = 11
"""Gaps at which motions are followed to their ends, unless another number is given."""


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    return run_study(_map, _parser(), words)


def _map(options: argparse.Namespace) -> int:
    execution = execution_of(options)
    design = design_of(options)
    gap_indices = _rows_of_curves(design, options.curves)
    with locked(options.output):
        for folder in (LINES, ENDS):
            (options.output / folder).mkdir(exist_ok=True)
        visits = visits_of(design, options.output / LINES, execution)
        found, rows = motions(visits)
        if not rows:
            raise RuntimeError("no visit has settled, so that there is no map; give another scene or other speeds")
        parameters = parameters_that_count(design.scene, design.sides)
        command_map = CommandMap(design.scene.name, parameters, design.sides, design.speeds, design.gaps, found, ())
        if gap_indices:
            all_ends = tuple(ends(command_map.found, rows, design.speeds, gap_indices))
            points = points_of(design, all_ends, options.output / ENDS, execution)
            command_map = replace(command_map, curves=curves(design, points, gap_indices))
        command_map, trials = proved(command_map, design, QUICK_PROOFS if options.quick else PROOFS)
        write_files(options.output, _files(command_map, rows))
    print("\n".join([*map_in_words(command_map, visits), *trials_in_words(trials)]))
    return 0


def _rows_of_curves(design: MapDesign, asked: int | None) -> range:
    """Gaps, equally spaced and about as many as `asked`, at which motions are followed to their ends."""
    count = (0 if is_sampled(design.scene) else min(CURVES, design.gaps.count)) if asked is None else asked
    if count:
        check_closes(design.scene)
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
                        "and grazings are located, which takes the longest; 0: none, as with a dc motor, whose orbits "
                        "do not close (default: 11, or all if fewer)")
    add_execution(parser)
    return parser


#: Folders of the two records.
LINES, ENDS = "lines", "ends"
_STATE = "state."  # begins the names of coordinates
_RUN_TIME = 20.0  # robot time [s] of a visit, and of an end, about
_VISIT = [
    Field("speed_index", pa.int64(), "1", "index of the motor speed in the grid"),
    Field("gap_index", pa.int64(), "1", "index of the gap in the grid"),
    Field("turns", pa.int64(), "1", "turns after which the motion repeats itself; 0: it does not; -1: it did not "
          "settle"),
    Field("landings", pa.int64(), "1", "landings of the body within these turns"),
    Field("mean_speed", pa.float64(), "m/s", "of the body, forwards positive"),
    Field("cost_of_transport", pa.float64(), "1", "mean power / (weight x speed)"),
    Field("stick_share", pa.float64(), "1", "share of the time in which the body stands on the ground"),
    Field("air_share", pa.float64(), "1", "share of the time in which the body is in the air"),
]
_POINT = [
    Field("kind", pa.string(), "1", "what becomes of the motion; null where its branch goes on or is lost",
          True),
    Field("turns", pa.int64(), "1", "turns after which the motion repeats itself"),
    Field("motion", pa.int64(), "1", "number of the motion"),
    Field("direction", pa.int64(), "1", "1 towards larger motor speeds, -1 towards smaller"),
    Field("gap_index", pa.int64(), "1", "index of the gap in the grid"),
    Field("motor_speed", pa.float64(), "rad/s", "where that is"),
]


def visits_of(design: MapDesign, lines: Path, execution: Execution) -> list[Visit]:
    """All visits of a map; lines that are missing in the folder `lines` are swept (see `computed`)."""
    every = design.lines()
    names = [f"{_STATE}{name}" for name in coordinates(design.scene)]
    fields = [*_VISIT, *(Field(name, pa.float64(), f"crank.radius{' x motor.speed' * name.endswith('velocity')}",
                               f"{name.removeprefix(_STATE)} at the cut, crank angle {PHASE:.6g} rad", True)
                         for name in names)]

    def are_own(numbers: Sequence[int], rows: list[dict]) -> bool:
        cells = [cell for number in numbers for cell in design.cells(every[number])]
        return are(rows, [{"speed_index": i, "gap_index": j} for i, j in cells]) and all(
            row["turns"] >= UNSETTLED and all((row[name] is None) == (row["turns"] == UNSETTLED) for name in names)
            for row in rows)

    run_time = _RUN_TIME * max(design.speeds.count, design.gaps.count)
    rows = computed(Study("lines visited", design.document(), fields, partial(rows_of_line, design), are_own, run_time,
                          ("exact",), len(every)), lines, execution).to_pylist()
    return [Visit(**{one.name: row[one.name] for one in _VISIT}, state=tuple(
        value for name, value in row.items() if name.startswith(_STATE) and value is not None))
        for row in rows]


def rows_of_line(design: MapDesign, number: int) -> list[dict]:
    """Sweep the line of a number; a row a visit."""
    names = [f"{_STATE}{name}" for name in coordinates(design.scene)]
    return [{**one._asdict(), **dict(zip(names, one.state, strict=False))}
            for one in visits(design, design.lines()[number])]


def points_of(design: MapDesign, ends: tuple[End, ...], folder: Path, execution: Execution) -> list[Point]:
    """The special point of each end that has one; points that are missing in the folder are looked for."""
    if not ends:
        return []
    document = {**design.document(), "ends": hashlib.sha256(repr(list(ends)).encode()).hexdigest()}

    def are_own(numbers: Sequence[int], rows: list[dict]) -> bool:
        return are(rows, [{name: getattr(ends[number], name) for name in ("turns", "motion", "direction", "gap_index")}
                          for number in numbers]) and all(row["kind"] in (None, *KINDS) for row in rows)

    rows = computed(Study("ends of motions followed", document, _POINT, partial(_row_of_end, design, ends), are_own,
                          20.0 * _RUN_TIME, ("exact",), len(ends)), folder, execution).to_pylist()
    return [Point(**row) for row in rows if row["kind"] is not None]


def _row_of_end(design: MapDesign, ends: tuple[End, ...], number: int) -> list[dict]:
    return [end_point(design, ends[number])._asdict()]
