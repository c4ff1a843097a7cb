"""The map put to the proof: commands chosen for mean speeds, given to a device that begins as its scene does."""

from typing import NamedTuple

import numpy as np

from vibro_ros.configuration.command_choice import Choice, CommandChoice
from vibro_ros.configuration.command_map import CommandMap
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.turn_map import TURN
from vibro_ros.simulation.simulator import Simulator

TRIALS = 24
"""Mean speeds that are asked for, equally spaced over what the map offers."""
SETTLING, MEASURING = 10.0, 10.0
"""Time [s] that does not count, and time that does, cut to whole turns."""


class Trial(NamedTuple):
    """One mean speed asked for.

    Attributes
    ----------
    asked, got : float
        Mean speeds [m/s].
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


def trials(command_map: CommandMap, scene: Scene) -> list[Trial]:
    """Mean speeds over the range of a map, those left out that no safe command gives."""
    choice, found = CommandChoice(command_map), []
    for asked in np.linspace(choice.slowest, choice.fastest, TRIALS).tolist():
        try:
            chosen = choice.commands_for(asked)
        except ValueError:
            continue
        found.append(Trial(asked, _mean_speed(scene, chosen), chosen))
    return found


def _mean_speed(scene: Scene, chosen: Choice) -> float:
    """Mean speed [m/s] of a device that is given the commands at its start, all at once."""
    device = Simulator(scene)
    device.command(**chosen.commands)
    device.advance_to(SETTLING)
    begin = device.state.body_position
    turn = TURN / chosen.commands["motor_speed"]
    duration = turn * round(MEASURING / turn)
    device.advance_to(SETTLING + duration)
    return (device.state.body_position - begin) / duration
