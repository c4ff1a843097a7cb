"""``study basins``: the motion that each of many starts leads to, and the share of the starts of each motion."""

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from vibro_lab.orbits.attractors import MOST_ATTRACTORS, Attractors, group_starts, with_exponents
from vibro_lab.orbits.chaos import sign_of
from vibro_lab.orbits.recurrence import SettledMotion, command_in_words, settle, tolerance_of
from vibro_lab.orbits.starts import running
from vibro_lab.orbits.turn_map import (
    TURN,
    Stroboscope,
    TurnMap,
    crank_speed,
    free_cut,
    has_sampled_controller,
    state_names,
    whole_number,
)
from vibro_lab.study import figures
from vibro_lab.study.command import Progress, Results, StudyCommand, machine_of
from vibro_lab.study.execution import Execution
from vibro_lab.study.table import NUMBERS, Field, Study, computed, file_of, table_of
from vibro_lab.study.variation import limits_in_words
from vibro_ros import STATE_UNITS, Parser, Scene, SimulationError, Value

FOLDER, STARTS, ATTRACTORS, PICTURE = "blocks", "starts.parquet", "attractors.parquet", "basins.png"
TURNS, MOST_TURNS, STARTS_DRAWN, QUICK_STARTS = 64, 4096, 1000, 300
MOST_STARTS = 1_000_000
"""Largest number of starts of a study."""
_FEWEST_TURNS, _LARGEST_TURNS = 8, 1_000_000  # limits of --turns and --most-turns
_LARGEST = 1e6  # SI units, of a coordinate of a start
_BLOCK_ROWS = 1024  # starts of a block, some seconds of work: the most that an interruption loses
ANGLE = "crank_angle"


@dataclass(frozen=True)
class Over:
    """A coordinate of the start that varies."""

    name: str  # name of an argument of `Simulator.set_state`
    low: float  # its range, in its SI unit
    high: float
    count: int = 0  # number of values on a grid, both ends included; 0 if starts are random

    @property
    def unit(self) -> str:
        """SI unit of the coordinate."""
        return STATE_UNITS[self.name]

    @property
    def values(self) -> np.ndarray:
        """Values on the grid, shape (count,)."""
        return np.linspace(self.low, self.high, self.count)


@dataclass(frozen=True)
class Starts:
    """A grid of starts over two coordinates, of which the second changes fastest, or random starts, uniform in a box.

    A random start depends only on seed and number, so a larger count includes the starts of a smaller one.
    """

    over: tuple[Over, ...]  # the coordinates of a grid, or the sides of the box
    count: int  # number of starts, and seed of the random ones
    seed: int = 0

    @property
    def is_grid(self) -> bool:
        """Whether the starts form a grid."""
        return self.over[0].count > 0

    def start(self, number: int) -> dict[str, float]:
        """Arguments of `Simulator.set_state` for a start by its number."""
        if self.is_grid:
            places = divmod(number, self.over[1].count)
            return {coordinate.name: float(values[place])
                    for coordinate, values, place in zip(self.over, self._values, places, strict=True)}
        shares = np.random.default_rng((self.seed, number)).uniform(size=len(self.over))
        return {coordinate.name: float(coordinate.low + share * (coordinate.high - coordinate.low))
                for coordinate, share in zip(self.over, shares, strict=True)}

    def document(self) -> dict:
        """Everything that determines the starts, for JSON."""
        over = [[coordinate.name, coordinate.low, coordinate.high, coordinate.count] for coordinate in self.over]
        return {"grid": over} if self.is_grid else {"box": over, "count": self.count, "seed": self.seed}

    @cached_property
    def _values(self) -> list[np.ndarray]:
        return [coordinate.values for coordinate in self.over]


@dataclass(frozen=True)
class BasinDesign:
    """A checked design of a study of basins."""

    scene: Scene  # scene that is started
    phase: float  # crank angle at the cut [rad]
    starts: Starts  # its starts
    turns: int  # turns of the crank after which a start is judged for the first time
    most_turns: int  # turns after which a start counts as not settled

    def __post_init__(self) -> None:
        if not _FEWEST_TURNS <= self.turns <= self.most_turns <= _LARGEST_TURNS:
            raise ValueError(f"--turns {self.turns} and --most-turns {self.most_turns}: give numbers from "
                             f"{_FEWEST_TURNS} to {_LARGEST_TURNS}, the smaller one first")

    def document(self) -> dict:
        """Everything that determines the results, for JSON."""
        return {"scene": self.scene.name, "set": dict(self.scene.parameters), "phase": self.phase,
                "starts": self.starts.document(), "turns": self.turns, "most_turns": self.most_turns}


def over_in_words(scene: Scene, text: str) -> Over:
    """Parse a coordinate from ``NAME=LOW:HIGH`` or ``NAME=LOW:HIGH:COUNT``."""
    name, equals, values = text.partition("=")
    if not equals:
        raise ValueError(f"--over {text}: give NAME=LOW:HIGH:COUNT for a grid, NAME=LOW:HIGH for draws")
    known = (*state_names(scene), ANGLE)
    if name not in known:
        raise ValueError(f"--over {name or repr(name)}: is no coordinate of this scene's start; give one of "
                         f"{', '.join(known)}")
    low, high, count = limits_in_words(f"--over {name}", values)
    if max(abs(low), abs(high)) > _LARGEST:
        raise ValueError(f"--over {name}: {low:g} to {high:g} is out of range; give numbers up to {_LARGEST:g}")
    if name == "body_height" and low < 0.0:
        raise ValueError(f"--over {name}: {low:g} {STATE_UNITS[name]} is out of range; give at least 0")
    return Over(name, low, high, count)


def chosen_starts(scene: Scene, over: tuple[Over, ...], count: int, seed: int) -> Starts:
    """Return the starts of the options `--over`, `--starts` and `--seed`."""
    if len({coordinate.name for coordinate in over}) < len(over):
        raise ValueError("--over: a coordinate is given twice; keep one")
    if not any(coordinate.count for coordinate in over):
        return Starts(over or everywhere(scene), whole_number("--starts", count, 1, MOST_STARTS), seed)
    if len(over) != 2 or not all(coordinate.count for coordinate in over):
        counts = sum(coordinate.count > 0 for coordinate in over)
        raise ValueError(f"--over: {len(over)} coordinates, of which {counts} have a count; a grid has two, both with "
                         "a count; draws have none with a count")
    cells = math.prod(coordinate.count for coordinate in over)
    if cells > MOST_STARTS:
        raise ValueError(f"--over: {cells} starts are more than {MOST_STARTS}; give smaller counts")
    return Starts(over, cells)


def everywhere(scene: Scene) -> tuple[Over, ...]:
    """All coordinates, each within one unit of the machine from rest: crank radius l, or l omega for velocities.

    The body starts on the ground. If a plate is nearer, the range of its mass ends at the deepest penetration that a
    blow can cause: none of a rigid plate. A dc motor's crank turns forwards; current and integral are those of the
    scene's own start.
    """
    reach = scene["crank.radius"]
    speed, sides = reach * crank_speed(scene), []
    for name in state_names(scene):
        side = name.split("_")[0]
        if name.endswith("velocity") and name != "body_vertical_velocity":
            sides.append(Over(name, -speed, speed))
        elif name == "motor_speed":
            sides.append(Over(name, 0.0, crank_speed(scene)))
        elif side in scene.guides:
            room = scene[f"{side}.gap"] + scene.deepest_penetration(side) if side in scene.plates else reach
            high = scene[f"crank.{side}_rod"] + min(reach, room)
            sides.append(Over(name, high - 2.0 * reach, high))
    return (*sides, Over(ANGLE, 0.0, TURN))


NO_START = "no such start: "
"""Prefix of the error of a start that is not possible, such as a mass beyond its rigid plate."""


def study_of(design: BasinDesign) -> Study:
    """The table of the motions that the starts lead to, with one row for each start."""
    fields = [
        *(Field(coordinate.name, pa.float64(), coordinate.unit, "of the start; others are as the scene starts")
          for coordinate in design.starts.over),
        Field("turns", pa.int64(), "1", "turns of the crank after which the settled motion repeats itself; 0 where it "
              "does not, null where nothing has settled", True),
        Field("after", pa.int64(), "1", "turns of the crank that the start was watched for"),
        Field("mean_speed", pa.float64(), "m/s", "mean speed of the settled body, forward positive; NaN where nothing "
              "has settled"),
        Field("states", NUMBERS, "1", "states of the settled motion at the cut, one after the other, in crank radii "
              "and crank radii times motor speed; of a dc motor see `vibro_lab.orbits.turn_map`"),
        Field("error", pa.string(), "1", "why the start leads nowhere; else null", True)]
    return Study("starts", design.document(), fields, partial(rows_of, design),
                 design.turns * TURN / crank_speed(design.scene), design.starts.count, _BLOCK_ROWS)


def rows_of(design: BasinDesign, number: int) -> list[dict]:
    """Let a start settle by its number, and return its row."""
    stroboscope, start = stroboscope_of(design), design.starts.start(number)
    motion, after, error = None, design.most_turns, None
    try:
        stroboscope.begin_as(**start)
        motion = settle(stroboscope, design.turns, design.most_turns)
    except ValueError as refused:
        after, error = 0, f"{NO_START}{refused}"
    except SimulationError as failed:
        after, error = 0, str(failed)
    return [{
        **start, "turns": motion.turns if motion else None, "after": motion.after if motion else after,
        "mean_speed": motion.mean_speed if motion else math.nan,
        "states": motion.kept_states().ravel() if motion else [], "error": error}]


def stroboscope_of(design: BasinDesign) -> Stroboscope:
    """Return the stroboscope of a design. The last one is cached, because making it takes as long as a start."""
    return _stroboscope(design.scene.name, tuple(design.scene.parameters.items()), design.phase)


@lru_cache(maxsize=1)
def _stroboscope(name: str, parameters: tuple[tuple[str, Value], ...], phase: float) -> Stroboscope:
    return Stroboscope(TurnMap(Scene(name, dict(parameters)), phase))


UNSETTLED, IMPOSSIBLE, OTHER = 0, -1, -2
"""Numbers of starts without an attractor: the motion had not settled; the start is not possible, or its run failed; the
motion is not among the first `MOST_ATTRACTORS`."""


@dataclass(frozen=True)
class Basins:
    """The attractors of all starts, and the attractor of each start."""

    attractors: Attractors  # the settled motions, that of most starts first
    # Shape (starts,): number of each start's attractor, counted from 1; or `UNSETTLED`, `IMPOSSIBLE`, `OTHER`.
    numbers: np.ndarray


def basins_in(design: BasinDesign, table: pa.Table) -> Basins:
    """Group all rows by attractor, and compute multipliers and exponents.

    Rows are grouped in their order, so that the result does not depend on how they were computed.
    """
    turn_map, turns = stroboscope_of(design).turn_map, table["turns"].to_pylist()
    able = np.array([error is None for error in table["error"].to_pylist()])
    motions = [None if attractor is None else SettledMotion(
        attractor, np.array(states).reshape(-1, len(turn_map.names)), speed, after, tolerance_of(design.scene))
        for attractor, states, speed, after in zip(turns, *(
            table[name].to_pylist() for name in ("states", "mean_speed", "after")), strict=True)]
    of_able = [motion for motion, is_able in zip(motions, able, strict=True) if is_able]
    groups, places = group_starts(of_able, table["mean_speed"].to_numpy()[able].tolist())
    settled = Attractors(attractor for attractor in groups if attractor.turns is not None)
    numbers = np.full(len(turns), IMPOSSIBLE)
    numbers[able] = [place + 1 if place < len(settled) else UNSETTLED if motion is None else OTHER
                     for place, motion in zip(places.tolist(), of_able, strict=True)]
    with Progress("motions measured", "motion", len(settled)) as progress:
        exact = []
        for attractor in settled:
            exact.append(with_exponents(attractor, turn_map))
            progress.add(1)
    return Basins(Attractors(exact), numbers)


def starts_table(table: pa.Table, basins: Basins) -> bytes:
    """Return a Parquet file of all starts with the numbers of their attractors."""
    meaning = ("number of the motion that the start leads to; 0: nothing had settled; -1: it cannot start, or not go "
               "on; -2: another motion than the first ones")
    field = pa.field("attractor", pa.int64(), metadata={"unit": "1", "meaning": meaning})
    table = table.drop_columns(["states"])
    return file_of(table.add_column(table.num_columns - 4, field, pa.array(basins.numbers, pa.int64())))


def attractors_table(basins: Basins) -> bytes:
    """Return a Parquet file of all attractors."""
    fields = [
        Field("attractor", pa.int64(), "1", "number of the motion"),
        Field("turns", pa.int64(), "1", "turns after which it repeats itself, 0: it does not"),
        Field("mean_speed", pa.float64(), "m/s", "of the body, forward positive"),
        Field("starts", pa.int64(), "1", "starts that lead to it"),
        Field("fraction", pa.float64(), "1", "of the starts that can be"),
        Field("fraction_low", pa.float64(), "1", "lower end of its 95 % interval"),
        Field("fraction_high", pa.float64(), "1", "upper end of its 95 % interval"),
        Field("lyapunov_exponent", pa.float64(), "1/s", "the largest one"),
        Field("lyapunov_spread", pa.float64(), "1/s", "half the width of its 95 % interval"),
        Field("multipliers_real", NUMBERS, "1", "real parts of its Floquet multipliers, the largest first"),
        Field("multipliers_imaginary", NUMBERS, "1", "imaginary parts of its Floquet multipliers, the largest first"),
        Field("states", NUMBERS, "1", "at successive cuts, one after the other, in crank radii and crank radii times "
              "motor speed")]
    return file_of(table_of([
        {"attractor": number, "turns": attractor.turns, "mean_speed": attractor.mean_speed, "starts": attractor.starts,
         "fraction": attractor.share, "fraction_low": attractor.low, "fraction_high": attractor.high,
         "lyapunov_exponent": attractor.exponent, "lyapunov_spread": attractor.exponent_spread,
         "multipliers_real": attractor.multipliers.real, "multipliers_imaginary": attractor.multipliers.imag,
         "states": attractor.states.ravel()} for number, attractor in enumerate(basins.attractors, 1)], fields))


_SHOWN = 12  # largest number of motions that are printed


def in_words(design: BasinDesign, table: pa.Table, basins: Basins) -> list[str]:
    """Return the results as lines of text."""
    over = ", ".join(f"{coordinate.name} {coordinate.low:g} to {coordinate.high:g} {coordinate.unit}"
                     for coordinate in design.starts.over)
    watched = float(np.mean(table["after"].to_numpy()))
    lines = [f"{design.starts.count} starts over {over}; watched for {watched:.1f} turns on average, cut at "
             f"{design.phase:.4f} rad"]
    for number, attractor in enumerate(basins.attractors[:_SHOWN], 1):
        if not attractor.turns:
            stability = f"largest Lyapunov exponent {attractor.exponent:.3g} ± {attractor.exponent_spread:.2g} 1/s" + (
                "" if sign_of(attractor.exponent, attractor.exponent_spread) else ", its sign not known")
        elif len(attractor.multipliers):
            stability = f"largest Floquet multiplier {abs(attractor.multipliers[0]):.4f}"
        else:
            stability = ("no multipliers, because the controller takes samples"
                         if has_sampled_controller(design.scene) else "no orbit closes by Newton's method")
        lines.append(f"motion {number}: {attractor.in_words()}; {attractor.starts} "
                     f"start{'s' * (attractor.starts > 1)}, {100.0 * attractor.share:.2f} % (95 % interval "
                     f"{100.0 * attractor.low:.2f} to {100.0 * attractor.high:.2f} %); {stability}")
    if len(basins.attractors) > _SHOWN:
        lines.append(f"{len(basins.attractors) - _SHOWN} more motions; without losses every start has one of its own")
    for number, what in ((UNSETTLED, f"starts had not settled within {design.most_turns} turns"),
                         (OTHER, f"starts have other motions than the first {MOST_ATTRACTORS}"),
                         (IMPOSSIBLE, "starts cannot be, or could not go on")):
        if count := int(np.sum(basins.numbers == number)):
            reason = next(text for text in table["error"].to_pylist() if text) if number == IMPOSSIBLE else ""
            lines.append(f"{count} {what}{f', such as: {reason}' if reason else ''}")
    return lines


_GREY, _WHITE = "#a0a0a0", "#ffffff"  # for `UNSETTLED` and `OTHER`, and for `IMPOSSIBLE`


@figures.default_settings()
def draw_basins(design: BasinDesign, basins: Basins) -> bytes:
    """Draw the motions that the starts lead to; returns a PNG file."""
    figure, over = figures.new_figure(9.0, 5.0), design.starts.over
    if design.starts.is_grid:
        _draw_map(figure.subplots(), over, basins.numbers)
    else:
        _draw_shares(figure.subplots(), basins)
    figures.set_heading(figure, f"{design.scene.name} at {command_in_words(design.scene)}: where "
                        f"{design.starts.count} starts lead")
    figure.legend(handles=_legend(basins), loc="outside lower center", fontsize=8, frameon=False, ncols=2)
    return figures.png(figure)


def _colour(number: int) -> str:
    if number > 0:
        return figures.PALETTE[min(number, len(figures.PALETTE)) - 1]
    return _WHITE if number == IMPOSSIBLE else _GREY


def _draw_map(axes: figures.Axes, over: tuple[Over, ...], numbers: np.ndarray) -> None:
    first, second = over
    kinds = np.unique(numbers)
    places = np.searchsorted(kinds, numbers).reshape(first.count, second.count)
    figures.draw_classes(axes, second.values, first.values, places, [_colour(int(number)) for number in kinds])
    axes.set(xlabel=f"{second.name} [{second.unit}]", ylabel=f"{first.name} [{first.unit}]")


def _draw_shares(axes: figures.Axes, basins: Basins) -> None:
    shown = basins.attractors[:len(figures.PALETTE)]
    places = np.arange(1, len(shown) + 1)
    share, low, high = 100.0 * np.array([(motion.share, motion.low, motion.high) for motion in shown]).reshape(-1, 3).T
    axes.bar(places, share, yerr=[share - low, high - share], capsize=4, color=figures.PALETTE[:len(shown)])
    axes.set(xlabel="motion", ylabel="share of the starts, with 95 % interval [%]", xticks=places)
    figures.style_axes(axes)


def _legend(basins: Basins) -> list[figures.Patch]:
    shown = [figures.Patch(color=_colour(number), label=f"{number}: {attractor.in_words()}, "
                           f"{100.0 * attractor.share:.3g} % of the starts")
             for number, attractor in enumerate(basins.attractors[:len(figures.PALETTE)], 1)]
    if np.isin(basins.numbers, (UNSETTLED, OTHER)).any():
        shown.append(figures.Patch(color=_GREY, label="not settled, or another motion"))
    if np.any(basins.numbers == IMPOSSIBLE):
        shown.append(figures.Patch(facecolor=_WHITE, edgecolor="black", label="cannot start"))
    return shown


def _results(design: BasinDesign, folder: Path, execution: Execution) -> Iterator[Results]:
    table = computed(study_of(design), folder / FOLDER, execution)
    errors = [text for text in table["error"].to_pylist() if text]
    if len(errors) == design.starts.count:
        raise ValueError(f"none of {len(errors)} starts can be simulated; the first one: {errors[0]}")
    basins = basins_in(design, table)
    yield Results({STARTS: starts_table(table, basins), ATTRACTORS: attractors_table(basins),
                   PICTURE: draw_basins(design, basins)}, in_words(design, table, basins),
                  any(not text.startswith(NO_START) for text in errors))


def _design(options: argparse.Namespace) -> BasinDesign:
    scene = running(machine_of(options))
    count = options.starts if options.starts is not None else QUICK_STARTS if options.quick else STARTS_DRAWN
    starts = chosen_starts(scene, tuple(over_in_words(scene, text) for text in options.over), count,
                           whole_number("--seed", options.seed, 0, 2**63 - 1))
    if starts.is_grid and options.starts is not None:
        raise ValueError("--starts: a grid draws no starts; leave it out, or the counts of --over")
    phase = Stroboscope(free_cut(scene)).turn_map.phase  # after the options: it simulates; refuses a scene at rest
    return BasinDesign(scene, phase, starts, options.turns, options.most_turns)


def _add_options(parser: Parser) -> None:
    parser.add_argument("--over", action="append", default=[], metavar="NAME=LOW:HIGH[:COUNT]", help="a coordinate of "
                        "the start, SI units: with counts two of them, a grid; without counts, from which starts are "
                        "drawn (default: all, within a crank radius l of rest, and l times motor speed)")
    parser.add_argument("--starts", type=int, metavar="N", help=f"drawn starts (default: {STARTS_DRAWN})")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the draws (default: %(default)s)")
    parser.add_argument("--turns", type=int, default=TURNS, metavar="N", help="turns of the crank after which a start "
                        "is looked at first; then after twice as many, and so on (default: %(default)s)")
    parser.add_argument("--most-turns", type=int, default=MOST_TURNS, metavar="N", help="turns after which a start is "
                        "given up (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_STARTS} starts unless you say otherwise")


main = StudyCommand(
    "basins", "Let a machine begin from many states, tell the motions apart that it settles to, and say how many "
    "starts lead to each, and how mixed they are. Writes Parquet files and a picture.", _add_options, _design, _results,
    failure="a start could not go on, or the disk is full")
