"""The result of a study of basins: tables, sentences and a picture."""

import math

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from vibro_ros.accuracy.figures import new_figure, png, tidy
from vibro_ros.orbits.attractors import Attractor
from vibro_ros.orbits.chaos import sign_of
from vibro_ros.orbits.recurrence import LONGEST_PERIOD, command_in_words
from vibro_ros.orbits.turn_map import is_sampled
from vibro_ros.study.basins.attractors import (
    MOST_MOTIONS,
    NOWHERE,
    UNSETTLED,
    UNTOLD,
    BasinEntropy,
    Found,
)
from vibro_ros.study.basins.starts import Design, Over, Plane
from vibro_ros.study.table import NUMBERS, Field, file_of, table_of


def starts_table(table: pa.Table, found: Found) -> bytes:
    """All starts with the numbers of their attractors, as a Parquet file."""
    meaning = ("number of the motion that the start leads to; 0: nothing had settled; -1: it cannot start, or not go "
               "on; -2: another motion than the first ones")
    field = pa.field("attractor", pa.int64(), metadata={"unit": "1", "meaning": meaning})
    table = table.drop_columns(["states"])
    return file_of(table.add_column(table.num_columns - 4, field, pa.array(found.numbers, pa.int64())))


def attractors_table(found: Found) -> bytes:
    """All attractors, as a Parquet file."""
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
        {"attractor": number, "turns": one.turns, "mean_speed": one.mean_speed, "starts": one.starts,
         "fraction": one.share, "fraction_low": one.low, "fraction_high": one.high,
         "lyapunov_exponent": one.exponent, "lyapunov_spread": one.exponent_spread,
         "multipliers_real": one.multipliers.real,
         "multipliers_imaginary": one.multipliers.imag, "states": one.states.ravel()}
        for number, one in enumerate(found.attractors, 1)], fields))


_SHOWN = 12  # motions


def in_words(design: Design, table: pa.Table, found: Found, entropy: BasinEntropy | None) -> list[str]:
    """What was found, a line each."""
    over = ", ".join(f"{one.name} {one.low:g} to {one.high:g} {one.unit}" for one in design.starts.over)
    watched = float(np.mean(table["after"].to_numpy()))
    lines = [f"{design.starts.count} starts over {over}; watched for {watched:.1f} turns on average, cut at "
             f"{design.phase:.4f} rad"]
    for number, attractor in enumerate(found.attractors[:_SHOWN], 1):
        if not attractor.turns:
            stability = f"largest Lyapunov exponent {attractor.exponent:.3g} ± {attractor.exponent_spread:.2g} 1/s" + (
                "" if sign_of(attractor.exponent, attractor.exponent_spread) else ", its sign not known")
        elif len(attractor.multipliers):
            stability = f"largest Floquet multiplier {abs(attractor.multipliers[0]):.4f}"
        else:
            stability = ("no multipliers, because the controller takes samples" if is_sampled(design.scene) else
                         "no orbit closes by Newton's method")
        lines.append(f"motion {number}: {_motion_in_words(attractor)}; {attractor.starts} "
                     f"start{'s' * (attractor.starts > 1)}, {100.0 * attractor.share:.2f} % (95 % interval "
                     f"{100.0 * attractor.low:.2f} to {100.0 * attractor.high:.2f} %); {stability}")
    if len(found.attractors) > _SHOWN:
        lines.append(f"{len(found.attractors) - _SHOWN} more motions; without losses every start has one of its own")
    if entropy:
        says = "above log 2 = 0.693, which hints at a fractal boundary" if entropy.boundary > math.log(2.0) else (
            "not above log 2 = 0.693, which leaves open whether the boundary is fractal")
        lines.append(f"basin entropy {entropy.entropy:.4f}, of the {entropy.mixed} of {entropy.boxes} boxes with more "
                     f"than one motion {entropy.boundary:.4f}, {says}" if entropy.mixed else
                     f"basin entropy 0: each of {entropy.boxes} boxes has one motion")
    for number, what in ((UNSETTLED, f"starts had not settled within {design.most_turns} turns"),
                         (UNTOLD, f"starts have other motions than the first {MOST_MOTIONS}"),
                         (NOWHERE, "starts cannot be, or could not go on")):
        if count := int(np.sum(found.numbers == number)):
            reason = next(text for text in table["error"].to_pylist() if text) if number == NOWHERE else ""
            lines.append(f"{count} {what}{f', such as: {reason}' if reason else ''}")
    return lines


def _motion_in_words(attractor: Attractor) -> str:
    turns = attractor.turns
    again = f"again after {turns} turn{'s' * (turns > 1)}" if turns else f"not again within {LONGEST_PERIOD} turns"
    return f"{attractor.mean_speed * 1e3:.4g} mm/s, {again}"


# Okabe and Ito's colours, which the colour-blind can tell apart; further motions share the last one.
_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#000000")
_UNSETTLED, _NOWHERE = "#a0a0a0", "#ffffff"


def draw_basins(design: Design, table: pa.Table, found: Found) -> bytes:
    """Draw where the starts lead; returns a PNG file."""
    figure = new_figure(9.0, 5.0)
    over = design.starts.over
    if isinstance(design.starts, Plane):
        axes = figure.subplots()
        _draw_map(axes, over, found.numbers)
    elif len(over) > 1:
        shares, axes = figure.subplots(1, 2)
        _draw_shares(shares, found)
        _draw_dots(axes, table, over, found.numbers)
    else:
        axes = figure.subplots()
        _draw_shares(axes, found)
    figure.suptitle(f"{design.scene.name} at {command_in_words(design.scene)}: where {design.starts.count} starts lead",
                    fontsize=11)
    figure.legend(handles=_legend(found), loc="outside lower center", fontsize=8, frameon=False, ncols=2)
    return png(figure)


def _colour(number: int) -> str:
    if number > 0:
        return _COLOURS[min(number, len(_COLOURS)) - 1]
    return _NOWHERE if number == NOWHERE else _UNSETTLED


def _draw_map(axes: Axes, over: tuple[Over, ...], numbers: np.ndarray) -> None:
    first, second = over
    kinds = np.unique(numbers)
    colours = ListedColormap([_colour(int(number)) for number in kinds])
    places = np.searchsorted(kinds, numbers).reshape(first.count, second.count)
    axes.pcolormesh(second.values, first.values, places, shading="nearest", cmap=colours,
                    norm=BoundaryNorm(np.arange(len(kinds) + 1) - 0.5, len(kinds)), rasterized=True)
    axes.set(xlabel=f"{second.name} [{second.unit}]", ylabel=f"{first.name} [{first.unit}]")


def _draw_dots(axes: Axes, table: pa.Table, over: tuple[Over, ...], numbers: np.ndarray) -> None:
    first, second = over[:2]
    # The motions with fewer starts lie on top.
    for number in sorted(set(numbers.tolist()) - {NOWHERE}):
        chosen = numbers == number
        axes.plot(table[second.name].to_numpy()[chosen], table[first.name].to_numpy()[chosen], ".", ms=3.0,
                  color=_colour(number), alpha=0.8)
    axes.set(xlabel=f"{second.name} [{second.unit}]", ylabel=f"{first.name} [{first.unit}]")
    tidy(axes)


def _draw_shares(axes: Axes, found: Found) -> None:
    shown = found.attractors[:len(_COLOURS)]
    places = np.arange(1, len(shown) + 1)
    spread = [[100.0 * (one.share - one.low) for one in shown], [100.0 * (one.high - one.share) for one in shown]]
    axes.bar(places, [100.0 * one.share for one in shown], yerr=spread, capsize=4,
             color=_COLOURS[:len(shown)])
    axes.set(xlabel="motion", ylabel="share of the starts, with 95 % interval [%]", xticks=places)
    tidy(axes)


def _legend(found: Found) -> list[Patch]:
    shown = [Patch(color=_colour(number), label=f"{number}: {_motion_in_words(one)}, "
                   f"{100.0 * one.share:.3g} % of the starts")
             for number, one in enumerate(found.attractors[:len(_COLOURS)], 1)]
    if np.any((found.numbers < 1) & (found.numbers != NOWHERE)):
        shown.append(Patch(color=_UNSETTLED, label="not settled, or another motion"))
    if np.any(found.numbers == NOWHERE):
        shown.append(Patch(facecolor=_NOWHERE, edgecolor="black", label="cannot start"))
    return shown
