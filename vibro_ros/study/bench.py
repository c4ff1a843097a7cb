"""`make bench`: what the exact solver costs, as ratios to the fixed-step baseline of the same run."""

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.parallel import simulate_many
from vibro_ros.samples import Samples
from vibro_ros.scene_file import load_scene
from vibro_ros.simulator import Simulator, simulate
from vibro_ros.study.baseline import integrate_rk4

SCENES = ("unilateral", "paper", "damped", "frictionless", "no_impact", "rigid", "device")
#: Heading of a column, and how it shows a value of `measure`. A peer is one column more, and one value there.
COLUMNS = {
    "scene": "`{scene}`",
    "cost, RK4 = 1": "{ratio:.4f}",
    "times faster than real time": "{real_time:.0f}",
    "an event": "{event:.2f} µs",
    "1 ms of robot time": "{tick:.1f} µs",
    "RK4, 1 s": "{baseline:.1f} ms",
}
_STEP = 1e-5
_RATE = 200.0
_SPEED = 100.0  # commanded at t = 0 of a scene whose motor stands still
_MANY = 200
_MANY_DURATION = 2.0


def seconds(function: Callable, *arguments: object) -> float:
    """Wall time of one call."""
    began = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - began


def run_exact(scene: Scene, times: np.ndarray) -> tuple[Samples, np.ndarray]:
    """Samples and events of a scene whose motor turns from t = 0, on command if not by itself."""
    device = Simulator(scene)
    if scene["motor.speed"] == 0.0:
        device.command(motor_speed=_SPEED)
    return device.sample(times), device.take_events()


def run_baseline(scene: Scene, times: np.ndarray, step: float = _STEP) -> np.ndarray:
    """The same by `integrate_rk4`; `times` are those of one rate, from 0."""
    first = simulate(scene, times=np.zeros(1))
    start = np.array([first.upper_position[0], 0.0, first.inclined_position[0], 0.0])
    speed = _SPEED if scene["motor.speed"] == 0.0 else None
    return integrate_rk4(scene, start, times[-1], 1.0 / times[1], step, speed)


def measure(name: str, duration: float, repeats: int) -> dict[str, str | float]:
    """Medians over `repeats` pairs of runs, exact and baseline in turn, all compiled before.

    Returns
    -------
    dict
        `scene`; `ratio` of exact to baseline; `real_time`, simulated seconds per second; `event`, microseconds an
        event; `tick`, microseconds of a 1 ms `advance_to`; `baseline`, milliseconds per simulated second.
    """
    scene, times = load_scene(name), np.arange(round(duration * _RATE) + 1) / _RATE
    run_baseline(scene, times[:2])
    _, events = run_exact(scene, times)
    pairs = [(seconds(run_exact, scene, times), seconds(run_baseline, scene, times)) for _ in range(repeats)]
    exact = statistics.median(pair[0] for pair in pairs)
    return {
        "scene": name,
        "ratio": statistics.median(a / b for a, b in pairs),
        "real_time": duration / exact,
        "event": exact / max(1, len(events)) * 1e6,
        "tick": _tick(scene) * 1e6,
        "baseline": statistics.median(pair[1] for pair in pairs) / duration * 1e3,
    }


def _tick(scene: Scene) -> float:
    device = Simulator(scene)
    device.command(motor_speed=_SPEED)
    device.advance_to(1.0)
    return statistics.median(seconds(device.advance_to, 1.0 + 0.001 * k) for k in range(1, 1001))


def measure_many(count: int, duration: float, repeats: int) -> float:
    """How many times faster two workers of `simulate_many` are than one: median over pairs of runs.

    `count` scenes of `duration` [s] that differ in the guide's angle, each compiled anew.
    """
    base = load_scene("unilateral")
    scenes = [base.with_parameters({"guide.angle": 0.3 + k / count}) for k in range(count)]

    def run(workers: int) -> None:
        for _ in simulate_many(scenes, duration=duration, rate=_RATE, workers=workers):
            pass

    run(2)
    return statistics.median(seconds(run, 1) / seconds(run, 2) for _ in range(repeats))


def heading() -> str:
    """First two lines of the table, in Markdown."""
    return f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|"


def row(values: dict[str, str | float]) -> str:
    """One line of the table."""
    return f"| {' | '.join(shown.format(**values) for shown in COLUMNS.values())} |"


def main(arguments: list[str] | None = None) -> None:
    """Print the table, as README has it."""
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument("--duration", type=float, default=10.0, help="robot time [s] (default 10)")
    parser.add_argument("--repeats", type=int, default=7, help="pairs of runs (default 7)")
    options = parser.parse_args(arguments)
    print(f"{options.duration:g} s of robot time sampled at {_RATE:g} Hz, medians of {options.repeats}; "
          f"RK4: dt = {_STEP:g} s, compiled by numba, in the same run\n")
    print(heading())
    for name in SCENES:
        print(row(measure(name, options.duration, options.repeats)), flush=True)
    gain = measure_many(_MANY, _MANY_DURATION, options.repeats)
    print(f"\n`simulate_many`, {_MANY} scenes of {_MANY_DURATION:g} s: "
          f"two workers are {gain:.2f} times as fast as one.")


if __name__ == "__main__":
    main()
