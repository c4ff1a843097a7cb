"""What each effect adds to a scene, what it costs and what leaving it out changes: tables in docs/robot.md.

Each row compares two runs that differ in one effect alone, of the scene `device`, of `damped` for what `device` may not
have, or of `machine` for what its motor adds.
"""

import argparse
import functools
import itertools
import statistics
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmark.costs import RATE
from tools.generated_text import write_between
from vibro_ros.accuracy.harness import seconds
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.parameters import Value
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.orbits.starts import SETTLING, started_at_share
from vibro_ros.simulation.simulator import Simulator
from vibro_ros.solver.system import NOTHING

BEGIN = "<!-- effects: written by `make documents` -->"
END = "<!-- end of effects -->"
#: Motor speed of the runs [rad/s], the paper's.
SPEED = 100.0


@dataclass(frozen=True)
class Effect:
    """An effect of a shipped scene, what the table calls it, and how the scene does without it.

    `without` are parameters that take it away, or put its simpler choice in its place, `given` those that give it to
    the scene, if it has it not. `travel` [m] is the way between the gaps that both plates are sent to in turn, all the
    time, about the scene's own: an effect of commands, which the run without it has not.
    """

    name: str
    without: Mapping[str, Value]
    given: Mapping[str, Value] = field(default_factory=dict)
    scene: str = "device"
    travel: float = 0.0

    def scenes(self) -> tuple[Scene, Scene]:
        """The scene with the effect and without."""
        with_it = load_scene(self.scene).with_parameters(self.given)
        return with_it, with_it.with_parameters(self.without)


EFFECTS = (
    Effect("upper mass", {"effects.upper_mass": False}),
    Effect("inclined mass", {"effects.inclined_mass": False}),
    Effect("upper plate", {"effects.upper_contact": "none"}),
    Effect("inclined plate", {"effects.inclined_contact": "none"}),
    Effect("compliant plates, not rigid ones of their restitution in flight",
           {"effects.upper_contact": "restitution", "upper.plate.restitution": 0.853,
            "effects.inclined_contact": "restitution", "inclined.plate.restitution": 0.839}),
    Effect("plates that cannot pull", {"effects.adhesion": True}),
    Effect("dampers of the plates", {"upper.plate.damping": 0.0, "inclined.plate.damping": 0.0}),
    Effect("dampers of the drives", {"upper.spring.damping": 0.0, "inclined.spring.damping": 0.0}),
    Effect("friction", {"effects.friction": "none"}),
    Effect("static friction, twice the kinetic", {"effects.friction": "coulomb"},
           {"effects.friction": "static", "ground.static_friction": 0.4}),
    Effect("`hop`, not `unilateral`", {"effects.normal_force": "unilateral"}),
    Effect("`hop`, not `weight`", {"effects.normal_force": "weight"}),
    Effect("friction twice as large backwards", {"ground.friction_backward": -1.0}, {"ground.friction_backward": 0.4}),
    Effect("slope of 0.05 rad", {"ground.slope": 0.0}, {"ground.slope": 0.05}),
    Effect("viscous friction of 2 N s/m", {"ground.viscous_friction": 0.0}, {"ground.viscous_friction": 2.0}),
    Effect("drag of 0.5 N", {"ground.drag": 0.0}, {"ground.drag": 0.5}),
    Effect("landings with a restitution of 0.3", {"ground.restitution": 0.0}, {"ground.restitution": 0.3}),
    Effect("reaction on the masses", {"effects.reaction": False}),
    Effect("10 g on each slider", {"mass.upper_slider": 0.0, "mass.inclined_slider": 0.0},
           {"mass.upper_slider": 0.01, "mass.inclined_slider": 0.01}),
    Effect("10 g on the crank pin", {"mass.crank_pin": 0.0}, {"mass.crank_pin": 0.01}),
    Effect("weight of the masses", {"effects.mass_weight": False}),
    Effect("`ramp` motor, not `ideal`", {"effects.motor": "ideal"}),
    Effect("`lag` motor, not `ideal`", {"effects.motor": "ideal"}, {"effects.motor": "lag"}),
    Effect("plates that move, 2 mm to and fro about their places", {}, travel=2e-3),
    Effect("starts about `zero`, not about `rest`", {"start.state": "rest"}, {"start.state": "zero"}),
    Effect("starts thrown forwards and up (`given`), not about `rest`", {"start.state": "rest"},
           {"start.state": "given", "start.body_velocity": 0.2, "start.body_vertical_velocity": 0.2,
            "start.upper_position": 0.06, "start.inclined_position": 0.06}),
    Effect("Stribeck's friction, from twice the kinetic, not Coulomb's", {"effects.friction": "coulomb"},
           {"effects.friction": "stribeck", "ground.static_friction": 0.4}, "damped"),
    Effect("`printed`, not `unilateral`", {"effects.normal_force": "unilateral"},
           {"effects.normal_force": "printed"}, "damped"),
    Effect("the paper's misprint, taken literally", {"effects.misprint": False}, {"effects.misprint": True}, "damped"),
    Effect("`unilateral`, not `weight`", {"effects.normal_force": "weight"}, scene="damped"),
    Effect("`dc` motor, not `ramp`", {"effects.motor": "ramp"}, scene="machine"),
    Effect("friction of the motor's bearing", {"motor.friction": 0.0, "motor.static_friction": 0.0}, scene="machine"),
    Effect("inductance of the winding", {"motor.winding_inductance": 0.0}, {"motor.winding_inductance": 2.81e-4},
           "machine"),
    Effect("10 g on each slider, moved by that motor", {"mass.upper_slider": 0.0, "mass.inclined_slider": 0.0},
           scene="machine"),
)


@dataclass(frozen=True)
class Size:
    """What a scene compiles to: positions and velocities, and combinations of its effects' states.

    `terms` are the coefficients of the equations in the mode that has most, `guards` the conditions watched in the mode
    that has most.
    """

    states: int
    modes: int
    terms: int
    guards: int


@dataclass(frozen=True)
class Row:
    """An effect's numbers: what the scene compiles to, and the mean speeds of the body [m/s], by start.

    `cost` is the median ratio of the wall time of a run with the effect to that of one without.
    """

    effect: Effect
    with_it: Size
    without: Size
    cost: float
    speed_with: np.ndarray
    speed_without: np.ndarray


def size(scene: Scene) -> Size:
    """Counts from the compiled tables of `scene`."""
    model = compile_scene(scene)
    system = model.system
    return Size(2 * model.forms.channels.coordinates, len(model.modes),
                max(int(np.count_nonzero(of_mode)) for of_mode in system.acceleration),
                max(int(np.count_nonzero(of_mode != NOTHING)) for of_mode in system.guard))


@functools.lru_cache(maxsize=64)
def mean_speeds(scene: Scene, duration: float, starts: int, speed: float = SPEED, travel: float = 0.0) -> np.ndarray:
    """Mean speeds of the body [m/s] over `duration` [s], one for each of several starts.

    Loss-free scenes are chaotic, and there only the mean over starts and its spread mean anything. A start is
    another motor speed in the first second, from half of `speed` [rad/s] up; `SETTLING` seconds do not count.
    For `travel` [m] see `Effect`. The array is shared between calls for the same scene, and read-only.
    """
    means = np.array([mean_speed(scene, duration, k / starts, speed, travel) for k in range(starts)])
    means.setflags(write=False)
    return means


def mean_speed(scene: Scene, duration: float, share: float, speed: float = SPEED, travel: float = 0.0) -> float:
    """One of `mean_speeds`: that of the start whose first second is `share` of the way from half of `speed` to it."""
    device = started_at_share(scene, share, speed)
    _advance(device, SETTLING, travel)
    begin = device.state.body_position
    _advance(device, SETTLING + duration, travel)
    return (device.state.body_position - begin) / duration


def _advance(device: Simulator, until: float, travel: float) -> None:
    """Advance to `until` [s]; with a `travel`, the plates turn round wherever they have arrived."""
    while travel and device.time < until:
        turn = round(device.time / _pace(device.scene, travel))
        send_plates(device, turn, travel)
        device.advance_to(min(until, (turn + 1) * _pace(device.scene, travel)))
    device.advance_to(until)


def send_plates(device: Simulator, turn: int, travel: float) -> None:
    """Command both gaps half of `travel` [m] above those of the scene, or as much below in every other `turn`."""
    offset = travel / 2.0 * (-1.0) ** turn
    device.command(upper_gap=device.scene["upper.gap"] + offset, inclined_gap=device.scene["inclined.gap"] + offset)


def _pace(scene: Scene, travel: float) -> float:
    """Time [s] that a plate takes for `travel`."""
    return travel / scene["gap_actuator.speed"]


def cost_ratio(effect: Effect, duration: float, repeats: int) -> float:
    """Median of the ratio of wall times with `effect` and without, run in turn, all compiled before.

    Both are sampled in the same pieces, between which the plates turn round if it is they that move.
    """
    with_it, without = effect.scenes()
    times = np.arange(round(duration * RATE) + 1) / RATE
    pace = _pace(with_it, effect.travel) if effect.travel else duration
    turns = np.arange(pace, duration, pace)
    pieces = np.split(times, np.searchsorted(times, turns))
    for scene in (with_it, without):
        _run(scene, [times[:2]], 0.0)
    return statistics.median(seconds(lambda: _run(with_it, pieces, effect.travel))
                             / seconds(lambda: _run(without, pieces, 0.0)) for _ in range(repeats))


def _run(scene: Scene, pieces: list[np.ndarray], travel: float) -> None:
    device = Simulator(scene)
    device.command(motor_speed=SPEED)
    for turn, times in enumerate(pieces):
        if travel:
            send_plates(device, turn, travel)
        device.sample(times)


def measure(effect: Effect, duration: float, starts: int, repeats: int) -> Row:
    """Numbers of one effect: speeds over `duration` [s] each, cost over half of it."""
    with_it, without = effect.scenes()
    return Row(effect, size(with_it), size(without), cost_ratio(effect, duration / 2.0, repeats),
               mean_speeds(with_it, duration, starts, travel=effect.travel), mean_speeds(without, duration, starts))


def heading() -> list[str]:
    """First lines of the table."""
    heads = ["effect", "states", "modes", "terms", "guards", "cost", "mean speed without it", "change it makes"]
    return [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]


def counted(effect: Effect, with_it: Size, without: Size) -> str:
    """The columns that do not depend on the machine."""
    added = (getattr(with_it, name) - getattr(without, name) for name in ("states", "modes", "terms", "guards"))
    return f"| {effect.name} | " + " | ".join(f"{number:+d}" if number else "" for number in added)


def as_line(row: Row) -> str:
    """A row of the table in Markdown."""
    return (f"{counted(row.effect, row.with_it, row.without)} | {row.cost:.2f} | {in_words(row.speed_without)} | "
            f"{_change(row)} |")


# A mean speed [m/s] that no steady motion has: it grows with the time that is watched, and is no number to compare.
_RUNS_AWAY = 100.0


def _change(row: Row) -> str:
    """Difference of the means in mm/s, and whether two standard deviations could explain it."""
    change = row.speed_with.mean() - row.speed_without.mean()
    if abs(change) > _RUNS_AWAY:
        return "runs away"
    if change == 0.0:
        return "none"
    spread = np.hypot(row.speed_with.std(), row.speed_without.std())
    return f"{change * 1e3:+.1f}{'' if abs(change) > 2.0 * spread else ', within the spread'}"


def in_words(speeds: np.ndarray) -> str:
    """Mean and spread (standard deviation over the starts) of mean speeds, in mm/s."""
    return f"{speeds.mean() * 1e3:+.1f} ± {speeds.std() * 1e3:.1f}"


def effects_tables(rows: Iterable[Row], duration: float, starts: int) -> str:
    """Markdown: a table for each scene of `rows`."""
    by_scene = itertools.groupby(rows, lambda row: row.effect.scene)
    return "\n\n".join(_table(load_scene(name), of_scene, duration, starts) for name, of_scene in by_scene)


def _table(scene: Scene, rows: Iterable[Row], duration: float, starts: int) -> str:
    """What is compared, and a line for each row."""
    whole = size(scene)
    return "\n".join([
        f"The scene `{scene.name}` has {whole.states} states, {whole.modes} modes, at most {whole.terms} terms and "
        f"{whole.guards} guards in one of them, and a mean speed of "
        f"{in_words(mean_speeds(scene, duration, starts))} mm/s at {SPEED:g} rad/s.", "",
        *heading(), *map(as_line, rows)])


def main(words: Sequence[str]) -> int:
    """Measure, and write the tables, or print the costs of some effects."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, nargs="?", default=Path("docs/robot.md"), help="default: %(default)s")
    parser.add_argument("--duration", type=float, default=20.0, help="robot time [s] (default %(default)g)")
    parser.add_argument("--starts", type=int, default=8, help="starts for each mean speed (default %(default)d)")
    parser.add_argument("--repeats", type=int, default=25, help="pairs of timed runs (default %(default)d)")
    parser.add_argument("--cost", metavar="WORD", help="only print the costs of effects with this word in their names")
    options = parser.parse_args(words)
    if options.cost:
        for effect in (effect for effect in EFFECTS if options.cost in effect.name):
            print(f"{effect.scene}, {effect.name}: {cost_ratio(effect, options.duration / 2.0, options.repeats):.2f}")
        return 0
    write_between(options.file, BEGIN, END, lambda: effects_tables(
        [measure(effect, options.duration, options.starts, options.repeats) for effect in tqdm(EFFECTS, disable=None)],
        options.duration, options.starts))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
