"""What a sweep costs: compiling each geometry, and handing scenes and runs from process to process."""

import itertools
import math
from collections.abc import Iterable, Mapping

import numpy as np

from vibro_ros.accuracy.timing import RATE, seconds, typical
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.simulation.many_runs import simulate_many
from vibro_ros.simulation.one_run import simulate
from vibro_ros.simulation.processes import in_processes

#: Changes that make a run of `unilateral` ten times as long, whatever the machine: 20 000 steps a second.
TEN_TIMES = {"solver.method": "rk4", "solver.step": 5e-5}
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0


def compiling_seconds(name: str) -> float:
    """Median time [s] to compile a shipped scene for another guide angle, with tables of other angles in the cache."""
    scene = load_scene(name)
    angles = (0.3 + k * _GOLDEN % 1.0 for k in itertools.count(1))
    compile_scene(scene)
    return typical(lambda: seconds(compile_scene, scene.with_parameters({"guide.angle": next(angles)})))


def measure_many(count: int, duration: float, repeats: int, every_tenth: Mapping[str, object] | None = None,
                 ) -> tuple[float, float]:
    """How many times faster two workers of `simulate_many` are than one; and what the machine allows: two processes
    that simulate half of the scenes each and hand nothing over.

    `count` scenes of `duration` [s] that differ in the guide's angle, each compiled anew; the first of every ten has
    the changes `every_tenth`. Medians over rounds of all.
    """
    base = load_scene("unilateral")
    changes: list[Mapping[str, object]] = [every_tenth or {}, *[{}] * 9]
    scenes = [base.with_parameters({"guide.angle": 0.3 + k / count, **changes[k % 10]}) for k in range(count)]
    halves = [[scene for k, scene in enumerate(scenes) if (k + k // 10) % 2 == half] for half in range(2)]

    def run(workers: int) -> None:
        for _ in simulate_many(scenes, duration=duration, rate=RATE, workers=workers):
            pass

    def run_apart() -> None:
        for job in in_processes(lambda half: _simulate_all(half, duration), halves, 2):
            job.outcome()

    for scene in scenes[:2]:  # both methods' kernels
        simulate(scene, times=np.zeros(1))
    run(2)
    rounds = np.array([[seconds(run, 1), seconds(run, 2), seconds(run_apart)] for _ in range(repeats)])
    gain, possible = np.median(rounds[:, :1] / rounds[:, 1:], axis=0)
    return gain, possible


def _simulate_all(scenes: Iterable[Scene], duration: float) -> None:
    for scene in scenes:
        simulate(scene, duration=duration, rate=RATE)
