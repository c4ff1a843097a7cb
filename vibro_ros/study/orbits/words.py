"""What a study of orbits found, in words: its branches, and their special points."""

from collections.abc import Iterator, Sequence

import numpy as np

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.branch import Branch
from vibro_ros.orbits.special_points import CORNER, DOUBLING, FOLD, GRAZING, TORUS
from vibro_ros.study.orbits.plan import Plan, Task

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
    head = f"{plan.name} [{unit}]" if unit not in ("", "1") else plan.name
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
