"""What of a run's cost is what: its start, the energy's audit and accounts, the samples."""

from collections.abc import Callable

import numpy as np

from tools.bench_runs import SHORT, moving, run_baseline, run_exact
from vibro_ros.accuracy.timing import RATE, typical_seconds
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene

_SAMPLED = ("no_impact", "frictionless", "device")


def ratio(one: Callable, other: Callable, repeats: int) -> float:
    """Cost of a run as ratio to that of another, in turn with it; the median of so many rounds."""
    return float(np.median([typical_seconds(one) / typical_seconds(other) for _ in range(repeats)]))


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


def about_shares(duration: float, repeats: int) -> str:
    """All of it, in words."""
    samples = (f"{100.0 * sampling(load_scene(name), duration, repeats):.0f} % (`{name}`)" for name in _SAMPLED)
    audit, accounts = (keeping(f"solver.{name}", duration, repeats) for name in ("audit", "accounts"))
    return (f"The first {SHORT:g} s of `device` cost {first_moments(repeats):.3f} of RK4's. With the energy audit "
            f"`device` costs {audit:.2f} of what it costs without, with the energy accounts {accounts:.2f}. Of a run, "
            f"{', '.join(samples)} goes into its samples.")
