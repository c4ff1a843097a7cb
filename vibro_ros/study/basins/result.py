"""The result of a study of basins as tables: where each start leads, and what the motions are."""

import io
from collections.abc import Iterable

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vibro_ros.study.basins.attractors import Found
from vibro_ros.study.basins.blocks import NUMBERS
from vibro_ros.study.running.parquet_blocks import Column, field


def starts_table(table: pa.Table, found: Found) -> bytes:
    """All starts with the numbers of their attractors, as a Parquet file."""
    columns = [column(table, name) for name in table.column_names if name != "states"]
    columns.insert(-4, Column("attractor", pa.array(found.numbers, pa.int64()), "1", "number of the motion that the "
                              "start leads to; 0: nothing had settled; -1: it cannot start, or not go on; -2: another "
                              "motion than those that are told apart"))
    return _file(columns)


def attractors_table(found: Found, upsets: list[pa.Table]) -> bytes:
    """All attractors, with what upsets them, as a Parquet file."""
    each = found.attractors
    columns = [
        _column("attractor", range(1, len(each) + 1), pa.int64(), "1", "number of the motion"),
        _column("turns", [one.motion.turns for one in each], pa.int64(), "1", "turns after which it repeats itself, 0: "
                "it does not"),
        _column("mean_speed", [one.motion.mean_speed for one in each], pa.float64(), "m/s", "of the body, forward "
                "positive"),
        _column("starts", [one.count for one in each], pa.int64(), "1", "starts that lead to it"),
        *(_column(name, [getattr(one.fraction, part) for one in each], pa.float64(), "1", meaning)
          for name, part, meaning in (("fraction", "share", "of the starts that can be"),
                                      ("fraction_low", "low", "lower end of its 95 % interval"),
                                      ("fraction_high", "high", "upper end of its 95 % interval"))),
        _column("lyapunov_exponent", [one.lyapunov for one in each], pa.float64(), "1/s", "the largest one"),
        *(_column(f"multipliers_{name}", [part(one.multipliers).tolist() for one in each], NUMBERS, "1",
                  f"{name} parts of its Floquet multipliers, the largest first")
          for name, part in (("real", np.real), ("imaginary", np.imag))),
        _column("states", [one.motion.states.ravel() for one in each], NUMBERS, "1", "at successive cuts, one after "
                "the other, in crank radii and crank radii times motor speed"),
    ]
    shocks = pa.concat_tables([one.replace_schema_metadata() for one in upsets]) if upsets else None
    if shocks is not None:
        columns += [column(shocks, name)._replace(name=f"shock_{name}") for name in shocks.column_names[1:]]
    return _file(columns)


def column(table: pa.Table, name: str) -> Column:
    """A column of a block's table."""
    told = table.schema.field(name).metadata
    return Column(name, table[name].combine_chunks(), told[b"unit"].decode(), told[b"meaning"].decode())


def _column(name: str, values: Iterable, kind: pa.DataType, unit: str, meaning: str) -> Column:
    return Column(name, pa.array(list(values), kind), unit, meaning)


def _file(columns: list[Column]) -> bytes:
    sink = io.BytesIO()
    schema = pa.schema([field(one) for one in columns])
    pq.write_table(pa.Table.from_arrays([one.values for one in columns], schema=schema), sink, compression="zstd")
    return sink.getvalue()
