"""The `robot` executable: the virtual device behind its ROS interface."""

import argparse
import gc
import json
import sys
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
from vibro_ros.bag.robot_topics import CHECKPOINT, CHECKPOINT_TYPE, COMMANDS
from vibro_ros.model.parameters import SCENE_PARAMETERS, Value, checked_parameters
from vibro_ros.model.scene import Scene
from vibro_ros.provenance import provenance
from vibro_ros.ros import process
from vibro_ros.ros.diagnostics import Diagnostics
from vibro_ros.ros.inputs import Inputs
from vibro_ros.ros.node import SteadyNode
from vibro_ros.ros.outputs import TOPICS, Outputs
from vibro_ros.ros.pacing import Pacing
from vibro_ros.ros.parameters import declare, parameter_lines, take_overrides
from vibro_ros.ros.recording import Recording, offer_recovery, open_recording, plan_recording
from vibro_ros.ros.remapping import check_names
from vibro_ros.ros.ros_arguments import check_addressed, check_arguments, own_arguments
from vibro_ros.ros.ros_time import wait_for_time
from vibro_ros.ros.stepping import Stepping
from vibro_ros.scene_file import DEVICE_PARAMETERS, load_scene, shipped_scenes
from vibro_ros.simulator import Simulator, compile_kernels

NODE_NAME = "vibro_robot"
CHECKPOINT_DEPTH = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run the robot until SIGINT or SIGTERM.

    Returns
    -------
    int
        0 after a signal; 2 for bad input; 1 when the simulation or the recording failed.
    """
    return process.exit_code("robot", lambda: _run(sys.argv[1:] if argv is None else argv), interrupted=0)


def _run(words: Sequence[str]) -> int:
    _parser().parse_args(own_arguments(words))
    files = check_arguments(words)
    with process.node_running(NODE_NAME, words) as (node, executor):
        check_addressed(files, node.get_fully_qualified_name())
        check_names(node, (*COMMANDS, *TOPICS))
        settings, scene = _configure(node)
        node.get_logger().info(f"scene {settings['scene']}; compiling (the first time takes a while) ...")
        compile_kernels(scene["solver.method"])
        gc.freeze()  # all of this lasts: to go through it again and again would delay ticks, and the process's end
        return _operate(node, executor, settings, scene)


def _configure(node: Node) -> tuple[dict[str, Value], Scene]:
    """The node's settings and scene, from its overrides; every parameter declared on `node`."""
    overrides = checked_parameters(take_overrides(node), (*DEVICE_PARAMETERS, *SCENE_PARAMETERS))
    settings = {parameter.name: overrides.pop(parameter.name, parameter.default) for parameter in DEVICE_PARAMETERS}
    scene = load_scene(settings["scene"]).with_parameters(overrides)
    declare(node, DEVICE_PARAMETERS, settings)
    declare(node, SCENE_PARAMETERS, scene.parameters)
    return settings, scene


def _operate(node: SteadyNode, executor: Executor, settings: Mapping[str, Value], scene: Scene) -> int:
    """Step, publish, record and listen until a signal or a failure."""
    log, device = node.get_logger(), Simulator(scene)
    if device.choice:
        log.info(f"solver.method auto: {device.choice}")
    outputs, inputs = Outputs(node, scene, settings["frame_prefix"]), Inputs(node)
    pacing = Pacing(settings["rate.real_time_factor"], settings["rate.max_catch_up"])
    wait_for_time(node, executor, stopped=lambda: False)  # a signal raises here
    start = node.get_clock().now().nanoseconds
    checkpoint = Topic(f"{node.get_fully_qualified_name()}/{CHECKPOINT}", CHECKPOINT_TYPE, CHECKPOINT_DEPTH)
    topics = {**inputs.topics, **outputs.topics, CHECKPOINT: checkpoint.name}
    metadata = _metadata(settings, device.scene, start, topics)
    plan = replace(plan_recording(settings, inputs, outputs, metadata), checkpoint=checkpoint,
                   namespace=node.get_namespace())
    offer_recovery(plan.directory, settings["record.recover"], log)
    # Signals become requests before the bag is opened, so that none can come between its opening and its sealing.
    with process.StopRequest() as stop, open_recording(plan, settings["record.enabled"], log) as recording:
        node.create_service(SetBool, "~/record", lambda request, answer: _switch(recording, request, answer))
        log.info(f"ready: {settings['rate.publish']:g} Hz, real-time factor {settings['rate.real_time_factor']:g}, "
                 f"{recording.destination()}")
        with Stepping(device, inputs, outputs, recording.record, pacing, settings["rate.publish"], start, log,
                      partial(_keep_checkpoint, recording)) as stepping:
            diagnostics = Diagnostics(node, device, stepping, pacing, inputs, recording)
            process.spin_until(executor, lambda: recording.watch() or bool(stop or stepping.error))
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


def _switch(recording: Recording, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
    """Answer the service `~/record`."""
    answer.success, answer.message = recording.switch(request.data)
    return answer


def _keep_checkpoint(recording: Recording, stamp: int, state: Callable[[], np.ndarray]) -> None:
    """Offer the device's whole state to the bag, which seldom wants it."""
    recording.checkpoint(stamp, lambda: serialize_message(Float64MultiArray(data=array("d", state()))))


def _metadata(settings: Mapping[str, Value], scene: Scene, start: int, topics: Mapping[str, str]) -> dict[str, str]:
    """What the bag says of itself: `scene`, the `topics` by the robot's own names for them, and all of `provenance`."""
    parameters = {**settings, **scene.parameters}
    return {"scene": str(settings["scene"]), "topics": json.dumps(topics), **provenance(parameters, start)}


def _parser() -> process.Parser:
    device = {parameter.name: parameter.default for parameter in DEVICE_PARAMETERS}
    scene = load_scene(device["scene"]).parameters
    return process.Parser(
        prog="robot",
        description="Run the vibro-impact robot as a ROS 2 device, until SIGINT or SIGTERM. "
        "Shipped scenes: " + ", ".join(shipped_scenes()),
        epilog="ROS parameters (--ros-args -p name:=value, or --params-file):\n"
        + parameter_lines(DEVICE_PARAMETERS, device) + "\n"
        + parameter_lines(SCENE_PARAMETERS, scene)
        + "\n\nExit code 0: ended by a signal; 1: simulation or recording failed; 2: bad parameter.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


if __name__ == "__main__":
    sys.exit(main())
