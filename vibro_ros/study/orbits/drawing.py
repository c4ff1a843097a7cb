"""The picture of branches of orbits: mean speed and one coordinate over the parameter, unstable parts dashed."""

import io
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from vibro_ros.accuracy.diagram import tidy
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.branch import Branch
from vibro_ros.orbits.special_points import CORNER, DOUBLING, FOLD, GRAZING, TORUS
from vibro_ros.study.orbits.plan import Plan
from vibro_ros.study.orbits.words import names_of

# Okabe and Ito's colours, which the colour-blind can tell apart, by the turns of a branch; the last one for all others.
_COLOURS = {1: "#000000", 2: "#0072b2", 3: "#d55e00", 4: "#009e73", 8: "#cc79a7", 0: "#e69f00"}
_MARKS = {FOLD: ("s", 5.0), DOUBLING: ("o", 5.0), TORUS: ("D", 5.0), GRAZING: ("^", 5.5), CORNER: (".", 3.5)}
_MOST_NAMES = 24  # places whose names are written into the picture
_CELLS = 50.0  # of a panel along each axis: names of one cell stand together


def draw_orbits(plan: Plan, branches: Sequence[Branch]) -> bytes:
    """Draw all branches; returns a PNG file."""
    figure = Figure(figsize=(9.0, 8.4), dpi=110, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1, sharex=True)
    coordinate = next((name for name in ("inclined_position", "upper_position")
                       if any(name in branch.strobe for branch in branches)), None)
    for branch in branches:
        _draw_line(upper, branch, 1e3 * branch.mean_speeds[:, None])
        if coordinate:
            _draw_line(lower, branch, 1e3 * branch.strobe[coordinate])
    lower.set_xlim(plan.low, plan.high)
    _draw_special(upper, branches)
    unit = BY_NAME[plan.name].unit
    upper.set(ylabel="mean speed [mm/s]")
    lower.set(xlabel=f"{plan.name} [{unit}]" if unit not in ("", "1") else plan.name,
              ylabel=f"{(coordinate or '').replace('_', ' ')} at crank angle 0 [mm]")
    for axes in (upper, lower):
        tidy(axes)
    figure.legend(handles=_legend(branches), loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    figure.suptitle(f"{plan.scene.name}: periodic orbits over {plan.name}, unstable ones dashed", fontsize=11)
    picture = io.BytesIO()
    figure.savefig(picture, format="png")
    return picture.getvalue()


def _draw_line(axes: Axes, branch: Branch, values: np.ndarray) -> None:
    """Stable parts solid, unstable ones dashed; neighbours of which one is unstable are joined by a dashed line."""
    colour = _COLOURS.get(branch.turns, _COLOURS[0])
    stable = branch.stable
    both = np.flatnonzero(stable[1:] & stable[:-1])
    either = np.flatnonzero(~(stable[1:] & stable[:-1]))
    for chosen, style in ((both, "-"), (either, (0, (3.0, 1.5)))):
        for run in np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1):
            if len(run):
                part = slice(run[0], run[-1] + 2)
                axes.plot(branch.values[part], values[part], color=colour, ls=style, lw=1.2)


def _draw_special(axes: Axes, branches: Sequence[Branch]) -> None:
    named = [(name, one, branch) for branch, names in zip(branches, names_of(branches), strict=True)
             for name, one in zip(names, branch.special_points, strict=True)]
    cells: dict[tuple[int, int], list[str]] = {}
    for _, one, branch in named:
        mark, size = _MARKS[one.kind]
        axes.plot(one.value, 1e3 * one.mean_speed, mark, ms=size, color=_COLOURS.get(branch.turns, _COLOURS[0]),
                  mfc="white" if one.kind != CORNER else None, zorder=3)
    # What lies together shares a label.
    for name, one, _ in named:
        if one.kind != CORNER:
            across, up = axes.transLimits.transform((one.value, 1e3 * one.mean_speed))
            cells.setdefault((round(_CELLS * across), round(_CELLS * up)), []).append(name)
    if len(cells) <= _MOST_NAMES:
        for (across, up), names in cells.items():
            axes.annotate(", ".join(names), (across / _CELLS, up / _CELLS), xycoords="axes fraction", xytext=(4, 4),
                          textcoords="offset points", fontsize=7)


def _legend(branches: Sequence[Branch]) -> list[Line2D]:
    turns = sorted({branch.turns for branch in branches if len(branch)})
    kinds = {one.kind for branch in branches for one in branch.special_points}
    lines = [Line2D([], [], color=_COLOURS.get(one, _COLOURS[0]), label=f"{one} turn{'s' * (one > 1)}")
             for one in turns]
    return lines + [Line2D([], [], color="#000000", ls="", marker=mark, ms=size, mfc="white", label=kind)
                    for kind, (mark, size) in _MARKS.items() if kind in kinds]
