"""What each effect adds to the scene `device`, what it costs and what leaving it out changes: a table in docs/model.md.

Each row compares two scenes that differ in one effect alone.
"""

import argparse
import functools
import statistics
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vibro_ros.model.parameters import Value
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.samples import Samples
from vibro_ros.scene_file import load_scene
from vibro_ros.simulator import Simulator
from vibro_ros.solver.system import NOTHING
from vibro_ros.study.bench import seconds
from vibro_ros.study.generated_text import replaced

BEGIN = "<!-- effects: written by `make docs` -->"
END = "<!-- end of effects -->"
#: Motor speed of the runs [rad/s], the paper's.
SPEED = 100.0
#: Time [s] that a start is given before its mean speed counts, and of that, the time at another motor speed.
SETTLING, STARTING = 4.0, 1.0
_RATE = 200.0


@dataclass(frozen=True)
class Effect:
    """An effect and how a scene does without it.

    Attributes
    ----------
    name : str
        What the table calls it.
    without : Mapping
        Parameters that take it away, or put its simpler choice in its place.
    given : Mapping
        Parameters that give it to the scene, if it has it not.
    """

    name: str
    without: Mapping[str, Value]
    given: Mapping[str, Value] = field(default_factory=dict)

    def scenes(self, scene: Scene) -> tuple[Scene, Scene]:
        """`scene` with the effect and without."""
        with_it = scene.with_parameters(self.given)
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
    Effect("reaction on the masses", {"effects.reaction": False}),
    Effect("weight of the masses", {"effects.mass_weight": False}),
    Effect("`ramp` motor, not `ideal`", {"effects.motor": "ideal"}),
    Effect("`lag` motor, not `ideal`", {"effects.motor": "ideal"}, {"effects.motor": "lag"}),
    Effect("energy audit", {"solver.audit": False}),
)


@dataclass(frozen=True)
class Size:
    """What a scene compiles to.

    Attributes
    ----------
    states : int
        Positions and velocities.
    modes : int
        Combinations of its effects' states.
    terms : int
        Coefficients of the equations in the mode that has most.
    guards : int
        Conditions watched in the mode that has most.
    """

    states: int
    modes: int
    terms: int
    guards: int


@dataclass(frozen=True)
class Row:
    """An effect's numbers.

    Attributes
    ----------
    effect : Effect
        The effect.
    with_it, without : Size
        What the scene compiles to.
    cost : float
        Wall time of a run with the effect over that of one without; median.
    speed_with, speed_without : ndarray, shape (starts,)
        Mean speeds of the body [m/s], by start.
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
                max(np.count_nonzero(of_mode) for of_mode in system.acceleration),
                max(np.count_nonzero(of_mode != NOTHING) for of_mode in system.guard))


@functools.lru_cache(maxsize=64)
def mean_speeds(scene: Scene, duration: float, starts: int, speed: float = SPEED) -> np.ndarray:
    """Mean speeds of the body [m/s] over `duration` [s], one for each of several starts.

    Loss-free scenes are chaotic, and there only the mean over starts and its spread mean anything. A start is
    another motor speed in the first second, from half of `speed` [rad/s] up; `SETTLING` seconds do not count.
    The array is shared between calls for the same scene, and read-only.
    """
    means = np.array([mean_speed(scene, duration, k / starts, speed) for k in range(starts)])
    means.setflags(write=False)
    return means


def mean_speed(scene: Scene, duration: float, share: float, speed: float = SPEED) -> float:
    """One of `mean_speeds`: that of the start whose first second is `share` of the way from half of `speed` to it."""
    begin, end = from_start(scene, share, speed, np.array([SETTLING, SETTLING + duration])).body_position
    return (end - begin) / duration


def from_start(scene: Scene, share: float, speed: float, times: np.ndarray) -> Samples:
    """Samples at `times` [s], after the first second, of one of the starts of `mean_speeds`."""
    device = Simulator(scene)
    device.command(motor_speed=speed * (1.0 + share) / 2.0)
    device.advance_to(STARTING)
    device.command(motor_speed=speed)
    return device.sample(times)


def cost_ratio(with_it: Scene, without: Scene, duration: float, repeats: int) -> float:
    """Median of the ratio of their wall times, run in turn, all compiled before."""
    times = np.arange(round(duration * _RATE) + 1) / _RATE
    for scene in (with_it, without):
        _run(scene, times[:2])
    return statistics.median(seconds(_run, with_it, times) / seconds(_run, without, times) for _ in range(repeats))


def _run(scene: Scene, times: np.ndarray) -> None:
    device = Simulator(scene)
    device.command(motor_speed=SPEED)
    device.sample(times)


def measure(scene: Scene, effect: Effect, duration: float, starts: int, repeats: int) -> Row:
    """Numbers of one effect of `scene`: speeds over `duration` [s] each, cost over half of it."""
    with_it, without = effect.scenes(scene)
    return Row(effect, size(with_it), size(without), cost_ratio(with_it, without, duration / 2.0, repeats),
               mean_speeds(with_it, duration, starts), mean_speeds(without, duration, starts))


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


def _change(row: Row) -> str:
    """Difference of the means in mm/s, and whether two standard deviations could explain it."""
    change = row.speed_with.mean() - row.speed_without.mean()
    if change == 0.0:
        return "none"
    spread = np.hypot(row.speed_with.std(), row.speed_without.std())
    return f"{change * 1e3:+.1f}{'' if abs(change) > 2.0 * spread else ', within the spread'}"


def in_words(speeds: np.ndarray) -> str:
    """Mean and spread (standard deviation over the starts) of mean speeds, in mm/s."""
    return f"{speeds.mean() * 1e3:+.1f} ± {speeds.std() * 1e3:.1f}"


def effects_table(scene: Scene, rows: Iterable[Row], duration: float, starts: int) -> str:
    """Markdown: what is compared, and a line for each row."""
    whole = size(scene)
    return "\n".join([
        f"The scene `{scene.name}` has {whole.states} states, {whole.modes} modes, at most {whole.terms} terms and "
        f"{whole.guards} guards in one of them, and a mean speed of "
        f"{in_words(mean_speeds(scene, duration, starts))} mm/s at {SPEED:g} rad/s.", "",
        *heading(), *map(as_line, rows)])


def main(arguments: list[str] | None = None) -> int:
    """Measure, and write the table; 2 when the file cannot be read or written, or has no place for it."""
    parser = argparse.ArgumentParser(prog="effects", description="Write the table of effects into a Markdown file.")
    parser.add_argument("file", type=Path, nargs="?", default=Path("docs/model.md"), help="default: %(default)s")
    parser.add_argument("--duration", type=float, default=20.0, help="robot time [s] (default %(default)g)")
    parser.add_argument("--starts", type=int, default=8, help="starts for each mean speed (default %(default)d)")
    parser.add_argument("--repeats", type=int, default=25, help="pairs of timed runs (default %(default)d)")
    options = parser.parse_args(arguments)
    scene = load_scene("device")
    try:
        document = options.file.read_text(encoding="utf-8")
        replaced(document, BEGIN, END, "")
        rows = [measure(scene, effect, options.duration, options.starts, options.repeats) for effect in EFFECTS]
        table = effects_table(scene, rows, options.duration, options.starts)
        options.file.write_text(replaced(document, BEGIN, END, table), encoding="utf-8")
    except (OSError, ValueError) as error:
        print(f"docs: {options.file}: {getattr(error, 'strerror', None) or error}", file=sys.stderr)
        return 2
    print(f"docs: {options.file}: effects written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
