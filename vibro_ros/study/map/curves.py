"""Where motions change their nature: special points of their branches of orbits at several gaps, joined to curves.

At each of these gaps every motion with a short period is followed from the ends of its run of cells outwards, over a
few cells, by pseudo-arclength (`orbits.continuation`). The first special point on the way is the end of the motion: a
fold, a period doubling, a Neimark-Sacker point or a grazing. Points of one kind and one motion at successive gaps that
lie near each other make a curve.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from vibro_ros.configuration.command_map import PATCHWORK, Axis, Curve, Found
from vibro_ros.orbits.branch_point import LostError
from vibro_ros.orbits.continuation import follow
from vibro_ros.orbits.family import Family
from vibro_ros.orbits.special_points import CORNER, special_points
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.study.map.design import MapDesign
from vibro_ros.study.map.visit import PHASE, Visit

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
        family = Family(design.scene_at(end.speed_index, end.gap_index), "motor.speed", low, high, end.turns, PHASE)
        branch = follow(family, np.array(end.state), family.share(here), float(end.direction))
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
        for distance, line, point in sorted(_near(open_lines, left), key=lambda one: one[0]):
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


def _near(lines: list[list[Point]], points: list[Point]) -> Iterator[tuple[float, list[Point], Point]]:
    """Each line and each point that may continue it, with their distance [rad/s]."""
    for line in lines:
        for point in points:
            if (line[-1].kind, line[-1].motion, line[-1].direction) == (point.kind, point.motion, point.direction):
                yield abs(line[-1].motor_speed - point.motor_speed), line, point
