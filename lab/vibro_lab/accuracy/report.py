"""Report from rows: cost of a digit, programs that meet requirements, mean speeds, and tables in Markdown."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile

import numpy as np
from scipy.stats import t as student

from vibro_lab.accuracy.harness import AVERAGE, OK, REFERENCE, REQUIRED, TRAJECTORY, Row
from vibro_lab.accuracy.programs import UNIT_IN_WORDS, UNIT_STEP
from vibro_lab.accuracy.scene_rows import LONG, SHORT, lyapunov_time_in
from vibro_lab.orbits.chaos import half_interval
from vibro_lab.orbits.starts import SETTLING
from vibro_lab.study.page import markdown_table

#: Largest relative error of a mean speed that counts as right.
WITHIN = 0.05
#: The program whose cost headlines are relative to, where it was measured: Runge-Kutta 4 written for one scene only.
BY_HAND, BY_HAND_IN_WORDS = "rk4_by_hand", f"Runge-Kutta 4 of {UNIT_STEP:g} s written by hand (`rk4_by_hand`)"
BELOW = "below the reference's"
_HEADING = ("program", "setting", "cost, RK4 = 1", "wall time", "runs", "body", "height", "masses", "contacts",
            "mean speed", "")
# Limits of a fit: larger errors [m] are not small beside the robot's motion; errors below this multiple of the
# reference's own error are dominated by rounding; least number of points.
_LARGEST_ERROR, _ABOVE_REFERENCE, _LEAST_POINTS = 1e-2, 10.0, 3
_MOST_STARTS = 10_000  # largest number of starts that is recommended to a user


def section(rows: Sequence[Row], picture: str) -> str:
    """Return the section of a scene in Markdown: diagram, chaos, reference and mean speeds."""
    reference, growth = reference_of(rows), lyapunov_time_in(rows)
    chaos, name = str(growth), rows[0].problem
    horizon = f"Trajectories are compared within {reference.horizon:g} s only; beyond that, averages are compared."
    if reference.horizon > growth.comparable:
        horizon = (f"Trajectories are compared within {reference.horizon:g} s as asked for, BEYOND the "
                   f"{growth.comparable:.2g} s that chaos allows: the errors show it as much as the programs.")
    return "\n\n".join([f"## {name}", f"![{name}: error over cost, and mean speed over the step]({picture})",
                        f"{chaos[0].upper()}{chaos[1:]}. {horizon}", reference_in_words(reference), speeds_table(rows)])


def reference_of(rows: Sequence[Row]) -> Row:
    """Return the row with the uncertainty of the reference within the diagram's horizon."""
    return next(row for row in rows if row.compared == REFERENCE)


def reference_in_words(row: Row) -> str:
    """Return a sentence on the reference and its uncertainty."""
    if math.isnan(row.body_error):
        return f"Reference: exact; no independent program could check it ({row.note})."
    return (f"Reference: exact; it agrees with {row.program}, {row.setting}, within {row.horizon:g} s to "
            f"{_number(row.path_error, 'm')} (body), {_number(row.mass_error, 'm')} (masses), "
            f"{_number(row.event_error, 's')} "
            f"(contacts), {_number(row.speed_error, 'm/s')} (mean speed): the reference's uncertainty.")


def table(rows: Sequence[Row]) -> str:
    """Return the table of a scene's trajectories in Markdown."""
    reference = reference_of(rows)
    least = _errors(reference)
    lines = [f"Trajectories, compared within {reference.horizon:g} s; errors are the largest within it.", ""]
    cells = list[tuple[object, ...]]()
    for row in rows:
        if row.compared == TRAJECTORY:
            errors = [BELOW if value <= known else "one kind missed" if math.isinf(value) else _number(value, unit)
                      for value, known, unit in zip(_errors(row), least, ("m", "m", "m", "s", "m/s"), strict=True)]
            cells.append((row.program, row.setting, _number(row.cost), _number(row.wall_time, "s"), row.repeats,
                          *errors, row.note))
    return "\n".join([*lines, markdown_table(_HEADING, cells), "", unit_in_words({reference.problem: rows})])


def _errors(row: Row) -> tuple[float, ...]:
    return row.body_error, row.height_error, row.mass_error, row.event_error, row.speed_error


def unit_in_words(rows: Mapping[str, Sequence[Row]]) -> str:
    """Return a sentence on the unit of cost, `RK4 = 1`, and its own error."""
    text = f"RK4 = 1 is the cost of {UNIT_IN_WORDS}"
    off = {name: error for name, own in rows.items() if math.isfinite(error := unit_error(own))}
    if not off:
        return f"{text}."
    worst, least = max(off, key=off.__getitem__), min(off, key=off.__getitem__)
    if worst == least:
        return f"{text}, which is itself off by {off[worst]:.1e} m within {SHORT:g} s."
    return (f"{text}, which is itself off by {off[least]:.1e} m (`{least}`) to {off[worst]:.1e} m (`{worst}`) within "
            f"{SHORT:g} s.")


def unit_error(rows: Sequence[Row]) -> float:
    """Largest position error [m] of the run that is the unit of cost; NaN if it was not measured."""
    return next((row.position_error for row in rows if (row.program, row.compared, row.horizon, row.value) == (
        "rk4", REQUIRED, SHORT, UNIT_STEP)), math.nan)


def finding(rows: Sequence[Row], method: str = "rk4") -> str:
    """Return sentences on the step from which a method gives the mean speed within 5 %, and its sign at larger steps.
    """
    averages = [row for row in rows if row.compared == AVERAGE and math.isfinite(row.mean)]
    exact = next((row for row in averages if row.program == "exact"), None)
    if exact is not None and exact.motions > 1:
        return f"There are several mean speeds ({speeds_of_exact(rows)}): no method can be judged by one."
    own = _farthest([row for row in averages if row.program == method], exact)
    if exact is None or not own:
        return f"Not enough was measured to judge {method}'s mean speed."
    truth = f"exact: {_speed(exact)}"
    if exact.spread >= WITHIN * abs(exact.mean):
        return f"The mean speed is not known to {WITHIN:.0%} ({truth}): no method can be judged by it."
    good = len(own)
    while good and abs(own[good - 1].mean / exact.mean - 1.0) <= WITHIN:
        good -= 1
    first = "at no step tried" if good == len(own) else f"from dt = {own[good].value:g} s down"
    first += ", the finest tried," if good == len(own) - 1 else ""
    text = f"`{method}` reports the mean speed within {WITHIN:.0%} {first} ({truth}"
    text += f"; {method}: {_speed(own[good])})." if good < len(own) else ")."
    failed = [f"{row.value:g} s" for row in rows if row.compared == AVERAGE and row.program == method
              and not math.isfinite(row.mean)]
    if failed:
        text += f" At {', '.join(failed)} it diverges."
    if good:
        text += " Before that: " + "; ".join(_verdict(row, exact) for row in own[:good]) + "."
    elif not failed:
        text += " No coarser step was tried."
    if good < len(own):
        off = abs(own[good].mean - exact.mean) + math.hypot(own[good].spread, exact.spread)
        if off > WITHIN * abs(exact.mean):
            text += f" Its interval allows for {off / abs(exact.mean):.0%}."
    return text


def speeds_of_exact(rows: Sequence[Row]) -> str:
    """Text of the mean speed by `exact`; for several motions, each with its number of starts."""
    own = [row for row in rows if row.compared == AVERAGE and row.program == "exact"]
    starts = sum(row.repeats for row in own)
    return "; ".join(_speed(row) + f" from {row.repeats} of {starts} starts" * (len(own) > 1) for row in own)


def _farthest(rows: Sequence[Row], exact: Row | None) -> list[Row]:
    """Return for each step, the coarsest first, the motion whose mean speed is farthest from that of `exact`."""
    found: dict[float, Row] = {}
    for row in sorted(rows, key=lambda row: abs(row.mean - exact.mean) if exact else 0.0):
        found[row.value] = row
    return [found[value] for value in sorted(found, reverse=True)]


def speeds_table(rows: Sequence[Row]) -> str:
    """Return the table of mean speeds by method and step in Markdown; bold within 5 %, marked if of the wrong sign."""
    averages: dict[tuple[str, float], list[Row]] = {}
    for row in rows:
        if row.compared == AVERAGE and row.program != "exact":
            averages.setdefault((row.program, row.value), []).append(row)
    exact = next((row for row in rows if row.compared == AVERAGE and row.program == "exact"), None)
    steps = sorted({value for _, value in averages}, reverse=True)
    if exact is None or not steps:
        return "No mean speeds were measured."
    heads = ("mean speed, mm/s", *(f"{step:.0e} s" for step in steps))
    whole = markdown_table(heads, [
        (method, *("; ".join(_cell(row, exact) for row in averages.get((method, step), [])) for step in steps))
        for method in dict.fromkeys(method for method, _ in averages)])
    judged = f"Bold: within {WITHIN:.0%}; (!): the wrong way."
    if exact.spread >= WITHIN * abs(exact.mean):
        judged = f"It is not known to {WITHIN:.0%}: no method can be judged by it."
    starts = sum(row.repeats for row in rows if row.compared == AVERAGE and row.program == "exact")
    return "\n".join([whole, "", f"By `exact`, {starts} starts of {exact.horizon:g} s: {speeds_of_exact(rows)}. "
                      f"Every interval is Student's, of 95 %, over independent starts. {judged}"])


def _cell(row: Row, exact: Row) -> str:
    if not math.isfinite(row.mean):
        return "diverges"
    text = f"{1e3 * row.mean:+.1f}" + f" ± {1e3 * row.spread:.1f}" * math.isfinite(row.spread)
    if abs(row.mean - exact.mean) <= WITHIN * abs(exact.mean):
        return f"**{text}**"
    return text + " (!)" * (_known(row) and _known(exact) and row.mean * exact.mean < 0.0)


def _known(row: Row) -> bool:
    """Whether the sign of a mean speed is known: 0 lies outside its interval."""
    return abs(row.mean) > row.spread


def _verdict(row: Row, exact: Row) -> str:
    off = f"{row.value:g} s: {_speed(row)}, {row.mean / exact.mean - 1.0:+.0%}"
    if not _known(row):
        off += ", sign not known"
    elif row.mean * exact.mean < 0.0:
        off += ", WRONG SIGN"
    wrong = row.starts_forwards if exact.mean < 0.0 else row.repeats - row.starts_forwards
    return off + (f" ({wrong} of {row.repeats} starts the wrong way)" if wrong else "")


def _speed(row: Row) -> str:
    spread = f" ± {1e3 * row.spread:.2g}" * math.isfinite(row.spread)
    return f"{1e3 * row.mean:.2f}{spread} mm/s{', ' * bool(row.note)}{row.note}"


def _number(value: float, unit: str = "") -> str:
    return f"{value:.2g} {unit}".strip() if not math.isnan(value) else "-"


@dataclass(frozen=True)
class Slope:
    """Growth of a program's cost with the digits of its answers: the slope of log cost over log error.

    Attributes
    ----------
    slope, spread : float
        Change of log10 of the cost per digit, and half the width of its 95 % interval: from the fit's residuals for one
        problem, from the problems' slopes for several.
    points, problems : int
        Number of settings, and of problems, in the fit.
    coarse, fine : float
        Largest and least error in the fit [m].
    """

    slope: float
    spread: float
    points: int
    problems: int
    coarse: float
    fine: float

    @property
    def factor(self) -> float:
        """Factor by which one more digit raises the cost."""
        return 10.0**self.slope

    def __str__(self):
        low, high = (10.0 ** (self.slope + sign * self.spread) for sign in (-1.0, 1.0))
        known = f"over {self.problems} related scenes" if self.problems > 1 else (
            f"95 % interval of {self.points} settings")
        return (f"{self.factor:.3g} times as much ({low:.3g} to {high:.3g} {known}) between errors of "
                f"{self.coarse:.0e} and {self.fine:.0e} m")


def fit_slope(groups: Sequence[Sequence[tuple[float, float]]]) -> Slope | None:
    """Fit one slope to groups of (error, cost), each with its own offset; None if there is too little data."""
    logs = [np.log10(np.array(points)) for points in groups if len(points) > 1]
    count = sum(map(len, logs))
    if not logs:
        return None
    digits = np.concatenate([points[:, 0].mean() - points[:, 0] for points in logs])
    costs = np.concatenate([points[:, 1] - points[:, 1].mean() for points in logs])
    scale, free = float(digits @ digits), count - len(logs) - 1
    if scale == 0.0:
        return None
    slope = float(digits @ costs) / scale
    error = math.sqrt(float(np.sum((costs - slope * digits) ** 2)) / free / scale) if free > 0 else math.inf
    spread = float(student.ppf(0.975, free)) * error if free > 0 else math.inf
    found = 10.0 ** np.concatenate([points[:, 0] for points in logs])
    return Slope(slope, spread, count, 1, float(found.max()), float(found.min()))


def slope_of_scene(rows: Sequence[Row], program: str) -> Slope | None:
    """Slope of a program in one scene; None if there is too little data."""
    groups = [points for kind in (TRAJECTORY, REQUIRED) if len(points := _points(rows, program, kind)) > 1]
    return fit_slope(groups) if sum(map(len, groups)) >= max(_LEAST_POINTS, len(groups) + 2) else None


def slope_over_scenes(rows: Mapping[str, Sequence[Row]], program: str) -> Slope | None:
    """Mean slope over scenes, or the fit of the only one; None if there is too little data."""
    found = [slope for own in rows.values() if (slope := slope_of_scene(own, program))]
    if len(found) < 2:
        return found[0] if found else None
    slopes = np.array([slope.slope for slope in found])
    return Slope(float(slopes.mean()), float(half_interval(slopes)),
                 sum(slope.points for slope in found), len(found), max(slope.coarse for slope in found),
                 min(slope.fine for slope in found))


def _points(rows: Sequence[Row], program: str, kind: str) -> list[tuple[float, float]]:
    """Largest position error [m] and cost of each setting whose error is within the limits of a fit."""
    own = [row for row in rows if row.program == program and row.compared == kind
           and (kind == TRAJECTORY or row.horizon == SHORT)]
    known = [row.position_error for row in rows if row.compared == REFERENCE and own and row.horizon == own[0].horizon]
    floor = _ABOVE_REFERENCE * (known[-1] if known and math.isfinite(known[-1]) else 0.0)
    return [(row.position_error, row.cost) for row in own
            if floor < row.position_error < _LARGEST_ERROR and row.cost > 0.0]


def slopes_in_words(rows: Mapping[str, Sequence[Row]]) -> list[str]:
    """Return a sentence for each program on the cost of one more digit of every position.

    `exact` has no setting, and therefore one cost and one error.
    """
    programs = dict.fromkeys(row.program for own in rows.values() for row in own if row.compared == TRAJECTORY)
    sentences = [f"One more digit of every position by `{program}` costs {slope}." for program in programs
                 if program != "exact" and (slope := slope_over_scenes(rows, program))]
    if cost := headline(rows, "exact", SHORT):
        worst = [row.position_error for own in rows.values() for row in own
                 if row.compared == REFERENCE and row.horizon == SHORT and math.isfinite(row.position_error)]
        error = f", at most {max(worst):.0e} m, as far as the reference is known" if worst else ""
        sentences.insert(0, f"`exact` has no setting, but one cost, {cost}, and one error within {SHORT:g} s, that of "
                         f"rounding{error}.")
    return sentences


def headline(rows: Mapping[str, Sequence[Row]], program: str, horizon: float) -> str:
    """Return `quotients` as text."""
    by_hand, by_unit = quotients(rows, program, horizon)
    phrases = [f"{cost_range(list(by_hand.values()))} of {BY_HAND_IN_WORDS}"] if by_hand else []
    if by_unit:
        where = f" (`{'`, `'.join(by_unit)}`)" if by_hand else ""
        phrases.append(f"{cost_range(list(by_unit.values()))} of {UNIT_IN_WORDS}{where}")
    return " and ".join(phrases)


def quotients(rows: Mapping[str, Sequence[Row]], program: str, horizon: float) -> tuple[dict[str, float],
                                                                                     dict[str, float]]:
    """Costs of a program's cheapest row within a horizon [s], by scene.

    The first result has costs relative to `rk4_by_hand`; the second, for scenes without it, relative to the unit.
    """
    by_hand, by_unit = dict[str, float](), dict[str, float]()
    for name, own in rows.items():
        compared = [row for row in own if row.compared == REQUIRED and row.horizon == horizon
                    and math.isfinite(row.cost)]
        costs = [row.cost for row in compared if row.program == program]
        hand = [row.cost for row in compared if row.program == BY_HAND and row.value == UNIT_STEP]
        if costs and hand:
            by_hand[name] = min(costs) / hand[0]
        elif costs:
            by_unit[name] = min(costs)
    return by_hand, by_unit


def cost_range(costs: Sequence[float]) -> str:
    """Text of the least and the largest cost, without exponents."""
    low, high = two_digits(min(costs)), two_digits(max(costs))
    return low if low == high else f"{low} to {high}"


def two_digits(cost: float) -> str:
    """Text of a cost with two digits, without an exponent."""
    return f"{float(f'{cost:.2g}'):g}"


@dataclass(frozen=True)
class Requirement:
    """An accuracy requirement: its text, its `horizon` [s], the `column` of a row with the error, and its `limit`."""

    words: str
    horizon: float
    column: str
    limit: float


REQUIREMENTS = (Requirement(f"every position to 1 mm for {SHORT:g} s", SHORT, "position_error", 1e-3),
                Requirement(f"every position to 1 µm for {SHORT:g} s", SHORT, "position_error", 1e-6),
                Requirement(f"every contact to 1 µs for {SHORT:g} s", SHORT, "event_error", 1e-6),
                Requirement(f"the body to 1 mm for {LONG:g} s", LONG, "path_error", 1e-3))
MEAN_SPEED = "the mean speed to 1 %"


def advice(rows: Sequence[Row]) -> dict[str, str]:
    """Return for each requirement the programs that meet it in a scene, the cheapest first, or why none does."""
    comparable = lyapunov_time_in(rows).comparable
    return {asked.words: _advice(rows, asked, comparable) for asked in REQUIREMENTS} | {
        MEAN_SPEED: _mean_speed_advice(rows)}


def cheapest(rows: Sequence[Row], asked: Requirement) -> dict[str, Row]:
    """Return the coarsest row of each program that meets a requirement, the cheapest first.

    A setting counts only if all finer settings that were measured meet the requirement, too, which excludes luck.
    """
    known = [row for row in rows if row.compared == REFERENCE and row.horizon == asked.horizon]
    found = {}
    if known and not getattr(known[-1], asked.column) >= asked.limit:  # NaN: nothing to compare
        measured = [row for row in rows if (row.compared, row.horizon) == (REQUIRED, asked.horizon)]
        for name in dict.fromkeys(row.program for row in measured):
            own = [row for row in measured if row.program == name]
            able = list(takewhile(lambda row: getattr(row, asked.column) < asked.limit,
                                  sorted(own, key=lambda row: row.value)))
            if able:
                found[name] = able[-1]
    return dict(sorted(found.items(), key=lambda item: item[1].wall_time if math.isnan(item[1].cost) else item[1].cost))


def _advice(rows: Sequence[Row], asked: Requirement, comparable: float) -> str:
    if asked.horizon > comparable:
        return "not possible: chaos"
    measured = [row for row in rows if row.compared == REQUIRED and row.horizon == asked.horizon]
    if not measured:
        return "not measured"
    done = [row for row in measured if row.outcome == OK and row.program != BY_HAND]
    if done and all(math.isnan(getattr(row, asked.column)) for row in done):
        return "nothing touches"
    uses = [f"{row.program}{'' if name == 'exact' else f' {row.setting}'} ({two_digits(row.cost)})"
            for name, row in cheapest(rows, asked).items()]
    return "; ".join(uses) or "nothing that was measured"


def _mean_speed_advice(rows: Sequence[Row]) -> str:
    exact = next((row for row in rows if row.compared == AVERAGE and row.program == "exact"), None)
    if exact is None or not math.isfinite(exact.mean):
        return "not measured"
    if exact.motions > 1:
        return f"not one: {exact.motions} motions"
    if abs(exact.mean) <= exact.spread:
        return "not known to differ from 0"
    spread = exact.spread / abs(exact.mean)
    starts = max(1, math.ceil(exact.repeats * (spread / 0.01) ** 2))
    if starts > _MOST_STARTS:
        return f"not measured: ± {spread:.0%} after {exact.repeats} starts"
    return f"exact, {starts} start{'s' * (starts > 1)} of {exact.horizon:g} s after {SETTLING:g} s"
