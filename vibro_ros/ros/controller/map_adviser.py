"""The command map in the controller's hands: whether it is the robot's, and where commands cross into another motion.

A map's motion goes on for as long as the cell of the commands has it. So a robot that is led into cells with two
motions stays with its own, and crosses where this one ends. Motions that the commands only pass through, too fast for
the robot to settle to them, are no crossing; what counts is the motion in which they stay. A robot that comes from
outside of the map, as from standing still, crosses nothing.
"""

from collections import deque
from collections.abc import Mapping
from pathlib import Path

from rclpy.node import Node

from vibro_ros.configuration.command_map import CommandMap
from vibro_ros.ros.controller.commanded_robot import PARAMETERS_TIMEOUT, CommandedRobot

STAY = 1.0
"""Time [s] for which a motion must go on to be one that the commands stay in."""
MOST_UNJUDGED = 1000
"""Commands that are kept while the robot has not answered; of a robot that never does, the latest."""


class MapAdviser:
    """Says where commands lead the robot into another motion, once the robot is known to be that of the map at `path`.
    """

    def __init__(self, node: Node, command_map: CommandMap, path: Path, robot: CommandedRobot):
        self._node, self._map, self._path, self._robot = node, command_map, path, robot
        self._watch: MotionWatch | None = None
        self._fault = ""  # why the map is not the robot's
        self._unjudged: deque[tuple[str, Mapping[str, float], Mapping[str, float]]] = deque(maxlen=MOST_UNJUDGED)

    def require(self) -> None:
        """Refuse a robot that is not that of the map.

        Raises
        ------
        RuntimeError
            When the map is another machine's, or the robot has not said which machine it is.
        """
        self.judge()
        if self._fault:
            raise RuntimeError(f"speed_over_ground: {self._fault}")
        if not self._watch:
            raise RuntimeError(f"speed_over_ground: {self._robot} does not say in {PARAMETERS_TIMEOUT:g} s which "
                               "machine it is; give motor_speed and gaps, or start a robot of this package")

    def advise(self, where: str, commands: Mapping[str, float], later: Mapping[str, float]) -> None:
        """Say if commands, which are about to be sent, lead into another motion; `where` names the script's entry."""
        self._unjudged.append((where, commands, later))
        self.judge()

    def judge(self) -> None:
        """Say what there is to say, late only of what was sent before the robot has answered."""
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
        """Whether the robot is that of the map, and where its commands stand."""
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
    """Follows the motion of one robot, whose commands stand at `initial` before the first, in the units of the topics.
    """

    def __init__(self, command_map: CommandMap, initial: Mapping[str, float]):
        self._map, self._initial = command_map, initial
        self._motions = self._possible(initial)
        self._passing = False

    def remark(self, commands: Mapping[str, float], later: Mapping[str, float]) -> tuple[str, bool]:
        """What is to be said before commands are sent, empty if nothing; and whether they leave the motion undecided.

        `commands` are all that stand then, in the units of the topics, NaN where one is not known; `later` those that
        stand `STAY` after them. A change into the one motion that the commands have is what they ask for. Where they
        have several, the motion before decides which of them it will be.
        """
        here, then = self._possible(commands), self._possible(later)
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
            return f"allows more than one motion at {place}, and the motion before decides: {_joined(lasting)}", True
        if before and lasting:
            return f"leads at {place} from the motion of {_joined(before)} to that of {_joined(lasting)}", False
        return "", False

    def _possible(self, commands: Mapping[str, float]) -> dict[int, str]:
        """Motions at commands by number, in words."""
        found = self._map.found
        return {int(found.motion[row]): found.describe(row)
                for row in self._map.rows_at({**self._initial, **commands}).tolist()}

    def _place(self, commands: Mapping[str, float]) -> str:
        motor, gap, *_ = ({**self._initial, **commands}[name] for name in self._map.commands)
        return f"motor_speed {motor:.6g} rad/s and gap {gap * 1e3:.3g} mm"


def _joined(motions: Mapping[int, str]) -> str:
    """Motions as parts of a sentence: each by its speed, and the rest of its words in parentheses."""
    first, *others = [f"{words.replace(', ', ' (', 1)})" for words in motions.values()]
    return " or ".join([", ".join([first, *others[:-1]]), *others[-1:]])
