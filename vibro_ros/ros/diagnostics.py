"""What the robot says of itself on /diagnostics, once a second (REP-107)."""

import time
from collections.abc import Mapping

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration

from vibro_ros.ros import qos
from vibro_ros.ros.inputs import Inputs
from vibro_ros.ros.node import SteadyNode
from vibro_ros.ros.pacing import Pacing
from vibro_ros.ros.recording import Recording
from vibro_ros.ros.stepping import Stepping
from vibro_ros.simulation.accuracy_in_force import accuracy_in_force, next_cheaper_choice
from vibro_ros.simulation.simulator import Simulator

PERIOD = 1.0  # s
LAST_WORD = 0.5  # s; Fast DDS asks for acknowledgements every 3 s only
TOPIC = "/diagnostics"
NOT_EVENTS = ("steps", "energy_residual", "energy_exchanged", "solver.method", "solver.step")
"""Keys of `Simulator.statistics` that do not count events."""

REFUSED = {"refused": "commands refused", "displaced": "commands dropped", "requests": "requests refused",
           "failures": "callbacks failed"}
"""What is said of counters that have grown within a period."""


class Diagnostics:
    """Publishes the state of simulation and recorder; runs in the executor's thread.

    Parameters
    ----------
    node : SteadyNode
        Publishes, and gives the name.
    device, stepping, pacing, inputs, recording
        What is reported.
    """

    def __init__(self, node: SteadyNode, device: Simulator, stepping: Stepping, pacing: Pacing, inputs: Inputs,
                 recording: Recording):
        self._node, self._device, self._stepping = node, device, stepping
        self._pacing, self._inputs, self._recording = pacing, inputs, recording
        self._publisher = node.create_publisher(DiagnosticArray, TOPIC, qos.DIAGNOSTICS)
        self._before = self._counters()
        self._accuracy = {"accuracy in force": accuracy_in_force(device.scene, device.choice),
                          "next cheaper choice": next_cheaper_choice(device.scene, device.choice)}
        # a clock that runs whatever drives the stamps
        node.create_timer(PERIOD, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish(self) -> None:
        """Publish once."""
        now = self._counters()
        change = {name: value - self._before[name] for name, value in now.items()}
        self._before = now
        stamp = self._node.get_clock().now().to_msg()
        message = DiagnosticArray(status=[self._simulation(change), self._recorder()])
        message.header.stamp = stamp
        self._publisher.publish(message)

    def publish_last(self) -> None:
        """Publish once more and wait up to `LAST_WORD` until it has arrived: the process is about to end."""
        self.publish()
        self._publisher.wait_for_all_acked(Duration(seconds=LAST_WORD))

    def _counters(self) -> dict[str, float]:
        """What only grows; numbers that the stepping thread may change meanwhile, each of them whole."""
        statistics = self._device.statistics
        return {"wall": time.monotonic(), "simulated": self._device.time, "ticks": self._stepping.ticks,
                "busy": self._stepping.busy, "unloaded": self._stepping.unloaded, "dropped": self._pacing.dropped,
                "missed": self._pacing.missed, "refused": self._inputs.refused,
                "displaced": self._inputs.dropped, "requests": self._node.refusals.count,
                "failures": self._node.refusals.failures,
                "events": sum(count for kind, count in statistics.items() if kind not in NOT_EVENTS)}

    def _simulation(self, change: Mapping[str, float]) -> DiagnosticStatus:
        device, wall = self._device, max(change["wall"], 1e-9)
        complaints = []
        if change["dropped"] > 0.0:
            complaints.append(f"{change['dropped']:.3f} s of simulated time dropped")
        complaints += [f"{change[name]:.0f} {what}" for name, what in REFUSED.items() if change[name]]
        level, text = (DiagnosticStatus.WARN, ", ".join(complaints)) if complaints else (DiagnosticStatus.OK, "running")
        if self._stepping.error:
            level, text = DiagnosticStatus.ERROR, str(self._stepping.error)
        values = {
            "simulated time [s]": f"{device.time:.6f}",
            "real-time factor": f"{change['simulated'] / wall:.4f}",
            "missed deadlines": f"{self._pacing.missed}",
            **self._lateness(),
            "dropped time [s]": f"{self._pacing.dropped:.6f}",
            "stalls": f"{self._pacing.stalls}",
            "cost of a step [us]": f"{1e6 * change['busy'] / max(change['ticks'], 1):.1f}",
            "share of time spent simulating": f"{change['busy'] / wall:.4f}",
            "events per second": f"{change['events'] / wall:.1f}",
            "share of time with N<0": f"{min(1.0, change['unloaded'] / max(change['ticks'], 1)):.4f}",
            "rejected commands": f"{self._inputs.refused}",
            "dropped commands": f"{self._inputs.dropped}",
            "refused requests": f"{self._node.refusals.count}",
            "failed callbacks": f"{self._node.refusals.failures}",
            "solver method": device.scene["solver.method"],
            **self._accuracy,
        }
        if "solver.step" in device.statistics:
            values["solver step [s]"] = f"{device.scene['solver.step']:g}"
        if device.choice:
            values["solver accuracy asked for [m]"] = f"{device.scene['solver.accuracy']:g}"
            values["solver choice"] = str(device.choice)
        residual = device.statistics.get("energy_residual")
        if residual is not None:
            values["energy residual [J]"] = f"{residual:.3e}"
        return self._status("simulation", level, text, values)

    def _lateness(self) -> dict[str, str]:
        """How late the ticks since the last report began; nothing of a device that never waits."""
        late = self._pacing.take_lateness()
        if not late:
            return {}
        of_ticks = zip(("median", "p99", "max"), np.quantile(late, (0.5, 0.99, 1.0)), strict=True)
        return {f"lateness {name} [us]": f"{1e6 * value:.1f}" for name, value in of_ticks}

    def _recorder(self) -> DiagnosticStatus:
        recording, recorder = self._recording, self._recording.latest
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
