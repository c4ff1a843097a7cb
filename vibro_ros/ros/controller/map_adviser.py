"""The command map in the controller's hands: whether it is the robot's, and where commands cross into another motion.

A map's motion goes on for as long as the cell of the commands has it. So a robot that is led into cells with two
motions stays with its own, and crosses where this one ends. Motions that the commands only pass through, too fast for
the robot to settle to them, are no crossing; what counts is the motion in which they stay. A robot that comes from
outside of the map, as from standing still, crosses nothing.
"""

import math
import re
import time
from collections import deque
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.publisher import Publisher

from vibro_ros.configuration.command_map import CommandMap
from vibro_ros.process.stop_signals import StopRequest
from vibro_ros.ros.live.scene import SceneReader, Settings
from vibro_ros.ros.node import process

STAY = 1.0
"""Time [s] for which a motion must go on to be one that the commands stay in."""
PATIENCE = 5.0
"""Longest wait [s] for the robot's parameters, where a script needs to know that the map is the robot's."""
LOOKS = 0.2
"""Time [s] between two looks for nodes that hear the commands."""
MOST_ASKED = 16
"""Nodes that are asked, of those that hear the commands."""
LONGEST_NAME = 200
"""Characters of a node's full name."""
MOST_UNJUDGED = 1000
"""Commands that are kept while the robot has not answered; of a robot that never does, the latest."""


class MapAdviser:
    """Learns from the nodes that hear the commands which robot they are, and warns.

    Parameters
    ----------
    node : Node
        Asks, and logs.
    command_map : CommandMap
        What is known of the commands.
    path : Path
        The map's file, for words.
    publisher : Publisher
        Of a command: who subscribes to it is asked for its scene.
    """

    def __init__(self, node: Node, command_map: CommandMap, path: Path, publisher: Publisher):
        self._node, self._map, self._path, self._publisher = node, command_map, path, publisher
        self._readers: dict[str, SceneReader] = {}
        self._watch: MotionWatch | None = None
        self._fault = ""  # why the map is not the robot's
        self._last_look = -math.inf
        self._unjudged: deque[tuple[str, Mapping[str, float], Mapping[str, float]]] = deque(maxlen=MOST_UNJUDGED)

    def tick(self) -> None:
        """Ask the robot, if that is due; to be called often."""
        now = time.monotonic()
        if self._watch or self._fault or now < self._last_look + LOOKS:
            return
        self._last_look = now
        for info in self._node.get_subscriptions_info_by_topic(self._publisher.topic_name):
            name = f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            if name not in self._readers and len(self._readers) < MOST_ASKED and _can_be_asked(name):
                self._readers[name] = SceneReader(self._node, name, partial(self._take, name))
        for reader in self._readers.values():
            reader.tick()

    def require(self, executor: Executor, stop: StopRequest) -> None:
        """Return when the map is known to be the robot's, or on `stop`.

        Raises
        ------
        RuntimeError
            When it is another's, or the robot does not say which machine it is.
        """
        deadline = time.monotonic() + PATIENCE

        def over() -> bool:
            self.tick()
            return bool(stop or self._watch or self._fault or time.monotonic() > deadline)

        process.spin_until(executor, over)
        if self._fault:
            raise RuntimeError(f"speed_over_ground: {self._fault}")
        if not (stop or self._watch):
            raise RuntimeError(f"speed_over_ground: {', '.join(self._readers) or 'the robot'} does not say in "
                               f"{PATIENCE:g} s which machine it is; give motor_speed and gaps, or start a robot of "
                               "this package")

    def advise(self, where: str, commands: Mapping[str, float], later: Mapping[str, float]) -> None:
        """Warn if commands, which are about to be sent, cross into another motion.

        Parameters
        ----------
        where : str
            Names the script's entry.
        commands, later : mapping of str to float
            As `MotionWatch.warning` takes them.
        """
        self._unjudged.append((where, commands, later))
        self._judge()

    def _judge(self) -> None:
        """Say what there is to say, late only of what was sent before the robot has answered."""
        while self._watch and self._unjudged:
            where, commands, later = self._unjudged.popleft()
            if words := self._watch.warning(commands, later):
                self._node.get_logger().warning(f"{where}: {words}")

    def _take(self, name: str, found: Settings | str) -> None:
        """What a node has answered; one that is no robot, as a recorder, says nothing."""
        if isinstance(found, str) or self._watch or self._fault:
            return
        if words := self._map.difference(found.scene):
            self._fault = (f"{self._path} is the map of another machine than {name}: {words}; make one with "
                           "`study map` and give it as the parameter `map`")
            self._node.get_logger().info(f"no warnings of other motions: {self._fault}")
        else:
            self._watch = MotionWatch(self._map, {
                "motor_speed": found.scene["motor.speed"], "upper_gap": found.scene["upper.gap"],
                "inclined_gap": found.scene["inclined.gap"]})
            self._judge()


def _can_be_asked(name: str) -> bool:
    """Whether the name that a peer gives itself is one that ROS makes services of; a name not yet known begins with _.
    """
    return bool(re.fullmatch(r"(/[A-Za-z][A-Za-z0-9_]*)+", name)) and "__" not in name and len(name) < LONGEST_NAME


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
