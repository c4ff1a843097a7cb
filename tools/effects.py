"""Tables of effects in docs/robot.md: their size, their cost, and the motions with and without them.

Each row compares two scenes that differ in one effect only: `device`, `damped` for effects that `device` cannot have,
or `machine` for those of its motor.
"""

import functools
import itertools
import statistics
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

import vibro_lab
import vibro_ros
from benchmark.costs import RATE
from tools.generated_text import write_between
from vibro_lab.accuracy.harness import seconds
from vibro_lab.orbits.attractors import Attractor
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.parameters import Value
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.solver.system import NOTHING

BEGIN = "<!-- effects: written by `make documents` -->"
END = "<!-- end of effects -->"
#: Motor speed of the runs [rad/s], that of the paper, and number of random starts of each scene.
SPEED, STARTS = 100.0, 32
DURATION, PAIRS = 10.0, 25  # s of a timed run, and number of pairs of runs
_MOST_NAMED = 4  # largest number of motions in a cell; of more motions it has the slowest and the fastest
_RUNS_AWAY = 100.0  # m/s, a mean speed that no steady motion has
_COUNTS = ("states", "modes", "terms", "guards")
HEADS = ("effect", *_COUNTS, "cost", "motions without it", "motions with it")


@dataclass(frozen=True)
class SceneEffect:
    """An effect of a shipped scene: a row of the table."""

    name: str
    without: Mapping[str, Value]  # parameters that remove the effect, or replace it by a simpler choice
    given: Mapping[str, Value] = field(default_factory=dict)  # parameters that add it to a scene without it
    scene: str = "device"

    def scenes(self) -> tuple[Scene, Scene]:
        """The scene with the effect and without."""
        with_it = load_scene(self.scene).with_parameters(self.given)
        return with_it, with_it.with_parameters(self.without)


EFFECTS = (
    SceneEffect("upper mass", {"effects.upper_mass": False}),
    SceneEffect("inclined mass", {"effects.inclined_mass": False}),
    SceneEffect("upper plate", {"effects.upper_contact": "none"}),
    SceneEffect("inclined plate", {"effects.inclined_contact": "none"}),
    SceneEffect("compliant plates, not rigid ones of their restitution in flight",
                {"effects.upper_contact": "restitution", "upper.plate.restitution": 0.853,
                 "effects.inclined_contact": "restitution", "inclined.plate.restitution": 0.839}),
    SceneEffect("plates that cannot pull", {"effects.adhesion": True}),
    SceneEffect("dampers of the plates", {"upper.plate.damping": 0.0, "inclined.plate.damping": 0.0}),
    SceneEffect("dampers of the drives", {"upper.spring.damping": 0.0, "inclined.spring.damping": 0.0}),
    SceneEffect("friction", {"effects.friction": "none"}),
    SceneEffect("static friction, twice the kinetic", {"effects.friction": "coulomb"},
                {"effects.friction": "static", "ground.static_friction": 0.4}),
    SceneEffect("`hop`, not `unilateral`", {"effects.normal_force": "unilateral"}),
    SceneEffect("`hop`, not `weight`", {"effects.normal_force": "weight"}),
    SceneEffect("friction twice as large backwards", {"ground.friction_backward": -1.0},
                {"ground.friction_backward": 0.4}),
    SceneEffect("slope of 0.05 rad", {"ground.slope": 0.0}, {"ground.slope": 0.05}),
    SceneEffect("viscous friction of 2 N s/m", {"ground.viscous_friction": 0.0}, {"ground.viscous_friction": 2.0}),
    SceneEffect("drag of 0.5 N", {"ground.drag": 0.0}, {"ground.drag": 0.5}),
    SceneEffect("landings with a restitution of 0.3", {"ground.restitution": 0.0}, {"ground.restitution": 0.3}),
    SceneEffect("reaction on the masses", {"effects.reaction": False}),
    SceneEffect("10 g on each slider", {"mass.upper_slider": 0.0, "mass.inclined_slider": 0.0},
                {"mass.upper_slider": 0.01, "mass.inclined_slider": 0.01}),
    SceneEffect("10 g on the crank pin", {"mass.crank_pin": 0.0}, {"mass.crank_pin": 0.01}),
    SceneEffect("weight of the masses", {"effects.mass_weight": False}),
    SceneEffect("`ramp` motor, not `ideal`", {"effects.motor": "ideal"}),
    SceneEffect("`lag` motor, not `ideal`", {"effects.motor": "ideal"}, {"effects.motor": "lag"}),
    SceneEffect("starts about `zero`, not about `rest`", {"start.state": "rest"}, {"start.state": "zero"}),
    SceneEffect("starts thrown forwards and up (`given`), not about `rest`", {"start.state": "rest"},
                {"start.state": "given", "start.body_velocity": 0.2, "start.body_vertical_velocity": 0.2,
                 "start.upper_position": 0.06, "start.inclined_position": 0.06}),
    SceneEffect("Stribeck's friction, from twice the kinetic, not Coulomb's", {"effects.friction": "coulomb"},
                {"effects.friction": "stribeck", "ground.static_friction": 0.4}, "damped"),
    SceneEffect("`printed`, not `unilateral`", {"effects.normal_force": "unilateral"},
                {"effects.normal_force": "printed"}, "damped"),
    SceneEffect("the paper's misprint, taken literally", {"effects.misprint": False}, {"effects.misprint": True},
                "damped"),
    SceneEffect("`unilateral`, not `weight`", {"effects.normal_force": "weight"}, scene="damped"),
    SceneEffect("`dc` motor, not `ramp`", {"effects.motor": "ramp"}, scene="machine"),
    SceneEffect("friction of the motor's bearing", {"motor.friction": 0.0, "motor.static_friction": 0.0},
                scene="machine"),
    SceneEffect("inductance of the winding", {"motor.winding_inductance": 0.0}, {"motor.winding_inductance": 2.81e-4},
                "machine"),
    SceneEffect("10 g on each slider, moved by that motor", {"mass.upper_slider": 0.0, "mass.inclined_slider": 0.0},
                scene="machine"),
)


@dataclass(frozen=True)
class Size:
    """Size of a compiled scene: `states` are positions and velocities, `modes` combinations of its effects' states.

    `terms` and `guards` are the largest numbers of coefficients of the equations, and of guards, in a mode.
    """

    states: int
    modes: int
    terms: int
    guards: int


def size(scene: Scene) -> Size:
    """Return the size of `scene` from its compiled tables."""
    model = compile_scene(scene)
    system = model.system
    return Size(2 * model.forms.channels.coordinates, len(model.modes),
                max(int(np.count_nonzero(of_mode)) for of_mode in system.equations),
                max(int(np.count_nonzero(of_mode != NOTHING)) for of_mode in system.guards.row))


@functools.cache
def motions(scene: Scene) -> str:
    """Text of the mean speeds [mm/s] of the motions that `STARTS` random starts lead to; if several, with their starts.
    """
    drawn = vibro_lab.attractors(scene.with_parameters({"motor.speed": SPEED}), STARTS).drawn
    speeds = [attractor.mean_speed for attractor in drawn]
    if max(map(abs, speeds)) > _RUNS_AWAY:
        return "runs away"
    if len(drawn) > _MOST_NAMED:
        return f"{len(drawn)} motions, {min(speeds) * 1e3:+.1f} to {max(speeds) * 1e3:+.1f}"
    cells = [_in_words(attractor) for attractor in drawn]
    return cells[0] if len(set(cells)) == 1 else ", ".join(
        f"{cell} ({attractor.starts} of {STARTS})" for cell, attractor in zip(cells, drawn, strict=True))


def _in_words(attractor: Attractor) -> str:
    """Mean speed of a motion [mm/s], with its interval; of starts that have not settled the least and the largest."""
    if attractor.turns is None:
        return f"{attractor.least * 1e3:+.1f} to {attractor.largest * 1e3:+.1f}, not settled"
    interval = f" ± {attractor.spread * 1e3:.1f}" if attractor.spread >= 5e-5 else ""
    return f"{round(attractor.mean_speed * 1e3, 1) + 0.0:+.1f}{interval}"


def cost_ratio(effect: SceneEffect) -> float:
    """Median ratio of wall times with `effect` and without, run alternately, after a short run."""
    with_it, without = effect.scenes()
    _run(with_it, 1.0 / RATE)
    _run(without, 1.0 / RATE)
    return statistics.median(seconds(lambda: _run(with_it, DURATION)) / seconds(lambda: _run(without, DURATION))
                             for _ in range(PAIRS))


def _run(scene: Scene, duration: float) -> None:
    device = vibro_ros.Simulator(scene)
    device.command(motor_speed=SPEED)
    device.sample(np.arange(round(duration * RATE) + 1) / RATE)


def counted(effect: SceneEffect) -> list[str]:
    """Return the cells of a row that do not depend on runs."""
    with_it, without = map(size, effect.scenes())
    added = [getattr(with_it, name) - getattr(without, name) for name in _COUNTS]
    return [effect.name, *(f"{number:+d}" if number else "" for number in added)]


def line(effect: SceneEffect, cost: str) -> str:
    """Return the row of an effect in Markdown, with its motions unless they are those of the shipped scene."""
    with_it, without = effect.scenes()
    cells = [*counted(effect), cost, motions(without), motions(with_it) if effect.given else ""]
    return f"| {' | '.join(cells)} |"


def tables(effects: Iterable[SceneEffect], costs: Iterable[str]) -> str:
    """Return a table in Markdown for each shipped scene, from effects and the texts of their costs."""
    parts = []
    for name, rows in itertools.groupby(zip(effects, costs, strict=True), lambda row: row[0].scene):
        whole = size(load_scene(name))
        parts.append("\n".join([
            f"The scene `{name}` has {whole.states} states, {whole.modes} modes, at most {whole.terms} terms and "
            f"{whole.guards} guards in one of them. At {SPEED:g} rad/s {STARTS} starts lead to "
            f"{motions(load_scene(name))} mm/s; [64 starts](speeds.md) may find more motions.",
            "",
            f"| {' | '.join(HEADS)} |", "|---" * len(HEADS) + "|", *(line(*row) for row in rows)]))
    return "\n\n".join(parts)


if __name__ == "__main__":
    write_between(Path("docs/robot.md"), BEGIN, END, lambda: tables(EFFECTS, (
        f"{cost_ratio(effect):.2f}" for effect in tqdm(EFFECTS, disable=None))))
