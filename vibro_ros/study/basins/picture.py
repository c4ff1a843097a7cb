"""The picture of a study of basins: a map of the starts, or dots and the shares of the motions."""

import io

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from vibro_ros.accuracy.diagram import tidy
from vibro_ros.study.basins.attractors import NOWHERE, Found
from vibro_ros.study.basins.design import Design
from vibro_ros.study.basins.starts import Over, Plane
from vibro_ros.study.basins.words import motion_in_words

# Okabe and Ito's colours, which the colour-blind can tell apart; further motions share the last one.
_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#000000")
_UNSETTLED, _NOWHERE = "#a0a0a0", "#ffffff"


def draw_basins(design: Design, table: pa.Table, found: Found) -> bytes:
    """Draw where the starts lead; returns a PNG file."""
    figure = Figure(figsize=(9.0, 5.0), dpi=110, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
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
    figure.suptitle(f"{design.scene.name} at {design.scene['motor.speed']:g} rad/s: where {design.starts.count} starts "
                    "lead", fontsize=11)
    figure.legend(handles=_legend(found), loc="outside lower center", fontsize=8, frameon=False, ncols=2)
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    return picture.getvalue()


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
    places, shares = np.arange(1, len(shown) + 1), [one.fraction for one in shown]
    spread = [[100.0 * (one.share - one.low) for one in shares], [100.0 * (one.high - one.share) for one in shares]]
    axes.bar(places, [100.0 * one.share for one in shares], yerr=spread, capsize=4,
             color=_COLOURS[:len(shown)])
    axes.set(xlabel="motion", ylabel="share of the starts, with 95 % interval [%]", xticks=places)
    tidy(axes)


def _legend(found: Found) -> list[Patch]:
    shown = [Patch(color=_colour(number), label=f"{number}: {motion_in_words(one)}, "
                   f"{100.0 * one.fraction.share:.3g} % of the starts")
             for number, one in enumerate(found.attractors[:len(_COLOURS)], 1)]
    if np.any((found.numbers < 1) & (found.numbers != NOWHERE)):
        shown.append(Patch(color=_UNSETTLED, label="not settled, or not told apart"))
    if np.any(found.numbers == NOWHERE):
        shown.append(Patch(facecolor=_NOWHERE, edgecolor="black", label="cannot start"))
    return shown
