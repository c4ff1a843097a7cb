"""Read a robot's parameters over ROS, for the live view and the controller: its scene and some of the node's own."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.model.parameters import SCENE_PARAMETERS, checked_parameters
from vibro_ros.model.scene import Scene
from vibro_ros.process.files import one_line

ASK_PERIOD = 1.0
"""Time [s] without an answer after which a request is repeated. DDS drops a request or its response while only one of
the two nodes has discovered the other."""
OF_DEVICE = ("scene", "frame_prefix", "command.timeout")
"""Parameters of the node that peers need besides those of the scene."""
LONGEST_TEXT = 200  # longest text [characters] among the parameters, except `scene`
_NAMES = (*(parameter.name for parameter in SCENE_PARAMETERS), *OF_DEVICE)


@dataclass(frozen=True)
class Settings:
    """Settings of a robot that its peers need: its scene, the prefix of its frames, and its `command.timeout` [s]."""

    scene: Scene
    prefix: str
    command_timeout: float


def settings_of(values: Sequence[ParameterValue]) -> Settings:
    """Return the settings from a robot's values of the parameters `_NAMES` (ValueError if they are not valid)."""
    if len(values) != len(_NAMES):
        raise ValueError(f"it answers {len(values)} values to {len(_NAMES)} names, because its parameters are not "
                         "those of this version's robots; name one of this version with --robot")
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
    """Asks a robot for its parameters, repeatedly until it answers; `reading` is true until then.

    Requests are sent in the thread of the node's executor. `answered` is called with the settings, or with the reason
    in words why there are none.
    """

    def __init__(self, node: Node, robot: str, answered: Callable[[Settings | str], object]):
        self._answered = answered
        self._client = node.create_client(GetParameters, f"{robot}/get_parameters")
        self._request: Future | None = None
        self._due, self.reading = 0.0, True

    @property
    def sees_robot(self) -> bool:
        """Whether a node of the robot's name offers its parameter services."""
        return self._client.service_is_ready()

    def read(self) -> None:
        """Ask again as soon as possible; a pending request is dropped."""
        self._forget()
        self.reading, self._due = True, 0.0

    def tick(self) -> None:
        """Send a request if one is due; to be called often."""
        if not self.reading or time.monotonic() < self._due or not self.sees_robot:
            return
        self._forget()
        self._due = time.monotonic() + ASK_PERIOD
        self._request = self._client.call_async(GetParameters.Request(names=list(_NAMES)))
        self._request.add_done_callback(self._take)

    def _take(self, future: Future) -> None:
        if future.cancelled() or future != self._request:
            return
        self._request = None
        try:
            answer: Settings | str = settings_of(future.result().values)
        except ValueError as error:
            answer = one_line(error, 300)
        self.reading = False
        self._answered(answer)

    def _forget(self) -> None:
        """Drop the pending request, here and in the client."""
        request, self._request = self._request, None
        if request:
            request.cancel()
