"""``study basins``: the motion that each of many starts leads to, and the share of the starts of each motion."""

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from vibro_lab.orbits.attractors import MOST_ATTRACTORS, Attractor, Attractors, group_starts, with_exponents
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
)
from vibro_lab.study import figures
from vibro_lab.study.command import Progress, Results, StudyCommand, machine_of
from vibro_lab.study.execution import Execution
from vibro_lab.study.table import NUMBERS, Field, Study, computed, file_of, table_of
from vibro_lab.study.variation import limits_in_words
from vibro_ros import STATE_UNITS, Parser, Scene, SimulationError

FOLDER, STARTS, ATTRACTORS, PICTURE = "blocks", "starts.parquet", "attractors.parquet", "basins.png"
TURNS, MOST_TURNS = 64, 4096
MOST_STARTS = 1_000_000
"""Largest number of starts of a study."""
_FEWEST_TURNS, _MOST_TURNS_LIMIT = 8, 1_000_000  # limits of --turns and --most-turns
_LARGEST = 1e6  # SI units, of a coordinate of a start
_BLOCK_ROWS = 1024  # starts of a block, some seconds of work: the most that an interruption loses
_COUNT, _QUICK_COUNT = 60, 17  # values of each coordinate of the default grid
_ANGLE = "crank_angle"


@dataclass(frozen=True)
class StartCoordinate:
    """A coordinate of the start that varies, in equal steps from `low` to `high`, both of them included."""

    name: str  # name of an argument of `Simulator.set_state`
    low: float  # its range, in its SI unit
    high: float
    count: int  # number of values

    @property
    def unit(self) -> str:
        """SI unit of the coordinate."""
        return STATE_UNITS[self.name]

    @cached_property
    def values(self) -> np.ndarray:
        """All values, shape (count,)."""
        return np.linspace(self.low, self.high, self.count)


@dataclass(frozen=True)
class BasinDesign:
    """A checked design of a study of basins: a grid of starts over two coordinates, of which the second changes faster.
    """

    scene: Scene  # scene that is started
    phase: float  # crank angle at the cut [rad]
    over: tuple[StartCoordinate, StartCoordinate]
    turns: int  # turns of the crank after which a start is judged for the first time
    most_turns: int  # turns after which a start counts as not settled

    def __post_init__(self) -> None:
        if not _FEWEST_TURNS <= self.turns <= self.most_turns <= _MOST_TURNS_LIMIT:
            raise ValueError(f"--turns {self.turns} and --most-turns {self.most_turns}: give numbers from "
                             f"{_FEWEST_TURNS} to {_MOST_TURNS_LIMIT}, the smaller one first")

    @property
    def count(self) -> int:
        """Number of starts."""
        return self.over[0].count * self.over[1].count

    def start(self, number: int) -> dict[str, float]:
        """Arguments of `Simulator.set_state` for a start by its number."""
        indices = divmod(number, self.over[1].count)
        return {coordinate.name: float(coordinate.values[index])
                for coordinate, index in zip(self.over, indices, strict=True)}

    def document(self) -> dict:
        """Everything that determines the results, for JSON."""
        return {"scene": self.scene.name, "set": dict(self.scene.parameters), "phase": self.phase,
                "grid": [astuple(coordinate) for coordinate in self.over], "turns": self.turns,
                "most_turns": self.most_turns}


def coordinate_in_words(scene: Scene, text: str) -> StartCoordinate:
    """Parse a coordinate from ``NAME=LOW:HIGH:COUNT``."""
    name, _, values = text.partition("=")
    names = (*state_names(scene), _ANGLE)
    if name not in names:
        raise ValueError(f"--over {name or repr(name)}: is no coordinate of this scene's start; give one of "
                         f"{', '.join(names)}")
    low, high, count = limits_in_words(f"--over {name}", values)
    if not count:
        raise ValueError(f"--over {text}: give NAME=LOW:HIGH:COUNT; for random starts use vibro_lab.attractors")
    if max(abs(low), abs(high)) > _LARGEST:
        raise ValueError(f"--over {name}: {low:g} to {high:g} is out of range; give numbers up to {_LARGEST:g}")
    if name == "body_height" and low < 0.0:
        raise ValueError(f"--over {name}: {low:g} {STATE_UNITS[name]} is out of range; give at least 0")
    return StartCoordinate(name, low, high, count)


def grid_of(scene: Scene, words: Sequence[str], default_count: int) -> tuple[StartCoordinate, StartCoordinate]:
    """Return the two coordinates of the options `--over`; without any, the first velocity and the crank's angle.

    The default range of a velocity is one unit of the machine, crank radius times motor speed, either way.
    """
    if words:
        coordinates = [coordinate_in_words(scene, text) for text in words]
    else:
        reach = scene["crank.radius"] * crank_speed(scene)
        velocity = next((name for name in state_names(scene) if name.endswith("velocity")), "body_velocity")
        coordinates = [StartCoordinate(velocity, -reach, reach, default_count),
                StartCoordinate(_ANGLE, 0.0, TURN, default_count)]
    if len(coordinates) != 2 or coordinates[0].name == coordinates[1].name:
        names = ", ".join(coordinate.name for coordinate in coordinates)
        raise ValueError(f"--over: {names}; give two different coordinates")
    if (cells := coordinates[0].count * coordinates[1].count) > MOST_STARTS:
        raise ValueError(f"--over: {cells} starts are more than {MOST_STARTS}; give smaller counts")
    return coordinates[0], coordinates[1]


NO_START = "no such start: "
"""Prefix of the error of a start that is not possible, such as a mass beyond its rigid plate."""


def study_of(design: BasinDesign) -> Study:
    """The table of the motions that the starts lead to, with one row for each start."""
    fields = [
        *(Field(coordinate.name, pa.float64(), coordinate.unit, "of the start; others are as the scene starts")
          for coordinate in design.over),
        Field("turns", pa.int64(), "1", "turns of the crank after which the settled motion repeats itself; 0 where it "
              "does not, null where nothing has settled", True),
        Field("after", pa.int64(), "1", "turns of the crank that the start was watched for"),
        Field("mean_speed", pa.float64(), "m/s", "mean speed of the settled body, forward positive; NaN where nothing "
              "has settled"),
        Field("states", NUMBERS, "1", "states of the settled motion at the cut, one after the other, in crank radii "
              "and crank radii times motor speed; of a dc motor see `vibro_lab.orbits.turn_map`"),
        Field("error", pa.string(), "1", "why the start leads nowhere; else null", True)]
    return Study("starts", design.document(), fields, partial(rows_of, design),
                 design.turns * TURN / crank_speed(design.scene), design.count, _BLOCK_ROWS)


def rows_of(design: BasinDesign, number: int) -> list[dict]:
    """Let a start settle by its number, and return its row."""
    stroboscope, start = _stroboscope(design.scene, design.phase), design.start(number)
    row: dict[str, Any] = {**start, "turns": None, "after": 0, "mean_speed": math.nan, "states": [], "error": None}
    try:
        stroboscope.begin_as(**start)
        motion = settle(stroboscope, design.turns, design.most_turns)
    except ValueError as error:
        return [{**row, "error": f"{NO_START}{error}"}]
    except SimulationError as error:
        return [{**row, "error": str(error)}]
    if motion is None:
        return [{**row, "after": design.most_turns}]
    return [{**row, "turns": motion.turns, "after": motion.after, "mean_speed": motion.mean_speed,
             "states": motion.kept_states().ravel()}]


@lru_cache(maxsize=1)
def _stroboscope(scene: Scene, phase: float) -> Stroboscope:
    """Return a stroboscope; the last one is cached, because making it takes as long as a start."""
    return Stroboscope(TurnMap(scene, phase))


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
    turn_map = TurnMap(design.scene, design.phase)
    rows = [row for row in table.to_pylist() if row["error"] is None]
    motions = [None if row["turns"] is None else SettledMotion(
        row["turns"], np.array(row["states"]).reshape(-1, len(turn_map.names)), row["mean_speed"], row["after"],
        tolerance_of(design.scene)) for row in rows]
    groups, places = group_starts(motions, [row["mean_speed"] for row in rows])
    settled = [attractor for attractor in groups if attractor.turns is not None]
    numbers = np.full(table.num_rows, IMPOSSIBLE)
    numbers[table["error"].is_null().to_numpy()] = [
        place + 1 if place < len(settled) else UNSETTLED if motion is None else OTHER
        for place, motion in zip(places.tolist(), motions, strict=True)]
    measured = list[Attractor]()
    with Progress("motions measured", "motion", len(settled)) as progress:
        for attractor in settled:
            measured.append(with_exponents(attractor, turn_map))
            progress.add(1)
    return Basins(Attractors(measured), numbers)


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
    grid = ", ".join(f"{coordinate.name} {coordinate.low:g} to {coordinate.high:g} {coordinate.unit}"
                     for coordinate in design.over)
    watched = float(np.mean(table["after"].to_numpy()))
    lines = [f"{design.count} starts over {grid}; watched for {watched:.1f} turns on average, cut at "
             f"{design.phase:.4f} rad"]
    for number, attractor in enumerate(basins.attractors[:_SHOWN], 1):
        lines.append(f"motion {number}: {attractor.in_words()}; {attractor.starts} "
                     f"start{'s' * (attractor.starts > 1)}, {100.0 * attractor.share:.2f} % (95 % interval "
                     f"{100.0 * attractor.low:.2f} to {100.0 * attractor.high:.2f} %); "
                     f"{_stability_in_words(design.scene, attractor)}")
    if len(basins.attractors) > _SHOWN:
        lines.append(f"{len(basins.attractors) - _SHOWN} more motions; without losses every start has one of its own")
    for number, outcome in ((UNSETTLED, f"starts had not settled within {design.most_turns} turns"),
                            (OTHER, f"starts have other motions than the first {MOST_ATTRACTORS}"),
                            (IMPOSSIBLE, "starts cannot be, or could not go on")):
        if count := int(np.sum(basins.numbers == number)):
            reason = next(text for text in table["error"].to_pylist() if text) if number == IMPOSSIBLE else ""
            lines.append(f"{count} {outcome}{f', such as: {reason}' if reason else ''}")
    return lines


def _stability_in_words(scene: Scene, attractor: Attractor) -> str:
    """Largest exponent or multiplier of an attractor, or the reason why it has none."""
    if not attractor.turns:
        exponent = f"largest Lyapunov exponent {attractor.exponent:.3g} ± {attractor.exponent_spread:.2g} 1/s"
        return exponent + ", its sign not known" * (not sign_of(attractor.exponent, attractor.exponent_spread))
    if len(attractor.multipliers):
        return f"largest Floquet multiplier {abs(attractor.multipliers[0]):.4f}"
    return ("no multipliers, because the controller takes samples" if has_sampled_controller(scene) else
            "no orbit closes by Newton's method")


_GREY, _WHITE = "#a0a0a0", "#ffffff"  # for `UNSETTLED` and `OTHER`, and for `IMPOSSIBLE`


@figures.default_settings()
def draw_basins(design: BasinDesign, basins: Basins) -> bytes:
    """Draw the motion that each start of the grid leads to; returns a PNG file."""
    figure, (first, second) = figures.new_figure(9.0, 5.0), design.over
    axes, kinds = figure.subplots(), np.unique(basins.numbers)
    classes = np.searchsorted(kinds, basins.numbers).reshape(first.count, second.count)
    figures.draw_classes(axes, second.values, first.values, classes, [_colour(int(number)) for number in kinds])
    axes.set(xlabel=figures.with_unit(second.name, second.unit), ylabel=figures.with_unit(first.name, first.unit))
    figures.set_heading(figure, f"{design.scene.name} at {command_in_words(design.scene)}: where {design.count} "
                        "starts lead")
    figure.legend(handles=_legend(basins), loc="outside lower center", fontsize=8, frameon=False, ncols=2)
    return figures.png(figure)


def _colour(number: int) -> str:
    if number > 0:
        return figures.PALETTE[min(number, len(figures.PALETTE)) - 1]
    return _WHITE if number == IMPOSSIBLE else _GREY


def _legend(basins: Basins) -> list[figures.Patch]:
    patches = [figures.Patch(color=_colour(number), label=f"{number}: {attractor.in_words()}, "
                             f"{100.0 * attractor.share:.3g} % of the starts")
               for number, attractor in enumerate(basins.attractors[:len(figures.PALETTE)], 1)]
    if np.isin(basins.numbers, (UNSETTLED, OTHER)).any():
        patches.append(figures.Patch(color=_GREY, label="not settled, or another motion"))
    if np.any(basins.numbers == IMPOSSIBLE):
        patches.append(figures.Patch(facecolor=_WHITE, edgecolor="black", label="cannot start"))
    return patches


def _results(design: BasinDesign, folder: Path, execution: Execution) -> Iterator[Results]:
    table = computed(study_of(design), folder / FOLDER, execution)
    errors = [text for text in table["error"].to_pylist() if text]
    if len(errors) == design.count:
        raise ValueError(f"none of {len(errors)} starts can be simulated; the first one: {errors[0]}")
    basins = basins_in(design, table)
    yield Results({STARTS: starts_table(table, basins), ATTRACTORS: attractors_table(basins),
                   PICTURE: draw_basins(design, basins)}, in_words(design, table, basins),
                  any(not text.startswith(NO_START) for text in errors))


def _design(options: argparse.Namespace) -> BasinDesign:
    scene = running(machine_of(options))
    coordinates = grid_of(scene, options.over, _QUICK_COUNT if options.quick else _COUNT)
    phase = Stroboscope(free_cut(scene)).turn_map.phase  # after the options: it simulates; refuses a scene at rest
    return BasinDesign(scene, phase, coordinates, options.turns, options.most_turns)


def _add_options(parser: Parser) -> None:
    parser.add_argument("--over", action="append", default=[], metavar="NAME=LOW:HIGH:COUNT", help="a coordinate of "
                        "the start, SI units; two of them make a grid (default: the first velocity, up to crank radius "
                        f"times motor speed either way, and crank_angle, {_COUNT} values each)")
    parser.add_argument("--turns", type=int, default=TURNS, metavar="N", help="turns of the crank after which a start "
                        "is looked at first; then after twice as many, and so on (default: %(default)s)")
    parser.add_argument("--most-turns", type=int, default=MOST_TURNS, metavar="N", help="turns after which a start is "
                        "given up (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help=f"{_QUICK_COUNT} values of each coordinate without --over")


main = StudyCommand(
    "basins", "Let a machine begin from a grid of states, tell the motions apart that it settles to, and say how many "
    "starts lead to each. Writes Parquet files and a picture.", _add_options, _design, _results,
    failure="a start could not go on, or the disk is full")
