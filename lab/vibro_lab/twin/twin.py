"""The `twin` executable: follows a robot by its sensors and commands, estimates its parameters, and names its fault."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_lab.executables import twin

    sys.exit(twin())

import argparse
import gc
import os
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

from vibro_lab.executables import EXECUTABLES
from vibro_lab.twin.estimator import Departure, Estimator
from vibro_lab.twin.messages import PUBLISHED, SENSORS, RobotSubscriptions, TwinPublishers
from vibro_lab.twin.particles import STEP
from vibro_ros import (
    COMMANDS,
    Parameter,
    Parser,
    Scene,
    SimulationError,
    StopRequest,
    ToleranceWarning,
    Value,
    checked_parameters,
    exit_code,
    load_scene,
    of_imu,
    say,
    scene_origin,
    shipped,
)
from vibro_ros import (
    PARAMETERS as SCENE_PARAMETERS,
)
from vibro_ros.ros import (
    CLOCK,
    GuardedNode,
    check_addressed,
    check_arguments,
    check_names,
    check_qos_overrides,
    declare,
    folder_of,
    node_running,
    own_arguments,
    parameter_lines,
    spin_until,
    take_overrides,
    wait_for_time,
)

NODE_NAME = "vibro_twin"
NICENESS = 5
"""Niceness of the twin, so that it gives way to the robot, which must keep time."""
POLL, REPORT_PERIOD = 0.02, 1.0
"""Time [s] between two looks for messages, and between two diagnostics of a robot about which nothing is new."""
LAG = 1.0
"""Time [s] by which the estimate may be behind the clock, besides `twin.delay`, without a warning."""
NOTHING = "none"
PARAMETERS = (
    Parameter("scene", "device", "", "the robot as it is believed to be: a shipped scene's name, or the path of a "
              "parameter file, whose own `scene` it changes"),
    Parameter("frame_prefix", "", "", "put before the name of every frame as it is, such as r1/ for one of two robots"),
    Parameter("twin.free", ("ground.friction", "mass.body", "upper.spring.stiffness", "inclined.spring.stiffness"), "",
              f"parameters that are estimated, numbers above 0; [{NOTHING}] for none"),
    Parameter("twin.spread", 0.02, "", "relative standard deviation of what the scene says of each of them",
              minimum=0.0, maximum=0.3, positive=True),
    Parameter("twin.particles", 40.0, "", "number of simulations side by side; cost grows with it", minimum=4.0,
              maximum=1000.0),
    Parameter("twin.delay", 0.05, "s", "time by which the estimate is behind the clock at least, so that late "
              "measurements count in the order of their stamps", minimum=0.0, maximum=2.0),
    Parameter("twin.joint_noise", 0.0, "m", "standard deviation of the positions in joint_states, as a camera measures "
              "them; 0: they are not heard", minimum=0.0, maximum=1.0),
)
"""The node's own parameters; those of the scene are the others."""


def main(argv: Sequence[str] | None = None) -> int:
    """Follow a robot until SIGINT, SIGTERM or SIGHUP.

    Returns
    -------
    int
        0 after a signal; 2 for bad input; 1 on failure.
    """
    return exit_code("twin", lambda: _run(sys.argv[1:] if argv is None else argv))


def _run(words: Sequence[str]) -> int:
    _parser().parse_args(own_arguments(words, PARAMETERS))
    files = check_arguments(words)
    os.nice(NICENESS)
    with StopRequest() as stop, node_running(NODE_NAME, words) as node:
        check_addressed(files, node.get_fully_qualified_name())
        check_names(node, (*COMMANDS, *SENSORS, *PUBLISHED))
        settings, scene = _configure(node, words)
        check_qos_overrides(node, PUBLISHED, (*COMMANDS, *SENSORS, CLOCK))
        node.get_logger().info(f"scene {settings['scene']}")
        estimator = _new_estimator(settings, scene)
        wait_for_time(node, lambda: bool(stop))
        if stop:
            say("twin", "stopped while starting")
            return 0
        gc.freeze()  # permanent objects: to collect among them would delay every step
        twin = Twin(node, settings, scene, estimator)
        node.get_logger().info("ready: " + ", ".join(map(node.resolve_topic_name, PUBLISHED)))

        def over() -> bool:
            twin.work(stop)
            return bool(stop)

        spin_until(node, over, POLL)
    return 0


def _configure(node: GuardedNode, words: Sequence[str]) -> tuple[dict[str, Value], Scene]:
    """Return the node's settings and the believed scene, and declare every parameter; `words` is the command line."""
    overrides = checked_parameters(take_overrides(node), (*PARAMETERS, *SCENE_PARAMETERS.values()))
    settings = {parameter.name: overrides.pop(parameter.name, parameter.default) for parameter in PARAMETERS}
    own_name = node.get_fully_qualified_name()
    settings["scene"] = scene_origin(settings["scene"], folder_of("scene", words, own_name))
    scene = load_scene(settings["scene"], own_name).with_parameters(overrides)
    if scene["solver.method"] != "exact":
        raise ValueError(f"solver.method: {scene['solver.method']} has no filtered acceleration; choose exact")
    declare(node, PARAMETERS, settings)
    declare(node, [replace(parameter, while_running=False) for parameter in SCENE_PARAMETERS.values()],
            scene.parameters)
    return settings, scene


def _new_estimator(settings: Mapping[str, Value], scene: Scene) -> Estimator:
    warnings.simplefilter("ignore", ToleranceWarning)
    free = [name for name in settings["twin.free"] if name != NOTHING]
    return Estimator(scene, free, settings["twin.spread"], round(settings["twin.particles"]),
                     bandwidth=of_imu(scene, "bandwidth"))


class Twin:
    """Feeds an estimator with measurements and commands, and publishes its estimate."""

    def __init__(self, node: GuardedNode, settings: Mapping[str, Value], scene: Scene, estimator: Estimator):
        self._node, self._settings, self._scene, self._estimator = node, settings, scene, estimator
        self._robot = RobotSubscriptions(node, scene, settings["twin.joint_noise"])
        self._publishers = TwinPublishers(node, settings["frame_prefix"])
        self._start = self._now()  # ROS time [ns] of the estimator's time 0
        self._reported: Departure | None = None
        self._due, self._refused, self._late, self._measured = 0.0, 0, 0, 0
        self._waits_of_late: list[float] = []  # s; of measurements that are late only because they waited for this node

    def _now(self) -> int:
        return self._node.get_clock().now().nanoseconds

    def work(self, stop: StopRequest) -> None:
        """Take what has arrived, take the steps that are due, and publish; returns early if a signal comes."""
        now, wall = self._now(), time.time_ns()
        if (now - self._start) * 1e-9 < self._estimator.time - LAG:
            self._node.get_logger().warning("the clock has jumped back; the estimate starts again")
            self._estimator, self._start, self._late = _new_estimator(self._settings, self._scene), now, 0
        for arrived, given in self._robot.commands():
            delay = 0 if self._node.get_clock().ros_time_is_active else max(0, wall - arrived)
            self._estimator.command((now - self._start - delay) * 1e-9, **given)
        for stamp, measurement in self._robot.measurements(now):
            was_late, waited = self._estimator.late, self._robot.waited
            self._estimator.measure(measurement._replace(time=(stamp - self._start) * 1e-9))
            self._measured += 1
            if self._estimator.late > was_late and (now - stamp) * 1e-9 <= waited + self._settings["twin.delay"]:
                self._waits_of_late.append(waited)
        target = (now - self._start) * 1e-9 - self._settings["twin.delay"]
        while not stop and self._estimator.time + STEP <= target:
            try:
                self._estimator.advance_by_step(target)
            except (SimulationError, ValueError) as error:  # no message may end the node
                self._node.refusals.catch("the estimate", error)
                self._estimator.start_again(target)
            stamp = self._start + round(1e9 * self._estimator.time)
            self._publishers.publish_step(stamp, self._estimator.estimate(), self._estimator.innovations)
            if self._estimator.departure != self._reported:
                self._note(self._estimator.departure)
            self._report()
        self._report()

    def _note(self, departure: Departure | None) -> None:
        self._reported, self._due = departure, 0.0
        if departure:
            self._node.get_logger().warning(
                f"the robot has left the model: {departure.words}, since about "
                f"{departure.time - departure.since:.2f} s, evidence {departure.evidence:.3g}")
        else:
            self._node.get_logger().info("the robot moves as the model again")

    def _report(self) -> None:
        """Publish the diagnostics if they are due."""
        if time.monotonic() < self._due:
            return
        self._due = time.monotonic() + REPORT_PERIOD
        estimator, refusals, now = self._estimator, self._node.refusals, self._now()
        behind = (now - self._start) * 1e-9 - estimator.time
        troubles = [f"{refusals.count - self._refused} messages or requests refused"] * (refusals.count > self._refused)
        if behind > self._settings["twin.delay"] + LAG:
            troubles.append(f"{behind:.1f} s behind the clock; give fewer twin.particles")
        if not self._robot.received.keys() & SENSORS.keys():
            troubles.append("no sensor of a robot is heard")
        if (late := estimator.late - self._late) > 0.5 * self._measured:
            why = "give a longer one, or use_sim_time if the robot's time is not the clock's"
            if len(self._waits_of_late) >= 0.5 * late:
                why = (f"they waited up to {max(self._waits_of_late):.1f} s for this node, which lacks time to "
                       "compute: give fewer twin.particles, or a computer with less to do")
            troubles.append(f"{late} of {self._measured} measurements came later than twin.delay, and are not used; "
                            f"{why}")
        self._waits_of_late.clear()
        self._refused, self._late, self._measured = refusals.count, estimator.late, 0
        departure = estimator.departure
        self._publishers.report(now, departure, troubles, {
            "fault": departure.words if departure and departure.fault else "",
            "since [s]": f"{departure.since:.3f}" if departure else "",
            "noticed [s]": f"{departure.time:.3f}" if departure else "",
            "evidence": f"{departure.evidence:.6g}" if departure else "",
            "estimate is of [s]": f"{estimator.time:.3f}",
            "behind [s]": f"{behind:.3f}",
            "restarts": f"{estimator.restarts}",
            "late measurements": f"{estimator.late}",
            "refused": f"{refusals.count}",
            "failed callbacks": f"{refusals.failures}",
            **{f"heard on {name}": f"{count}" for name, count in sorted(self._robot.received.items())}})


def _parser() -> Parser:
    defaults = {parameter.name: parameter.default for parameter in PARAMETERS}
    return Parser(
        prog="twin",
        description=f"{EXECUTABLES['twin'].does} Shipped scenes: " + ", ".join(shipped("scene")),
        epilog="ROS parameters (--ros-args -p name:=value, or --params-file), besides all of the scene, which\n"
        "`robot --help` lists:\n" + parameter_lines(PARAMETERS, defaults)
        + "\n\nExit code 0: ended by a signal; 1: failed; 2: bad parameter.",
        formatter_class=argparse.RawDescriptionHelpFormatter)
