"""The map put to the proof: commands chosen for mean speeds, given to devices that have begun in many ways.

Sweeps find the motions that lead on from cell to cell; a motion of its own, to which no sweep leads, is met by drawn
starts only. Where a trial of commands that count as sure leads elsewhere, the cells beside are not sure any more, and
others are chosen and tried, until all trials lead where they should.
"""

from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from vibro_ros.accuracy.starts import started
from vibro_ros.configuration.command_choice import Choice, CommandChoice, has_choice
from vibro_ros.configuration.command_map import CommandMap
from vibro_ros.orbits.turn_map import TURN
from vibro_ros.simulation.preparation import provide_kernels
from vibro_ros.simulation.processes import core_count, in_processes
from vibro_ros.study.map.design import MapDesign
from vibro_ros.study.progress import Progress

PROOFS, QUICK_PROOFS = 185, 16
"""Mean speeds that are tried, equally spaced over what a map offers, or a quick one."""
STARTS = 8
"""Drawn starts of each, `accuracy.starts`: a first second at other motor speeds and gaps."""
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
        choices = _choices(command_map, asked)
        new = [one for one in choices if _key(*one) not in done]
        with Progress("commands tried", "job", len(new)) as progress:
            for job in in_processes(partial(_trial, design), new, min(core_count(), len(new)) or 1):
                trial = job.outcome()
                done[_key(trial.asked, trial.choice)] = trial
                progress.add(1)
        failed = [trial for trial in done.values()
                  if trial.error > MET and command_map.found.sure[list(trial.choice.rows)].all()]
        if not failed:
            return command_map, [done[_key(*one)] for one in choices]
        sure = command_map.found.sure.copy()
        sure[[row for trial in failed for row in trial.choice.rows]] = 0
        command_map = replace(command_map, found=replace(command_map.found, sure=sure))


def _key(asked: float, choice: Choice) -> tuple[float, ...]:
    return asked, *choice.commands.values()


def _choices(command_map: CommandMap, asked: list[float]) -> list[tuple[float, Choice]]:
    """Commands for the mean speeds for which there are some."""
    found: list[tuple[float, Choice]] = []
    if not has_choice(command_map):
        return found
    choice = CommandChoice(command_map)
    for speed in asked:
        with suppress(ValueError):
            found.append((speed, choice.commands_for(speed)))
    return found


def _trial(design: MapDesign, one: tuple[float, Choice]) -> Trial:
    asked, choice = one
    motor, gap = list(choice.commands.values())[:2]
    speeds = [_mean_speed(design, motor, gap, start) for start in range(STARTS)]
    return Trial(asked, max(speeds, key=lambda speed: abs(speed - asked)), choice)


def _mean_speed(design: MapDesign, motor: float, gap: float, start: int) -> float:
    """Mean speed [m/s] of a device that is given the commands, all at once, after a drawn start."""
    device = started(design.scene_with(motor, gap), np.random.default_rng((0, start)))
    device.advance_to(SETTLING)
    begin = device.state.body_position
    turn = TURN / motor
    duration = turn * round(MEASURING / turn)
    device.advance_to(SETTLING + duration)
    return (device.state.body_position - begin) / duration
