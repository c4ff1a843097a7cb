"""What a map says, in words and as pictures."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from vibro_ros.accuracy.figures import new_figure, png
from vibro_ros.configuration.command_choice import CommandChoice, has_choice
from vibro_ros.configuration.command_map import PATCHWORK, Axis, CommandMap
from vibro_ros.study.map.motions import STARTS, Trial
from vibro_ros.study.map.visits import UNSETTLED, Visit

SHOWN = 22
"""Rows of the table of trials, about."""


def map_in_words(command_map: CommandMap, visits: list[Visit]) -> list[str]:
    """How many motions there are, where, and how fast they go."""
    found = command_map.found
    cells, counts = np.unique(np.column_stack([found.speed_index, found.gap_index]), axis=0, return_counts=True)
    unsettled = sum(visit.turns == UNSETTLED for visit in visits)
    numbered = np.unique(found.motion[found.motion > PATCHWORK])
    periodic = float(np.mean(found.turns > 0))
    fastest, slowest = int(np.argmax(np.abs(found.mean_speed))), int(np.argmin(np.abs(found.mean_speed)))
    forwards = int(np.sum(found.mean_speed > 0.0))
    place = (f"{command_map.speeds.values[found.speed_index[fastest]]:g} rad/s, gap "
                  f"{command_map.gaps.values[found.gap_index[fastest]] * 1e3:g} mm")
    kinds = [curve.kind for curve in command_map.curves]
    curves = ", ".join(f"{kinds.count(kind)} of {kind}" for kind in dict.fromkeys(kinds))
    sure = "no sure commands for any mean speed"
    if has_choice(command_map):
        choice = CommandChoice(command_map)
        sure = (f"sure commands for {choice.covered:.0%} of the mean speeds from {choice.slowest * 1e3:.1f} to "
                f"{choice.fastest * 1e3:.1f} mm/s")
    return [
        f"{len(cells)} of {command_map.speeds.count * command_map.gaps.count} cells have a motion, "
        f"{np.sum(counts > 1)} have more than one; {unsettled} of {len(visits)} visits did not settle",
        f"{len(numbered)} motions of neighbouring cells; {periodic:.0%} of what was found repeats itself within 8 "
        "turns",
        f"mean speeds from {found.mean_speed[slowest] * 1e3:.1f} to {found.mean_speed[fastest] * 1e3:.1f} mm/s "
        f"({place}); {forwards} go forwards",
        f"curves: {curves or 'none'}",
        sure,
    ]


def trials_in_words(trials: list[Trial]) -> list[str]:
    """A table of mean speeds asked for, with the start that is farthest off, and the largest deviation of all."""
    if not trials:
        return []
    lines = ["asked [mm/s]  motor speed [rad/s]  gap [mm]  got [mm/s]  off [%]"]
    for trial in trials[::max(1, len(trials) // SHOWN)]:
        motor, gap = list(trial.choice.commands.values())[:2]
        lines.append(f"{trial.asked * 1e3:12.1f}  {motor:19.2f}  {gap * 1e3:8.2f}  {trial.got * 1e3:10.1f}  "
                     f"{trial.error * 100.0:7.1f}")
    worst = max(trials, key=lambda trial: trial.error)
    median = np.median([trial.error for trial in trials])
    return [*lines, f"{len(trials)} mean speeds from {STARTS} starts each: asked and got differ by {worst.error:.1%} "
            f"at most, and by {median:.1%} in the median"]


WIDTH, HEIGHT = 9.6, 8.4  # in
#: Colours of periods (Okabe and Ito's, which the colour-blind tell apart) and what they say.
_PERIODS = (("#dddddd", "none up to 8"), ("#0072b2", "1"), ("#56b4e9", "2"), ("#009e73", "3"),
            ("#f0e442", "4"), ("#e69f00", "5 to 8"))
_STYLES = {"fold": ("black", "-"), "period doubling": ("black", "--"), "Neimark-Sacker": ("black", ":"),
           "grazing": ("#d55e00", "-")}


def draw_map(command_map: CommandMap) -> bytes:
    """Mean speed, and period, over motor speed and gap: a PNG."""
    figure = new_figure(WIDTH, HEIGHT)
    upper, lower = figure.subplots(2, 1, sharex=True, sharey=True)
    _draw_quantity(figure, upper, command_map, command_map.found.mean_speed * 1e3, "mean speed [mm/s]", "viridis")
    _draw_periods(figure, lower, command_map)
    for axes in (upper, lower):
        _draw_curves(axes, command_map)
    found = command_map.found
    cells, counts = np.unique(np.column_stack([found.speed_index, found.gap_index]), axis=0, return_counts=True)
    several = cells[counts > 1]  # each gets a dot
    upper.plot(command_map.speeds.values[several[:, 0]], command_map.gaps.values[several[:, 1]] * 1e3, ".",
               color="white", markersize=2.5, markeredgewidth=0.0)
    handles = [Line2D([], [], color=colour, linestyle=style, label=kind) for kind, (colour, style) in _STYLES.items()
               if any(curve.kind == kind for curve in command_map.curves)]
    handles.append(Line2D([], [], color="white", markeredgecolor="grey", marker="o", markersize=5, linestyle="",
                          label="more than one motion"))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False)
    sides = "both plates" if len(command_map.sides) > 1 else f"the {command_map.sides[0]} plate"
    upper.set_title(f"{command_map.scene}: motions over motor speed and gap of {sides}")
    lower.set_xlabel("motor speed [rad/s]")
    return png(figure)


def draw_costs(command_map: CommandMap) -> bytes:
    """Cost of transport, and shares of standing and flight, over motor speed and gap: a PNG."""
    figure, found = new_figure(WIDTH, 1.3 * HEIGHT), command_map.found
    rows = figure.subplots(3, 1, sharex=True)
    _draw_quantity(figure, rows[0], command_map, np.log10(found.cost_of_transport), "cost of transport [log10]",
                   "viridis_r")
    _draw_quantity(figure, rows[1], command_map, found.stick_share * 100.0, "standing on the ground [% of time]",
                   "cividis")
    _draw_quantity(figure, rows[2], command_map, found.air_share * 100.0, "in the air [% of time]", "cividis")
    rows[0].set_title(f"{command_map.scene}: what the motions cost, and how they go; where two exist, the faster one")
    rows[2].set_xlabel("motor speed [rad/s]")
    return png(figure)


def _fastest(command_map: CommandMap, values: np.ndarray) -> np.ndarray:
    """Of each cell the value of its fastest motion, whichever way it goes."""
    order = np.argsort(np.abs(command_map.found.mean_speed), kind="stable")
    cells = np.full((command_map.gaps.count, command_map.speeds.count), np.nan)
    cells[command_map.found.gap_index[order], command_map.found.speed_index[order]] = values[order]
    return cells


def _edges(axis: Axis, factor: float = 1.0) -> np.ndarray:
    return factor * np.linspace(axis.low - axis.step / 2.0, axis.high + axis.step / 2.0, axis.count + 1)


def _draw_quantity(figure: Figure, axes: Axes, command_map: CommandMap, values: np.ndarray, name: str,
                   colours: str) -> None:
    mesh = axes.pcolormesh(_edges(command_map.speeds), _edges(command_map.gaps, 1e3), _fastest(command_map, values),
                           cmap=colours, rasterized=True)
    figure.colorbar(mesh, ax=axes, label=name, pad=0.01)
    axes.set_ylabel("gap [mm]")
    axes.set_facecolor("white")


def _draw_periods(figure: Figure, axes: Axes, command_map: CommandMap) -> None:
    turns = command_map.found.turns
    classes = _fastest(command_map, np.where(turns > 4, 5, turns).astype(float))
    colours = ListedColormap([colour for colour, _ in _PERIODS])
    mesh = axes.pcolormesh(_edges(command_map.speeds), _edges(command_map.gaps, 1e3), classes, cmap=colours,
                           norm=BoundaryNorm(np.arange(-0.5, len(_PERIODS)), len(_PERIODS)), rasterized=True)
    axes.set_ylabel("gap [mm]")
    bar = figure.colorbar(mesh, ax=axes, pad=0.01, ticks=range(len(_PERIODS)), label="period [turns]")
    bar.ax.set_yticklabels([words for _, words in _PERIODS])


def _draw_curves(axes: Axes, command_map: CommandMap) -> None:
    for curve in command_map.curves:
        colour, style = _STYLES[curve.kind]
        axes.plot(curve.motor_speed, np.array(curve.gap) * 1e3, color=colour, linestyle=style, linewidth=1.1)
    axes.set_xlim(*_edges(command_map.speeds)[[0, -1]])
    axes.set_ylim(*_edges(command_map.gaps, 1e3)[[0, -1]])
