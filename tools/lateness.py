"""Measure what recording costs the robot's clock: `python -m tools.lateness`.

One robot publishes everything at 1 kHz and begins and seals bags in turn, as `~/record` asks; how late its ticks are,
it says in /diagnostics once a second. So both halves share the process and the machine's other load, and their ratio is
the recorder's.
"""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("lateness"))

import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import Executor
from rclpy.node import Node
from std_srvs.srv import SetBool

from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code
from vibro_ros.ros.node import process, qos
from vibro_ros.ros.robot.diagnostics import TOPIC

NODE_NAME = "lateness"
PATIENCE = 600.0
"""Longest wait [s] for the robot, whose kernels may have to be compiled first."""
NOT_COUNTED = 2
"""Reports after a switch that still tell of the time before it, or of the switch itself."""
FIGURES = ("median", "p99", "max")

Seconds = dict[bool, list[dict[str, float]]]
"""What each counted report said [us], by whether it was of a second that was recorded."""


class Measurement:
    """Listens to what the robot in `namespace` says of its ticks, while something is switched on and off.

    Parameters
    ----------
    node, executor : Node, Executor
        Used from the calling thread alone.
    namespace : str
        The robot's.
    """

    def __init__(self, node: Node, executor: Executor, namespace: str):
        self._executor = executor
        self._robot = f"/{namespace}/vibro_robot"
        self._reports: list[dict[str, str]] = []
        node.create_subscription(DiagnosticArray, TOPIC, self._hear, qos.DIAGNOSTICS)

    def run(self, robot: subprocess.Popen, rounds: int, length: int) -> Seconds:
        """Switch on and off `rounds` times, for `length` counted reports each time.

        Raises
        ------
        RuntimeError
            When the robot ends, or what is switched fails.
        """
        self._wait(robot, lambda: bool(self._reports))
        print(f"measuring for about {2 * rounds * (NOT_COUNTED + length)} s ...", file=sys.stderr, flush=True)
        found: Seconds = {False: [], True: []}
        for number in range(2 * rounds):
            on = number % 2 == 1
            self.switch(robot, on)
            self._reports.clear()
            self._wait(robot, lambda: len(self._reports) >= NOT_COUNTED + length)
            found[on] += [{name: float(report[f"lateness {name} [us]"]) for name in FIGURES}
                          for report in self._reports[NOT_COUNTED:]]
        self.switch(robot, False)
        return found

    def switch(self, robot: subprocess.Popen, on: bool) -> None:
        """Switch on or off what is measured; it is off at first."""
        raise NotImplementedError

    def _wait(self, robot: subprocess.Popen, done: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        process.spin_until(self._executor, lambda: done() or robot.poll() is not None or time.monotonic() > deadline)
        if not done():
            raise RuntimeError("the robot has ended, it says why above" if robot.poll() is not None
                               else f"the robot did not answer within {PATIENCE:g} s")

    def _hear(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if status.hardware_id == self._robot and "lateness p99 [us]" in values:
                self._reports.append(values)


class RecordingMeasurement(Measurement):
    """Switches recording on and off."""

    def __init__(self, node: Node, executor: Executor, namespace: str):
        super().__init__(node, executor, namespace)
        self._client = node.create_client(SetBool, f"{self._robot}/record")

    def switch(self, robot: subprocess.Popen, on: bool) -> None:
        """Have the robot begin or seal a bag."""
        self._wait(robot, self._client.service_is_ready)
        answer = self._client.call_async(SetBool.Request(data=on))
        self._wait(robot, answer.done)
        if not answer.result().success:
            raise RuntimeError(answer.result().message)


def table(found: Seconds, what: str = "recording") -> str:
    """Medians over the seconds [us], and what that `what` is on changes, as Markdown."""
    rows = [f"| lateness of a tick | without {what} | with {what} | ratio |\n|{'---|' * 4}"]
    for name in FIGURES:
        without, recorded = (statistics.median(second[name] for second in found[on]) for on in (False, True))
        rows.append(f"| {name} [µs] | {without:.0f} | {recorded:.0f} | {recorded / without:.2f} |")
    counts = f"medians over {len(found[False])} and {len(found[True])} seconds in turn, in one process"
    return "\n".join([*rows, "", counts])


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print; 0 when done, 1 when the robot failed, 2 for a bad argument, 130 when interrupted."""
    return exit_code("lateness", lambda: _run(argv))


def _run(argv: Sequence[str] | None) -> int:
    options = _parser().parse_args(argv)
    namespace = f"lateness_{os.getpid()}"
    with tempfile.TemporaryDirectory(dir=options.directory) as folder, \
            process.node_running(NODE_NAME, []) as (node, executor), \
            robot_running(namespace, folder, options.rate) as robot:
        print(table(RecordingMeasurement(node, executor, namespace).run(robot, options.rounds, options.length)))
    return 0


@contextmanager
def robot_running(namespace: str, folder: str, rate: float) -> Iterator[subprocess.Popen]:
    """A robot that crawls in `namespace`, publishes at `rate` [Hz], and records into `folder` when asked."""
    settings = {"record.enabled": "false", "record.directory": f"'{folder}'", "rate.publish": rate,
                "motor.speed": 100.0}
    words = [word for name, value in settings.items() for word in ("-p", f"{name}:={value}")]
    robot = subprocess.Popen([sys.executable, "-m", "vibro_ros.ros.robot.robot", "--ros-args", "-r",
                              f"__ns:=/{namespace}",
                              "--log-level", "warn", *words])
    try:
        yield robot
    finally:
        robot.send_signal(signal.SIGINT)
        robot.wait()


def _parser() -> Parser:
    parser = Parser(prog="lateness", description=EXECUTABLES["lateness"].does,
                    formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--rounds", type=int, default=6, help="how often recording is switched on and off")
    parser.add_argument("--length", type=int, default=5, help="seconds counted each time")
    parser.add_argument("--rate", type=float, default=1000.0, help="rate.publish of the robot [Hz]")
    parser.add_argument("--directory", default=".", help="folder for bags, which are deleted at the end")
    return parser
