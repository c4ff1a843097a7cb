"""Scenes as the worlds of `simulation_interfaces`: which there are, and how a running robot goes into another one.

A recording is of one scene. So the bag of the old scene is sealed and another begins, with the first sample of the new
one, whose stamp follows that of the last sample. Topics and services stay, and their clients notice nothing.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.impl.rcutils_logger import RcutilsLogger

from vibro_ros.configuration.parameter_file import merged, sections
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS, described_scenes, load_scene, read_scene
from vibro_ros.messages.fields import joints_of, stamp_at
from vibro_ros.messages.topics import LOAD, Operation
from vibro_ros.model.parameters import Value, quoted
from vibro_ros.model.scene import Scene
from vibro_ros.process.untrusted import one_line
from vibro_ros.ros.node.node import NextTurn, SteadyNode
from vibro_ros.ros.robot.diagnostics import Diagnostics
from vibro_ros.ros.robot.operations import BETWEEN, FACTOR
from vibro_ros.ros.robot.services import PATIENCE, Answer, Code, RefusalError
from vibro_ros.ros.robot.stepping import Run, Stepping
from vibro_ros.sensors.device import new_device, sensors_on
from vibro_ros.simulation.kernels import compile_kernels
from vibro_ros.simulation.preparation import Preparation
from vibro_ros.simulation.provenance import provenance
from vibro_ros.simulation.simulator import Simulator

NO_RESOURCE, RESOURCE_PARSE_ERROR, UNSUPPORTED_ELEMENTS = 102, 103, 106
"""Codes of LoadWorld alone."""
TEXT = "resource_string"
"""The field of a request that holds a scene's text; the name of such a scene."""
WORDS = 300
"""Longest reason that an answer gives."""


@dataclass(frozen=True)
class World:
    """A scene as peers know it.

    `uri` is what the parameter `scene` takes, empty for a text; `text` the content of the scene's file where a request
    had it.
    """

    name: str
    uri: str = ""
    text: str = ""

    def fill(self, message: Any) -> None:
        """Fill a simulation_interfaces/msg/WorldResource."""
        message.name, message.description = self.name, described_scenes().get(self.uri, "")
        message.world_resource.uri, message.world_resource.resource_string = self.uri, self.text


def asked_world(uri: str, text: str) -> World:
    """The world that a request of LoadWorld names.

    A text, not a path, brings a scene of one's own: so nobody reads files of the robot's computer through the robot.

    Raises
    ------
    RefusalError
        For none, and for a scene that is not shipped.
    """
    names = ", ".join(described_scenes())
    if uri and uri not in described_scenes():
        raise RefusalError(Code.NOT_FOUND, f"uri: {quoted(uri)} is no shipped scene; give one of {names}, or leave uri "
                           f"empty and give the content of a scene's file as {TEXT}")
    if not uri and not text:
        raise RefusalError(NO_RESOURCE, f"uri and {TEXT} are empty; give as uri one of {names}, or the content of a "
                           f"scene's file as {TEXT}")
    return World(uri, uri) if uri else World(TEXT, text=text)


def scene_of(world: World, node: str, strict: bool) -> Scene:
    """The scene of a world for the robot of the fully qualified name `node`.

    Raises
    ------
    RefusalError
        For a text that is no scene, and where `strict` for one that gives parameters of the device around the scene,
        which are ignored otherwise.
    """
    if world.uri:
        return load_scene(world.uri)
    try:
        scene = read_scene(TEXT, world.text, node)
        given = merged(sections(Path(TEXT), world.text), node)
    except ValueError as error:
        raise RefusalError(RESOURCE_PARSE_ERROR, one_line(error, WORDS)) from None
    ignored = [one.name for one in DEVICE_PARAMETERS if one.name in given and one.name != "scene"]
    if strict and ignored:
        raise RefusalError(UNSUPPORTED_ELEMENTS, f"{ignored[0]}: is of the robot's node, not of a scene; leave it out, "
                           "or set fail_on_unsupported_element to false")
    return scene


def check_interface(present: Scene, wanted: Scene) -> None:
    """Refuse a scene whose robot has other topics or joints than the one that runs (RefusalError)."""
    for what, of in (("commands and topics of the motor", lambda scene: (scene.has_rotor, scene.motor_command)),
                     ("joints", joints_of), ("sensors", sensors_on)):
        if of(present) != of(wanted):
            raise RefusalError(Code.OPERATION_FAILED, f"{wanted.name}: has other {what} than the robot that runs; "
                               "start another one: ros2 run vibro_ros robot --ros-args -p scene:=NAME_OR_PATH")


def prepared_device(scene: Scene, log: RcutilsLogger) -> Simulator:
    """The device of a scene, ready to be stepped; takes long where kernels are to be compiled."""
    compile_kernels(scene["solver.method"])
    if fault := scene.broken_promise:
        log.warning(fault)
    device = new_device(scene)
    if device.choice:
        log.info(f"solver.method auto: {device.choice}")
    return device


class Worlds:
    """The scene of a running robot, and its change; for the executor's thread.

    `settings` are the device's parameters as it was started; `declare` declares the node's with other values.
    """

    def __init__(self, node: SteadyNode, settings: Mapping[str, Value], run: Run, stepping: Stepping,
                 diagnostics: Diagnostics, declare: Callable[[Mapping[str, Value]], object]):
        self._node, self._settings, self._run = node, dict(settings), run
        self._stepping, self._diagnostics, self._declare = stepping, diagnostics, declare
        self._present = World(run.device.scene.name, str(settings["scene"]))
        self._loading = False

    def answers(self) -> dict[str, Answer]:
        """What answers the requests about worlds, by type."""
        from simulation_interfaces.msg import WorldResource  # only where the package is installed

        async def available(request: Any, response: Any) -> Any:
            result = response.result
            if request.filter.tags:
                result.result, result.error_message = Code.FEATURE_UNSUPPORTED, "filter.tags: worlds have none here"
            elif request.additional_sources and not request.continue_on_error:
                result.result, result.error_message = Code.FEATURE_UNSUPPORTED, (
                    f"additional_sources: {quoted(request.additional_sources[0])} is not searched, only shipped scenes "
                    "are; leave it out, or set continue_on_error")
            else:
                result.result = Code.OK
                response.worlds = [WorldResource() for _ in described_scenes()]
                for message, name in zip(response.worlds, described_scenes(), strict=True):
                    World(name, name).fill(message)
            return response

        async def current(request: Any, response: Any) -> Any:
            response.result.result = Code.OK
            self._present.fill(response.world)
            return response

        async def load(request: Any, response: Any) -> Any:
            asked = request.world_resource
            try:
                await self._load(asked_world(asked.uri, asked.resource_string), request.fail_on_unsupported_element)
            except RefusalError as refusal:
                response.result.result, response.result.error_message = refusal.code, str(refusal)
                return response
            return await current(request, response)

        return {"GetAvailableWorlds": available, "GetCurrentWorld": current, "LoadWorld": load}

    async def _load(self, world: World, strict: bool) -> None:
        """Go into another world, stopped at its start (RefusalError: everything is as it was)."""
        control = self._run.control
        control.check_idle()
        if self._loading:
            raise RefusalError(Code.INCORRECT_STATE, "another world is being loaded; wait for its end")
        self._loading = True
        control.waiting += 1  # the answer is to go out before the robot ends
        try:
            preparation = Preparation(partial(self._prepared, world, strict), self._node.get_logger().info)
            while not preparation.done():
                await NextTurn()
                control.check_idle()
            try:
                self._change(world, *preparation.result())
            except (ValueError, RuntimeError) as error:
                raise RefusalError(Code.OPERATION_FAILED, one_line(error, WORDS)) from None
        finally:
            self._loading = False
            control.waiting -= 1

    def _prepared(self, world: World, strict: bool) -> tuple[Simulator, str]:
        """The world's device, and what the parameter `scene` is there: of a text, the scene that it changes."""
        name = self._node.get_fully_qualified_name()
        scene = scene_of(world, name, strict)
        check_interface(self._run.device.scene, scene)
        origin = world.uri or merged(sections(Path(TEXT), world.text), name).get("scene", "paper")
        return prepared_device(scene, self._node.get_logger()), str(origin)

    def _change(self, world: World, device: Simulator, origin: str) -> None:
        """Go into the world of a prepared device, while this thread waits, so that nothing else is done meanwhile."""
        run, recording = self._run, self._run.recording
        settings = self._settings | {"scene": origin, FACTOR: run.pacing.factor}

        def change() -> None:
            if run.operations.takes_steps:
                raise ValueError("steps are being taken; ask again later")
            start = stamp_at(run.robot_time.start, run.robot_time.due)
            recording.begin_run({"scene": world.name, **provenance({**settings, **device.scene.parameters}, start)})
            self._stepping.begin_scene(device, start)

        asked = run.operations.ask(Operation(BETWEEN), work=change)
        try:
            asked.result(PATIENCE)
        except FutureTimeoutError:
            if asked.cancel():
                raise ValueError("the simulation has not answered in time; nothing was changed") from None
            asked.result()
        self._present, self._settings = world, settings
        self._declare({**settings, **device.scene.parameters})
        self._diagnostics.look_at_scene()
        run.operations.announce(Operation(LOAD))
        self._node.get_logger().info(f"scene {world.name}: stopped at its start; {recording.destination()}")
