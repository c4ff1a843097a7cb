"""The robot's diagnostics on /diagnostics, once a second (REP-107)."""

import math
import time
from collections.abc import Callable, Mapping

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration

from vibro_ros.messages.topics import full_name
from vibro_ros.model.scene import Scene
from vibro_ros.ros.node.node import GuardedNode, qos_profile
from vibro_ros.ros.robot.run import RobotRun
from vibro_ros.simulation.samples import FIELDS
from vibro_ros.simulation.validity import validity_of

PERIOD = 1.0  # s
SECOND = 1_000_000_000  # ns
LAST_TIMEOUT = 0.5  # s; Fast DDS asks for acknowledgements every 3 s only
NOT_EVENTS = ("steps", "energy_accounts", "solver.method", "solver.step")
"""Keys of `Simulator.statistics` that do not count events."""

REFUSED = {"refused": "commands refused", "requests": "requests refused", "failures": "callbacks failed"}
"""Words for counters that have grown within a period."""
BEHIND = 1.0
"""Difference [s] of stamps from ROS time, and its change in a period, above which there is a warning; short stalls have
a warning of their own."""
NEWS = 10.0  # time [s] for which a clock that was set is a warning; afterwards the message says so at level OK


class Diagnostics:
    """Publishes the state of simulation and recorder, in the executor's thread; `now` returns ROS time [ns]."""

    def __init__(self, node: GuardedNode, run: RobotRun, now: Callable[[], int]):
        self._node, self._run, self._now = node, run, now
        self._publisher = node.create_publisher(DiagnosticArray, full_name("diagnostics"), qos_profile("diagnostics"))
        self._namesakes = 0
        self._previous_counters = self._counters()
        self._first_offset = self._offset = self._clock_offset()
        self._clock_was_set = -math.inf  # when, by the monotonic clock [s]
        # a steady clock, because ROS time may stand still
        node.create_timer(PERIOD, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish(self) -> None:
        """Publish once."""
        previous, self._previous_counters = self._previous_counters, self._counters()
        change = {name: value - previous[name] if value >= previous[name] else value  # a reset restarts some counts
                  for name, value in self._previous_counters.items()}
        message = DiagnosticArray(status=[self._simulation(change), self._recorder()])
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self._now(), SECOND)
        self._publisher.publish(message)

    def publish_last(self) -> None:
        """Publish once more and wait up to `LAST_TIMEOUT` until it has arrived, because the process is about to end."""
        self.publish()
        self._publisher.wait_for_all_acked(Duration(seconds=LAST_TIMEOUT))

    def _counters(self) -> dict[str, float]:
        """Return all counters; the stepping thread may increase them meanwhile, but each value is consistent."""
        self._statistics, self._disturbances = self._run.device_facts()
        return {"wall": time.monotonic(), "simulated": self._run.robot_time.time, "ticks": self._run.robot_time.ticks,
                "busy": self._run.busy, "unloaded": self._run.ticks_without_normal_force,
                "dropped": self._run.pacing.dropped, "refused": self._run.commands.refused,
                "requests": self._node.refusals.count, "failures": self._node.refusals.failures,
                "events": sum(count for kind, count in self._statistics.items() if kind not in NOT_EVENTS)}

    def _simulation(self, change: Mapping[str, float]) -> DiagnosticStatus:
        begun, (behind, clock_change) = time.monotonic(), self._differences_of_time()
        stamp_warning = self._stamp_warning(behind, clock_change)
        validity = validity_of(self._run.device.scene, dict(zip(FIELDS, self._run.take_samples().T, strict=True)))
        complaints = []
        if change["dropped"] > 0.0:
            complaints.append(f"{change['dropped']:.3f} s of simulated time dropped")
        complaints += [f"{change[name]:.0f} {words}" for name, words in REFUSED.items() if change[name]]
        if stamp_warning and begun < self._clock_was_set + NEWS:  # true when just noticed, however slow the computer is
            complaints.append(stamp_warning)
        if self._other_robots():
            complaints.append(self._same_name_warning)
        complaints += validity.warnings()
        state = "paused" if self._run.paused else "running"
        level, text = (DiagnosticStatus.WARN, ", ".join(complaints)) if complaints else (
            DiagnosticStatus.OK, f"{state}; {stamp_warning}" if stamp_warning else state)
        if self._run.error:
            level, text = DiagnosticStatus.ERROR, str(self._run.error)
        values = self._values(change, behind, clock_change)
        if validity.pitch_index is not None:
            values["pitch index"] = f"{validity.pitch_index:.3f}"
        if validity.current_share is not None:
            values["rms current over continuous"] = f"{validity.current_share:.3f}"
        if "energy_accounts" in self._statistics:
            values["energy residual [J]"] = f"{self._statistics['energy_accounts']['residual']:.3e}"
        return self._status("simulation", level, text, values)

    def _values(self, change: Mapping[str, float], behind: float, clock_change: float) -> dict[str, str]:
        """Return the values that the simulation always has, from the `change` of its counters and the differences of
        time [s]."""
        wall, scene = max(change["wall"], 1e-9), self._run.device.scene
        values = {
            "simulated time [s]": f"{self._run.robot_time.time:.6f}",
            "real-time factor": f"{change['simulated'] / wall:.4f}",
            "missed deadlines": f"{self._run.pacing.missed}",
            **self._lateness(),
            "dropped time [s]": f"{self._run.pacing.dropped:.6f}",
            "stalls": f"{self._run.pacing.stalls}",
            "stamps behind [s]": f"{behind:.6f}",
            "clock set by [s]": f"{clock_change:.6f}",
            "nodes of this name": f"{1 + self._namesakes}",
            "cost of a step [us]": f"{1e6 * change['busy'] / max(change['ticks'], 1):.1f}",
            "share of time spent simulating": f"{change['busy'] / wall:.4f}",
            "events per second": f"{change['events'] / wall:.1f}",
            "share of time with N<0": f"{min(1.0, change['unloaded'] / max(change['ticks'], 1)):.4f}",
            "stops by command.timeout": f"{self._run.timeout.count if self._run.timeout else 0}",
            "lasting": ", ".join(f"{name} until {until:.6g} s"
                                 for name, until in sorted(self._active_disturbances().items())),
            "lost commands": f"{self._run.commands.lost}",
            "rejected commands": f"{self._run.commands.refused}",
            "refused requests": f"{self._node.refusals.count}",
            "failed callbacks": f"{self._node.refusals.failures}",
            "solver method": scene["solver.method"],
            "accuracy in force": _accuracy_of(scene),
        }
        if "solver.step" in self._statistics:
            values["solver step [s]"] = f"{scene['solver.step']:g}"
        return values

    def _lateness(self) -> dict[str, str]:
        """Return quantiles of the ticks' lateness since the last call; none if the device never waits."""
        late = sorted(self._run.pacing.take_lateness())
        if not late:
            return {}
        # np.quantile would load numpy's masked arrays: 2 MB
        quantiles = np.interp(np.array((0.5, 0.99, 1.0)) * (len(late) - 1), range(len(late)), late)
        return {f"lateness {name} [us]": f"{1e6 * seconds:.1f}"
                for name, seconds in zip(("median", "p99", "max"), quantiles, strict=True)}

    def _active_disturbances(self) -> dict[str, float]:
        """Return the disturbances that are active now, a push and faults, with the robot time [s] of their end."""
        run, time = self._run, self._run.robot_time
        stamps = {name: time.stamp_of(until) for name, until in self._disturbances.items()}
        stamps |= run.commands.disturbances
        return {name: (stamp - time.start) / SECOND for name, stamp in stamps.items() if stamp > time.stamp}

    def _clock_offset(self) -> float:
        """Return ROS time less the time of the computer's monotonic clock, which nobody can set [s]."""
        return (self._now() - time.monotonic_ns()) / SECOND

    def _differences_of_time(self) -> tuple[float, float]:
        """Return by how much the last sample's stamp is behind ROS time, and how far ROS time has gone ahead of the
        monotonic clock since the start [s]; both are 0 where robot time is ROS time.

        The log warns when ROS time has jumped since the last call.
        """
        behind = (self._now() - self._run.robot_time.stamp) / SECOND
        if not behind:
            return 0.0, 0.0
        last_offset, self._offset = self._offset, self._clock_offset()
        change = self._offset - self._first_offset
        if abs(self._offset - last_offset) > BEHIND:
            self._clock_was_set = time.monotonic()
            if warning := self._stamp_warning(behind, change):
                self._node.get_logger().warning(warning)
        return behind, change

    def _stamp_warning(self, behind: float, clock_change: float) -> str:
        """Return in words why stamps differ from ROS time; empty if they do not, or are meant to.

        The part of the difference that is no change of the clock is time in which robot time stood still, because of
        pauses and stalls.
        """
        still, follows_clock = behind - clock_change, self._node.get_parameter("use_sim_time").value
        clock, why = ("/clock", "jumped, or runs faster or slower") if follows_clock else (
            "the wall clock", "was set, or the computer slept")
        if abs(behind) <= BEHIND or self._run.pacing.factor != 1.0 or self._run.paused:
            return ""
        causes = []
        if abs(clock_change) > BEHIND / 2.0:
            side = "ahead of" if clock_change > 0.0 else "behind"
            causes.append(f"{clock} has gone {abs(clock_change):.2f} s {side} the computer's monotonic clock (it "
                          f"{why}): start the robot again to take over the new time")
        if still > BEHIND / 2.0:
            causes.append(f"robot time stood still for {still:.2f} s of pauses or stalls: start the robot with "
                          "clock.publish and its peers with use_sim_time, so that all have one time")
        return (f"stamps are {abs(behind):.2f} s {'behind' if behind > 0.0 else 'ahead of'} {clock}, because "
                + ", and because ".join(causes))

    def _other_robots(self) -> int:
        """Return the number of other nodes with this node's full name; the log warns when the number grows."""
        earlier, own_name = self._namesakes, (self._node.get_name(), self._node.get_namespace())
        self._namesakes = max(0, self._node.get_node_names_and_namespaces().count(own_name) - 1)
        if self._namesakes > earlier:
            self._node.get_logger().warning(self._same_name_warning)
        return self._namesakes

    @property
    def _same_name_warning(self) -> str:
        return (f"{self._namesakes + 1} nodes are named {self._node.get_fully_qualified_name()}: all of them take each "
                "command, and their topics are mixed; give each robot a namespace, such as --ros-args -r __ns:=/r1 "
                "(a robot that was killed counts for 20 s)")

    def _recorder(self) -> DiagnosticStatus:
        recording, recorder = self._run.recording, self._run.recording.latest
        level, text, values = DiagnosticStatus.OK, recording.destination(), {}
        if recorder:
            values = {"folder": str(recorder.folder), "backlog": f"{recorder.backlog}",
                      "written": f"{recorder.written}", "dropped": f"{recorder.dropped}", "lost": f"{recorder.lost}",
                      "fault": recorder.fault or ""}
            if recorder.dropped or recorder.lost:
                level, text = DiagnosticStatus.WARN, f"{text}; {recorder.dropped + recorder.lost} messages lost"
            if recorder.fault:
                level, text = DiagnosticStatus.ERROR, recorder.fault
        return self._status("recorder", level, text, values)

    def _status(self, part: str, level: bytes, text: str, values: Mapping[str, str]) -> DiagnosticStatus:
        robot = self._node.get_fully_qualified_name()
        return DiagnosticStatus(level=level, name=f"{robot.lstrip('/')}: {part}", message=text, hardware_id=robot,
                                values=[KeyValue(key=key, value=value) for key, value in values.items()])


def _accuracy_of(scene: Scene) -> str:
    """Return in words the accuracy of a scene's simulation."""
    if scene["solver.method"] == "exact":
        return f"rounding: {scene.attainable_accuracy:.2g} m for 0.2 s"
    return "not known: a step of fixed length promises nothing, and the executable accuracy measures its error"
