"""A work–precision study in words: findings, and the tables in Markdown."""

import math
from collections.abc import Sequence

from vibro_ros.accuracy.diagram import WITHIN
from vibro_ros.accuracy.measurement import AVERAGE, REFERENCE, TRAJECTORY, Measurement

_HEADING = ("method", "setting", "cost, RK4 = 1", "wall time", "runs", "body", "height", "masses", "contacts",
            "mean speed", "")
BELOW = "below the reference's"


def reference_of(rows: Sequence[Measurement]) -> Measurement:
    """The row of the reference's uncertainty, within the diagram's horizon."""
    return next(row for row in rows if row.compared == REFERENCE)


def markdown(rows: Sequence[Measurement]) -> str:
    """Table of one scene's trajectories."""
    reference = reference_of(rows)
    lines = [f"Trajectories, compared within {reference.horizon:g} s; errors are the largest within it.", "",
             _line(_HEADING), "|---" * len(_HEADING) + "|"]
    lines += [_line(_trajectory(row, reference)) for row in rows if row.compared == TRAJECTORY]
    return "\n".join(lines)


def reference_in_words(row: Measurement) -> str:
    """What the reference is, and how well it is known."""
    if math.isnan(row.body_error):
        return f"Reference: exact; no independent method could check it ({row.note})."
    return (f"Reference: exact; it agrees with {row.method} at tolerance {row.value:g} within {row.horizon:g} s to "
            f"{_metres(row.path_error)} (body), {_metres(row.mass_error)} (masses), {_number(row.event_error, 's')} "
            f"(contacts), {_number(row.speed_error, 'm/s')} (mean speed): the reference's uncertainty.")


def findings(rows: Sequence[Measurement]) -> list[str]:
    """`finding` for each method whose mean speeds were measured."""
    methods = (row.method for row in rows if row.compared == AVERAGE and row.method != "exact")
    return list(dict.fromkeys(finding(rows, method) for method in dict.fromkeys(methods)))


def finding(rows: Sequence[Measurement], method: str = "rk4") -> str:
    """From which step on a method reports the mean speed within 5 %, and its sign before that."""
    averages = [row for row in rows if row.compared == AVERAGE and math.isfinite(row.mean_speed)]
    exact = next((row for row in averages if row.method == "exact"), None)
    own = sorted((row for row in averages if row.method == method), key=lambda row: -row.value)
    if exact is None or not own:
        return f"Not enough was measured to judge {method}'s mean speed."
    truth = f"exact: {_speed(exact)}"
    if exact.mean_speed_spread >= WITHIN * abs(exact.mean_speed):
        return f"The mean speed is not known to {WITHIN:.0%} ({truth}): no method can be judged by it."
    good = len(own)
    while good and abs(own[good - 1].mean_speed / exact.mean_speed - 1.0) <= WITHIN:
        good -= 1
    first = "at no step tried" if good == len(own) else f"from dt = {own[good].value:g} s down"
    first += ", the finest tried," if good == len(own) - 1 else ""
    text = f"`{method}` reports the mean speed within {WITHIN:.0%} {first} ({truth}"
    text += f"; {method}: {_speed(own[good])})." if good < len(own) else ")."
    failed = [f"{row.value:g} s" for row in rows if row.compared == AVERAGE and row.method == method
              and not math.isfinite(row.mean_speed)]
    if failed:
        text += f" At {', '.join(failed)} it diverges."
    if good:
        text += " Before that: " + "; ".join(_verdict(row, exact) for row in own[:good]) + "."
    elif not failed:
        text += " No coarser step was tried."
    if good < len(own):
        off = abs(own[good].mean_speed - exact.mean_speed)
        off += math.hypot(own[good].mean_speed_spread, exact.mean_speed_spread)
        if off > WITHIN * abs(exact.mean_speed):
            text += f" Its interval allows for {off / abs(exact.mean_speed):.0%}."
    return text


def speeds_table(rows: Sequence[Measurement]) -> str:
    """Mean speeds by method and step in Markdown; bold within 5 %, marked where they have the wrong sign."""
    averages = {(row.method, row.value): row for row in rows if row.compared == AVERAGE}
    exact = next((row for (method, _), row in averages.items() if method == "exact"), None)
    steps = sorted({value for method, value in averages if method != "exact"}, reverse=True)
    if exact is None or not steps:
        return "No mean speeds were measured."
    methods = dict.fromkeys(method for method, _ in averages if method != "exact")
    heads = ("mean speed, mm/s", *(f"{step:.0e} s" for step in steps))
    lines = [_line(heads), "|---" * len(heads) + "|"]
    lines += [_line((method, *(_cell(averages.get((method, step)), exact) for step in steps))) for method in methods]
    judged = f"Bold: within {WITHIN:.0%}; (!): the wrong way."
    if exact.mean_speed_spread >= WITHIN * abs(exact.mean_speed):
        judged = f"It is not known to {WITHIN:.0%}: no method can be judged by it."
    return "\n".join([*lines, "", f"By `exact`, {exact.repeats} starts of {exact.horizon:g} s: {_speed(exact)}. "
                      f"Every interval is Student's, of 95 %, over independent starts. {judged}"])


def _cell(row: Measurement | None, exact: Measurement) -> str:
    if row is None:
        return ""
    if not math.isfinite(row.mean_speed):
        return "diverges"
    text = f"{1e3 * row.mean_speed:+.1f} ± {1e3 * row.mean_speed_spread:.1f}"
    if abs(row.mean_speed - exact.mean_speed) <= WITHIN * abs(exact.mean_speed):
        return f"**{text}**"
    return text + " (!)" * (_known(row) and _known(exact) and row.mean_speed * exact.mean_speed < 0.0)


def _known(row: Measurement) -> bool:
    """Whether the sign of a mean speed is known."""
    return abs(row.mean_speed) > row.mean_speed_spread


def _verdict(row: Measurement, exact: Measurement) -> str:
    off = f"{row.value:g} s: {_speed(row)}, {row.mean_speed / exact.mean_speed - 1.0:+.0%}"
    if not _known(row):
        off += ", sign not known"
    elif row.mean_speed * exact.mean_speed < 0.0:
        off += ", WRONG SIGN"
    wrong = row.starts_forwards if exact.mean_speed < 0.0 else row.repeats - row.starts_forwards
    return off + (f" ({wrong} of {row.repeats} starts the wrong way)" if wrong else "")


def _speed(row: Measurement) -> str:
    return f"{1e3 * row.mean_speed:.2f} ± {1e3 * row.mean_speed_spread:.2g} mm/s"


def _trajectory(row: Measurement, reference: Measurement) -> tuple:
    errors = [_error(value, least, unit) for value, least, unit in
              zip(row.errors, reference.errors, ("m", "m", "m", "s", "m/s"), strict=True)]
    return (row.method, _setting(row), _number(row.cost), _number(row.wall_time, "s"), row.repeats, *errors, row.note)


def _error(value: float, least: float, unit: str) -> str:
    if value <= least:
        return BELOW
    return "one kind missed" if math.isinf(value) else _number(value, unit)


def _metres(value: float) -> str:
    return _number(value, "m")


def _number(value: float, unit: str = "") -> str:
    return f"{value:.2g} {unit}".strip() if not math.isnan(value) else "-"


def _setting(row: Measurement) -> str:
    return f"{row.setting} {row.value:.2g}" + (" s" if row.setting == "step" else "")


def _line(cells: Sequence[object]) -> str:
    return f"| {' | '.join(str(cell).replace('|', '/') for cell in cells)} |"
