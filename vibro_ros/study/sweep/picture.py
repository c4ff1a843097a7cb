"""The picture of a sweep: each measure over what varies, with 95 % intervals over the starts.

One number that varies gives lines, one for each combination of the other parameters; two that vary on a grid, and
nothing else, give maps; where numbers are sampled, or more of them vary, every number has a column of dots.
"""

import io
import itertools
from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from vibro_ros.accuracy.diagram import tidy
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.study.measures import MEASURES
from vibro_ros.study.sweep.summary import Summary

#: Most lines of a panel; further combinations are left to the table.
MOST_LINES = 6
# Okabe and Ito's colours, which the colour-blind can tell apart, and markers for everybody else who cannot.
_STYLES = (("#0072b2", "o"), ("#d55e00", "^"), ("#009e73", "s"), ("#cc79a7", "v"), ("#000000", "D"), ("#e69f00", "x"))
_WIDTH, _HEIGHT = 5.2, 3.6  # in, of a panel


def draw_sweep(found: Summary) -> bytes:
    """Draw every measure of a sweep, a row a measure; returns a PNG file."""
    numbers = [name for name in found.design.names if isinstance(BY_NAME[name].default, float)]
    on_grid = not found.design.ranges
    is_map = on_grid and len(numbers) == 2 and len(found.design.names) == 2
    columns = [tuple(numbers)] if is_map else [(name,) for name in numbers] or [(found.design.names[0],)]
    measures = found.design.measures
    figure = Figure(figsize=(_WIDTH * len(columns), _HEIGHT * len(measures)), dpi=100, layout="constrained",
                    facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(measures), len(columns), squeeze=False)
    for row, measure in zip(axes, measures, strict=True):
        for axis, over in zip(row, columns, strict=True):
            if is_map:
                _draw_map(figure, axis, found, measure, over)
            elif on_grid and len(columns) == 1:
                _draw_lines(axis, found, measure, over[0], measure == measures[0])
            else:
                _draw_dots(axis, found, measure, over[0])
    starts = f"{found.design.starts} starts, 95 % intervals" if found.design.starts > 1 else "one start"
    figure.suptitle(f"{found.design.scene.name}: {starts}, {found.design.duration:g} s after "
                    f"{found.design.settling:g} s", fontsize=11)
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    return picture.getvalue()


def _draw_lines(axes: Axes, found: Summary, measure: str, over: str, legend: bool) -> None:
    for (label, chosen), (colour, marker) in zip(_combinations(found, over), itertools.cycle(_STYLES), strict=False):
        places = [found.parameters[over][point] for point in chosen]
        spread = np.nan_to_num(found.spread[measure][chosen])
        axes.errorbar(places, found.mean[measure][chosen], yerr=spread, color=colour, marker=marker, ms=4, lw=1.2,
                      capsize=2, label=label)
    if legend and len(found.design.names) > 1:
        axes.legend(fontsize=8, frameon=False)
    _label(axes, over, measure)


def _combinations(found: Summary, over: str) -> Iterator[tuple[str, np.ndarray]]:
    """Label and points of each combination of all parameters but one, at most `MOST_LINES`."""
    others = [name for name in found.design.names if name != over]
    keys = list(zip(*(found.parameters[name] for name in others), strict=True)) or [()] * found.design.points
    for key in list(dict.fromkeys(keys))[:MOST_LINES]:
        label = ", ".join(f"{name} = {_short(value)}" for name, value in zip(others, key, strict=True))
        yield label, np.array([point for point, own in enumerate(keys) if own == key])


def _draw_dots(axes: Axes, found: Summary, measure: str, over: str) -> None:
    axes.plot(found.parameters[over], found.mean[measure], ".", color=_STYLES[0][0], ms=4, alpha=0.6)
    _label(axes, over, measure)


def _draw_map(figure: Figure, axes: Axes, found: Summary, measure: str, over: tuple[str, ...]) -> None:
    first, second = found.design.axes
    values = found.mean[measure].reshape(len(first.values), len(second.values))
    order = np.ix_(np.argsort(first.values), np.argsort(second.values))
    mesh = axes.pcolormesh(np.sort(second.values), np.sort(first.values), values[order], shading="nearest",
                           cmap="viridis")
    figure.colorbar(mesh, ax=axes, label=_with_unit(measure, MEASURES[measure].unit))
    axes.set(xlabel=_with_unit(second.name, BY_NAME[second.name].unit),
             ylabel=_with_unit(first.name, BY_NAME[first.name].unit))


def _label(axes: Axes, over: str, measure: str) -> None:
    axes.set(xlabel=_with_unit(over, BY_NAME[over].unit), ylabel=_with_unit(measure, MEASURES[measure].unit))
    tidy(axes)


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit not in ("", "1") else name


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
