"""`make bench`: what the exact solver and its peer heyoka cost, as ratios to the fixed-step baseline of one run."""

if __name__ == "__main__":  # before all imports, as in every executable
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("bench"))

import os
import platform
import statistics
import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib import metadata

import numpy as np

from tools.bench_runs import SHORT, SPEED, STEP, baseline_error, run_baseline, run_exact
from tools.cost_shares import about_shares
from tools.sweep_cost import TEN_TIMES, compiling_seconds, measure_many
from vibro_ros.accuracy.timing import LEAST_TIME, RATE, seconds, typical_seconds
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene
from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code
from vibro_ros.simulation.simulator import Simulator

SCENES = ("unilateral", "paper", "damped", "frictionless", "no_impact", "rigid", "device")
#: Heading of a column, and how it shows a value of `measure`.
COLUMNS = {
    "scene": "`{scene}`",
    "cost, RK4 = 1": "{ratio:.4f}",
    "heyoka, RK4 = 1": "{heyoka}",
    "times faster than real time": "{real_time:.0f}",
    "an event": "{event:.2f} µs",
    "1 ms of robot time": "{tick:.1f} µs",
    "RK4, 1 s": "{baseline:.1f} ms",
}
_PACKAGES = ("numpy", "numba", "heyoka")
_TOLERANCE = 1e-9  # heyoka's: over 10 s of each scene, its errors are below the baseline's
_MANY = 200
_COMPILED = ("no_impact", "unilateral", "device")


def about_the_baseline() -> str:
    """How far off the baseline is itself, and why `make accuracy` has other costs; a line of words."""
    off = {baseline_error(load_scene(name)): name for name in SCENES}
    told = " to ".join(f"{error:.1e} m ({off[error]})" for error in sorted(off)[::max(1, len(off) - 1)])
    return (f"RK4 itself is off by {told} within {SHORT:g} s. `make accuracy` samples at 1000 Hz, where exact costs "
            "more: it reads more samples off each segment.")


def about_compiling() -> str:
    """What a new geometry costs in a sweep; a line of words."""
    told = ", ".join(f"{1e3 * compiling_seconds(name):.2f} ms (`{name}`)" for name in _COMPILED)
    return f"A scene with another guide angle is compiled in {told}."


def compiled_peer(scene: Scene) -> Callable[[np.ndarray], np.ndarray]:
    """The same by heyoka, compiled: a function of the times that returns u, u', w, w', x, x', ... for each of them.

    Raises
    ------
    ModuleNotFoundError
        Without the extra `bench`.
    """
    from vibro_ros.peer import Peer

    peer = Peer(scene, _TOLERANCE)
    commands = ((0.0, {"motor_speed": SPEED}),) if scene["motor.speed"] == 0.0 else ()
    return lambda times: peer.integrate(times, commands).samples


def measure(name: str, duration: float, repeats: int) -> dict[str, str | float]:
    """Medians over `repeats` rounds: exact, baseline and peer in turn, all compiled before, each for `LEAST_TIME`.

    Returns
    -------
    dict
        `scene`; `ratio` of exact to baseline; `heyoka`, its ratio as text, `-` without a peer; `real_time`, simulated
        seconds per second; `event`, microseconds an event; `tick`, microseconds of a 1 ms `advance_to`; `baseline`,
        milliseconds per simulated second.
    """
    scene, times = load_scene(name), np.arange(round(duration * RATE) + 1) / RATE
    run_baseline(scene, times[:2])
    _, events = run_exact(scene, times)
    runs: list[Callable] = [partial(run, scene, times) for run in (run_exact, run_baseline)]
    runs += _peer_runs(scene, times)
    rounds = np.array([[typical_seconds(run) for run in runs] for _ in range(repeats)])
    exact, baseline, *_ = np.median(rounds, axis=0)
    ratio, _, *peers = np.median(rounds / rounds[:, 1:2], axis=0)
    return {
        "scene": name,
        "ratio": ratio,
        "heyoka": f"{peers[0]:.4f}" if peers else "-",
        "real_time": duration / exact,
        "event": exact / max(1, len(events)) * 1e6,
        "tick": _tick(scene) * 1e6,
        "baseline": baseline / duration * 1e3,
    }


def _peer_runs(scene: Scene, times: np.ndarray) -> list[Callable[[], np.ndarray]]:
    """The peer's run if it can be measured; if it is not installed or fails, none, and the reason on stderr."""
    try:
        run = partial(compiled_peer(scene), times)
        run()
    except (ModuleNotFoundError, ValueError, RuntimeError) as error:
        print(f"bench: {scene.name} without heyoka: {error}", file=sys.stderr)
        return []
    return [run]


def _tick(scene: Scene) -> float:
    device = Simulator(scene)
    device.command(motor_speed=SPEED)
    device.advance_to(1.0)
    return statistics.median(seconds(device.advance_to, 1.0 + 0.001 * k) for k in range(1, 1001))


def machine() -> str:
    """What the numbers depend on: versions, and processor cores."""
    versions = [f"Python {platform.python_version()}"]
    for package in _PACKAGES:
        try:
            versions.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            versions.append(f"no {package}")
    return f"{', '.join(versions)}; {platform.machine()}, {os.cpu_count()} cores"


def heading() -> str:
    """First two lines of the table, in Markdown."""
    return f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|"


def row(values: dict[str, str | float]) -> str:
    """One line of the table."""
    return f"| {' | '.join(shown.format(**values) for shown in COLUMNS.values())} |"


def main(words: Sequence[str]) -> int:
    """Print the table, as README has it; 0 when done; see `front_door.exit_code` for errors."""
    return exit_code("bench", lambda: _measure_all(words))


def _measure_all(words: Sequence[str]) -> int:
    parser = Parser(prog="bench", description=EXECUTABLES["bench"].does)
    parser.add_argument("--duration", type=float, default=10.0, help="robot time [s] (default 10)")
    parser.add_argument("--repeats", type=int, default=7, help="rounds (default 7)")
    options = parser.parse_args(words)
    print(f"{options.duration:g} s of robot time sampled at {RATE:g} Hz, medians of {options.repeats}, each over "
          f"{LEAST_TIME:g} s of runs; "
          f"RK4: dt = {STEP:g} s, compiled by numba, and heyoka: tolerance {_TOLERANCE:g}, in the same run")
    print(f"{machine()}\n{about_the_baseline()}\n")
    print(heading())
    for name in SCENES:
        print(row(measure(name, options.duration, options.repeats)), flush=True)
    print(f"\n{about_shares(options.duration, options.repeats)}\n\n{about_compiling()}\n")
    gain, possible = measure_many(_MANY, options.duration, options.repeats, TEN_TIMES)
    print(f"If every tenth run takes ten times as long, two workers of `simulate_many` are {gain:.2f} times as fast as "
          f"one; two processes that share nothing, {possible:.2f} times.")
    gain, possible = measure_many(_MANY, options.duration, options.repeats)
    print(f"`simulate_many`, {_MANY} scenes of {options.duration:g} s: two workers are {gain:.2f} times as fast as "
          f"one; two processes that share nothing, {possible:.2f} times.")
    return 0
