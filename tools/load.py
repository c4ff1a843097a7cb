"""What a load does to the robot: `python -m tools.load`.

Real robots with their recording, each a process of its own, and a probe in this one. Rates are ratios to the rate that
was asked for, and delays are counted in publish periods, so that both mean the same on every machine.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from subprocess import Popen

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64
from tqdm import tqdm

from tools.probe import Commanding, Listening, Probe
from tools.ready_process import ready_process, sleep_unless
from vibro_ros.process.stop_signals import StopRequest


@dataclass(frozen=True)
class Load:
    """What a robot has to bear.

    Attributes
    ----------
    robots : int
        Robots in one graph, each in a namespace of its own; the first one is commanded, the others run at 100 rad/s.
    rate : float
        Rate [Hz] at which each publishes.
    listeners : int
        Subscriptions to the `odom` of each.
    flood : float
        Rate [Hz] at which the first robot's last command is repeated; 0: not at all.
    """

    robots: int = 1
    rate: float = 200.0
    listeners: int = 1
    flood: float = 0.0


LOADS = {
    "one listener": Load(),
    "flood": Load(flood=5000.0),
    "listeners": Load(listeners=20),
    "robots": Load(robots=10, rate=50.0),
}
"""Each load by its name; the first one is what the others are compared with."""
CRUISE = 100.0  # rad/s
_POLL = 0.1  # s


@dataclass(frozen=True)
class Outcome:
    """What was seen of a load.

    Attributes
    ----------
    rates : sequence of float
        Messages per second that each subscription has heard, as part of the rate asked for.
    lost : int
        Messages, by the stamps of those around them, that a subscription has not heard.
    growth : sequence of float
        What the memory of each robot has grown by [MB].
    delays : sequence of float
        From command to first effect, in publish periods; dimensionless.
    flooded : float
        Commands per second that were sent.
    """

    rates: Sequence[float]
    lost: int
    growth: Sequence[float]
    delays: Sequence[float]
    flooded: float


def measure(load: Load, settling: float, duration: float, stop: StopRequest) -> Outcome:
    """Start the robots, wait until their memory has settled [s], and watch them for a duration [s]."""
    spaces = [f"/r{number}" for number in range(load.robots)]
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        sleep = partial(sleep_unless, stop)
        robots = [stack.enter_context(ready_process(_words(space, load.rate, folder), sleep)) for space in spaces]
        node = Node("load")
        stack.callback(node.destroy_node)
        executor = SingleThreadedExecutor()
        stack.callback(executor.shutdown)
        executor.add_node(node)
        return _watch(load, Probe(node, spaces, load.listeners), executor, robots, (settling, duration), stop)


def _watch(load: Load, probe: Probe, executor: SingleThreadedExecutor, robots: Sequence[Popen],
           times: tuple[float, float], stop: StopRequest) -> Outcome:
    settling, duration = times
    for _ in _turns(executor, stop):
        if probe.connected:
            break
    for publisher in probe.publishers[1:]:
        publisher.publish(Float64(data=CRUISE))
    with Commanding(probe.publishers[0], probe.effects, load.flood) as commanding:
        _spin(executor, settling, stop)
        memory, sent, subscriptions = [*map(_memory, robots)], commanding.sent, probe.listening
        for one in subscriptions:
            one.restart()
        probe.effects.delays.clear()
        _spin(executor, duration, stop)
        growth = [_memory(robot) - before for robot, before in zip(robots, memory, strict=True)]
        sent = commanding.sent - sent
    return Outcome([rate_of(one) / load.rate for one in subscriptions],
                   sum(lost_by(one, load.rate) for one in subscriptions), growth,
                   [delay * load.rate for delay in probe.effects.delays], sent / duration)


def rate_of(one: Listening) -> float:
    """Messages per second [Hz] that a subscription has heard."""
    return (one.heard - 1) / (one.last[0] - one.first[0])


def lost_by(one: Listening, rate: float) -> int:
    """Messages that a subscription has not heard of those between its first and its last, stamped at `rate` [Hz]."""
    return round((one.last[1] - one.first[1]) * 1e-9 * rate) + 1 - one.heard


def _turns(executor: SingleThreadedExecutor, stop: StopRequest) -> Iterator[None]:
    """Callbacks without end, one a turn (KeyboardInterrupt on `stop`)."""
    while not stop:
        executor.spin_once(timeout_sec=_POLL)
        yield
    raise KeyboardInterrupt


def _spin(executor: SingleThreadedExecutor, duration: float, stop: StopRequest) -> None:
    until = time.monotonic() + duration
    with tqdm(total=round(duration), unit="s", disable=None, leave=False) as bar:
        for _ in _turns(executor, stop):
            if (rest := until - time.monotonic()) < 0.0:
                return
            bar.update(int(duration - rest) - bar.n)


def _words(space: str, rate: float, folder: str) -> list[str]:
    """The command of a robot."""
    settings = {"record.directory": f"'{folder}'", "rate.publish": rate, "effects.motor": "ideal"}
    return ["vibro_ros.ros.robot.robot", "--ros-args", "-r", f"__ns:={space}",
            *(word for name, value in settings.items() for word in ("-p", f"{name}:={value}"))]


def _memory(process: Popen) -> float:
    """Resident memory [MB] of a process."""
    text = Path(f"/proc/{process.pid}/status").read_text()
    return int(text.partition("VmRSS:")[2].split()[0]) * 1024e-6


def table(found: Mapping[str, Outcome]) -> str:
    """The worst of each as Markdown."""
    rows = ["| load | rate asked for = 1 | messages lost | memory growth | commands | from command to effect, p50 | "
            "p99 | longest | commands watched |", "|---" * 9 + "|"]
    for name, one in found.items():
        worst = max(one.rates, key=lambda rate: abs(rate - 1.0))
        p50, p99, longest = np.quantile(one.delays, (0.5, 0.99, 1.0))
        rows.append(f"| {name} | {worst:.4f} | {one.lost} | {max(one.growth):.2f} MB | {one.flooded:.0f}/s | "
                    f"{p50:.2f} periods | {p99:.2f} | {longest:.2f} | {len(one.delays)} |")
    return "\n".join(rows)


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("loads", nargs="*", choices=[[], *LOADS], metavar="LOAD", help=f"of {', '.join(LOADS)}")
    parser.add_argument("--duration", type=float, default=60.0, help="of each measurement [s] (default %(default)g)")
    parser.add_argument("--settling", type=float, default=10.0,
                        help="until a robot's memory holds all that it needs [s] (default %(default)g)")
    options = parser.parse_args(words)
    with StopRequest() as stop:
        stop.hold()
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        try:
            found = {}
            for name in options.loads or LOADS:
                print(f"{name}: about {options.settling + options.duration:.0f} s ...", file=sys.stderr, flush=True)
                found[name] = measure(LOADS[name], options.settling, options.duration, stop)
            print(table(found))
        except KeyboardInterrupt:
            return stop.exit_code
        finally:
            rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
