"""Diagrams of error over cost, and of mean speeds beyond the horizon of a trajectory."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from vibro_lab.accuracy.harness import AVERAGE, REFERENCE, TRAJECTORY, Row
from vibro_lab.accuracy.report import WITHIN, averages_of
from vibro_lab.study import figures

# Colours, and markers for readers who cannot distinguish them.
_STYLES = {"exact": (figures.BLACK, "*"), "rk4": (figures.BLUE, "o"), "rk4_located": ("#882255", "P"),
           "rk4_by_hand": ("#777777", "X"), "heyoka": (figures.SKY, "D"), "scipy": (figures.PURPLE, "v"),
           "cvode": (figures.ORANGE, "<"), "diffrax": (figures.GREEN, "s"), "drake": (figures.VERMILION, "^"),
           "mujoco": ("#8c564b", "h"), "siconos": ("#5b2c83", ">")}
_OTHER_STYLE, _BAND_COLOUR, _NEAR_COLOUR = ("#999999", "."), "#dddddd", "#f6e58d"
# m or s, more than the robot's length or the horizon: a method with a larger error has diverged, and is not shown.
_LARGEST_ERROR = 1.0
_PANELS = (("body_error", "error of the body's position [m]"), ("mass_error", "error of the masses' positions [m]"),
           ("event_error", "error of the contacts' instants [s]"))
COST_AXIS = "cost [s for each simulated second, without set-up]"


def style(name: str) -> dict[str, object]:
    """Colour and marker of a program in every diagram."""
    colour, marker = _STYLES.get(name, _OTHER_STYLE)
    return {"color": colour, "marker": marker, "ms": 14 if marker == "*" else 5}


@figures.default_settings()
def draw_scene(rows: Sequence[Row], caption: str) -> figures.Figure:
    """Draw three panels of errors of trajectories in one scene, and one of mean speeds."""
    figure = figures.new_figure(13.0, 9.3, 100)
    axes = figure.subplots(2, 2)
    reference = next((row for row in rows if row.compared == REFERENCE), None)
    trajectories = [row for row in rows if row.compared == TRAJECTORY]
    for axis, (column, label) in zip(axes.flat, _PANELS, strict=False):
        draw_errors(axis, trajectories, column, getattr(reference, column) if reference else math.nan)
        horizon = f"within {trajectories[0].horizon:g} s" if trajectories else "not measured"
        axis.set_title(f"trajectories, {horizon}", fontsize=10, loc="left")
        axis.set_ylabel(label)
    _draw_speeds(axes[1, 1], rows)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    figures.set_heading(figure, f"{rows[0].problem}: accuracy and its cost\n{caption}")
    return figure


def draw_errors(axes: figures.Axes, rows: Sequence[Row], column: str, floor: float) -> None:
    """Draw error over cost of each program; errors below `floor`, the reference's own, are drawn at it."""
    touched = [row for row in rows if math.isfinite(getattr(row, column))]
    for name in dict.fromkeys(row.program for row in touched):
        points = [(row.cost, max(getattr(row, column), floor) if math.isfinite(floor) else getattr(row, column))
                  for row in touched if row.program == name and getattr(row, column) <= _LARGEST_ERROR]
        if points:
            axes.plot(*zip(*points, strict=True), label=name, lw=1.2, **style(name))
    axes.set(xscale="log", yscale="log", xlabel=COST_AXIS)
    if not touched:
        axes.text(0.5, 0.5, "nothing touches", transform=axes.transAxes, ha="center")
    elif floor > 0.0:
        axes.axhspan(floor / 10.0, floor, color=_BAND_COLOUR, lw=0)
        axes.text(0.99, 0.02, "below the reference's own error", transform=axes.transAxes, fontsize=8, ha="right")
    figures.style_axes(axes)


def _draw_speeds(axes: figures.Axes, rows: Sequence[Row]) -> None:
    """Draw mean speeds over the step, with the exact mean speed and the range of nine of ten starts as a band."""
    exact = averages_of(rows, "exact")
    for row in exact:
        axes.axhline(row.mean, color="black", lw=1.2)
        axes.axhspan(row.low, row.high, color="#999999", alpha=0.5, lw=0)
    for name in dict.fromkeys(row.program for row in rows if row.compared == AVERAGE and row.program != "exact"):
        ladder = averages_of(rows, name)
        joined: Mapping[str, object] = {} if all(row.motions == 1 for row in ladder) else {"linestyle": "none"}
        means = np.array([row.mean for row in ladder])
        ranges = np.abs([[row.low for row in ladder], [row.high for row in ladder]] - means)
        axes.errorbar([row.value for row in ladder], means, yerr=ranges, capsize=3, **{**style(name), **joined})
    if exact:
        near = WITHIN * abs(exact[0].mean)
        axes.axhspan(exact[0].mean - near, exact[0].mean + near, color=_NEAR_COLOUR, lw=0, zorder=0)
        axes.axhline(0.0, color="#777777", lw=0.8, ls=":")
        reach = max(3.0 * abs(exact[0].mean), 2.0 * (exact[0].high - exact[0].low), 1e-3)
        axes.set_ylim(-reach, reach)
        axes.set_title(f"averages over {exact[0].horizon:g} s of drawn starts, nine of ten within the bars\n"
                       "black: exact; coloured band: ± 5 %", fontsize=10, loc="left")
    axes.set(xscale="log", xlabel="step [s]", ylabel="mean speed [m/s]")
    figures.style_axes(axes)
