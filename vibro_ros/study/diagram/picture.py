"""A diagram as a picture: one coordinate at the cut, the mean speed, and what kind of motion it is."""

import io
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from vibro_ros.accuracy.diagram import tidy
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.study.diagram.design import DOWN, UP
from vibro_ros.study.diagram.result import Diagram

# Okabe and Ito's blue and vermilion, which the colour-blind can tell apart. Where both ways lead to one motion, the dot
# of the way down stands within the ring of the way up.
_COLOURS = {UP: "#0072b2", DOWN: "#d55e00"}
_MARKS: dict[str, dict[str, Any]] = {
    UP: {"marker": "o", "markerfacecolor": "none", "markeredgewidth": 0.8},
    DOWN: {"marker": ".", "markeredgewidth": 0.0}}
_SHADE = "#e4e4e4"
_FAINT = 0.3  # of the many states of a motion that does not repeat itself
_WIDTH, _STATES, _PANEL = 9.0, 3.8, 1.8  # in
_MOST, _LEAST, _CROWD = 5.0, 2.0, 450.0  # size of a ring [pt]: a share of the crowd, among so many values


def draw_diagram(found: Diagram) -> bytes:
    """Draw a diagram; returns a PNG file."""
    design = found.design
    panels = [_draw_states, _draw_speed]
    panels += [_draw_exponents] * bool(design.exponents) + [_draw_chaos] * bool(design.cuts)
    heights = [_STATES, *[_PANEL] * (len(panels) - 1)]
    figure = Figure(figsize=(_WIDTH, sum(heights)), dpi=100, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    rows = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    for axes, draw in zip(rows, panels, strict=True):
        draw(axes, found)
        _shade(axes, found)
        tidy(axes)
    unit = BY_NAME[design.axis.name].unit
    rows[-1].set_xlabel(f"{design.axis.name} [{unit}]" if unit else design.axis.name)
    figure.suptitle(f"{design.scene.name}: once a turn, at the crank angle {design.phase:.3f} rad; "
                    f"{len(design.axis.values)} values up and down", fontsize=11)
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    return picture.getvalue()


def _draw_states(axes: Axes, found: Diagram) -> None:
    design = found.design
    column, size = design.names.index(design.coordinate), _size(found)
    for direction in (UP, DOWN):
        for is_periodic, opacity in ((False, _FAINT), (True, 1.0)):
            visits = [one for one in found.of(direction) if bool(one.motion.turns) == is_periodic]
            places = [design.value(one.number) for one in visits for _ in one.states]
            states = [1e3 * value for one in visits for value in one.states[:, column]]
            share = 1.0 if is_periodic and direction == UP else 0.8
            axes.plot(places, states, linestyle="none", ms=share * size, alpha=opacity, color=_COLOURS[direction],
                      **_MARKS[direction if is_periodic else DOWN])
        axes.plot([], [], linestyle="none", ms=6, label=f"{direction}wards", color=_COLOURS[direction],
                  **_MARKS[direction])
    axes.set_ylabel(f"{design.coordinate.replace('_', ' ')} [m{UNITS[design.coordinate]}]")
    axes.legend(fontsize=9, frameon=False, ncols=2, loc="best")


def _size(found: Diagram) -> float:
    return min(_MOST, max(_LEAST, _CROWD / len(found.design.axis.values)))


def _draw_speed(axes: Axes, found: Diagram) -> None:
    for direction in (UP, DOWN):
        _draw_line(axes, found, direction, [1e3 * one.motion.mean_speed for one in found.of(direction)])
    axes.set_ylabel("mean speed [mm/s]")


def _draw_exponents(axes: Axes, found: Diagram) -> None:
    """The largest exponent, and the second one as a thin line."""
    for direction in (UP, DOWN):
        for column, share in (("exponent_1", 1.0), ("exponent_2", 0.4)):
            if found.natures is not None and column in found.natures.column_names:
                values = [found.nature(column, one.number) for one in found.of(direction)]
                _draw_line(axes, found, direction, [v if np.isfinite(v) else np.nan for v in values], share)
    axes.axhline(0.0, color="black", lw=0.8)
    axes.set_ylabel("two largest exponents\n[1/s]")


def _draw_chaos(axes: Axes, found: Diagram) -> None:
    for direction in (UP, DOWN):
        _draw_line(axes, found, direction, [found.nature("zero_one", one.number) for one in found.of(direction)])
    axes.set(ylabel="0-1 test, K\n[dimensionless]", ylim=(-0.2, 1.1))


def _draw_line(axes: Axes, found: Diagram, direction: str, values: list[float], share: float = 1.0) -> None:
    axes.plot(found.design.axis.values, values, ms=share * _size(found), lw=0.8 * share, alpha=0.4 + 0.6 * share,
              color=_COLOURS[direction], **_MARKS[direction])


def _shade(axes: Axes, found: Diagram) -> None:
    """Grey where both ways lead to two motions, from halfway to the values beside."""
    values = np.array(found.design.axis.values, dtype=float)
    middles = np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1]), values[-1:]])
    for region in found.hysteresis():
        axes.axvspan(middles[region.places[0]], middles[region.places[-1] + 1], color=_SHADE, zorder=0, lw=0.0)
