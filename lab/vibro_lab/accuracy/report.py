"""Words and diagrams made of rows: which program meets a requirement, at what cost, and what mean speeds are.

Costs are in seconds of wall time for each simulated second, without set-up, in every text and diagram.
"""

import math
from collections.abc import Mapping, Sequence
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from vibro_lab.accuracy.harness import AVERAGE, OK, REFERENCE, REQUIRED, TRAJECTORY, Row
from vibro_lab.accuracy.scene_rows import LONG, SHORT, lyapunov_time_in
from vibro_lab.orbits.starts import SETTLING
from vibro_lab.study import figures

WITHIN = 0.05  # largest relative error of a mean speed that counts as right


class Requirement(NamedTuple):
    """An accuracy requirement: its text, its horizon [s], the column of a row with the error, and the error's limit."""

    words: str
    horizon: float
    column: str
    limit: float


REQUIREMENTS = (Requirement(f"every position to 1 mm for {SHORT:g} s", SHORT, "position_error", 1e-3),
                Requirement(f"every position to 1 µm for {SHORT:g} s", SHORT, "position_error", 1e-6),
                Requirement(f"every contact to 1 µs for {SHORT:g} s", SHORT, "event_error", 1e-6),
                Requirement(f"every position to 1 mm for {LONG:g} s", LONG, "position_error", 1e-3),
                Requirement(f"every position to 1 µm for {LONG:g} s", LONG, "position_error", 1e-6))
MEAN_SPEED = "the mean speed"


def two_digits(value: float) -> str:
    """Text of a number with two digits, without an exponent down to 0.0001."""
    return f"{float(f'{value:.2g}'):g}" if math.isfinite(value) else "-"


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.2g} {unit}" if not math.isnan(value) else "-"


def cheapest(rows: Sequence[Row], requirement: Requirement) -> dict[str, Row]:
    """Return the coarsest row of each program that meets a requirement, the cheapest first; set-up counts.

    A setting counts only if all finer settings that were measured meet the requirement, too, which excludes luck.
    """
    references = [row for row in rows if row.compared == REFERENCE and row.horizon == requirement.horizon]
    able_rows = dict[str, Row]()
    if references and not getattr(references[-1], requirement.column) >= requirement.limit:  # NaN: nothing to compare
        measured = [row for row in rows if (row.compared, row.horizon) == (REQUIRED, requirement.horizon)]
        for name in dict.fromkeys(row.program for row in measured):
            ladder = sorted((row for row in measured if row.program == name), key=lambda row: row.value)
            if able := list(takewhile(lambda row: getattr(row, requirement.column) < requirement.limit, ladder)):
                able_rows[name] = able[-1]
    return dict(sorted(able_rows.items(), key=lambda item: item[1].wall_time))


def use_in_words(row: Row) -> str:
    """Return program, setting, cost and set-up of a row."""
    setting = "" if row.program == "exact" else f" {row.setting}"
    return f"{row.program}{setting} ({two_digits(row.cost)}; set-up {two_digits(row.set_up)} s)"


def advice(rows: Sequence[Row]) -> dict[str, str]:
    """Return for each requirement the programs that meet it in a scene, the cheapest first, or why none does."""
    comparable = lyapunov_time_in(rows).comparable
    return {requirement.words: _advice(rows, requirement, comparable) for requirement in REQUIREMENTS} | {
        MEAN_SPEED: _mean_speed_advice(rows)}


def _advice(rows: Sequence[Row], requirement: Requirement, comparable: float) -> str:
    if requirement.horizon > comparable:
        return "not possible: chaos"
    measured = [row for row in rows if row.compared == REQUIRED and row.horizon == requirement.horizon]
    if not measured:
        return "not measured"
    measured_by_device = [row for row in measured if row.outcome == OK and row.program in ("exact", "rk4_located")]
    if measured_by_device and all(math.isnan(getattr(row, requirement.column)) for row in measured_by_device):
        return "nothing touches"
    return "; ".join(map(use_in_words, cheapest(rows, requirement).values())) or "nothing that was measured"


def averages_of(rows: Sequence[Row], program: str) -> list[Row]:
    """Return the rows of the mean speeds by a program, without those of steps at which it diverges."""
    return [row for row in rows if row.compared == AVERAGE and row.program == program and math.isfinite(row.mean)]


def is_one_speed(row: Row) -> bool:
    """Whether nine of ten starts of a row have the same mean speed within `WITHIN`."""
    return row.motions == 1 and row.high - row.low <= WITHIN * abs(row.mean)


def _mean_speed_advice(rows: Sequence[Row]) -> str:
    exact = averages_of(rows, "exact")
    if not exact:
        return "not measured"
    if exact[0].motions > 1:
        return f"not one: {exact[0].motions} motions"
    if not is_one_speed(exact[0]):
        return f"not one: starts keep speeds from {1e3 * exact[0].low:.1f} to {1e3 * exact[0].high:.1f} mm/s"
    return f"exact, 1 start of {exact[0].horizon:g} s after {SETTLING:g} s"


def speed_in_words(row: Row) -> str:
    """Return the mean speed of a row's starts, with the range of nine of ten of them where it shows."""
    drift = f", {row.note}" if row.note else ""
    spread = "" if row.high - row.low < 1e-5 else f" ({1e3 * row.low:.1f} to {1e3 * row.high:.1f})"
    return f"{1e3 * row.mean:.1f}{spread} mm/s{drift}"


def speeds_by_exact(rows: Sequence[Row]) -> str:
    """Return the mean speeds by `exact`; of several motions each, with its number of starts."""
    exact = averages_of(rows, "exact")
    starts = sum(row.repeats for row in exact)
    return "; ".join(speed_in_words(row) + f" from {row.repeats} of {starts} starts" * (len(exact) > 1)
                     for row in exact)


def finding(rows: Sequence[Row], method: str = "rk4") -> str:
    """Return sentences on the steps with which a method sends the body the wrong way, or gives its speed within 5 %."""
    exact, ladder = averages_of(rows, "exact"), averages_of(rows, method)
    if not exact or not ladder:
        return f"Not enough was measured to judge {method}'s mean speed."
    if exact[0].motions > 1:
        return f"There are several mean speeds ({speeds_by_exact(rows)}): no method can be judged by one."
    truth = exact[0]
    wrong = [row for row in ladder if goes_wrong_way(row, truth)]
    right = [row for row in ladder if abs(row.mean - truth.mean) <= WITHIN * abs(truth.mean)]
    failed = [f"{row.value:g} s" for row in rows if row.compared == AVERAGE and row.program == method
              and not math.isfinite(row.mean)]
    sentences = [f"By `exact` {speed_in_words(truth)}, of {truth.repeats} starts."]
    if failed:
        sentences.append(f"`{method}` diverges at {', '.join(failed)}.")
    sentences += [f"With a step of {row.value:g} s, `{method}` sends "
                  f"{row.starts_forwards if row.mean > 0.0 else row.repeats - row.starts_forwards} of {row.repeats} "
                  f"starts the WRONG way, at {speed_in_words(row)}." for row in wrong]
    if right:
        steps = ", ".join(f"{row.value:g} s" for row in right)
        sentences.append(f"It gives the mean speed within {WITHIN:.0%} at {steps}.")
    else:
        sentences.append(f"At none of {len(ladder)} steps that were tried it gives the mean speed within {WITHIN:.0%}.")
    return " ".join(sentences)


def goes_wrong_way(row: Row, exact: Row) -> bool:
    """Whether nine of ten starts of a row go one way, and nine of ten by `exact` the other."""
    return row.low * row.high > 0.0 and exact.low * exact.high > 0.0 and row.mean * exact.mean < 0.0


def reference_in_words(row: Row) -> str:
    """Return a sentence on the reference and its uncertainty."""
    if math.isnan(row.body_error):
        return f"Reference: exact; no independent program could check it ({row.note})."
    return (f"Reference: exact; it agrees with {row.program}, {row.setting}, within {row.horizon:g} s to "
            f"{_with_unit(row.path_error, 'm')} (body), {_with_unit(row.mass_error, 'm')} (masses), "
            f"{_with_unit(row.event_error, 's')} (contacts), {_with_unit(row.speed_error, 'm/s')} (mean speed): the "
            "reference's uncertainty.")


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
