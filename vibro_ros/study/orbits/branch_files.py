"""The files of a study of orbits: one a branch, a row an orbit or special point, in the order of the branch."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.branch import Branch, Special
from vibro_ros.orbits.turn_map import coordinates
from vibro_ros.study.orbits.plan import Plan
from vibro_ros.study.running.parquet_blocks import Column, ParquetBlocks

FOLDER = "branches"
MOST_BRANCHES = 10_000
_LIST = pa.list_(pa.field("element", pa.float64()))  # as a file that is read has it


class BranchFiles(ParquetBlocks[Branch]):
    """The files of a plan in a folder.

    Parameters
    ----------
    folder : Path
        Where they are; it exists.
    plan : Plan
        What they hold.
    """

    def __init__(self, folder: Path, plan: Plan):
        super().__init__(folder, "orbits", plan.document(), MOST_BRANCHES)
        self._plan = plan

    def is_own(self, block: int, table: pa.Table) -> bool:
        """Whether the rows are those of a branch that this plan may have."""
        try:
            branch = branch_of(table, self._plan.name, coordinates(self._plan.scene))
            return self.is_of(block, table, [branch])
        except (LookupError, TypeError, ValueError, OverflowError):
            return False

    def columns(self, block: int, found: Sequence[Branch]) -> list[Column]:
        """The columns of a branch."""
        return columns_of(*found)


def columns_of(branch: Branch) -> list[Column]:
    """A row an orbit or special point, in the order of the branch."""
    rows = _rows(branch)

    def column(name: str, kind: pa.DataType, unit: str, meaning: str, value: Callable[[int | Special], Any]) -> Column:
        return Column(name, pa.array([value(row) for row in rows], kind), unit, meaning)

    def either(of_orbit: np.ndarray, of_special: Callable[[Special], Any]) -> Callable[[int | Special], Any]:
        return lambda row: of_special(row) if isinstance(row, Special) else of_orbit[row].tolist()

    def special(value: Callable[[Special], Any]) -> Callable[[int | Special], Any]:
        return lambda row: value(row) if isinstance(row, Special) else None

    parameter, multipliers = BY_NAME[branch.name], branch.multipliers
    return [
        column("kind", pa.string(), "1", "of a special point; null for an orbit between them",
               special(lambda s: s.kind)),
        column(branch.name, pa.float64(), parameter.unit or "1", parameter.description,
               either(branch.values, lambda s: s.value)),
        column("width", pa.float64(), parameter.unit or "1", "of the interval that holds the special point",
               special(lambda s: s.width)),
        column("turns", pa.int64(), "1", "of the crank, after which the motion repeats itself", lambda _: branch.turns),
        column("mean_speed", pa.float64(), "m/s", "of the body, forwards positive",
               either(branch.mean_speeds, lambda s: s.mean_speed)),
        column("stable", pa.bool_(), "1", "whether small disturbances die out; null for a special point",
               either(branch.stable, lambda _: None)),
        column("multipliers_real", _LIST, "1", "Floquet multipliers, the largest first",
               either(multipliers.real, lambda s: s.multipliers.real.tolist())),
        column("multipliers_imag", _LIST, "1", "their imaginary parts",
               either(multipliers.imag, lambda s: s.multipliers.imag.tolist())),
        column("phase", pa.float64(), "rad", "crank angle at the cut", either(branch.phases, lambda s: s.phase)),
        column("state", _LIST, "1", "at the cut, in units of the machine",
               either(branch.states, lambda s: s.state.tolist())),
        *(column(name, _LIST, "m/s" if name.endswith("velocity") else "m",
                 "each time the crank passes the angle 0; null for a special point", either(values, lambda _: None))
          for name, values in branch.strobe.items()),
        column("change", pa.string(), "1", "of the events, at a grazing or corner",
               special(lambda s: s.change or None)),
        column("end", pa.string(), "1", "why the branch was not followed further; in its last row",
               lambda row: branch.end if row is rows[-1] else None),
    ]


def branch_of(table: pa.Table, name: str, names: Sequence[str]) -> Branch:
    """The branch of at least one row that a file holds, of the parameter `name` and with the coordinates `names`."""
    rows = table.to_pylist()
    turns, end = int(rows[0]["turns"]), rows[-1]["end"]
    orbits = [row for row in rows if row["kind"] is None]
    special, before = [], 0
    for row in rows:
        if row["kind"] is None:
            before += 1
        else:
            special.append(Special(row["kind"], row[name], row["width"], row["mean_speed"], _complex(row),
                                   row["change"] or "", row["phase"], np.array(row["state"]), before))
    n = len(names)
    return Branch(
        name, turns, _array(orbits, name), _array(orbits, "mean_speed"),
        np.array([_complex(row) for row in orbits], dtype=complex).reshape(-1, n), _array(orbits, "phase"),
        _array(orbits, "state").reshape(-1, n),
        {one: _array(orbits, one).reshape(-1, turns) for one in names}, tuple(special), end)


def _rows(branch: Branch) -> list[int | Special]:
    rows: list[int | Special] = list(range(len(branch)))
    for number, special in enumerate(branch.special_points):
        rows.insert(special.at + number, special)
    return rows


def _array(rows: Sequence[dict[str, Any]], key: str) -> np.ndarray:
    return np.array([row[key] for row in rows], dtype=float)


def _complex(row: dict[str, Any]) -> np.ndarray:
    return np.array(row["multipliers_real"]) + 1j * np.array(row["multipliers_imag"])
