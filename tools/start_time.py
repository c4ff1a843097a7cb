"""How long a robot and a Python program take to start: with an empty cache of kernels, and with a full one.

`python -m tools.start_time` starts each as a process of its own and waits for the first odometry, as a user
does. A bare rclpy node that publishes odometry is started in turn with them: what it takes is not ours to save.
"""

import argparse
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import Path

from nav_msgs.msg import Odometry
from rclpy.executors import Executor
from rclpy.node import Node

from tools.child import Child
from vibro_ros.process.front_door import say
from vibro_ros.ros.node import process, qos

PATIENCE = 600.0
"""Longest wait [s] for a start."""
_POLL = 0.002  # s, between two looks whether the odometry has come
_PACKAGES = ("numba", "numpy", "scipy")
_BARE = """
import signal, sys, time
import rclpy
from nav_msgs.msg import Odometry
rclpy.init(args=sys.argv)
signal.signal(signal.SIGINT, signal.SIG_DFL)
node = rclpy.create_node("bare")
publisher = node.create_publisher(Odometry, "odom", 10)
while True:
    publisher.publish(Odometry())
    time.sleep(0.005)
"""
_PYTHON = "import vibro_ros; vibro_ros.simulate(vibro_ros.load_scene('device'), duration=1.0, rate=200.0)"

#: What is started: in words, and the interpreter's words.
ROBOT = "the robot, until its first odometry"
BARE = "a bare rclpy node, until its first odometry"
PYTHON = "Python, until `simulate` of 1 s in `device` has ended"


class Starts:
    """Starts processes and listens for the first odometry of each, in the calling thread; recordings go into `folder`.
    """

    def __init__(self, node: Node, executor: Executor, folder: Path):
        self._node, self._executor, self._folder = node, executor, folder
        self._count = 0

    def seconds(self, what: str, cache: Path | None = None) -> float:
        """Time [s] that a start takes, with the kernels in the folder `cache`, or in the usual one."""
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)} if cache else dict(os.environ)
        if what == PYTHON:
            begun = time.perf_counter()
            subprocess.run([sys.executable, "-c", _PYTHON], env=environment, check=True, timeout=PATIENCE)
            return time.perf_counter() - begun
        self._count += 1  # a topic of its own, or the last words of the process before would be taken for the first
        namespace = f"/start_time_{os.getpid()}_{self._count}"
        heard: list[Odometry] = []
        subscription = self._node.create_subscription(Odometry, f"{namespace}/odom", heard.append, qos.SAMPLES)
        words = self._robot() if what == ROBOT else ["-c", _BARE, "--ros-args"]
        begun = time.perf_counter()
        with Child(*words, "-r", f"__ns:={namespace}", environment=environment) as started:
            self._wait(lambda: bool(heard) or started.exit_code is not None)
            taken = time.perf_counter() - begun
        self._node.destroy_subscription(subscription)
        if not heard:
            raise RuntimeError(f"{what}: it has ended, and says why above")
        return taken

    def _robot(self) -> list[str]:
        return ["vibro_ros.ros.robot.robot", "--ros-args", "--log-level", "warn", "-p",
                f"record.directory:='{self._folder}'"]

    def _wait(self, done: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        process.spin_until(self._executor, lambda: done() or time.monotonic() > deadline, _POLL)
        if not done():
            raise RuntimeError(f"nothing was heard for {PATIENCE:g} s")


def measured(starts: Starts, rounds: int, folder: Path) -> dict[str, tuple[list[float], list[float]]]:
    """First and second starts [s] of each: one of everything in each round, with an empty cache of its own."""
    found: dict[str, tuple[list[float], list[float]]] = {what: ([], []) for what in (ROBOT, PYTHON, BARE)}
    for number in range(rounds):
        for what, (first, second) in found.items():
            say("start_time", f"round {number + 1} of {rounds}: {what}")
            cache = folder / f"{number}.{len(what)}"
            if what != BARE:
                first.append(starts.seconds(what, cache))
            second.append(starts.seconds(what, cache))
    return found


def table(found: Mapping[str, tuple[Sequence[float], Sequence[float]]]) -> str:
    """Medians [s], as Markdown."""
    rows = ["| what starts | first start, empty cache | second start |\n|---|---|---|"]
    rows += [f"| {what} | {_median(first)} | {_median(second)} |" for what, (first, second) in found.items()]
    return "\n".join(rows)


def _median(values: Sequence[float]) -> str:
    return f"{statistics.median(values):.1f} s" if values else "-"


def main(argv: Sequence[str]) -> int:
    """Run the command line `argv`; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="how often everything is started (default 3)")
    rounds = parser.parse_args(argv).rounds
    if rounds < 1:
        raise ValueError(f"--rounds: {rounds} is too few; give 1 or more")
    with tempfile.TemporaryDirectory() as name, process.node_running("start_time", []) as (node, executor):
        found = measured(Starts(node, executor, Path(name)), rounds, Path(name))
    versions = ", ".join(f"{package} {metadata.version(package)}" for package in _PACKAGES)
    print(f"Python {platform.python_version()}, {versions}; {os.cpu_count()} cores; medians of {rounds}\n")
    print(table(found))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
