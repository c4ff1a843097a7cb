"""The methods of a study: every method of the table with a ladder that takes seconds, and the baseline."""

import time as wall_clock
from dataclasses import replace

import numpy as np

from vibro_ros.accuracy.baseline import integrate_rk4
from vibro_ros.accuracy.methods import METHODS, Answer, ComparedMethod, UnableError, drive_speed
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.one_run import simulate

#: Step of the baseline [s].
BASELINE_STEP = 1e-5


def by_baseline(scene: Scene, times: np.ndarray, step: float) -> Answer:
    """The baseline as a method; `times` are those of one rate. It has no events."""
    first = simulate(scene, times=np.zeros(1))
    start = np.array([first.upper_position[0], 0.0, first.inclined_position[0], 0.0])
    began = wall_clock.perf_counter()
    try:
        samples = integrate_rk4(scene, start, times[-1], 1.0 / times[1], step, drive_speed(scene))
    except ValueError as error:
        raise UnableError(str(error)) from error
    wall_time = wall_clock.perf_counter() - began
    steps = round(times[-1] / step)
    return Answer(times, samples, np.empty(0, METHODS["exact"](scene, times[:1], 1e-9).events.dtype), steps, 4 * steps,
                  wall_time)


def _thinned(method: ComparedMethod) -> ComparedMethod:
    """One setting a decade, or a hundredth for what a right-hand side in Python makes slow."""
    return replace(method, ladder=method.ladder[::2 if method.setting == "step" else 4])


#: Name to method of a study: every method, with ladders that take seconds, and the baseline.
STUDIED: dict[str, ComparedMethod] = {name: _thinned(method) for name, method in METHODS.items()} | {
    "baseline": ComparedMethod(by_baseline, "step", (BASELINE_STEP,))}
