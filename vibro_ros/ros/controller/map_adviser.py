"""Use of the command map in the controller: does it belong to the robot, and which commands change the motion?

A robot keeps its motion as long as the map has that motion in the cell of the commands. In cells with two motions it
therefore keeps its present one, and changes the motion only where the present one ends. Cells that the commands only
pass through, too fast for the robot to settle, do not count; only the motion in which the commands stay does. A robot
that comes from outside of the map, such as from standstill, changes nothing.
"""

from collections import deque
from collections.abc import Mapping
from pathlib import Path

from rclpy.node import Node

from vibro_ros.configuration.command_map import CommandMap
from vibro_ros.ros.controller.commanded_robot import PARAMETERS_TIMEOUT, CommandedRobot

STAY = 1.0
"""Time [s] for which the commands must keep a motion to count as staying in it."""
MOST_UNJUDGED = 1000
"""Most commands that are kept while the robot has not answered; the latest are kept."""


class MapAdviser:
    """Logs commands that lead the robot into another motion, once it is known that the map at `path` is the robot's."""

    def __init__(self, node: Node, command_map: CommandMap, path: Path, robot: CommandedRobot):
        self._node, self._map, self._path, self._robot = node, command_map, path, robot
        self._watch: MotionWatch | None = None
        self._fault = ""  # why the map is not the robot's
        self._unjudged: deque[tuple[str, Mapping[str, float], Mapping[str, float]]] = deque(maxlen=MOST_UNJUDGED)

    def require(self) -> None:
        """Refuse a robot that does not belong to the map.

        Raises
        ------
        RuntimeError
            When the map is another machine's, or the robot has not answered with its parameters.
        """
        self.judge()
        if self._fault:
            raise RuntimeError(f"speed_over_ground: {self._fault}")
        if not self._watch:
            raise RuntimeError(f"speed_over_ground: {self._robot} does not say in {PARAMETERS_TIMEOUT:g} s which "
                               "machine it is; give motor_speed and gaps, or start a robot of this package")

    def advise(self, where: str, commands: Mapping[str, float], later: Mapping[str, float]) -> None:
        """Log whether commands about to be sent lead into another motion; `where` names the script's entry.

        `commands` and `later` are as in `MotionWatch.remark`.
        """
        self._unjudged.append((where, commands, later))
        self.judge()

    def judge(self) -> None:
        """Judge all waiting commands; they wait only until the robot has answered with its parameters."""
        if not self._watch and not self._fault and self._robot.settings:
            self._compare()
        log = self._node.get_logger()
        while self._watch and self._unjudged:
            where, commands, later = self._unjudged.popleft()
            words, undecided = self._watch.remark(commands, later)
            if undecided:
                log.warning(f"{where} {words}")
            elif words:
                log.info(f"{where} {words}")

    def _compare(self) -> None:
        """Compare the robot with the map's machine; if they agree, watch its motion from its initial commands on."""
        assert self._robot.settings
        scene = self._robot.settings.scene
        if words := self._map.difference(scene):
            self._fault = (f"{self._path} is the map of another machine than {self._robot.name}: {words}; make one "
                           "with `study map` and give it as the parameter `map`")
            self._node.get_logger().info(f"nothing is said of other motions: {self._fault}")
        else:
            self._watch = MotionWatch(self._map, {"motor_speed": scene["motor.speed"], "upper_gap": scene["upper.gap"],
                                                  "inclined_gap": scene["inclined.gap"]})


class MotionWatch:
    """Follows the motion of one robot; `initial` are its commands before the first one, in the units of the topics."""

    def __init__(self, command_map: CommandMap, initial: Mapping[str, float]):
        self._map, self._initial = command_map, initial
        self._motions = self._motions_at(initial)
        self._passing = False

    def remark(self, commands: Mapping[str, float], later: Mapping[str, float]) -> tuple[str, bool]:
        """Return a remark on commands about to be sent, empty if none, and whether they allow several motions.

        `commands` are all commands then in force, in the units of the topics, NaN where one is not known; `later` those
        in force `STAY` later. A change into the only motion at the commands is what they ask for. Where several motions
        are possible, the earlier motion decides which of them follows.
        """
        here, then = self._motions_at(commands), self._motions_at(later)
        lasting = {motion: words for motion, words in here.items() if motion in then}
        if here and not lasting:
            self._passing = True
            return "", False
        before, passed, self._passing = self._motions, self._passing, False
        staying = {motion: words for motion, words in lasting.items() if motion in before}
        if staying and not (passed and len(here) > 1):
            self._motions = staying
            return "", False
        self._motions = lasting
        place = self._place(commands)
        if len(lasting) > 1:
            return f"allows more than one motion at {place}, and the motion before decides: {_phrase_of(lasting)}", True
        if before and lasting:
            return f"leads at {place} from the motion of {_phrase_of(before)} to that of {_phrase_of(lasting)}", False
        return "", False

    def _motions_at(self, commands: Mapping[str, float]) -> dict[int, str]:
        """Return the motions that the map has at commands: their numbers, and their descriptions."""
        found = self._map.found
        return {int(found.motion[row]): found.describe(row)
                for row in self._map.rows_at({**self._initial, **commands}).tolist()}

    def _place(self, commands: Mapping[str, float]) -> str:
        motor, gap, *_ = ({**self._initial, **commands}[name] for name in self._map.commands)
        return f"motor_speed {motor:.6g} rad/s and gap {gap * 1e3:.3g} mm"


def _phrase_of(motions: Mapping[int, str]) -> str:
    """Join descriptions of motions to a phrase: the speed of each, and the rest in parentheses."""
    first, *others = [f"{words.replace(', ', ' (', 1)})" for words in motions.values()]
    return " or ".join([", ".join([first, *others[:-1]]), *others[-1:]])
