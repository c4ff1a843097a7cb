"""What the whole robot costs, recording included, against a bare rclpy node that publishes messages of the same types:
`python -m tools.node_cost`.

Robot and bare node are processes of their own and take turns, so that the machine's other load meets both. What is
measured is processor time, of all threads, once a process has settled.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from functools import partial

from tqdm import tqdm

from tools.ready_process import ready_process, sleep_unless
from vibro_ros.process.stop_signals import StopRequest

RATES = (1000.0, 200.0)  # Hz
BARE = "bare node"
#: Speed [rad/s] of the robot's motor in each of its cases.
SPEEDS = {"running": 100.0, "standing still": 0.0}
_STARTING = 3.0  # s, about
_SCHEDULED = 2  # of Linux' clocks of another process: the one that the C library's clock_getcpuclockid gives

Shares = Mapping[tuple[float, str], list[float]]
"""Shares of a core, one a round, by rate [Hz] and case."""


def table(found: Shares) -> str:
    """Medians over the rounds, and of the rounds' ratios to the bare node, as Markdown."""
    rows = ["| rate | bare node | robot | of a core | bare node = 1 |", "|---" * 5 + "|"]
    for rate in dict.fromkeys(rate for rate, _ in found):
        bare = found[rate, BARE]
        for case in SPEEDS:
            robot = found[rate, case]
            ratio = statistics.median(one / other for one, other in zip(robot, bare, strict=True))
            rows.append(f"| {rate:g} Hz | {_percent(bare)} | {case} | {_percent(robot)} | {ratio:.2f} |")
    return "\n".join([*rows, "", f"medians of {len(bare)} rounds"])


def _percent(shares: Sequence[float]) -> str:
    return f"{100.0 * statistics.median(shares):.1f} %"


class Measurement:
    """Processor times of processes that are started one after the other.

    Parameters
    ----------
    settling : float
        Time [s] from a process's first message until it is measured: the motor has reached its speed by then, and what
        swings has come to rest.
    duration : float
        Time [s] over which it is measured.
    stop : StopRequest
        Ends the measurement, by KeyboardInterrupt, at a point at which no process is left behind.
    """

    def __init__(self, settling: float, duration: float, stop: StopRequest):
        self._settling, self._duration, self._stop = settling, duration, stop

    def run(self, rates: Sequence[float], rounds: int) -> Shares:
        """Every case at each of `rates` [Hz], `rounds` times in turn (RuntimeError when a process ends by itself)."""
        cases = [(rate, case) for rate in rates for case in (BARE, *SPEEDS)]
        found: dict[tuple[float, str], list[float]] = {case: [] for case in cases}
        each = _STARTING + self._settling + self._duration
        print(f"measuring for about {rounds * len(cases) * each:.0f} s ...", file=sys.stderr, flush=True)
        with tqdm(total=rounds * len(cases), unit="process", disable=None) as bar:
            for rate, case in cases * rounds:
                bar.set_description(f"{case}, {rate:g} Hz")
                found[rate, case].append(self._share(rate, case))
                bar.update()
        return found

    def _share(self, rate: float, case: str) -> float:
        """Share of a core that a process takes."""
        sleep = partial(sleep_unless, self._stop)
        with tempfile.TemporaryDirectory() as folder, ready_process(_words(rate, case, folder), sleep) as child:
            sleep(self._settling)
            begun, before = time.monotonic(), _processor_time(child)
            sleep(self._duration)
            return (_processor_time(child) - before) / (time.monotonic() - begun)


def _words(rate: float, case: str, folder: str) -> list[str]:
    """The command of a case."""
    if case == BARE:
        return ["tools.bare_node", "--rate", f"{rate}"]
    settings = {"record.directory": f"'{folder}'", "rate.publish": rate, "motor.speed": SPEEDS[case]}
    return ["vibro_ros.ros.robot.robot", "--ros-args",
            *(word for name, value in settings.items() for word in ("-p", f"{name}:={value}"))]


def _processor_time(child: subprocess.Popen) -> float:
    """Processor time [s] of all threads of a process, in user mode and in the kernel."""
    return time.clock_gettime(~child.pid << 3 | _SCHEDULED)


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rates", type=float, nargs="+", default=RATES, help="of publishing [Hz] (default 1000 200)")
    parser.add_argument("--rounds", type=int, default=5, help="how often each is started (default %(default)d)")
    parser.add_argument("--settling", type=float, default=3.0, help="before each measurement [s] (default %(default)g)")
    parser.add_argument("--duration", type=float, default=5.0, help="of each measurement [s] (default %(default)g)")
    options = parser.parse_args(words)
    with StopRequest() as stop:
        stop.hold()
        try:
            print(table(Measurement(options.settling, options.duration, stop).run(options.rates, options.rounds)))
        except KeyboardInterrupt:
            return stop.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
