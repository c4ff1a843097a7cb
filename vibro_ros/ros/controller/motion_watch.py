"""What a command map says of a course of commands: where the robot crosses into another motion, before it does.

A map's motion goes on for as long as the cell of the commands has it. So a robot that is led into cells with two
motions stays with its own, and crosses where this one ends. Motions that the commands only pass through, too fast for
the robot to settle to them, are no crossing; what counts is the motion in which they stay. A robot that comes from
outside of the map, as from standing still, crosses nothing.
"""

from collections.abc import Mapping

from vibro_ros.configuration.command_map import CommandMap

STAY = 1.0
"""Time [s] for which a motion must go on to be one that the commands stay in."""


class MotionWatch:
    """Follows the motion of one robot.

    Parameters
    ----------
    command_map : CommandMap
        Of this robot.
    initial : mapping of str to float
        Where the commands stand before the first, in the units of the topics.
    """

    def __init__(self, command_map: CommandMap, initial: Mapping[str, float]):
        self._map, self._initial = command_map, initial
        self._motions = self._possible(initial)
        self._passing = False

    def warning(self, commands: Mapping[str, float], later: Mapping[str, float]) -> str:
        """What is to be said before commands are sent; empty if nothing.

        Parameters
        ----------
        commands : mapping of str to float
            All that stand then, in the units of the topics; a number that is not known may be NaN.
        later : mapping of str to float
            Those that stand `STAY` after them.
        """
        here, then = self._possible(commands), self._possible(later)
        lasting = {motion: words for motion, words in here.items() if motion in then}
        if here and not lasting:
            self._passing = True
            return ""
        before, passed, self._passing = self._motions, self._passing, False
        staying = {motion: words for motion, words in lasting.items() if motion in before}
        if staying and not (passed and len(here) > 1):
            self._motions = staying
            return ""
        self._motions = lasting
        there = " or ".join(lasting.values())
        if before and lasting:
            was = " or ".join(before.values())
            return f"{self._place(commands)} crosses into another motion: from {was} to {there}"
        if len(lasting) > 1:
            return f"{self._place(commands)} has more than one motion, and the way there decides: {there}"
        return ""

    def _possible(self, commands: Mapping[str, float]) -> dict[int, str]:
        """Motions at commands by number, in words."""
        found = self._map.found
        return {int(found.motion[row]): found.describe(row)
                for row in self._map.rows_at({**self._initial, **commands}).tolist()}

    def _place(self, commands: Mapping[str, float]) -> str:
        motor, gap, *_ = ({**self._initial, **commands}[name] for name in self._map.commands)
        return f"motor_speed {motor:.6g} rad/s at gap {gap * 1e3:.3g} mm"
