"""What a study of orbits has found: its branches and special points, in words and as a picture."""

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from vibro_ros.accuracy.figures import new_figure, png, tidy, with_unit
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.branch import Branch
from vibro_ros.orbits.continuation import CORNER, DOUBLING, FOLD, GRAZING, TORUS
from vibro_ros.study.orbits.run import Plan, Task

#: By kind of special point, the letter that begins its name in picture and table.
LETTERS = {FOLD: "F", DOUBLING: "P", TORUS: "N", GRAZING: "G", CORNER: "C"}


def names_of(branches: Sequence[Branch]) -> list[list[str]]:
    """A name for each special point of each branch: the letter of its kind and a number, counted over all branches."""
    counts, found = dict.fromkeys(LETTERS, 0), []
    for branch in branches:
        own = []
        for special in branch.special_points:
            counts[special.kind] += 1
            own.append(f"{LETTERS[special.kind]}{counts[special.kind]}")
        found.append(own)
    return found


def document(plan: Plan, done: Sequence[tuple[Task, Branch]]) -> str:
    """The tables as a page."""
    unit = BY_NAME[plan.name].unit
    branches = [branch for _, branch in done]
    head = with_unit(plan.name, unit)
    lines = [
        f"# Orbits of {plan.scene.name} over {plan.name}", "",
        f"{plan.name} from {plan.low:g} to {plan.high:g} {unit}".rstrip(" 1") + f"; orbits of at most {plan.turns} "
        f"turns of the crank; looked for at {', '.join(f'{value:g}' for value in plan.begin)}, from {plan.starts} "
        "starts each.", "",
        "![Branches](orbits.png)", "", "## Branches", "",
        f"| branch | turns | begins | orbits | {head} | stable for | mean speed, mm/s | ends |",
        "|---|---|---|---|---|---|---|---|"]
    lines += [_row(number, task, branch) for number, (task, branch) in enumerate(done)]
    lines += ["", "## Special points", "",
              f"| name | kind | branch | turns | {head} | known to | mean speed, mm/s | multipliers | what happens |",
              "|---|---|---|---|---|---|---|---|---|"]
    for number, (branch, names) in enumerate(zip(branches, names_of(branches), strict=True)):
        lines += [
            f"| {name} | {one.kind} | {number} | {branch.turns} | {one.value:.10g} | {one.width:.1g} | "
            f"{1e3 * one.mean_speed:.4f} | {_multipliers(one.multipliers)} | {one.change} |"
            for name, one in zip(names, branch.special_points, strict=True)]
    return "\n".join(lines) + "\n"


def in_words(done: Sequence[tuple[Task, Branch]]) -> Iterator[str]:
    """One line a branch."""
    branches = [branch for _, branch in done]
    for number, ((task, branch), names) in enumerate(zip(done, names_of(branches), strict=True)):
        special = ", ".join(f"{name} {one.kind} at {one.value:.9g}" for name, one in
                            zip(names, branch.special_points, strict=True) if one.kind != CORNER)
        yield (f"branch {number}, {branch.turns} turn{'s' * (branch.turns > 1)}: {len(branch)} orbits {_begin(task)}; "
               f"{special + '; ' if special else ''}{branch.end}")


def stable_ranges(branch: Branch) -> list[tuple[float, float]]:
    """Ranges of the parameter [its unit] over which neighbours on the branch are stable, in its order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], branch.stable.astype(int), [0]]))).reshape(-1, 2)
    return [(float(branch.values[first:last].min()), float(branch.values[first:last].max())) for first, last in edges]


def _begin(task: Task) -> str:
    if task.parent is not None:
        return f"from a period doubling of branch {task.parent} at {task.value:.6g}"
    return f"{task.way} from {task.value:g}"


def _row(number: int, task: Task, branch: Branch) -> str:
    if not len(branch):
        return f"| {number} | {branch.turns} | {_begin(task)} | 0 | | | | {branch.end} |"
    stable = ", ".join(f"{low:.6g} to {high:.6g}" for low, high in stable_ranges(branch))
    speeds = 1e3 * branch.mean_speeds
    return (f"| {number} | {branch.turns} | {_begin(task)} | {len(branch)} | {branch.values.min():.6g} to "
            f"{branch.values.max():.6g} | {stable} | {speeds.min():.2f} to {speeds.max():.2f} | {branch.end} |")


def _multipliers(values: np.ndarray) -> str:
    """The two largest, a pair as one."""
    shown = []
    for value in values[:2]:
        if value.imag == 0.0:
            shown.append(f"{value.real:.6f}")
        elif value.imag > 0.0:
            shown.append(f"{value.real:.6f} ± {value.imag:.6f}i")
    return ", ".join(shown)


# Okabe and Ito's colours, which the colour-blind can tell apart, by the turns of a branch; the last one for all others.
_COLOURS = {1: "#000000", 2: "#0072b2", 3: "#d55e00", 4: "#009e73", 8: "#cc79a7", 0: "#e69f00"}
MARKS = {FOLD: ("s", 5.0), DOUBLING: ("o", 5.0), TORUS: ("D", 5.0), GRAZING: ("^", 5.5), CORNER: (".", 3.5)}
_MOST_NAMES = 24  # places whose names are written into the picture
_CELLS = 50.0  # of a panel along each axis: names of one cell stand together


def draw_orbits(plan: Plan, branches: Sequence[Branch]) -> bytes:
    """Draw all branches; returns a PNG file."""
    figure = new_figure(9.0, 8.4)
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
    lower.set(xlabel=with_unit(plan.name, unit), ylabel=f"{(coordinate or '').replace('_', ' ')} at crank angle 0 [mm]")
    for axes in (upper, lower):
        tidy(axes)
    figure.legend(handles=_legend(branches), loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    figure.suptitle(f"{plan.scene.name}: periodic orbits over {plan.name}, unstable ones dashed", fontsize=11)
    return png(figure)


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
        mark, size = MARKS[one.kind]
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
                    for kind, (mark, size) in MARKS.items() if kind in kinds]
