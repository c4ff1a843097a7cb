"""The work–precision diagram of a scene: error over cost within the horizon, and mean speeds beyond it."""

import math
from collections.abc import Sequence

from vibro_lab.accuracy.harness import AVERAGE, RATE, REFERENCE, TRAJECTORY, Row
from vibro_lab.accuracy.report import WITHIN
from vibro_lab.study.figures import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    Axes,
    Figure,
    default_settings,
    new_figure,
    set_heading,
    style_axes,
)

# Colours, and markers for readers who cannot distinguish them.
_STYLES = {"exact": (BLACK, "*"), "rk4": (BLUE, "o"), "rk4_located": ("#882255", "P"),
           "rk4_by_hand": ("#777777", "X"), "heyoka": (SKY, "D"), "scipy": (PURPLE, "v"),
           "cvode": (ORANGE, "<"), "diffrax": (GREEN, "s"), "drake": (VERMILION, "^"),
           "mujoco": ("#8c564b", "h"), "siconos": ("#5b2c83", ">")}
_OTHER_STYLE = ("#999999", ".")
_BAND_COLOUR, _NEAR_COLOUR = "#dddddd", "#f6e58d"
# m or s, more than the robot's length or the horizon: a method with a larger error has diverged, and is not shown.
_LARGEST_ERROR = 1.0
_PANELS = (("body_error", "error of the body's position [m]"), ("mass_error", "error of the masses' positions [m]"),
           ("event_error", "error of the contacts' instants [s]"))
# Largest difference from the exact mean speed that is shown, in multiples of it, or of ten of its intervals if larger.
_LARGEST_DIFFERENCE = 2.0


@default_settings()
def draw_scene(rows: Sequence[Row], caption: str) -> Figure:
    """Draw the rows of one scene.

    Parameters
    ----------
    rows : sequence of Row
        Rows of one scene; missing rows are not drawn.
    caption : str
        Text under the title.

    Returns
    -------
    Figure
        Three panels of errors of trajectories, and one of mean speeds with 95 % intervals.
    """
    figure = new_figure(13.0, 9.3, 100)
    axes = figure.subplots(2, 2)
    for axis, (column, label) in zip(axes.flat, _PANELS, strict=False):
        _draw_errors(axis, rows, column, label)
    _draw_speeds(axes[1, 1], rows)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    set_heading(figure, f"{rows[0].problem}: accuracy and its cost\n{caption}")
    return figure


def _draw_errors(axes: Axes, rows: Sequence[Row], column: str, label: str) -> None:
    """Draw error over cost; errors below the reference's own are unknown, so their points are drawn at that error."""
    reference = next((row for row in rows if row.compared == REFERENCE), None)
    floor = getattr(reference, column) if reference else math.nan
    floor = floor if math.isfinite(floor) and floor > 0.0 else 1e-16
    trajectories = [row for row in rows if row.compared == TRAJECTORY and math.isfinite(row.cost)]
    for name in dict.fromkeys(row.program for row in trajectories):
        points = [(row.cost, max(getattr(row, column), floor)) for row in trajectories
                  if row.program == name and math.isfinite(getattr(row, column))]
        axes.loglog(*zip(*points, strict=True) if points else ([], []), lw=1.4, label=name,
                    **style(name))
    axes.set_ylim(floor / 10.0, _LARGEST_ERROR)
    if trajectories and all(math.isnan(getattr(row, column)) for row in trajectories):
        axes.text(0.5, 0.5, "nothing touches", transform=axes.transAxes, ha="center")
        axes.set(xticks=[], yticks=[])
        axes.minorticks_off()
    else:
        axes.axhspan(floor / 10.0, floor, color=_BAND_COLOUR, lw=0)
        axes.text(0.99, 0.02, "below the reference's own error", transform=axes.transAxes, fontsize=8, ha="right")
    axes.set_title(f"trajectories, within {trajectories[0].horizon:g} s" if trajectories else "no trajectories",
                   fontsize=10, loc="left")
    axes.set_xlabel(f"cost, the device's own rk4 at 1e-5 s = 1, sampled at {RATE:g} Hz")
    axes.set_ylabel(label)
    style_axes(axes)


def _draw_speeds(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw mean speeds over the step, with the exact mean speed and its 95 % interval as a band."""
    averages = [row for row in rows if row.compared == AVERAGE and math.isfinite(row.mean)]
    motions = [row for row in averages if row.program == "exact"]
    for one in motions:
        axes.axhline(one.mean, color="black", lw=1.2)
        axes.axhspan(one.mean - one.spread, one.mean + one.spread, color="#999999", alpha=0.5, lw=0)
    if motions:
        exact = motions[0]
        axes.axhline(0.0, color="#777777", lw=0.8, ls=":")
        reach = _LARGEST_DIFFERENCE * max(abs(exact.mean), 10.0 * exact.spread) or 1.0
        shown = [0.0, *(row.mean for row in averages if abs(row.mean - exact.mean) <= reach)]
        margin = 0.12 * (max(shown) - min(shown)) or 1.0
        axes.set_ylim(min(shown) - margin, max(shown) + margin)
        near = WITHIN * abs(exact.mean)
        axes.axhspan(exact.mean - near, exact.mean + near, color=_NEAR_COLOUR, lw=0, zorder=0)
    for name in dict.fromkeys(row.program for row in averages if row.program != "exact"):
        own = [row for row in averages if row.program == name]
        joined = {} if all(row.motions == 1 for row in own) else {"linestyle": "none"}
        axes.errorbar([row.value for row in own], [row.mean for row in own],
                      yerr=[row.spread for row in own], capsize=3, **style(name) | joined)
    axes.set_xscale("log")
    if averages:
        last = averages[-1]
        starts = sum(row.repeats for row in averages if (row.program, row.value) == (last.program, last.value))
        axes.set_title(f"averages, beyond the horizon: {starts} starts of {averages[-1].horizon:g} s\n"
                       "95 % intervals; black: exact, coloured band: ± 5 %", fontsize=10, loc="left")
    axes.set_xlabel("step [s]")
    axes.set_ylabel("mean speed [m/s]")
    style_axes(axes)


def style(name: str) -> dict[str, object]:
    """Colour and marker of a program in every diagram."""
    colour, marker = _STYLES.get(name, _OTHER_STYLE)
    return {"color": colour, "marker": marker, "ms": 14 if marker == "*" else 5}
