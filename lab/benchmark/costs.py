"""`make bench`: what a run by `exact`, by heyoka and by Runge-Kutta 4 by hand costs, in seconds a simulated second."""

import argparse
import itertools
import math
import os
import platform
import statistics
import sys
from collections.abc import Iterable, Sequence
from importlib import metadata

import numpy as np

from benchmark import rk4_by_hand
from vibro_lab.accuracy.harness import Effort, SceneProblem, cost_of, median_time, seconds
from vibro_lab.accuracy.programs import DEVICE, DRIVE_SPEED, Program, Setting, UnableError
from vibro_ros import Scene, Simulator, in_processes, load_scene, simulate, simulate_many

SCENES = ("unilateral", "paper", "damped", "frictionless", "no_impact", "rigid", "device", "machine")
#: Heading of each column, and the format of its value from `measure`.
COLUMNS = {
    "scene": "`{scene}`",
    "exact [s/s]": "{exact:.2g}",
    "its set-up [s]": "{set_up:.2g}",
    "heyoka [s/s]": "{heyoka:.2g}",
    "RK4 [s/s]": "{rk4:.2g}",
    "segments a turn": "{segments:.1f}",
    "an event": "{event:.2f} µs",
    "1 ms of robot time": "{tick:.1f} µs",
}
#: Samples of a run per second of robot time.
RATE = 200.0
_PACKAGES = ("numpy", "numba", "heyoka")
_TOLERANCE = 1e-9  # heyoka's: over 10 s of each scene, its errors are below those of Runge-Kutta
_STEP = 1e-5  # s, of Runge-Kutta 4
_COMPILED = ("no_impact", "unilateral", "device")
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


def main(words: Sequence[str]) -> int:
    """Print the table of costs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=10.0, help="robot time [s] (default 10)")
    parser.add_argument("--repeats", type=int, default=7, help="rounds (default 7)")
    parser.add_argument("--many", type=int, default=200, help="scenes of `simulate_many` (default 200)")
    options = parser.parse_args(words)
    print(f"Wall time [s] for each simulated second, without set-up, over {options.duration:g} s sampled at {RATE:g} "
          f"Hz; medians of {options.repeats} rounds. RK4: step {_STEP:g} s, `rk4_by_hand`, in `machine` the device's "
          f"own `rk4`, because the other has no dc motor; heyoka: tolerance {_TOLERANCE:g}")
    print(f"{machine()}\n")
    print(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
    for name in SCENES:
        values = measure(name, options.duration, options.repeats)
        print(f"| {' | '.join(form.format(**values) for form in COLUMNS.values())} |", flush=True)
    print(f"\n{about_compiling()}\n")
    gain, possible = measure_many(options.many, options.duration, options.repeats)
    print(f"`simulate_many`, {options.many} scenes of {options.duration:g} s: two workers are {gain:.2f} times as fast "
          f"as one; two processes that share nothing, {possible:.2f} times.")
    return 0


def measure(name: str, duration: float, repeats: int) -> dict[str, str | float]:
    """Return the values of the columns `COLUMNS` of a scene; NaN for heyoka where it is not installed or fails."""
    scene = load_scene(name)
    problem = SceneProblem(scene, np.arange(round(duration * RATE) + 1) / RATE)
    effort = Effort(repeats=repeats, patience=math.inf)
    exact, set_up = _cost(problem, DEVICE["exact"], DEVICE["exact"].settings[0], effort)
    device = moving(scene)
    device.advance_to(duration)
    return {
        "scene": name, "exact": exact, "set_up": set_up, "heyoka": _heyoka(problem, effort),
        "rk4": _rk4(problem, effort),
        "segments": device.statistics["steps"] * 2.0 * math.pi / abs(device.state.crank_angle),
        "event": exact * duration / max(1, len(device.take_events())) * 1e6,
        "tick": _tick(scene) * 1e6,
    }


def _cost(problem: SceneProblem, program: Program, setting: Setting, effort: Effort) -> tuple[float, float]:
    """Cost [s for each simulated second] and set-up [s] of a program, compiled before."""
    whole, short = program.prepare(problem, setting), program.prepare(problem.at(problem.times[:2]), setting)
    whole()
    return cost_of(problem, whole, short, effort)[:2]


def _rk4(problem: SceneProblem, effort: Effort) -> float:
    try:
        return _cost(problem, rk4_by_hand.PROGRAM, Setting(_STEP, ""), effort)[0]
    except UnableError:
        return _cost(problem, DEVICE["rk4"], Setting(_STEP, ""), effort)[0]


def _heyoka(problem: SceneProblem, effort: Effort) -> float:
    """Return heyoka's cost, or NaN, with the reason on stderr, if heyoka is not installed or fails."""
    try:
        from benchmark.programs.heyoka import ON_SCENES

        return _cost(problem, ON_SCENES, Setting(_TOLERANCE, ""), effort)[0]
    except (ModuleNotFoundError, UnableError) as error:
        print(f"bench: {problem.name} without heyoka: {error}", file=sys.stderr)
        return math.nan


def moving(scene: Scene) -> Simulator:
    """Return a device of the scene at t = 0 whose motor turns, by a command if the scene's motor stands still."""
    device = Simulator(scene)
    if scene["motor.speed"] == 0.0:
        device.command(motor_speed=DRIVE_SPEED)
    return device


def _tick(scene: Scene) -> float:
    device = Simulator(scene)
    device.command(motor_speed=DRIVE_SPEED)
    device.advance_to(1.0)
    ends = iter(1.0 + 0.001 * np.arange(1, 1001))
    return statistics.median(seconds(lambda: device.advance_to(next(ends))) for _ in range(1000))


def machine() -> str:
    """Return the versions and the processor cores on which the numbers depend."""
    versions = [f"Python {platform.python_version()}"]
    for package in _PACKAGES:
        try:
            versions.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            versions.append(f"no {package}")
    return f"{', '.join(versions)}; {platform.machine()}, {os.cpu_count()} cores"


def about_compiling() -> str:
    """Return a sentence with the time that a sweep needs for a device of another geometry."""
    times = ", ".join(f"{1e3 * compiling_seconds(name):.2f} ms (`{name}`)" for name in _COMPILED)
    return f"A device with another guide angle is made, its scene compiled, in {times}."


def compiling_seconds(name: str) -> float:
    """Median time [s] to make a device of a shipped scene with another guide angle; the cache has tables of others."""
    scene = load_scene(name)
    angles = (0.3 + k * _GOLDEN % 1.0 for k in itertools.count(1))
    Simulator(scene)
    return median_time(lambda: Simulator(scene.with_parameters({"guide.angle": next(angles)})))


def measure_many(count: int, duration: float, repeats: int) -> tuple[float, float]:
    """Return how many times faster two workers of `simulate_many` are than one, and the same for two processes that
    simulate half of the scenes each and exchange no data, which is what the machine allows.

    The runs are `count` scenes of `duration` [s] that differ in the guide's angle, so that each is compiled separately.
    Both numbers are medians over rounds.
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
    rounds = np.array([[seconds(lambda: run(1)), seconds(lambda: run(2)), seconds(run_apart)] for _ in range(repeats)])
    gain, possible = np.median(rounds[:, :1] / rounds[:, 1:], axis=0)
    return gain, possible


def _simulate_all(scenes: Iterable[Scene], duration: float) -> None:
    for scene in scenes:
        simulate(scene, duration=duration, rate=RATE)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
