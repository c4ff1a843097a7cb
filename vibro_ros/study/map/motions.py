"""Which of the motions that were found are one and the same: in a cell, and from cell to cell.

In a cell two visits have found the same motion when all that the map says of it agrees. Motions of neighbouring cells
are one where the period and the landings are equal and the mean speed changes little. Two motions that exist in one
cell are never one, whatever way leads from the one to the other through other cells: a fold ends where its two sheets
meet, and behind that end they are told apart nowhere.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from vibro_ros.configuration.command_map import PATCHWORK, Axis, Found
from vibro_ros.study.map.visit import UNSETTLED, Visit

LONG = 8
"""Turns beyond which a period tells nothing: a longer one counts as none, because a small change of the commands ends
it, and visits that settle slowly do not find it alike."""
LEAST_CELLS = 8
"""Cells of a motion that gets a number; smaller ones are `PATCHWORK`."""
_STEADY, _NOISY = (1e-5, 1e-4), (2e-3, 0.1)  # m/s, and share: differences of mean speeds of one motion in a cell
_FROM_CELL_TO_CELL = (3e-3, 0.25)  # the same of neighbouring cells


def motions(visits: Iterable[Visit], speeds: Axis, gaps: Axis) -> tuple[Found, list[Visit]]:
    """The motions of each cell, with their numbers; and for each a visit that has found it.

    Parameters
    ----------
    visits : iterable of Visit
        Those that have not settled say nothing.
    speeds, gaps : Axis
        The grid.
    """
    in_cell: dict[tuple[int, int], list[Visit]] = defaultdict(list)
    for visit in visits:
        cell = in_cell[visit.speed_index, visit.gap_index]
        if visit.turns != UNSETTLED and not any(_same(visit, other) for other in cell):
            cell.append(visit)
    for cell in in_cell.values():
        cell.sort(key=lambda visit: visit.mean_speed)
    rows = [visit for _, cell in sorted(in_cell.items()) for visit in cell]
    numbers = _numbers(rows, (speeds.count, gaps.count))
    columns = {name: np.array([getattr(visit, name) for visit in rows]) for name in Found.__dataclass_fields__
               if name not in ("motion", "sure")}
    short = columns["turns"] <= LONG
    columns |= {name: np.where(short, columns[name], 0) for name in ("turns", "landings")}
    alone = np.array([len(in_cell[visit.speed_index, visit.gap_index]) == 1 for visit in rows])
    sure = alone & (columns["turns"] > 0) & (numbers > PATCHWORK)
    return Found(motion=numbers, sure=sure.astype(int), **columns), rows


def _close(one: Visit, other: Visit, tolerance: tuple[float, float]) -> bool:
    most = max(abs(one.mean_speed), abs(other.mean_speed))
    return abs(one.mean_speed - other.mean_speed) <= tolerance[0] + tolerance[1] * most


def _kind(visit: Visit) -> tuple[int, int]:
    return (visit.turns, visit.landings) if 0 < visit.turns <= LONG else (0, 0)


def _same(one: Visit, other: Visit) -> bool:
    return _kind(one) == _kind(other) and _close(one, other, _STEADY if _kind(one)[0] else _NOISY)


def _numbers(rows: Sequence[Visit], shape: tuple[int, int]) -> np.ndarray:
    """Number of each row's motion, 0 for that of the most cells."""
    groups = _Groups([(visit.speed_index, visit.gap_index) for visit in rows])
    for first, last in sorted(_links(rows, shape), key=lambda pair: abs(
            rows[pair[0]].mean_speed - rows[pair[1]].mean_speed)):
        groups.join(first, last)
    members = groups.members()
    numbers = np.full(len(rows), PATCHWORK)
    for number, group in enumerate(sorted((one for one in members if len(one) >= LEAST_CELLS), key=len, reverse=True)):
        numbers[group] = number
    return numbers


def _links(rows: Sequence[Visit], shape: tuple[int, int]) -> Iterable[tuple[int, int]]:
    """Pairs of rows in neighbouring cells that may be one motion."""
    at: dict[tuple[int, int], list[int]] = defaultdict(list)
    for row, visit in enumerate(rows):
        at[visit.speed_index, visit.gap_index].append(row)
    for (i, j), here in at.items():
        for beside in (at.get((i + 1, j), ()), at.get((i, j + 1), ())):
            yield from ((first, last) for first in here for last in beside
                        if _kind(rows[first]) == _kind(rows[last])
                        and _close(rows[first], rows[last], _FROM_CELL_TO_CELL))


class _Groups:
    """Rows that are joined to groups, no two of one cell to the same."""

    def __init__(self, cells: Sequence[tuple[int, int]]):
        self._group = list(range(len(cells)))
        self._rows = {row: [row] for row in range(len(cells))}
        self._cells = {row: {cell} for row, cell in enumerate(cells)}

    def join(self, first: int, last: int) -> None:
        """Join the groups of two rows, unless they share a cell."""
        small, large = sorted((self._group[first], self._group[last]), key=lambda group: len(self._rows[group]))
        if small == large or self._cells[small] & self._cells[large]:
            return
        for row in self._rows[small]:
            self._group[row] = large
        self._rows[large] += self._rows.pop(small)
        self._cells[large] |= self._cells.pop(small)

    def members(self) -> list[list[int]]:
        """The rows of each group."""
        return list(self._rows.values())
