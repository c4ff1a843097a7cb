"""The curves of a study of orbits in words and as a picture."""

from collections.abc import Iterator, Sequence

from matplotlib.lines import Line2D

from vibro_ros.accuracy.figures import new_figure, png, tidy, with_unit
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.branch import Branch
from vibro_ros.orbits.continuation import DOUBLING, FOLD, GRAZING
from vibro_ros.orbits.curve import has_curve
from vibro_ros.study.orbits.curves import CurvePlan, CurveTask
from vibro_ros.study.orbits.result import MARKS, names_of
from vibro_ros.study.orbits.run import Task

_COLOURS = {FOLD: "#d55e00", DOUBLING: "#0072b2", GRAZING: "#000000"}
_CELLS = 50.0  # of the first parameter's range: names of one cell stand together
_STYLES = {FOLD: "-", DOUBLING: "--", GRAZING: ":"}


def curve_document(asked: CurvePlan, found: Sequence[tuple[CurveTask, Branch]]) -> str:
    """The tables as the last part of a page."""
    heads = [with_unit(name, BY_NAME[name].unit) for name in asked.ranges]
    lines = ["", f"## Curves over {' and '.join(asked.ranges)}", "", "![Curves](curves.png)", "",
             f"| through | kind | turns | {asked.name} | orbits | {heads[0]} | {heads[1]} | ends |",
             "|---|---|---|---|---|---|---|---|"]
    for task, curve in found:
        ranges = [f"{column.min():.6g} to {column.max():.6g}" for column in curve.values.T] if len(curve) else ["", ""]
        lines.append(f"| {task.name} | {task.special.kind} | {task.branch.turns} | {task.way} | {len(curve)} | "
                     f"{' | '.join(ranges)} | {curve.end} |")
    lines += ["", f"| on the curve through | point | {heads[0]} | {heads[1]} | what happens |", "|---|---|---|---|---|"]
    lines += [f"| {task.name} | {one.kind} | {one.values[0]:.9g} | {one.values[1]:.9g} | {one.change} |"
              for task, curve in found for one in curve.special_points]
    return "\n".join(lines) + "\n"


def curves_in_words(found: Sequence[tuple[CurveTask, Branch]]) -> Iterator[str]:
    """One line a curve and direction."""
    for task, curve in found:
        yield f"{task.special.kind} curve through {task.name}, {task.way}: {len(curve)} orbits; {curve.end}"


def draw_curves(asked: CurvePlan, done: Sequence[tuple[Task, Branch]],
                found: Sequence[tuple[CurveTask, Branch]]) -> bytes:
    """Draw all curves, and the special points of the branches that they begin with; returns a PNG file."""
    figure = new_figure(8.0, 5.4)
    axes = figure.subplots()
    for _, curve in found:
        if len(curve):
            axes.plot(*curve.values.T, _STYLES[curve.kind], color=_COLOURS[curve.kind], lw=1.4)
    branches, base = [branch for _, branch in done], asked.plan.scene[asked.name]
    cells: dict[int, list[tuple[float, str]]] = {}
    for branch, names in zip(branches, names_of(branches), strict=True):
        for name, special in zip(names, branch.special_points, strict=True):
            if has_curve(special):
                mark, size = MARKS[special.kind]
                axes.plot(special.value, base, mark, ms=size, color=_COLOURS[special.kind], mfc="white", zorder=4)
                near = round(_CELLS * (special.value - asked.plan.low) / (asked.plan.high - asked.plan.low))
                cells.setdefault(near, []).append((special.value, name))
    for named in cells.values():  # what lies together shares a label
        axes.annotate(", ".join(name for _, name in named), (named[0][0], base), xytext=(5, -9),
                      textcoords="offset points", fontsize=7)
    kinds = [kind for kind in _COLOURS if any(curve.kind == kind for _, curve in found)]
    axes.set_xlim(asked.plan.low, asked.plan.high)
    margin = 0.02 * (asked.high - asked.low)
    axes.set_ylim(asked.low - margin, asked.high + margin)
    axes.set(**{f"{axis}label": with_unit(name, BY_NAME[name].unit)
                for axis, name in zip("xy", asked.ranges, strict=True)})
    tidy(axes)
    if kinds:
        axes.legend(handles=[Line2D([], [], ls=_STYLES[kind], color=_COLOURS[kind], marker=MARKS[kind][0],
                                    ms=MARKS[kind][1], mfc="white", label=kind) for kind in kinds], frameon=False)
    figure.suptitle(f"{asked.plan.scene.name}: special points over {' and '.join(asked.ranges)}", fontsize=11)
    return png(figure)
