"""A robot's parameters, asked for over ROS by the live view and the controller: its scene, and what else peers need."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.model.parameters import SCENE_PARAMETERS, checked_parameters
from vibro_ros.model.scene import Scene
from vibro_ros.process.files import one_line
from vibro_ros.ros.node.refusals import peer_text

ASK_PERIOD = 1.0
"""Time [s] without an answer after which a question is asked once more. DDS drops a question or its answer where robot
and view know each other on one side only."""
OF_DEVICE = ("scene", "frame_prefix", "command.timeout")
"""Parameters of the node that peers need beside those of the scene."""
LONGEST_TEXT = 200
"""Characters of a text among the parameters."""
_GROUPS = frozenset(parameter.name.partition(".")[0] for parameter in SCENE_PARAMETERS)
_NAMES = (*(parameter.name for parameter in SCENE_PARAMETERS), *OF_DEVICE)


@dataclass(frozen=True)
class Settings:
    """What peers know of a robot: its scene, what the names of its frames begin with, and its `command.timeout` [s]."""

    scene: Scene
    prefix: str
    command_timeout: float


def check_names(names: Sequence[str]) -> None:
    """Refuse a node whose parameters are not those of this version's robots (ValueError)."""
    given = set(names)
    if missing := [name for name in _NAMES if name not in given]:
        raise ValueError(f"it has no parameter {missing[0]}; name a robot of this version with --robot")
    if unknown := sorted(name for name in given if name.partition(".")[0] in _GROUPS and name not in _NAMES):
        raise ValueError(f"it has the parameter {peer_text(unknown[0])}, which this version does not know; use the "
                         "view of the robot's version")


def settings_of(values: Sequence[ParameterValue]) -> Settings:
    """The settings that a robot answers under `_NAMES` (ValueError when no robot can have them)."""
    if len(values) != len(_NAMES):
        raise ValueError(f"it answers {len(values)} values to {len(_NAMES)} names")
    given: Mapping[str, Any] = {name: _value(name, value) for name, value in zip(_NAMES, values, strict=True)}
    of_device = checked_parameters({name: given[name] for name in OF_DEVICE}, DEVICE_PARAMETERS)
    of_scene = {name: value for name, value in given.items() if name not in OF_DEVICE}
    return Settings(Scene(one_line(Path(of_device["scene"]).stem, 60), checked_parameters(of_scene, SCENE_PARAMETERS)),
                    of_device["frame_prefix"], of_device["command.timeout"])


def _value(name: str, message: ParameterValue) -> Any:
    try:
        value = parameter_value_to_python(message)
    except RuntimeError as error:
        raise ValueError(f"{name}: {error}") from None
    if isinstance(value, str) and len(value) > LONGEST_TEXT and name != "scene":
        raise ValueError(f"{name}: a text of {len(value)} characters; at most {LONGEST_TEXT} are shown")
    return value


class SceneReader:
    """Asks a robot for its parameters, again and again until it answers; `reading` says whether an answer is awaited.

    The node asks in its executor's thread. `found` is given the settings, or in words why there are none.
    """

    def __init__(self, node: Node, robot: str, found: Callable[[Settings | str], object]):
        self._found = found
        self._list = node.create_client(ListParameters, f"{robot}/list_parameters")
        self._get = node.create_client(GetParameters, f"{robot}/get_parameters")
        self._asked: Future | None = None
        self._due, self._listed = 0.0, False
        self.reading = True

    @property
    def sees_robot(self) -> bool:
        """Whether a node of the robot's name offers its parameters."""
        return self._get.service_is_ready()

    def read(self) -> None:
        """Ask from the beginning, as soon as possible; what was asked before is forgotten."""
        self._forget()
        self._listed, self.reading, self._due = False, True, 0.0

    def tick(self) -> None:
        """Ask, if that is due; to be called often."""
        client = self._get if self._listed else self._list
        if not self.reading or time.monotonic() < self._due or not client.service_is_ready():
            return
        self._forget()
        self._due = time.monotonic() + ASK_PERIOD
        self._asked = client.call_async(
            GetParameters.Request(names=list(_NAMES)) if self._listed else ListParameters.Request())
        self._asked.add_done_callback(self._take)

    def _take(self, future: Future) -> None:
        if future.cancelled() or future != self._asked:
            return
        self._asked, self._due = None, 0.0
        try:
            if not self._listed:
                check_names(future.result().result.names)
                self._listed = True
                return
            found: Settings | str = settings_of(future.result().values)
        except ValueError as error:
            found = one_line(error, 300)
        self.reading = False
        self._found(found)

    def _forget(self) -> None:
        """Wait no longer for an answer; the client then forgets the question, too."""
        asked, self._asked = self._asked, None
        if asked:
            asked.cancel()
