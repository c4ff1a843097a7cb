"""The accuracy in force, and what the next cheaper choice would cost and lose, in words for who watches a robot run.

Nothing is measured for it while the robot runs: `auto` has measured at the start, and for the shipped scenes the
numbers are known.
"""

from collections.abc import Mapping
from typing import NamedTuple

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.auto import HORIZON, Candidate, Choice, counted_work

#: Motor speed [rad/s] at which `KNOWN` holds.
KNOWN_SPEED = 100.0


class Known(NamedTuple):
    """Of a shipped scene: counted work by `exact` [s per simulated s], and what costs next less."""

    exact_cost: float
    cheaper: Candidate


#: Shipped scene to what is known of its first 0.2 s at `KNOWN_SPEED`, as the measurement of
#: the weights prints it.
KNOWN: Mapping[str, Known] = {
    "damped": Known(0.0008883, Candidate("moreau", 0.003162, 0.016, 0.0001017)),
    "device": Known(0.001435, Candidate("moreau", 0.003162, 0.015, 0.0001137)),
    "frictionless": Known(0.0009945, Candidate("moreau", 0.005623, 0.04, 5.814e-05)),
    "no_impact": Known(8.612e-05, Candidate("semi_implicit_euler", 0.001778, 0.0082, 6.552e-05)),
    "paper": Known(0.001428, Candidate("moreau", 0.005623, 0.04, 5.814e-05)),
    "rigid": Known(0.000272, Candidate("semi_implicit_euler", 0.001778, 0.014, 8.568e-05)),
    "unilateral": Known(0.001662, Candidate("moreau", 0.005623, 0.04, 5.814e-05)),
}
_UNKNOWN = "not known for this scene: solver.method auto finds it at the start, the executable accuracy measures more"


def accuracy_in_force(scene: Scene, choice: Choice | None) -> str:
    """What `scene` is simulated to, in words; `choice` is what `auto` has picked, if it was asked."""
    if scene["solver.method"] == "exact":
        return f"rounding: {scene.attainable_accuracy:.2g} m for {HORIZON:g} s"
    if choice:
        return f"{choice.error:.2g} m for the first {HORIZON:g} s, of {scene['solver.accuracy']:g} m asked for"
    return "not known: a step of fixed length promises nothing, and the executable accuracy measures its error"


def next_cheaper_choice(scene: Scene, choice: Choice | None) -> str:
    """What costs less than what `scene` is simulated by, how much less, and what it loses, in words."""
    if choice:
        return _in_words(choice.cheaper, choice.cost, f"the first {HORIZON:g} s")
    shipped = load_scene(scene.name) if scene.name in KNOWN else None
    if shipped is None or any(value != shipped[name] for name, value in scene.parameters.items()
                              if name != "motor.speed" and not name.startswith("solver.")):
        return _UNKNOWN
    known = KNOWN[scene.name]
    where = f"the first {HORIZON:g} s at {KNOWN_SPEED:g} rad/s"
    if scene["solver.method"] == "exact":
        return _in_words(known.cheaper, known.exact_cost, where)
    cost = counted_work(scene, 1.0 / scene["solver.step"])
    if known.exact_cost < cost:
        return f"exact: {known.exact_cost / cost:.2g} of the work in {where}, and nothing lost"
    return _in_words(known.cheaper if known.cheaper.cost < cost else None, cost, where)


def _in_words(cheaper: Candidate | None, cost: float, where: str) -> str:
    if cheaper is None:
        return "none: whatever costs less goes wrong"
    return (f"{cheaper.method}, step {cheaper.step:.3g} s: {cheaper.cost / cost:.2g} of the work, but off by "
            f"{cheaper.error:.2g} m in {where}")
