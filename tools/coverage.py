"""How far the intervals of mean speeds can be trusted: they are repeated from other starts, and counted.

    python -m tools.coverage

prints for steps of rk4 and for exact in the scene `paper`, the hardest of the shipped ones, how many intervals hold the
mean of all starts, and how many pairs of neighbouring batches overlap; some minutes.
"""

if __name__ == "__main__":  # before all imports, as in every executable
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("coverage"))

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibro_ros.accuracy.starts import average, speeds_of_starts
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene
from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code

#: What is repeated: methods and steps [s] of the scene `paper`.
ROWS = (("rk4", 1e-4), ("rk4", 5e-5), ("exact", None))
BATCHES, STARTS, DURATION = 16, 64, 5.0


@dataclass(frozen=True)
class Coverage:
    """Of `batches` intervals, those that hold the mean of all starts, and of `batches` pairs, those that overlap."""

    batches: int
    holding: int
    overlapping: int


def covered(values: np.ndarray, starts: int) -> Coverage:
    """Count over batches of `starts` values each; the last batch's neighbour is the first."""
    batches = [average(batch) for batch in values.reshape(-1, starts)]
    truth = float(values.mean())
    holding = sum(abs(found.mean - truth) <= found.spread for found in batches)
    overlapping = sum(abs(found.mean - other.mean) <= found.spread + other.spread
                      for found, other in zip(batches, batches[1:] + batches[:1], strict=True))
    return Coverage(len(batches), holding, overlapping)


def with_method(scene: Scene, method: str, step: float | None) -> Scene:
    """`scene` by a method."""
    return scene.with_parameters({"solver.method": method, **({"solver.step": step} if step else {})})


def main(words: Sequence[str]) -> int:
    """Measure and print; 0 when done; see `front_door.exit_code` for errors."""
    return exit_code("coverage", lambda: _measure(words))


def _measure(words: Sequence[str]) -> int:
    parser = Parser(prog="coverage", description=EXECUTABLES["coverage"].does)
    parser.add_argument("--batches", type=int, default=BATCHES, help="default: %(default)d")
    parser.add_argument("--starts", type=int, default=STARTS, help="of a batch (default: %(default)d)")
    options = parser.parse_args(words)
    scene = load_scene("paper")
    for method, step in ROWS:
        values = speeds_of_starts(with_method(scene, method, step), DURATION, options.batches * options.starts, batch=1)
        found, whole = covered(values, options.starts), average(values)
        name = f"{method}, {step:g} s" if step else method
        print(f"{name}: {1e3 * whole.mean:.1f} mm/s over all {len(values)} starts; of {found.batches} "
              f"intervals of {options.starts} starts {found.holding} hold it, and of as many pairs "
              f"{found.overlapping} overlap", flush=True)
    return 0
