"""`make bench`: what the exact solver costs, as ratios to the fixed-step baseline of the same run."""

import argparse
import statistics
import time

import numpy as np

from vibro_ros.scene_file import load_scene
from vibro_ros.simulator import Simulator, simulate
from vibro_ros.study.baseline import integrate_rk4

SCENES = ("unilateral", "paper", "damped", "frictionless", "no_impact")
_STEP = 1e-5
_RATE = 200.0


def seconds(function, *arguments) -> float:
    """Wall time of one call."""
    began = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - began


def measure(name: str, duration: float, repeats: int) -> dict[str, float]:
    """Medians over `repeats` pairs of runs, exact and baseline in turn.

    Returns
    -------
    dict
        `ratio` of exact to baseline; `real_time`, simulated seconds per second; `event`, microseconds an event;
        `tick`, microseconds of a 1 ms `advance_to`; `baseline`, milliseconds per simulated second.
    """
    scene = load_scene(name)
    first = simulate(scene, times=np.zeros(1))
    start = np.array([first.upper_position[0], 0.0, first.inclined_position[0], 0.0])
    integrate_rk4(scene, start, 0.01, _RATE, _STEP)
    pairs = [(seconds(lambda: simulate(scene, duration=duration, rate=_RATE)),
              seconds(integrate_rk4, scene, start, duration, _RATE, _STEP)) for _ in range(repeats)]
    exact = statistics.median(pair[0] for pair in pairs)
    run = simulate(scene, duration=duration, rate=_RATE)
    return {
        "ratio": statistics.median(a / b for a, b in pairs),
        "real_time": duration / exact,
        "event": exact / max(1, len(run.events)) * 1e6,
        "tick": _tick(scene) * 1e6,
        "baseline": statistics.median(pair[1] for pair in pairs) / duration * 1e3,
    }


def _tick(scene) -> float:
    device = Simulator(scene)
    device.advance_to(0.2)
    return statistics.median(seconds(device.advance_to, 0.2 + 0.001 * k) for k in range(1, 1001))


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument("--duration", type=float, default=10.0, help="robot time [s] (default 10)")
    parser.add_argument("--repeats", type=int, default=7, help="pairs of runs (default 7)")
    options = parser.parse_args(arguments)
    print(f"{options.duration:g} s of robot time sampled at {_RATE:g} Hz, medians of {options.repeats}; "
          f"ratio 1 = RK4 with dt = {_STEP:g} s, compiled by numba, in the same run")
    print(f"{'scene':<14}{'ratio':>8}{'× real time':>13}{'µs/event':>10}{'µs/1 ms tick':>14}{'RK4 ms/s':>10}")
    for name in SCENES:
        row = measure(name, options.duration, options.repeats)
        print(f"{name:<14}{row['ratio']:>8.4f}{row['real_time']:>13.0f}{row['event']:>10.2f}{row['tick']:>14.1f}"
              f"{row['baseline']:>10.2f}")


if __name__ == "__main__":
    main()
