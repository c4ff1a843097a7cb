"""The weights of counted work, measured: what a step, a segment and an event cost, and how well their sum is the time.

    python -m tools.work_weights

prints the weights that fit this machine best, and for each shipped scene the costs of `exact` and of fixed steps as
ratios to the steps of rk4: counted by the weights of `counted_work`, and measured.
"""

import argparse
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.simulation.accuracy_in_force import KNOWN_SPEED
from vibro_ros.simulation.auto import (
    EXACT_WEIGHTS,
    HORIZON,
    STEP_WEIGHTS,
    choose_method,
    counted_work,
    counts_of_exact,
    promised_commands,
)
from vibro_ros.simulation.kernels import compile_kernels
from vibro_ros.simulation.simulator import Simulator

STEP = 2e-5  # s
#: An accuracy that no step of fixed length keeps [m].
UNKEPT = 1e-10
#: The shipped scenes for which `auto` tries steps of fixed length: those without a dc motor.
STEPPED = tuple(name for name in shipped_scenes() if not load_scene(name).has_rotor)
_ROUNDS = 7
# s; a run that takes less, because nothing moves, is no longer than a call by itself is uncertain.
_LEAST = 2e-5
#: Scenes beside the shipped ones, for effects that these lack: scene and parameters.
VARIED = (("device", {"solver.audit": False}), ("device", {"effects.reaction": False}),
          ("device", {"effects.motor": "lag"}), ("device", {"effects.upper_mass": False}),
          ("device", {"effects.upper_contact": "restitution", "effects.inclined_contact": "restitution"}),
          ("device", {"motor.speed": 100.0}), ("paper", {"effects.normal_force": "hop"}),
          ("paper", {"effects.friction": "stribeck", "ground.static_friction": 0.4}),
          ("paper", {"effects.friction": "static", "ground.static_friction": 0.4}),
          ("paper", {"effects.reaction": True}), ("paper", {"motor.speed": 5.0}), ("paper", {"motor.speed": 500.0}),
          ("paper", {"upper.plate.stiffness": 1e9, "inclined.plate.stiffness": 1e9}))


@dataclass(frozen=True)
class Timed:
    """A run of one of the motions that `auto` promises something of; `seconds` without what every call costs."""

    scene: Scene
    command: float | None
    steps: int
    events: int
    seconds: float

    @property
    def counted(self) -> float:
        """Its counted work [s]."""
        return counted_work(self.scene, self.steps, self.events, self.command is not None)


def timed(scene: Scene, command: float | None) -> Timed:
    """Run one motion; the least time of some rounds, beside a machine that does something else."""
    devices = [_commanded(scene, command) for _ in range(_ROUNDS)]
    seconds = min(_seconds(device, HORIZON) for device in devices)
    call = min(_seconds(_commanded(scene, command), 0.0) for _ in range(_ROUNDS))
    last = devices[-1]
    return Timed(scene, command, last.statistics["steps"], len(last.take_events()), max(1e-9, seconds - call))


def _commanded(scene: Scene, command: float | None) -> Simulator:
    device = Simulator(scene)
    device.advance_to(0.0)
    if command is not None:
        device.command(motor_speed=command)
    return device


def _seconds(device: Simulator, until: float) -> float:
    began = time.thread_time()  # not that of whatever else the machine does
    device.advance_to(until)
    return time.thread_time() - began


def step_weight(runs: Iterable[Timed]) -> float:
    """Weight of a step [µs a channel] that fits runs of one scheme best."""
    return float(np.median([1e6 * run.seconds / run.steps / compile_scene(run.scene).forms.channels.count
                            for run in runs]))


def exact_weights(runs: Iterable[Timed]) -> dict[str, float]:
    """Weights of the method exact that fit runs by it best, each run's relative error counting alike."""
    runs = list(runs)
    counts = np.array([list(counts_of_exact(run.scene, run.steps, run.events, run.command is not None).values())
                       for run in runs], dtype=float)
    micros = np.array([1e6 * run.seconds for run in runs])
    found, _ = nnls(counts / micros[:, None], np.ones(len(runs)))
    return dict(zip(EXACT_WEIGHTS, found, strict=True))


def timed_by(scene: Scene, method: str) -> list[Timed]:
    """The promised motions of a scene by a method."""
    compile_kernels(method)
    scene = scene.with_parameters({"solver.method": method, "solver.step": STEP})
    return [timed(scene, command) for command in promised_commands(scene)]


def ratio_table(runs: Mapping[str, Mapping[str, list[Timed]]]) -> str:
    """Costs of the first motion of each scene as ratios to rk4's, counted and measured, in Markdown."""
    heads = ("scene", *(f"`{method}` {how}" for method in ("exact", *STEP_WEIGHTS) if method != "rk4"
                        for how in ("counted", "measured")))
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for name, by_method in runs.items():
        cells = [f"{getattr(by_method[method][-1], what) / getattr(by_method['rk4'][-1], what):.3f}"
                 for method in ("exact", *STEP_WEIGHTS) if method != "rk4" for what in ("counted", "seconds")]
        lines.append(f"| `{name}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def known_scenes() -> str:
    """The lines of `accuracy_in_force.KNOWN`: for an accuracy that no step keeps, all that costs less is tried."""
    lines = []
    for name in STEPPED:
        changes = {"motor.speed": KNOWN_SPEED, "solver.method": "auto", "solver.accuracy": UNKEPT}
        found = choose_method(load_scene(name).with_parameters(changes))
        method, step, error, cost = found.cheaper or ("none", 0.0, 0.0, 0.0)
        lines.append(f'    "{name}": Known({found.exact_cost:.4g}, Candidate("{method}", {step:.4g}, {error:.2g}, '
                     f"{cost:.4g})),")
    return "\n".join(lines)


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; the exit code."""
    argparse.ArgumentParser(description=__doc__).parse_args(words)
    shipped = {name: {method: timed_by(load_scene(name), method) for method in ("exact", *STEP_WEIGHTS)}
               for name in STEPPED}
    exact = [run for of_scene in shipped.values() for run in of_scene["exact"]]
    exact += [run for name, changes in VARIED for run in timed_by(load_scene(name).with_parameters(changes), "exact")]
    for method in STEP_WEIGHTS:
        found = step_weight(run for of_scene in shipped.values() for run in of_scene[method])
        print(f"a step by {method}: {found:.2g} µs a channel (in use: {STEP_WEIGHTS[method]:g})")
    exact = [run for run in exact if run.seconds > _LEAST]
    for name, found in exact_weights(exact).items():
        print(f"exact, {name}: {found:.2g} µs a channel (in use: {EXACT_WEIGHTS[name]:g})")
    off = [run.counted / run.seconds for run in exact]
    print(f"exact, counted over measured: {np.median(off):.2f}, from {min(off):.2f} to {max(off):.2f}\n")
    print(f"Cost of {HORIZON:g} s from the start, rk4 with a step of {STEP:g} s = 1; after a command, if the motor "
          f"stands still:\n\n{ratio_table(shipped)}\n")
    print(f"What accuracy_in_force.KNOWN has, by the weights in use:\n{known_scenes()}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
