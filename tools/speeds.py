"""The tables of docs/speeds.md: the motions of each robot that a page names, and what a metre costs."""

import math
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

import vibro_lab
import vibro_ros
from tools.generated_text import write_between
from vibro_lab.orbits.attractors import Attractor, group_starts, steady_start
from vibro_lab.orbits.recurrence import NotSettledError, SettledMotion, number_among, settle
from vibro_lab.orbits.starts import motor_command, running
from vibro_lab.orbits.turn_map import Stroboscope, free_cut
from vibro_lab.study.measures import device_at_start, measure
from vibro_ros.configuration.scene_file import load_scene, shipped
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.validity import validity_of
from vibro_ros.simulation.workers import core_count, in_processes

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs/speeds.md"
MOTIONS = "<!-- motions: written by `make documents` -->", "<!-- end of motions -->"
COSTS = "<!-- costs: written by `make documents` -->", "<!-- end of costs -->"
DISTRIBUTIONS = "<!-- distributions: written by `make documents` -->", "<!-- end of distributions -->"
OPTIMA = sorted((ROOT / "docs/optimum").glob("*.yaml"))
#: What `study optimise` found in `device`, with the motors that pay differently.
ADVISED = ("thriftiest", "thrifty", "fastest", "thrifty_grounded", "fastest_grounded")
STARTS, COSTED_STARTS = 64, 8
#: Settling and measuring time [s] of a start that keeps its energy.
KEEPS_SETTLING, KEEPS_MEASURED = 4.0, 64.0
#: Starts about which a robot that keeps its energy is started.
ABOUT = ("rest", "zero")
#: Speeds of the body [m/s] with which a robot is started as well.
PUSHED = (0.5, -0.5, 1.0, -1.0, 2.0, -2.0)
#: Settling and measuring time of a cost [s], and period of the samples that judge a flight [s].
SETTLING, MEASURED, PERIOD = 24.0, 16.0, 5e-4
#: Mean speed [m/s] below which a robot stands.
STANDS = 1e-5
#: Time [s] that a robot which stood has had its command.
COMMANDED = 8.0
_MOST_NAMED = 6  # motions of one robot
_COSTS = ("mean_speed", "cost_of_transport", "delivered_cost_of_transport", "supply_power", "air_share",
          "upper_peak_force", "inclined_peak_force")


def robots() -> dict[str, Scene]:
    """Return every robot that a page names, by its name there, with its motor turning."""
    return {**{f"`{name}`": running(load_scene(name)) for name in shipped("scene")},
            **{f"`optimum/{path.stem}`": load_scene(path) for path in OPTIMA}}


def keeps_energy(scene: Scene) -> bool:
    """Whether nothing takes energy from the masses: no damper, no rebound slower than the blow, and a body whose
    friction does not act back on them. Such a robot does not forget its start: no two starts need settle to one motion.
    """
    rebounds = all(scene[f"effects.{side}_contact"] != "restitution" or scene[f"{side}.plate.restitution"] == 1.0
                   for side in scene.guides)
    dampers = any(scene[f"{side}.{part}.damping"] for side in scene.guides for part in ("spring", "plate"))
    return rebounds and not dampers and not scene["effects.reaction"]


def named(name: str, scene: Scene) -> str:
    """Return the first cell of a row: the robot and its command."""
    command, value = motor_command(scene)
    return f"{name}, {value:.4g} {'V' if command == 'motor_voltage' else 'rad/s'}"


def distribution_rows(name: str, scene: Scene) -> list[str]:
    """Return a row for the starts about each of `ABOUT` of a robot that keeps its energy: the range of their speeds."""
    rows = []
    for state in ABOUT:
        begun = scene.with_parameters({"start.state": state})
        runs = in_processes(partial(measure, begun, ("mean_speed",), KEEPS_SETTLING, KEEPS_MEASURED), range(STARTS),
                            core_count())
        speeds = 1e3 * np.array([future.result()["mean_speed"] for _, future in runs])
        digits = max(0, 2 - math.floor(math.log10(np.abs(speeds).max())))
        ends = [f"{value:.{digits}f}" for value in np.quantile(speeds, (0.0, 0.25, 0.5, 0.75, 1.0))]
        rows.append(f"| {named(name, scene)} | near `{state}` | {' | '.join(ends)} |")
    return rows


def motion_rows(name: str, scene: Scene, starts: int = STARTS) -> list[str]:
    """Return a row of the first table for each motion of a robot."""
    name = named(name, scene)
    drawn = vibro_lab.attractors(scene, starts).drawn
    leads, others = led_to(scene, drawn)
    rows = [f"| {name} | {attractor.in_words()} | {attractor.starts} of {starts} ({100 * attractor.low:.0f} to "
            f"{100 * attractor.high:.0f} %) | {exponent_in_words(attractor)} | {lead} |"
            for attractor, lead in zip(drawn[:_MOST_NAMED], leads, strict=False)]
    if unnamed := drawn[_MOST_NAMED:]:
        speeds = [1e3 * attractor.mean_speed for attractor in unnamed]
        rows.append(f"| {name} | {len(unnamed)} motions more, {min(speeds):.1f} to {max(speeds):.1f} mm/s | "
                    f"{sum(attractor.starts for attractor in unnamed)} of {starts} | | |")
    return rows + [f"| {name} | {motion.in_words()} | 0 of {starts} | | {words} |" for words, motion in others.items()]


def exponent_in_words(attractor: Attractor) -> str:
    """The largest Lyapunov exponent [1/s] with its interval."""
    spread = f" ± {attractor.exponent_spread:.1g}" if attractor.exponent_spread > 0.0 else ""
    if attractor.exponent == -np.inf:
        return "below all"
    return "" if np.isnan(attractor.exponent) else f"{attractor.exponent:.2f}{spread}"


def led_to(scene: Scene, attractors: Sequence[Attractor]) -> tuple[list[str], dict[str, Attractor]]:
    """Return a simple start that leads to each motion; and, by their starts, the periodic motions to which simple
    starts lead and no random start does. Motions without a period are left out of the latter, because one start does
    not suffice to compare them.
    """
    words, others, met = [""] * len(attractors), dict[str, Attractor](), list[SettledMotion]()
    for start, motion in simple_starts(scene):
        places = [place for place, attractor in enumerate(attractors) if is_of(motion, attractor)]
        if places:
            words[places[0]] = words[places[0]] or start
        elif motion.turns and number_among(motion, met) is None:
            met.append(motion)
            others[start] = group_starts([motion], [motion.mean_speed])[0][0]
    return words, others


def simple_starts(scene: Scene) -> Iterator[tuple[str, SettledMotion]]:
    """Yield a description of each simple start, and the motion to which it leads: a command to a standing robot; the
    motor turning from the start; the same with another speed of the body.
    """
    command, value = motor_command(scene)
    device = vibro_ros.Simulator(scene.with_parameters({command.replace("_", "."): 0.0}))
    device.command(**{command: value})
    device.advance_to(COMMANDED)
    stroboscope, moving = Stroboscope(free_cut(scene)), vibro_ros.Simulator(scene)
    moving.restore(device.checkpoint())  # the two scenes differ in the command with which they begin alone
    stroboscope.begin_with(moving)
    if motion := settle(stroboscope):
        yield "a command while it stands", motion
    for speed in (0.0, *PUSHED):
        with suppress(NotSettledError, ValueError):  # it moves on, or the body of this scene stays where it is
            motion = vibro_lab.settled_motion(scene, **({"body_velocity": speed} if speed else {}))
            yield f"turning from the start{f', `body_velocity={speed:g}`' if speed else ''}", motion


def is_of(motion: SettledMotion, attractor: Attractor) -> bool:
    """Whether a start has settled to an attractor."""
    return bool(attractor.turns is not None and len(attractor.states)
                and SettledMotion(attractor.turns, attractor.states, attractor.mean_speed, 0,
                                  motion.tolerance).is_same(motion))


class MeasuredMotion(NamedTuple):
    """A motion of a robot, the measures of the first random start that leads to it, and samples of that start."""

    attractor: Attractor
    values: dict[str, float]
    samples: Samples

    def in_words(self, starts: int) -> str:
        """Return the motion's speed and period, and the number of starts, of `starts`, that lead to it."""
        return f"{self.attractor.in_words()} ({self.attractor.starts} of {starts})"


def measured_motions(scene: Scene, names: Collection[str], starts: int = COSTED_STARTS) -> list[MeasuredMotion]:
    """Return the motions that random starts have settled to, those of most starts first, each with its own measures."""
    runs = in_processes(partial(_measured, scene, names), range(starts), core_count())
    measures, motions = zip(*(future.result() for _, future in runs), strict=True)
    speeds = [of_start["mean_speed"] if motion is None else motion.mean_speed
              for of_start, motion in zip(measures, motions, strict=True)]
    attractors, places = group_starts(motions, speeds)
    first_starts = [int(np.argmax(places == place)) for place in range(len(attractors))]
    return [MeasuredMotion(attractor, measures[start], _sampled(scene, start))
            for attractor, start in zip(attractors[:_MOST_NAMED], first_starts, strict=False)]


def _measured(scene: Scene, names: Collection[str], start: int) -> tuple[dict[str, float], SettledMotion | None]:
    values = measure(scene, names, SETTLING, MEASURED, start)
    try:
        stroboscope = Stroboscope(free_cut(scene))
        stroboscope.begin_with(steady_start(scene, start))
        return values, settle(stroboscope)
    except SimulationError:  # the crank does not come round
        return values, None


def _sampled(scene: Scene, start: int) -> Samples:
    device = device_at_start(scene, start)
    device.advance_to(SETTLING)
    return device.sample(np.arange(SETTLING, SETTLING + 2.0, PERIOD))


def with_machines_motor(scene: Scene) -> Scene:
    """A robot with the motor of `machine`, at the same motor speed."""
    motor = {name: value for name, value in load_scene("machine").parameters.items()
             if name == "effects.motor" or (name.startswith("motor.") and name not in ("motor.speed",
                                                                                       "motor.max_speed"))}
    return scene.with_parameters(motor)


def cost_rows(name: str, scene: Scene) -> Iterator[str]:
    """A row of the second table for each motion of a robot, with an ideal motor and with that of `machine`, and one
    that says why a robot cannot have that motor.
    """
    stroke = 2.0 * scene["crank.radius"] / scene["body.wheelbase"]
    robots_by_motor, refusal = {"ideal": scene.with_parameters({"effects.motor": "ideal"})}, ""
    try:
        robots_by_motor["of `machine`"] = with_machines_motor(scene)
    except ValueError as error:
        refusal = str(error).partition(";")[0]
    for motor, moved in robots_by_motor.items():
        for motion in measured_motions(moved, _COSTS):
            values, speed = motion.values, abs(motion.values["mean_speed"])
            pitch = validity_of(moved, vars(motion.samples)).pitch_index
            peak = np.nanmax([values["upper_peak_force"], values["inclined_peak_force"]])
            if speed < STANDS:
                prices = ["-", "-", f"stands, and takes {values['supply_power']:.0f} W"]
            else:
                weight = moved.total_mass * moved["gravity"]
                supply = f"{values['supply_power'] / (weight * speed):.3g}" if moved.has_rotor else "-"
                prices = [f"{values['cost_of_transport']:.3g}", f"{values['delivered_cost_of_transport']:.3g}", supply]
            cells = [name, motor, motion.in_words(COSTED_STARTS), *prices, f"{100 * values['air_share']:.0f} %",
                     f"{peak:.3g} N", f"{stroke:.2f}", "-" if pitch is None else f"{pitch:.2g}"]
            yield f"| {' | '.join(cells)} |"
    if refusal:
        yield f"| {name} | of `machine` | refused: {refusal}{' | -' * 5} | {stroke:.2f} | - |"


def motion_table() -> str:
    """Markdown of the first table."""
    lines = ["| robot and command | motion | share of starts [%] (95 %) | exponent [1/s] | a start that leads there |",
             "|---|---|---|---|---|"]
    for name, scene in tqdm(robots().items(), disable=None):
        lines += [] if keeps_energy(scene) else motion_rows(name, scene)
    return "\n".join(lines)


def distribution_table() -> str:
    """Markdown of the table of robots that keep their energy."""
    lines = [f"| robot and command | {STARTS} starts | least | a quarter is below | half are below | three quarters "
             "are below | largest |", "|---" * 7 + "|"]
    for name, scene in tqdm(robots().items(), disable=None):
        lines += distribution_rows(name, scene) if keeps_energy(scene) else []
    return "\n".join(lines)


def cost_table() -> str:
    """Markdown of the second table."""
    lines = ["| robot | motor | motion | net | delivered | from the supply | in the air | largest force on a plate | "
             "stroke over wheelbase | pitch index |", "|---" * 10 + "|"]
    chosen = {"`device`": running(load_scene("device")),
              **{f"`{name}`": load_scene(ROOT / "docs/optimum" / f"{name}.yaml") for name in ADVISED}}
    for name, scene in tqdm(chosen.items(), disable=None):
        lines += cost_rows(name, scene)
    return "\n".join(lines)


def main() -> int:
    """Write the tables into the page."""
    for marks, table in ((DISTRIBUTIONS, distribution_table), (MOTIONS, motion_table), (COSTS, cost_table)):
        write_between(PAGE, *marks, table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
