"""What a command map says of a course of commands: where the robot crosses into another motion, before it does.

A map's motion goes on for as long as the cell of the commands has it. So a robot that is led into cells with two
motions stays with its own, and crosses where this one ends. A robot that comes from outside of the map, as from
standing still, crosses nothing.
"""

from collections.abc import Mapping

from vibro_ros.configuration.command_map import CommandMap
from vibro_ros.messages.topics import COMMAND_UNITS


class MotionWatch:
    """Follows the motion of one robot.

    Parameters
    ----------
    command_map : CommandMap
        Of this robot.
    initial : mapping of str to float
        Where the commands stand before the first, in the units of `COMMAND_UNITS`.
    """

    def __init__(self, command_map: CommandMap, initial: Mapping[str, float]):
        self._map, self._initial = command_map, initial
        self._motions = self._possible(initial)

    def warning(self, commands: Mapping[str, float]) -> str:
        """What is to be said before commands are sent; empty if nothing.

        Parameters
        ----------
        commands : mapping of str to float
            All that stand then, in the units of `COMMAND_UNITS`; a number that is not known may be NaN.
        """
        before, here = self._motions, self._possible({**self._initial, **commands})
        self._motions = {motion: words for motion, words in here.items() if motion in before} or here
        if not here or self._motions.keys() <= before.keys():
            return ""
        where = ", ".join(f"{name} {commands.get(name, self._initial[name]):.6g} {COMMAND_UNITS[name]}"
                          for name in self._map.commands)
        there = " or ".join(here.values())
        if before:
            return f"{where} crosses into another motion: from {' or '.join(before.values())} to {there}"
        return f"{where} has more than one motion, and the way there decides: {there}" if len(here) > 1 else ""

    def _possible(self, commands: Mapping[str, float]) -> dict[int, str]:
        """Motions at commands by number, in words."""
        found = self._map.found
        return {int(found.motion[row]): found.describe(row) for row in self._map.rows_at(commands).tolist()}
