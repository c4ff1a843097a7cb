"""The `robot` executable: the virtual device with its ROS interface."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    from vibro_ros.process.entry_point import enter

    raise SystemExit(enter("robot"))

import argparse
import gc
import json
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as ParameterOfRclpy

from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS, NODE_NAME, load_scene, scene_origin, shipped_scenes
from vibro_ros.messages.frames import ODOM
from vibro_ros.messages.topics import (
    CHECKPOINT,
    COMMANDS,
    EVENT,
    ONCE,
    OPERATIONS,
    SAMPLE,
    SAMPLES,
    TOPICS,
    VARIANCES,
    commands_of,
    full_name,
)
from vibro_ros.model.parameters import SCENE_PARAMETERS, Value, checked_parameters
from vibro_ros.model.scene import Scene
from vibro_ros.process.entry_point import Parser, StopRequest, exit_code, say
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.ros.node import process
from vibro_ros.ros.node.arguments import check_addressed, check_arguments, check_names, folder_of, own_arguments
from vibro_ros.ros.node.node import GuardedNode, check_qos_overrides, installed_type
from vibro_ros.ros.node.parameters import declare, parameter_lines, take_overrides
from vibro_ros.ros.node.process import CLOCK, wait_for_time
from vibro_ros.ros.robot.diagnostics import Diagnostics
from vibro_ros.ros.robot.lock_step import checked_nodes
from vibro_ros.ros.robot.pacing import set_real_time_priority
from vibro_ros.ros.robot.recording import Plan, Recording, check_directory, handle_unsealed_bags, plan_recording
from vibro_ros.ros.robot.run import RobotPublishers, RobotRun
from vibro_ros.ros.robot.services import offer_disturbances, offer_run_services
from vibro_ros.sensors.device import new_device
from vibro_ros.simulation.provenance import provenance
from vibro_ros.simulation.simulator import Simulator, ToleranceWarning

PUBLISHED = tuple(full_name(name) for name, topic in TOPICS.items() if topic.when in (SAMPLE, EVENT, ONCE))
"""Topics on which any robot publishes its device's motion, before namespace and remapping."""
SWITCH_INTERVAL = 1e-4
"""Longest time [s] for which a thread keeps the interpreter lock that another one waits for: a delay of a tick."""
RECORDING_POLL = 1.0
"""Longest time [s] until the node reacts to a failure of the recording; a signal or the run's end wakes the node."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the robot until SIGINT, SIGTERM or SIGHUP. Returns the exit code, which `--help` explains."""
    return exit_code("robot", lambda: _run(sys.argv[1:] if argv is None else argv))


def _run(words: Sequence[str]) -> int:
    _parser().parse_args(own_arguments(words, (*DEVICE_PARAMETERS, *SCENE_PARAMETERS)))
    files = check_arguments(words)
    with StopRequest() as stop, process.node_running(NODE_NAME, words) as node:
        check_addressed(files, node.get_fully_qualified_name())
        check_names(node, (*COMMANDS, *PUBLISHED))
        settings, scene = _configure(node, words)
        check_qos_overrides(node, (*PUBLISHED, *map(full_name, (OPERATIONS, SAMPLES, "diagnostics")),
                                   *[CLOCK] * settings["clock.publish"]), (*COMMANDS, CLOCK))
        publishers = RobotPublishers(node, scene, settings["frame_prefix"], settings["tf.publish"],
                                     [settings[name] for name in VARIANCES], settings["ros2_control"])
        plan = _plan(node, settings, scene, publishers)
        node.get_logger().info(f"scene {settings['scene']}")
        preparation = process.in_thread(partial(_prepare, node, settings, scene, plan), process.waker(node))
        process.spin_until(node, lambda: bool(stop or preparation.done()))
        device = None if stop else preparation.result()
        if not settings["clock.publish"]:  # else the robot itself publishes the time
            wait_for_time(node, lambda: bool(stop))
        if stop or device is None:
            say("robot", "stopped while starting")
            return 0
        gc.freeze()  # permanent objects: to collect among them would delay ticks and the process's end
        sys.setswitchinterval(SWITCH_INTERVAL)
        set_real_time_priority(settings["rate.real_time_factor"], settings["rate.start_paused"])
        return _operate(node, settings, device, publishers, plan, stop)


def _configure(node: GuardedNode, words: Sequence[str]) -> tuple[dict[str, Value], Scene]:
    """Return the node's settings and scene from its parameter overrides, and declare each parameter on `node`.

    `words` is the command line, from which relative paths are resolved.
    """
    overrides = checked_parameters(take_overrides(node), (*DEVICE_PARAMETERS, *SCENE_PARAMETERS))
    settings = {parameter.name: overrides.pop(parameter.name, parameter.default) for parameter in DEVICE_PARAMETERS}
    own_name = node.get_fully_qualified_name()
    settings["scene"] = scene_origin(settings["scene"], folder_of("scene", words, own_name))
    scene = load_scene(settings["scene"], own_name).with_parameters(overrides)
    declare(node, DEVICE_PARAMETERS, settings)
    declare(node, SCENE_PARAMETERS, scene.parameters)
    node.add_on_set_parameters_callback(_refuse_while_starting)
    if checked_nodes(node, settings["clock.lock_step"]) and not settings["clock.publish"]:
        raise ValueError("clock.lock_step: has no effect without robot time on /clock; set clock.publish to true")
    return settings, scene


def _refuse_while_starting(parameters: Sequence[ParameterOfRclpy]) -> SetParametersResult:
    """Refuse every change of parameters while the robot has no device yet."""
    reason = f"{parameters[0].name}: the robot is still starting; set it when it is ready"
    return SetParametersResult(successful=False, reason=reason)


def _plan(node: GuardedNode, settings: Mapping[str, Value], scene: Scene, publishers: RobotPublishers) -> Plan:
    """Return the plan of the recording, as far as known before the start (ValueError when it cannot be recorded)."""
    names = (*publishers.topics, *commands_of(scene), OPERATIONS, CHECKPOINT)
    topics = {name: node.resolve_topic_name(full_name(name)) for name in names}
    metadata = {"scene": str(settings["scene"]), "topics": json.dumps(topics)}  # `provenance` comes with the start
    plan = plan_recording(settings, topics, metadata, node.get_namespace())
    if settings["record.enabled"]:
        check_directory(plan.directory)
    return plan


def _prepare(node: GuardedNode, settings: Mapping[str, Value], scene: Scene, plan: Plan) -> Simulator:
    """Return the device, and handle unsealed bags; runs in a thread, because both may take long and a signal must not
    wait."""
    warnings.simplefilter("ignore", ToleranceWarning)  # the log says it below
    if fault := scene.broken_promise:
        node.get_logger().warning(fault)
    device = new_device(scene)
    handle_unsealed_bags(plan.directory, settings["record.recover"], node.get_logger())
    return device


def _operate(node: GuardedNode, settings: Mapping[str, Value], device: Simulator,
             publishers: RobotPublishers, plan: Plan, stop: StopRequest) -> int:
    """Run the prepared robot until `stop` or its end; return the exit code."""
    log, parameters = node.get_logger(), {**settings, **device.scene.parameters}
    plan = replace(plan, metadata={**plan.metadata, **provenance(parameters, _now(node, settings))})
    stop.hold()  # before the bag is opened, so that no signal can come between its opening and its sealing
    with Recording(plan, log) as recording:
        if settings["record.enabled"]:
            recording.begin()
        run = RobotRun(node, device, settings, publishers, recording, lambda: bool(stop))
        offer_run_services(node, run)
        offer_disturbances(node, run)
        node.remove_on_set_parameters_callback(_refuse_while_starting)
        node.add_on_set_parameters_callback(run.set_parameters)
        # the clocks are read last, after everything that takes time; the bag is open by then
        run.robot_time.start, begin = _now(node, settings, run), time.monotonic()
        recording.announce({"start": str(run.robot_time.start)}, publishers.begin(run.robot_time.start))
        with run.start(begin):
            diagnostics = Diagnostics(node, run, partial(_now, node, settings, run))
            _offer_simulation(node, run, settings["frame_prefix"] + ODOM)
            log.info(f"ready: {settings['rate.publish']:g} Hz, real-time factor "
                     f"{settings['rate.real_time_factor']:g}, {recording.destination()}{_how_to_resume(node, run)}")

            def over() -> bool:
                recording.watch()
                return bool(stop or run.is_ending)

            process.spin_until(node, over, RECORDING_POLL)
        process.spin_until(node, lambda: not run.waiting)  # requests for steps have an answer, which must be sent
    if run.error or recording.faults:
        diagnostics.publish_last()
    log.info(f"{recording.summary()}; {run.robot_time.time:.3f} s simulated, {run.pacing.dropped:.3f} s dropped "
             f"in {run.pacing.stalls} stalls, {run.commands.refused} commands refused")
    if run.error:
        raise run.error
    if recording.faults:
        raise RuntimeError(recording.faults[0])
    return 0


def _how_to_resume(node: Node, run: RobotRun) -> str:
    """Return how a user lets a paused robot go on, as the end of a sentence; empty if the robot is not paused."""
    if not run.paused:
        return ""
    name = node.get_fully_qualified_name()
    return (f"; paused until {name}/pause is called with false, by the page of `view --robot {name}` or by "
            f"`ros2 service call {name}/pause std_srvs/srv/SetBool '{{data: false}}'`")


def _offer_simulation(node: GuardedNode, run: RobotRun, frame: str) -> None:
    """Offer the services of `simulation_interfaces` if that package is installed; else log that it is not."""
    if installed_type("simulation_interfaces", "msg", "Result"):
        from vibro_ros.ros.robot.simulation_services import SimulationServices

        SimulationServices(node, run, frame)
    else:
        node.get_logger().info("simulation_interfaces is not installed: without its services")


def _now(node: Node, settings: Mapping[str, Value], run: RobotRun | None = None) -> int:
    """Return the ROS time [ns]; where the robot publishes /clock, this is robot time, from which all stamps come."""
    if settings["clock.publish"]:
        return run.robot_time.stamp if run else 0
    return node.get_clock().now().nanoseconds


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
