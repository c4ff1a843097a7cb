"""The `robot` executable: the virtual device behind its ROS interface."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("robot"))

import argparse
import gc
import json
import sys
import time
import warnings
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from vibro_ros.bag.definitions import Topic
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS, NODE_NAME, load_scene, scene_origin, shipped_scenes
from vibro_ros.messages.topics import CHECKPOINT, CHECKPOINT_TYPE, COMMAND_UNITS
from vibro_ros.model.parameters import SCENE_PARAMETERS, Value, checked_parameters
from vibro_ros.model.scene import Scene
from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code, say
from vibro_ros.process.stop_signals import StopRequest
from vibro_ros.ros import process
from vibro_ros.ros.diagnostics import Diagnostics
from vibro_ros.ros.inputs import Inputs
from vibro_ros.ros.node import SteadyNode
from vibro_ros.ros.outputs import PUBLISHED, Outputs
from vibro_ros.ros.pacing import Pacing
from vibro_ros.ros.parameters import declare, parameter_lines, take_overrides
from vibro_ros.ros.recording import Recording, open_recording
from vibro_ros.ros.recording_plan import Plan, check_directory, plan_recording
from vibro_ros.ros.remapping import check_names
from vibro_ros.ros.ros_arguments import check_addressed, check_arguments, folder_of, own_arguments
from vibro_ros.ros.ros_time import wait_for_time
from vibro_ros.ros.stepping import Stepping
from vibro_ros.ros.unsealed import offer_recovery
from vibro_ros.simulation.kernels import compile_kernels
from vibro_ros.simulation.preparation import Preparation
from vibro_ros.simulation.provenance import provenance
from vibro_ros.simulation.simulator import Simulator, ToleranceWarning

CHECKPOINT_DEPTH = 1
WATCH = 0.5
"""Longest time [s] from a failure of the device or the recording until the node says so."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the robot until SIGINT, SIGTERM or SIGHUP.

    Returns
    -------
    int
        0 after a signal; 2 for bad input; 1 when the simulation or the recording failed.
    """
    return exit_code("robot", lambda: _run(sys.argv[1:] if argv is None else argv))


def _run(words: Sequence[str]) -> int:
    _parser().parse_args(own_arguments(words))
    files = check_arguments(words)
    with StopRequest() as stop, process.node_running(NODE_NAME, words) as (node, executor):
        check_addressed(files, node.get_fully_qualified_name())
        check_names(node, (*COMMAND_UNITS, *PUBLISHED))
        settings, scene = _configure(node, words)
        outputs = Outputs(node, scene, settings["frame_prefix"])
        plan = _plan(node, settings, scene, outputs)
        node.get_logger().info(f"scene {settings['scene']}")
        preparation = Preparation(partial(_prepare, node, settings, scene, plan), node.get_logger().info)
        process.spin_until(executor, lambda: bool(stop) or preparation.done())
        device = None if stop else preparation.result()
        wait_for_time(node, executor, lambda: bool(stop))
        if stop or device is None:
            say("robot", "stopped while starting")
            return 0
        gc.freeze()  # all of this lasts: to go through it again and again would delay ticks, and the process's end
        return _operate(node, executor, settings, device, outputs, plan, stop)


def _configure(node: Node, words: Sequence[str]) -> tuple[dict[str, Value], Scene]:
    """The node's settings and scene, from its overrides in the command's `words`; each parameter declared on `node`."""
    overrides = checked_parameters(take_overrides(node), (*DEVICE_PARAMETERS, *SCENE_PARAMETERS))
    settings = {parameter.name: overrides.pop(parameter.name, parameter.default) for parameter in DEVICE_PARAMETERS}
    own_name = node.get_fully_qualified_name()
    settings["scene"] = scene_origin(settings["scene"], folder_of("scene", words, own_name))
    scene = load_scene(settings["scene"], own_name).with_parameters(overrides)
    declare(node, DEVICE_PARAMETERS, settings)
    declare(node, SCENE_PARAMETERS, scene.parameters)
    return settings, scene


def _plan(node: SteadyNode, settings: Mapping[str, Value], scene: Scene, outputs: Outputs) -> Plan:
    """How to record, as far as it is known before the start; whatever is wrong with it is found here."""
    checkpoint = Topic(f"{node.get_fully_qualified_name()}/{CHECKPOINT}", CHECKPOINT_TYPE, CHECKPOINT_DEPTH)
    received = {name: node.resolve_topic_name(name) for name in COMMAND_UNITS}
    topics = {**received, **outputs.topics, CHECKPOINT: checkpoint.name}
    plan = plan_recording(settings, received, outputs, _metadata(settings, scene, topics))
    if settings["record.enabled"]:
        check_directory(plan.directory)
    return replace(plan, checkpoint=checkpoint, namespace=node.get_namespace())


def _prepare(node: SteadyNode, settings: Mapping[str, Value], scene: Scene, plan: Plan) -> Simulator:
    """The device, ready to be stepped; and whatever else takes long, so that a signal need not wait for it."""
    log = node.get_logger()
    compile_kernels(scene["solver.method"])
    if fault := scene.broken_promise:
        warnings.simplefilter("ignore", ToleranceWarning)  # said here, in the log's form
        log.warning(fault)
    device = Simulator(scene)
    if device.choice:
        log.info(f"solver.method auto: {device.choice}")
    offer_recovery(plan.directory, settings["record.recover"], log)
    return device


def _operate(node: SteadyNode, executor: Executor, settings: Mapping[str, Value], device: Simulator, outputs: Outputs,
             plan: Plan, stop: StopRequest) -> int:
    """Step, publish, record and listen until a signal or a failure."""
    log, pacing = node.get_logger(), Pacing(settings["rate.real_time_factor"], settings["rate.max_catch_up"])
    parameters, opened = {**settings, **device.scene.parameters}, node.get_clock().now().nanoseconds
    plan = replace(plan, metadata={**plan.metadata, **provenance(parameters, opened)})
    stop.hold()  # before the bag is opened, so that no signal can come between its opening and its sealing
    with open_recording(plan, settings["record.enabled"], log) as recording:
        node.create_service(SetBool, "~/record", lambda request, answer: _switch(recording, request, answer))
        inputs = Inputs(node)  # not before: commands would wait and be applied in a burst
        start, begin = _start(node, recording)
        with Stepping(device, inputs, outputs, recording.record, pacing, settings["rate.publish"], start, log,
                      partial(_keep_checkpoint, recording), begin) as stepping:
            log.info(f"ready: {settings['rate.publish']:g} Hz, real-time factor "
                     f"{settings['rate.real_time_factor']:g}, {recording.destination()}")
            diagnostics = Diagnostics(node, device, stepping, pacing, inputs, recording)

            def over() -> bool:
                recording.watch()
                return bool(stop or stepping.error)

            process.spin_until(executor, over, WATCH)
        if stepping.error:
            recording.save(stepping.error)
    if stepping.error or recording.faults:
        diagnostics.publish_last()
    log.info(f"{recording.summary()}; {device.time:.3f} s simulated, {pacing.dropped:.3f} s dropped in "
             f"{pacing.stalls} stalls, {inputs.refused} commands refused, {inputs.dropped} dropped")
    if stepping.error:
        raise stepping.error
    if recording.faults:
        raise RuntimeError(recording.faults[0])
    return 0


def _start(node: Node, recording: Recording) -> tuple[int, float]:
    """The instant of simulated time 0, which is now: ROS time [ns], and the monotonic clock [s].

    It is read last, when all that takes time is done; the bag is open by then and hears of it now.
    """
    start, begin = node.get_clock().now().nanoseconds, time.monotonic()
    recording.describe({"start": str(start)})
    return start, begin


def _switch(recording: Recording, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
    """Answer the service `~/record`."""
    answer.success, answer.message = recording.switch(request.data)
    return answer


def _keep_checkpoint(recording: Recording, stamp: int, state: Callable[[], np.ndarray]) -> None:
    """Offer the device's whole state to the bag, which seldom wants it."""
    recording.checkpoint(stamp, lambda: serialize_message(Float64MultiArray(data=array("d", state()))))


def _metadata(settings: Mapping[str, Value], scene: Scene, topics: Mapping[str, str]) -> dict[str, str]:
    """What the bag says of itself beside its `provenance`: `scene`, and the `topics` by the robot's own names."""
    return {"scene": str(settings["scene"]), "topics": json.dumps(topics)}


def _parser() -> Parser:
    device = {parameter.name: parameter.default for parameter in DEVICE_PARAMETERS}
    scene = load_scene(device["scene"]).parameters
    return Parser(
        prog="robot",
        description=f"{EXECUTABLES['robot'].does} Shipped scenes: " + ", ".join(shipped_scenes()),
        epilog="ROS parameters (--ros-args -p name:=value, or --params-file):\n"
        + parameter_lines(DEVICE_PARAMETERS, device) + "\n"
        + parameter_lines(SCENE_PARAMETERS, scene)
        + "\n\nExit code 0: ended by a signal; 1: simulation or recording failed; 2: bad parameter.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
