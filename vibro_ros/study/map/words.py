"""What a map says, in words."""

import numpy as np

from vibro_ros.configuration.command_choice import CommandChoice, has_choice
from vibro_ros.configuration.command_map import PATCHWORK, CommandMap
from vibro_ros.study.map.proof import STARTS, Trial
from vibro_ros.study.map.visit import UNSETTLED, Visit

SHOWN = 22
"""Rows of the table of trials, about."""


def map_in_words(command_map: CommandMap, visits: list[Visit]) -> list[str]:
    """How many motions there are, where, and how fast they go."""
    found = command_map.found
    cells, counts = np.unique(np.column_stack([found.speed_index, found.gap_index]), axis=0, return_counts=True)
    unsettled = sum(visit.turns == UNSETTLED for visit in visits)
    numbered = np.unique(found.motion[found.motion > PATCHWORK])
    periodic = float(np.mean(found.turns > 0))
    fastest, slowest = int(np.argmax(np.abs(found.mean_speed))), int(np.argmin(np.abs(found.mean_speed)))
    forwards = int(np.sum(found.mean_speed > 0.0))
    return [
        f"{len(cells)} of {command_map.speeds.count * command_map.gaps.count} cells have a motion, "
        f"{np.sum(counts > 1)} have more than one; {unsettled} of {len(visits)} visits did not settle",
        f"{len(numbered)} motions of neighbouring cells; {periodic:.0%} of what was found repeats itself within 8 "
        "turns",
        f"mean speeds from {found.mean_speed[slowest] * 1e3:.1f} to {found.mean_speed[fastest] * 1e3:.1f} mm/s "
        f"({_place(command_map, fastest)}); {forwards} go forwards",
        f"curves: {', '.join(_curves(command_map)) or 'none'}",
        _sure(command_map),
    ]


def trials_in_words(trials: list[Trial]) -> list[str]:
    """A table of mean speeds asked for, with the start that is farthest off, and the largest deviation of all."""
    if not trials:
        return []
    lines = ["asked [mm/s]  motor speed [rad/s]  gap [mm]  got [mm/s]  off [%]"]
    for trial in trials[::max(1, len(trials) // SHOWN)]:
        motor, gap = list(trial.choice.commands.values())[:2]
        lines.append(f"{trial.asked * 1e3:12.1f}  {motor:19.2f}  {gap * 1e3:8.2f}  {trial.got * 1e3:10.1f}  "
                     f"{trial.error * 100.0:7.1f}")
    worst = max(trials, key=lambda trial: trial.error)
    median = np.median([trial.error for trial in trials])
    return [*lines, f"{len(trials)} mean speeds from {STARTS} starts each: asked and got differ by {worst.error:.1%} "
            f"at most, and by {median:.1%} in the median"]


def _sure(command_map: CommandMap) -> str:
    if not has_choice(command_map):
        return "no sure commands for any mean speed"
    choice = CommandChoice(command_map)
    return (f"sure commands for {choice.covered:.0%} of the mean speeds from {choice.slowest * 1e3:.1f} to "
            f"{choice.fastest * 1e3:.1f} mm/s")


def _place(command_map: CommandMap, row: int) -> str:
    found = command_map.found
    return (f"{command_map.speeds.values[found.speed_index[row]]:g} rad/s, gap "
            f"{command_map.gaps.values[found.gap_index[row]] * 1e3:g} mm")


def _curves(command_map: CommandMap) -> list[str]:
    kinds = dict.fromkeys(curve.kind for curve in command_map.curves)
    return [f"{sum(curve.kind == kind for curve in command_map.curves)} of {kind}" for kind in kinds]
