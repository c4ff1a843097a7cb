"""Which of the motions that were found are one and the same: in a cell, and from cell to cell.

In a cell two visits have found the same motion when all that the map says of it agrees. Motions of neighbouring cells
are one where the period and the landings are equal and the mean speed changes little. Two motions that exist in one
cell are never one, whatever way leads from the one to the other through other cells: a fold ends where its two sheets
meet, and behind that end nothing separates them.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from vibro_ros.configuration.command_choice import Choice, CommandChoice, has_choice
from vibro_ros.configuration.command_map import PATCHWORK, Axis, CommandMap, Curve, Found
from vibro_ros.orbits.continuation import CORNER, follow, special_points
from vibro_ros.orbits.family import Family, LostError
from vibro_ros.orbits.starts import drawn_start
from vibro_ros.orbits.turn_map import TURN
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.preparation import provide_kernels
from vibro_ros.simulation.processes import core_count, in_processes
from vibro_ros.study.map.visits import PHASE, UNSETTLED, MapDesign, Visit
from vibro_ros.study.progress import Progress

LONG = 8
"""Turns beyond which a period tells nothing: a longer one counts as none, because a small change of the commands ends
it, and visits that settle slowly do not find it alike."""
LEAST_CELLS = 8
"""Cells of a motion that gets a number; smaller ones are `PATCHWORK`."""
_STEADY, _NOISY = (1e-5, 1e-4), (2e-3, 0.1)  # m/s, and share: differences of mean speeds of one motion in a cell
_FROM_CELL_TO_CELL = (3e-3, 0.25)  # the same of neighbouring cells


def motions(visits: Iterable[Visit]) -> tuple[Found, list[Visit]]:
    """The motions of each cell, with their numbers; and for each a visit that has found it."""
    in_cell: dict[tuple[int, int], list[Visit]] = defaultdict(list)
    for visit in visits:
        cell = in_cell[visit.speed_index, visit.gap_index]
        if visit.turns != UNSETTLED and not any(_same(visit, other) for other in cell):
            cell.append(visit)
    for cell in in_cell.values():
        cell.sort(key=lambda visit: visit.mean_speed)
    rows = [visit for _, cell in sorted(in_cell.items()) for visit in cell]
    numbers = _numbers(rows)
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


def _numbers(rows: Sequence[Visit]) -> np.ndarray:
    """Number of each row's motion, 0 for that of the most cells.

    Rows of neighbouring cells are joined to groups, the most alike first, but never two rows of one cell to one group.
    """
    at: dict[tuple[int, int], list[int]] = defaultdict(list)
    for row, visit in enumerate(rows):
        at[visit.speed_index, visit.gap_index].append(row)
    links = [(first, last) for (i, j), here in list(at.items())
             for beside in (at.get((i + 1, j), ()), at.get((i, j + 1), ())) for first in here for last in beside
             if _kind(rows[first]) == _kind(rows[last]) and _close(rows[first], rows[last], _FROM_CELL_TO_CELL)]
    group_of = list(range(len(rows)))
    members = {row: [row] for row in range(len(rows))}
    cells = {row: {(visit.speed_index, visit.gap_index)} for row, visit in enumerate(rows)}
    for first, last in sorted(links, key=lambda pair: abs(rows[pair[0]].mean_speed - rows[pair[1]].mean_speed)):
        small, large = sorted((group_of[first], group_of[last]), key=lambda group: len(members[group]))
        if small == large or cells[small] & cells[large]:
            continue
        for row in members[small]:
            group_of[row] = large
        members[large] += members.pop(small)
        cells[large] |= cells.pop(small)
    numbers = np.full(len(rows), PATCHWORK)
    numbered = [group for group in members.values() if len(group) >= LEAST_CELLS]
    for number, group in enumerate(sorted(numbered, key=len, reverse=True)):
        numbers[group] = number
    return numbers


LONGEST = 4
"""Period [turns] of motions that are followed, at most."""
BEYOND = 3.0
"""Cells over which a motion is followed beyond its last cell."""
_MOST_STEPS = 60  # along a branch
_LEAST_RUN = 3  # cells
_TILT = 8.0  # rad/s a mm of gap: as far as a curve may lean between two gaps


class End(NamedTuple):
    """A motion, and a way along the motor speed on which it ends.

    Attributes
    ----------
    gap_index, turns : int
        Row of the grid, and period [turns].
    motion : int
        Its number.
    speed_index : int
        Last cell.
    direction : int
        1 upwards, -1 downwards.
    state : tuple of float
        State in the last cell, at the cut, in units of the machine.
    """

    gap_index: int
    turns: int
    motion: int
    speed_index: int
    direction: int
    state: tuple[float, ...]


class Point(NamedTuple):
    """What was found beyond the end of a motion.

    Attributes
    ----------
    kind : str or None
        The special point, as `orbits.special_points` names it; None where the branch goes on, or is lost.
    turns, motion, direction : int
        Of the `End`.
    gap_index : int
        Row of the grid.
    motor_speed : float
        [rad/s]
    """

    kind: str | None
    turns: int
    motion: int
    direction: int
    gap_index: int
    motor_speed: float


def ends(found: Found, rows: list[Visit], speeds: Axis, gap_indices: range) -> list[End]:
    """Where the motions of some rows of the grid end within it, in both directions of the motor speed."""
    listed = []
    for gap_index in gap_indices:
        for motion in np.unique(found.motion[(found.gap_index == gap_index) & (found.motion > PATCHWORK)]).tolist():
            own = np.flatnonzero((found.gap_index == gap_index) & (found.motion == motion))
            turns = int(found.turns[own[0]])
            if not 0 < turns <= LONGEST:
                continue
            for run in np.split(own, np.flatnonzero(np.diff(found.speed_index[own]) > 1) + 1):
                if len(run) >= _LEAST_RUN:
                    listed += [End(gap_index, turns, motion, int(found.speed_index[row]), direction, rows[row].state)
                               for row, direction, border in ((run[0], -1, 0), (run[-1], 1, speeds.count - 1))
                               if found.speed_index[row] != border]
    return listed


def end_point(design: MapDesign, end: End) -> Point:
    """The special point at which a motion ends, if its branch leads to one within `BEYOND`."""
    span = BEYOND * design.speeds.step
    here = float(design.speeds.values[end.speed_index])
    low, high = (here, here + span) if end.direction > 0 else (max(here - span, 0.1 * here), here)
    try:
        family = Family(design.scene_at(end.speed_index, end.gap_index), {"motor.speed": (low, high)}, end.turns, PHASE)
        branch = follow(family, np.append(end.state, family.shares(here)), float(end.direction))
        for _, (before, after) in zip(range(_MOST_STEPS), branch, strict=False):
            for special in special_points(before, after):
                if special.kind == CORNER:  # the motion goes on
                    continue
                return Point(special.kind, end.turns, end.motion, end.direction, end.gap_index, special.point.value)
    except (LostError, SimulationError, ValueError):
        pass
    return Point(None, end.turns, end.motion, end.direction, end.gap_index, here)


def curves(design: MapDesign, points: list[Point], gap_indices: range) -> tuple[Curve, ...]:
    """Points joined to curves, each of at least two points."""
    lines: list[list[Point]] = []
    open_lines: list[list[Point]] = []
    reach = _TILT * 1e3 * gap_indices.step * design.gaps.step + design.speeds.step
    for gap_index in gap_indices:
        left = [point for point in points if point.gap_index == gap_index]
        still_open = []
        near = [(abs(line[-1].motor_speed - point.motor_speed), line, point) for line in open_lines for point in left
                if (line[-1].kind, line[-1].motion, line[-1].direction) == (point.kind, point.motion, point.direction)]
        for distance, line, point in sorted(near, key=lambda one: one[0]):
            if distance <= reach and point in left and line not in still_open:
                left.remove(point)
                line.append(point)
                still_open.append(line)
        fresh = [[point] for point in left]
        lines += fresh
        open_lines = still_open + fresh
    values = design.gaps.values
    return tuple(Curve(str(line[0].kind), line[0].turns, tuple(float(f"{point.motor_speed:.9g}") for point in line),
                       tuple(float(f"{values[point.gap_index]:.9g}") for point in line))
                 for line in lines if len(line) > 1)


PROOFS, QUICK_PROOFS = 185, 16
"""Mean speeds that are tried, equally spaced over what a map offers, or a quick one."""
STARTS = 8
"""Drawn starts of each, `orbits.starts`: a first second at other motor speeds and gaps."""
SETTLING, MEASURING = 10.0, 10.0
"""Time [s] that does not count, and time that does, cut to whole turns."""
MET = 0.05
"""Deviation, as a share of what was asked, within which a trial leads where it should."""


class Trial(NamedTuple):
    """One mean speed asked for.

    Attributes
    ----------
    asked, got : float
        Mean speeds [m/s]; `got` is that of the start which is farthest off.
    choice : Choice
        The commands.
    """

    asked: float
    got: float
    choice: Choice

    @property
    def error(self) -> float:
        """Deviation as a share of what was asked, dimensionless."""
        return abs(self.got / self.asked - 1.0)


def proved(command_map: CommandMap, design: MapDesign, count: int) -> tuple[CommandMap, list[Trial]]:
    """The map without cells that are not sure after all, and the trials of its commands, by mean speed.

    Parameters
    ----------
    command_map : CommandMap
        With the cells that sweeps have found to be sure.
    design : MapDesign
        The machine and the grid.
    count : int
        Mean speeds to try.
    """
    if not has_choice(command_map):
        return command_map, []
    offered = CommandChoice(command_map)
    asked = np.linspace(offered.slowest, offered.fastest, count).tolist()
    done: dict[tuple[float, ...], Trial] = {}
    provide_kernels("exact")  # once for all that are forked
    while True:
        choices = {}
        if has_choice(command_map):
            choice = CommandChoice(command_map)
            for speed in asked:
                with suppress(ValueError):  # a speed for which there are no sure commands
                    chosen = choice.commands_for(speed)
                    choices[(speed, *chosen.commands.values())] = (speed, chosen)
        new = [key for key in choices if key not in done]
        with Progress("commands tried", "job", len(new)) as progress:
            tried = [choices[key] for key in new]
            with closing(in_processes(partial(_trial, design), tried, min(core_count(), len(new)) or 1)) as trials:
                for key, (_, future) in zip(new, trials, strict=True):
                    done[key] = future.result()
                    progress.add(1)
        failed = [trial for trial in done.values()
                  if trial.error > MET and command_map.found.sure[list(trial.choice.rows)].all()]
        if not failed:
            return command_map, [done[key] for key in choices]
        sure = command_map.found.sure.copy()
        sure[[row for trial in failed for row in trial.choice.rows]] = 0
        command_map = replace(command_map, found=replace(command_map.found, sure=sure))


def _trial(design: MapDesign, one: tuple[float, Choice]) -> Trial:
    """Give the commands, all at once, to a device after each of the drawn starts."""
    asked, choice = one
    motor, gap = list(choice.commands.values())[:2]
    turn, speeds = TURN / motor, []
    duration = turn * round(MEASURING / turn)
    for start in range(STARTS):
        device = drawn_start(design.scene_with(motor, gap), start)
        device.advance_to(SETTLING)
        begin = device.state.body_position
        device.advance_to(SETTLING + duration)
        speeds.append((device.state.body_position - begin) / duration)
    return Trial(asked, max(speeds, key=lambda speed: abs(speed - asked)), choice)
