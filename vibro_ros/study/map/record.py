"""The lines of a map that are done: one Parquet file a line, from which the same command goes on."""

import io
import json
import os
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from vibro_ros.process.regular_file import content, is_temporary, replace_file
from vibro_ros.study.map.design import Line, MapDesign
from vibro_ros.study.map.origin import sources
from vibro_ros.study.map.visit import Visit

FOLDER, KEY = "lines", b"vibro_ros"
_LARGEST = 2**26  # bytes of a line's file
_COLUMNS = {
    "speed_index": (pa.int64(), "1", "index of the motor speed in the grid"),
    "gap_index": (pa.int64(), "1", "index of the gap in the grid"),
    "turns": (pa.int64(), "1", "turns after which the motion repeats itself; 0: it does not; -1: it did not settle"),
    "landings": (pa.int64(), "1", "landings of the body within these turns"),
    "mean_speed": (pa.float64(), "m/s", "of the body, forwards positive"),
    "cost_of_transport": (pa.float64(), "1", "mean power / (weight x speed)"),
    "stick_share": (pa.float64(), "1", "share of the time in which the body stands on the ground"),
    "air_share": (pa.float64(), "1", "share of the time in which the body is in the air"),
    "state": (pa.list_(pa.float64()), "crank.radius; crank.radius x motor.speed",
              "one state at the cut, coordinates of `orbits.turn_map`"),
}


class LineRecord:
    """The files of a map's lines in a folder.

    Parameters
    ----------
    folder : Path
        Where they are; it exists, and nobody else writes into it.
    design : MapDesign
        What they are of.
    """

    def __init__(self, folder: Path, design: MapDesign):
        self._folder, self._design = folder, design
        self._study = json.loads(json.dumps({**sources(), "map": design.document()}))

    def path(self, line: Line) -> Path:
        """The file of a line."""
        return self._folder / f"{line.name}.parquet"

    def check_folder(self) -> None:
        """Delete what an interrupted write has left (ValueError for files of another study)."""
        own = {self.path(line).name for line in self._design.lines()}
        for name in sorted(os.listdir(self._folder)):
            if is_temporary(name) and name[1:].partition(".parquet")[0] + ".parquet" in own:
                (self._folder / name).unlink()
            elif name not in own:
                raise ValueError(f"{self._folder / name}: is no line of this map; give another --output, or delete "
                                 "that folder")

    def write(self, line: Line, visits: Sequence[Visit]) -> None:
        """Put a line on the disk (OSError)."""
        columns = [pa.array([getattr(visit, name) for visit in visits], kind)
                   for name, (kind, _, _) in _COLUMNS.items()]
        sink = io.BytesIO()
        pq.write_table(pa.Table.from_arrays(columns, schema=self._schema(line)), sink, compression="zstd",
                       write_page_checksum=True)
        replace_file(self.path(line), sink.getvalue())

    def read(self, line: Line) -> list[Visit] | None:
        """A line; None where there is no file, or a damaged one.

        Raises
        ------
        ValueError
            For a whole file of another map or version.
        OSError
            For one that cannot be read.
        """
        path, wanted = self.path(line), self._schema(line)
        if not os.path.lexists(path):
            return None
        data = content(path, _LARGEST, follow=False)
        try:
            table = pq.ParquetFile(io.BytesIO(data), page_checksum_verification=True).read()
            metadata = json.loads((table.schema.metadata or {})[KEY])
        except (pa.ArrowException, OSError, KeyError, ValueError, RecursionError):
            return None
        if metadata != json.loads(wanted.metadata[KEY]) or not table.schema.equals(wanted):
            raise ValueError(f"{path}: is of another map, scene or version; give another --output, or delete that "
                             "folder")
        found = [Visit(**{**row, "state": tuple(row["state"])}) for row in table.to_pylist()]
        cells = [(visit.speed_index, visit.gap_index) for visit in found]
        return found if cells == list(self._design.cells(line)) else None

    def _schema(self, line: Line) -> pa.Schema:
        fields = [pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})
                  for name, (kind, unit, meaning) in _COLUMNS.items()]
        return pa.schema(fields, metadata={KEY: json.dumps({**self._study, "line": line.name})})
