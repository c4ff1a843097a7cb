"""Words and tables made of rows: which program meets a requirement, at what cost, and what mean speeds are.

Costs are in seconds of wall time for each simulated second, without set-up, in every text, table and diagram.
"""

import math
from collections.abc import Iterable, Sequence
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from vibro_lab.accuracy.harness import (
    AVERAGE,
    LEAST_TIME,
    OK,
    RATE,
    REFERENCE,
    REQUIRED,
    TRAJECTORY,
    Effort,
    Row,
)
from vibro_lab.accuracy.scene_rows import LONG, SHORT, lyapunov_time_in
from vibro_lab.orbits.starts import RUNNING_SPEED, SETTLING

COST = "cost [s/s]"  # heading of the unit of all costs
WITHIN = 0.05  # largest relative error of a mean speed that counts as right
BELOW = "below the reference's"
_HEADING = ("program", "setting", COST, "set-up [s]", "body", "height", "masses", "contacts", "mean speed", "")
# Limits of a fit: errors are small beside the robot's motion; and above rounding, this multiple of the reference's own.
_LARGEST_FITTED, _ABOVE_REFERENCE = 1e-2, 10.0


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


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with a line for each row; a bar within a cell is a slash, because it would end the cell."""
    first, *others = (f"| {' | '.join(str(cell).replace('|', '/') for cell in cells)} |" for cells in (heads, *rows))
    return "\n".join([first, "|---" * len(heads) + "|", *others])


def two_digits(value: float) -> str:
    """Text of a number with two digits, without an exponent down to 0.0001."""
    return f"{float(f'{value:.2g}'):g}" if math.isfinite(value) else "-"


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.2g} {unit}" if not math.isnan(value) else "-"


def cheapest(rows: Sequence[Row], asked: Requirement) -> dict[str, Row]:
    """Return the coarsest row of each program that meets a requirement, the cheapest first; set-up counts.

    A setting counts only if all finer settings that were measured meet the requirement, too, which excludes luck.
    """
    known = [row for row in rows if row.compared == REFERENCE and row.horizon == asked.horizon]
    able_rows = dict[str, Row]()
    if known and not getattr(known[-1], asked.column) >= asked.limit:  # NaN: nothing to compare
        measured = [row for row in rows if (row.compared, row.horizon) == (REQUIRED, asked.horizon)]
        for name in dict.fromkeys(row.program for row in measured):
            ladder = sorted((row for row in measured if row.program == name), key=lambda row: row.value)
            if able := list(takewhile(lambda row: getattr(row, asked.column) < asked.limit, ladder)):
                able_rows[name] = able[-1]
    return dict(sorted(able_rows.items(), key=lambda item: item[1].wall_time))


def use_in_words(row: Row) -> str:
    """Return program, setting, cost and set-up of a row."""
    setting = "" if row.program == "exact" else f" {row.setting}"
    return f"{row.program}{setting} ({two_digits(row.cost)}; set-up {two_digits(row.set_up)} s)"


def advice(rows: Sequence[Row]) -> dict[str, str]:
    """Return for each requirement the programs that meet it in a scene, the cheapest first, or why none does."""
    comparable = lyapunov_time_in(rows).comparable
    return {asked.words: _advice(rows, asked, comparable) for asked in REQUIREMENTS} | {
        MEAN_SPEED: _mean_speed_advice(rows)}


def _advice(rows: Sequence[Row], asked: Requirement, comparable: float) -> str:
    if asked.horizon > comparable:
        return "not possible: chaos"
    measured = [row for row in rows if row.compared == REQUIRED and row.horizon == asked.horizon]
    if not measured:
        return "not measured"
    done = [row for row in measured if row.outcome == OK and row.program in ("exact", "rk4_located")]
    if done and all(math.isnan(getattr(row, asked.column)) for row in done):
        return "nothing touches"
    return "; ".join(map(use_in_words, cheapest(rows, asked).values())) or "nothing that was measured"


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


def speeds_table(rows: Sequence[Row]) -> str:
    """Return the table of mean speeds by method and step in Markdown; bold within 5 %, marked if of the wrong sign."""
    measured: dict[tuple[str, float], list[Row]] = {}
    for row in rows:
        if row.compared == AVERAGE and row.program != "exact":
            measured.setdefault((row.program, row.value), []).append(row)
    exact, steps = averages_of(rows, "exact"), sorted({value for _, value in measured}, reverse=True)
    if not exact or not steps:
        return "No mean speeds were measured."
    whole = markdown_table(("mean speed, mm/s", *(f"{step:.0e} s" for step in steps)), [
        (method, *("; ".join(_cell(row, exact[0]) for row in measured.get((method, step), [])) for step in steps))
        for method in dict.fromkeys(method for method, _ in measured)])
    starts = sum(row.repeats for row in exact)
    return "\n".join([whole, "", f"By `exact`, {starts} drawn starts of {exact[0].horizon:g} s after {SETTLING:g} s: "
                      f"{speeds_by_exact(rows)}. In brackets: nine of ten starts lie from the first to the second. "
                      f"Bold: within {WITHIN:.0%}; (!): the wrong way."])


def _cell(row: Row, exact: Row) -> str:
    if not math.isfinite(row.mean):
        return "diverges"
    text = f"{1e3 * row.mean:+.1f} ({1e3 * row.low:.1f} to {1e3 * row.high:.1f})"
    if abs(row.mean - exact.mean) <= WITHIN * abs(exact.mean):
        return f"**{text}**"
    return text + " (!)" * goes_wrong_way(row, exact)


def reference_of(rows: Sequence[Row]) -> Row:
    """Return the row with the uncertainty of the reference within the diagram's horizon."""
    return next(row for row in rows if row.compared == REFERENCE)


def reference_in_words(row: Row) -> str:
    """Return a sentence on the reference and its uncertainty."""
    if math.isnan(row.body_error):
        return f"Reference: exact; no independent program could check it ({row.note})."
    return (f"Reference: exact; it agrees with {row.program}, {row.setting}, within {row.horizon:g} s to "
            f"{_with_unit(row.path_error, 'm')} (body), {_with_unit(row.mass_error, 'm')} (masses), "
            f"{_with_unit(row.event_error, 's')} (contacts), {_with_unit(row.speed_error, 'm/s')} (mean speed): the "
            "reference's uncertainty.")


def digit_factor(ladder: Sequence[tuple[float, float]]) -> float:
    """Factor by which one more digit multiplies the cost: a fit of log cost over log error to pairs of error and cost.

    NaN for one setting, or settings that gain less than half a digit from the first to the last.
    """
    logs = np.log10(np.array([(error, cost) for error, cost in ladder if error > 0.0 and cost > 0.0]).reshape(-1, 2))
    if len(logs) < 2 or logs[0, 0] - logs[-1, 0] < 0.5:
        return math.nan
    return float(10.0 ** -np.polyfit(logs[:, 0], logs[:, 1], 1)[0])


def digits_in_words(rows: Sequence[Row]) -> list[str]:
    """Return a sentence for each program with settings on the cost of one more digit of every position in a scene."""
    floor = _ABOVE_REFERENCE * np.nan_to_num(reference_of(rows).position_error)
    sentences = []
    for program in dict.fromkeys(row.program for row in rows if row.compared == TRAJECTORY):
        factor = digit_factor([(row.position_error, row.cost) for row in rows if (row.program, row.compared) == (
            program, TRAJECTORY) and floor < row.position_error < _LARGEST_FITTED])
        if math.isfinite(factor):
            sentences.append(f"One more digit of every position by `{program}` multiplies the cost by {factor:.3g}.")
    return sentences


def section(rows: Sequence[Row], picture: str) -> str:
    """Return the section of a scene in Markdown: diagram, chaos, reference and mean speeds."""
    reference, growth = reference_of(rows), lyapunov_time_in(rows)
    chaos, name = str(growth), rows[0].problem
    horizon = f"Trajectories are compared within {reference.horizon:g} s only; beyond that, averages are compared."
    if reference.horizon > growth.comparable:
        horizon = (f"Trajectories are compared within {reference.horizon:g} s as asked for, BEYOND the "
                   f"{growth.comparable:.2g} s that chaos allows: the errors show it as much as the programs.")
    return "\n\n".join([f"## {name}", f"![{name}: error over cost, and mean speed over the step]({picture})",
                        f"{chaos[0].upper()}{chaos[1:]}. {horizon}",
                        reference_in_words(reference), speeds_table(rows)])


def table(rows: Sequence[Row]) -> str:
    """Return the table of a scene's trajectories in Markdown."""
    reference = reference_of(rows)
    least, cells = _five_errors(reference), list[tuple[object, ...]]()
    for row in rows:
        if row.compared == TRAJECTORY:
            shown = [BELOW if value <= known else "one kind missed" if math.isinf(value) else _with_unit(value, unit)
                     for value, known, unit in zip(_five_errors(row), least, ("m", "m", "m", "s", "m/s"), strict=True)]
            cells.append((row.program, row.setting, two_digits(row.cost), two_digits(row.set_up), *shown, row.note))
    return "\n".join([f"Trajectories, compared within {reference.horizon:g} s; errors are the largest within it.", "",
                      markdown_table(_HEADING, cells)])


def _five_errors(row: Row) -> tuple[float, ...]:
    return row.body_error, row.height_error, row.mass_error, row.event_error, row.speed_error


def how_measured(rows: Sequence[Row], effort: Effort) -> str:
    """Return a description of the measurement in Markdown: unit of cost, rounds, instants, starts and machine."""
    machines = dict.fromkeys(row.measured_on for row in rows if row.measured_on)
    return ("A cost is the wall time in seconds for each simulated second, without the set-up of the run, which has "
            "its own column [s]: runs over the horizon alternate with runs over the first sample. Costs are medians of "
            f"at most {effort.repeats} rounds, each the median of as many runs as fit into {LEAST_TIME:g} s, sampled "
            f"at {RATE:g} Hz. No finer setting is measured after a run of more than {effort.patience:g} s. Errors are "
            "measured in other runs, at instants that do not coincide with samples or steps; `every position` means "
            "the body along the ground, its height, and both masses. A motor that stands in the scene turns at "
            f"{RUNNING_SPEED:g} rad/s: in runs of {LONG:g} s by a command at t = 0, in shorter ones from the start. "
            f"Measured on {'; and on '.join(machines) or 'an unknown machine'}.")
