"""`make bench`: what the exact solver and its peer heyoka cost, as ratios to the fixed-step baseline of one run."""

import argparse
import itertools
import math
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib import metadata

import numpy as np

from tools.baseline import integrate_rk4
from vibro_ros.accuracy.methods import COLUMNS as COLUMNS_OF_ANSWER
from vibro_ros.accuracy.precision import LEAST_TIME, typical
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene
from vibro_ros.model.support import unsupported
from vibro_ros.model.tables import compile_scene
from vibro_ros.simulation.processes import in_processes
from vibro_ros.simulation.runs import simulate, simulate_many
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator

SCENES = ("unilateral", "paper", "damped", "frictionless", "no_impact", "rigid", "device", "machine")
#: Heading of a column, and how it shows a value of `measure`.
COLUMNS = {
    "scene": "`{scene}`",
    "cost, RK4 = 1": "{ratio:.4f}",
    "heyoka, RK4 = 1": "{heyoka}",
    "times faster than real time": "{real_time:.0f}",
    "segments a turn": "{segments:.1f}",
    "an event": "{event:.2f} µs",
    "1 ms of robot time": "{tick:.1f} µs",
    "RK4, 1 s": "{baseline:.1f} ms",
}
#: Step of the baseline [s].
STEP = 1e-5
#: Motor speed [rad/s] commanded at t = 0 of a scene whose motor stands still.
SPEED = 100.0
#: Samples per second of robot time that a run is asked for.
RATE = 200.0
#: Time [s] from the start over which the baseline's own error is measured.
SHORT = 0.2
_PACKAGES = ("numpy", "numba", "heyoka")
_TOLERANCE = 1e-9  # heyoka's: over 10 s of each scene, its errors are below the baseline's
_FINEST = 1e-15  # heyoka's, at which its errors are nearest to those of exact
_COMPILED = ("no_impact", "unilateral", "device")
_SAMPLED = ("no_impact", "frictionless", "device")
#: A dc motor at a constant voltage: between two events neither program has to stop.
_AT_VOLTAGE = {"motor.control": "voltage", "motor.voltage": 15.0, "motor.speed": SPEED}
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


def seconds(function: Callable, *arguments: object) -> float:
    """Wall time [s] of one call."""
    began = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - began


def typical_seconds(function: Callable) -> float:
    """Wall time [s] of a call; `typical` of many."""
    return typical(partial(seconds, function))


def main(words: Sequence[str]) -> int:
    """Print the table that docs/accuracy.md has."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=10.0, help="robot time [s] (default 10)")
    parser.add_argument("--repeats", type=int, default=7, help="rounds (default 7)")
    parser.add_argument("--many", type=int, default=200, help="scenes of `simulate_many` (default 200)")
    options = parser.parse_args(words)
    print(f"{options.duration:g} s of robot time sampled at {RATE:g} Hz, medians of {options.repeats}, each over "
          f"{LEAST_TIME:g} s of runs; "
          f"RK4: dt = {STEP:g} s, compiled by numba, and heyoka: tolerance {_TOLERANCE:g}, in the same run")
    print(f"{machine()}\n{about_the_baseline()}\n")
    print(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
    for name in SCENES:
        values = measure(name, options.duration, options.repeats)
        print(f"| {' | '.join(shown.format(**values) for shown in COLUMNS.values())} |", flush=True)
    print(f"\n{about_dc_motors(options.duration, options.repeats)}\n\n"
          f"{about_shares(options.duration, options.repeats)}\n\n{about_compiling()}\n")
    gain, possible = measure_many(options.many, options.duration, options.repeats)
    print(f"`simulate_many`, {options.many} scenes of {options.duration:g} s: two workers are {gain:.2f} times as fast "
          f"as one; two processes that share nothing, {possible:.2f} times.")
    return 0


def measure(name: str, duration: float, repeats: int) -> dict[str, str | float]:
    """Medians over `repeats` rounds: exact, baseline and peer in turn, all compiled before, each for `LEAST_TIME`.

    Returns
    -------
    dict
        `scene`; `ratio` of exact to baseline; `heyoka`, its ratio as text, `-` without a peer; `real_time`, simulated
        seconds per second; `segments`, segments a turn; `event`, microseconds an event; `tick`, microseconds of a 1 ms
        `advance_to`; `baseline`, milliseconds per simulated second.
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
        "segments": segments_a_turn(scene, duration),
        "event": exact / max(1, len(events)) * 1e6,
        "tick": _tick(scene) * 1e6,
        "baseline": baseline / duration * 1e3,
    }


def moving(scene: Scene) -> Simulator:
    """The scene at t = 0, its motor turning, on command if not by itself."""
    device = Simulator(scene)
    if scene["motor.speed"] == 0.0:
        device.command(motor_speed=SPEED)
    return device


def run_exact(scene: Scene, times: np.ndarray) -> tuple[Samples, np.ndarray]:
    """Samples and events of a scene whose motor turns from t = 0."""
    device = moving(scene)
    return device.sample(times), device.take_events()


def run_baseline(scene: Scene, times: np.ndarray, step: float = STEP) -> np.ndarray:
    """The same by `integrate_rk4`, or by the device's own `rk4` if the baseline lacks an effect; `times` are those of
    one rate, from 0."""
    if unsupported(scene, "baseline"):
        own = {"solver.method": "rk4", "solver.step": step, "solver.audit": False}
        found = moving(scene.with_parameters(own)).sample(times)
        return np.stack([getattr(found, column) for column in COLUMNS_OF_ANSWER], axis=1)
    first = simulate(scene, times=np.zeros(1))
    start = np.array([first.upper_position[0], 0.0, first.inclined_position[0], 0.0])
    speed = SPEED if scene["motor.speed"] == 0.0 else None
    return integrate_rk4(scene, start, times[-1], 1.0 / times[1], step, speed)


def segments_a_turn(scene: Scene, duration: float) -> float:
    """Segments of a run over the turns of its crank."""
    device = moving(scene)
    device.advance_to(duration)
    return device.statistics["steps"] * 2.0 * math.pi / abs(device.state.crank_angle)


def _peer_runs(scene: Scene, times: np.ndarray, tolerance: float = _TOLERANCE) -> list[Callable[[], np.ndarray]]:
    """The peer's run if it can be measured; if it is not installed or fails, none, and the reason on stderr."""
    try:
        run = partial(compiled_peer(scene, tolerance), times)
        run()
    except (ModuleNotFoundError, ValueError, RuntimeError) as error:
        print(f"bench: {scene.name} without heyoka: {error}", file=sys.stderr)
        return []
    return [run]


def compiled_peer(scene: Scene, tolerance: float = _TOLERANCE) -> Callable[[np.ndarray], np.ndarray]:
    """The same by heyoka, compiled: a function of the times that returns u, u', w, w', x, x', ... for each of them.

    Raises
    ------
    ModuleNotFoundError
        Without the extra `bench`.
    """
    from tools.peer import Peer

    peer = Peer(scene, tolerance)
    commands = ((0.0, {"motor_speed": SPEED}),) if scene["motor.speed"] == 0.0 else ()
    return lambda times: peer.integrate(times, commands).samples


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


def about_the_baseline() -> str:
    """How far off the baseline is itself, and why `make accuracy` has other costs; a line of words."""
    off = {baseline_error(load_scene(name)): name for name in SCENES}
    told = " to ".join(f"{error:.1e} m ({off[error]})" for error in sorted(off)[::max(1, len(off) - 1)])
    return (f"RK4 itself is off by {told} within {SHORT:g} s. `make accuracy` samples at 1000 Hz, where exact costs "
            "more: it reads more samples off each segment.")


def baseline_error(scene: Scene) -> float:
    """How far the baseline is off itself [m]: the largest error of a position within `SHORT`, the motor running."""
    scene = scene.with_parameters({"motor.speed": scene["motor.speed"] or SPEED})
    times = 2.0 * STEP * np.arange(round(SHORT / (2.0 * STEP)) + 1)
    exact, found = run_exact(scene, times)[0], run_baseline(scene, times)
    places = (exact.upper_position, exact.inclined_position, exact.body_position, exact.body_height)
    return float(np.abs(found[:, ::2] - np.stack(places, axis=1)).max())


def about_dc_motors(duration: float, repeats: int) -> str:
    """What the row of `machine` is measured against, and the same machine at a constant voltage; words."""
    scene = load_scene("machine").with_parameters(_AT_VOLTAGE)
    times, costs = np.arange(round(duration * RATE) + 1) / RATE, []
    for tolerance in (_TOLERANCE, _FINEST):
        for peer in _peer_runs(scene, times, tolerance):
            cost = ratio(partial(run_exact, scene, times), peer, repeats)
            costs.append(f"{cost:.2f} of heyoka's cost at the tolerance {tolerance:g}")
    return ("RK4 of `machine` is the device's own `rk4`, because the baseline has no dc motor. Its controller takes "
            "1000 samples a second, at each of which heyoka's robot stops in Python. At a constant voltage, where "
            f"neither stops, exact takes {segments_a_turn(scene, duration):.0f} segments a turn, and "
            f"{' and '.join(costs) or 'heyoka is not installed'}.")


def about_shares(duration: float, repeats: int) -> str:
    """Shares of a run's cost, in words: its start, the energy's audit and accounts, the samples."""
    samples = (f"{100.0 * sampling(load_scene(name), duration, repeats):.0f} % (`{name}`)" for name in _SAMPLED)
    audit, accounts = (keeping(f"solver.{name}", duration, repeats) for name in ("audit", "accounts"))
    return (f"The first {SHORT:g} s of `device` cost {first_moments(repeats):.3f} of RK4's. With the energy audit "
            f"`device` costs {audit:.2f} of what it costs without, with the energy accounts {accounts:.2f}. Of a run, "
            f"{', '.join(samples)} goes into its samples.")


def first_moments(repeats: int) -> float:
    """Cost of the first 0.2 s of `device`, RK4 = 1: its masses ring on their plates, and its motor speeds up."""
    scene, times = load_scene("device"), np.arange(round(SHORT * RATE) + 1) / RATE
    run_baseline(scene, times)
    return ratio(lambda: run_exact(scene, times), lambda: run_baseline(scene, times), repeats)


def keeping(parameter: str, duration: float, repeats: int) -> float:
    """Cost of `device` with the audit or the accounts that `parameter` switches on, 1 without both."""
    times, neither = np.arange(round(duration * RATE) + 1) / RATE, {"solver.audit": False, "solver.accounts": False}
    with_one, without = (load_scene("device").with_parameters(neither | {parameter: on}) for on in (True, False))
    return ratio(lambda: run_exact(with_one, times), lambda: run_exact(without, times), repeats)


def sampling(scene: Scene, duration: float, repeats: int) -> float:
    """Part of a run's cost that goes into its samples."""
    times = np.arange(round(duration * RATE) + 1) / RATE
    return 1.0 - ratio(lambda: moving(scene).advance_to(duration), lambda: run_exact(scene, times), repeats)


def ratio(one: Callable, other: Callable, repeats: int) -> float:
    """Cost of a run as ratio to that of another, in turn with it; the median of so many rounds."""
    return float(np.median([typical_seconds(one) / typical_seconds(other) for _ in range(repeats)]))


def about_compiling() -> str:
    """What a new geometry costs in a sweep; a line of words."""
    told = ", ".join(f"{1e3 * compiling_seconds(name):.2f} ms (`{name}`)" for name in _COMPILED)
    return f"A scene with another guide angle is compiled in {told}."


def compiling_seconds(name: str) -> float:
    """Median time [s] to compile a shipped scene for another guide angle, with tables of other angles in the cache."""
    scene = load_scene(name)
    angles = (0.3 + k * _GOLDEN % 1.0 for k in itertools.count(1))
    compile_scene(scene)
    return typical(lambda: seconds(compile_scene, scene.with_parameters({"guide.angle": next(angles)})))


def measure_many(count: int, duration: float, repeats: int) -> tuple[float, float]:
    """How many times faster two workers of `simulate_many` are than one; and what the machine allows: two processes
    that simulate half of the scenes each and hand nothing over.

    `count` scenes of `duration` [s] that differ in the guide's angle, each compiled by itself. Medians over rounds.
    """
    base = load_scene("unilateral")
    scenes = [base.with_parameters({"guide.angle": 0.3 + k / count}) for k in range(count)]

    def run(workers: int) -> None:
        for _ in simulate_many(scenes, duration=duration, rate=RATE, workers=workers):
            pass

    def run_apart() -> None:
        halves = [scenes[::2], scenes[1::2]]
        for _, future in in_processes(lambda half: _simulate_all(half, duration), halves, 2):
            future.result()

    run(2)
    rounds = np.array([[seconds(run, 1), seconds(run, 2), seconds(run_apart)] for _ in range(repeats)])
    gain, possible = np.median(rounds[:, :1] / rounds[:, 1:], axis=0)
    return gain, possible


def _simulate_all(scenes: Iterable[Scene], duration: float) -> None:
    for scene in scenes:
        simulate(scene, duration=duration, rate=RATE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
