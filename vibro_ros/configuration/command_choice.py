"""Choose motor speed and gap for a mean speed of the body, at a point of the map where no other motion is possible.

The mean speed is interpolated between neighbouring cells that have the same sure motion (`Found.sure`). Of all points
with the wanted mean speed, the one farthest from any cell that is not sure or has another motion is chosen; among
equally far ones, the one between the cells whose mean speeds differ least, because interpolation is most exact there.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from vibro_ros.configuration.command_map import CommandMap

FAR = 4
"""Distance [cells] from the border of a motion beyond which all points count as equally far."""
_NOT_SURE = -2
_NEIGHBOURS = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))


class Choice(NamedTuple):
    """Commands for a mean speed, by name, in the units of the topics, and where they lie in the map.

    The point lies between two cells of the map: `rows` are their rows in `Found`, `row` that of the nearer one. It is
    `clearance` cells, 1 to `FAR`, from the border of the motion.
    """

    commands: Mapping[str, float]
    row: int
    rows: tuple[int, int]
    clearance: int


class CommandChoice:
    """Chooses commands from the map of a machine (ValueError when the map has no choice, see `has_choice`).

    `slowest` and `fastest` are the signed mean speeds [m/s] of least and largest magnitude among the cells between
    which commands can be chosen.
    """

    def __init__(self, command_map: CommandMap):
        self._map = command_map
        if not has_choice(command_map):
            raise ValueError(f"the map of {command_map.scene} has no two neighbouring cells with one and the same sure "
                             "motion; give motor_speed and gaps")
        rows = _sure_rows(command_map)
        clearance = _clearance(np.where(rows >= 0, command_map.found.motion[rows], _NOT_SURE))
        self._first, self._last, self._clear = _edges(rows, clearance, command_map)
        speeds = command_map.found.mean_speed
        self._from, self._to = speeds[self._first], speeds[self._last]
        ends = np.concatenate([self._from, self._to])
        self.slowest, self.fastest = (float(ends[find(np.abs(ends))]) for find in (np.argmin, np.argmax))

    @property
    def covered(self) -> float:
        """Share of the range from `slowest` to `fastest` for which commands exist, dimensionless."""
        if self.slowest == self.fastest:
            return 1.0
        reached, covered = -np.inf, 0.0
        for low, high in sorted(zip(np.minimum(self._from, self._to), np.maximum(self._from, self._to), strict=True)):
            covered += max(0.0, high - max(low, reached))
            reached = max(reached, high)
        return float(covered / abs(self.fastest - self.slowest))

    def commands_for(self, speed: float) -> Choice:
        """Return the commands for a mean speed [m/s] of the body.

        Raises
        ------
        ValueError
            When no commands surely give this mean speed; the message names the range, or the nearest possible speeds.
        """
        span = self._to - self._from
        share = np.where(span == 0.0, 0.0, (speed - self._from) / np.where(span == 0.0, 1.0, span))
        within = np.flatnonzero((share >= 0.0) & (share <= 1.0) & ((span != 0.0) | (self._from == speed)))
        if not len(within):
            low, high = sorted((self.slowest, self.fastest))
            if not low <= speed <= high:
                raise ValueError(f"{speed:g} m/s is out of range of the map of {self._map.scene}; give a mean speed "
                                 f"from {low:.4g} to {high:.4g} m/s")
            ends = np.concatenate([self._from, self._to])
            raise ValueError(f"no command of the map of {self._map.scene} surely gives {speed:g} m/s; the nearest that "
                             f"one gives are {ends[ends < speed].max():.4g} and {ends[ends > speed].min():.4g} m/s")
        best = within[np.lexsort([np.abs(span[within]), -self._clear[within]])[0]]
        first, last, at = self._first[best], self._last[best], share[best]
        motor, gap = (axis.values[index[first]] + at * (axis.values[index[last]] - axis.values[index[first]])
                      for axis, index in ((self._map.speeds, self._map.found.speed_index),
                                          (self._map.gaps, self._map.found.gap_index)))
        values = (float(f"{motor:.6g}"), *[round(float(gap), 8)] * len(self._map.sides))
        return Choice(dict(zip(self._map.commands, values, strict=True)), int(first if at < 0.5 else last),
                      (int(first), int(last)), int(self._clear[best]))


def has_choice(command_map: CommandMap) -> bool:
    """Return whether two neighbouring cells have the same sure motion, so that commands between them can be chosen."""
    rows = _sure_rows(command_map)
    return bool(len(_edges(rows, np.zeros(rows.shape, dtype=int), command_map)[0]))


def _sure_rows(command_map: CommandMap) -> np.ndarray:
    """Return the row of each sure cell, -1 for the other cells; shape (speeds, gaps)."""
    found = command_map.found
    rows = np.full((command_map.speeds.count, command_map.gaps.count), -1)
    sure = np.flatnonzero(found.sure)
    rows[found.speed_index[sure], found.gap_index[sure]] = sure
    return rows


def _clearance(motion: np.ndarray) -> np.ndarray:
    """Return each cell's distance [cells, diagonals count 1] to the nearest that is unsure or of another motion.

    The distance is at most `FAR`, and 0 where the cell itself is not sure.
    """
    far = np.zeros(motion.shape, dtype=int)
    inside = motion != _NOT_SURE
    for _ in range(FAR):
        far += inside
        padded, motions = np.pad(inside, 1), np.pad(motion, 1, constant_values=_NOT_SURE)
        for i, j in _NEIGHBOURS:
            beside = np.s_[1 + i:1 + i + motion.shape[0], 1 + j:1 + j + motion.shape[1]]
            inside = inside & padded[beside] & (motions[beside] == motion)
    return far


def _edges(rows: np.ndarray, clearance: np.ndarray, command_map: CommandMap) -> tuple[np.ndarray, ...]:
    """Return, for each pair of neighbouring sure cells of the same motion, both rows and the smaller clearance."""
    found = []
    for here, there in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
        first, last = rows[here].ravel(), rows[there].ravel()
        clear = np.minimum(clearance[here], clearance[there]).ravel()
        motion = command_map.found.motion
        pairs = (first >= 0) & (last >= 0) & (motion[first] == motion[last])
        found.append((first[pairs], last[pairs], clear[pairs]))
    return tuple(np.concatenate(column) for column in zip(*found, strict=True))
