"""A work-precision study in words: findings, recommendations, and the table in Markdown."""

import math
from collections.abc import Sequence

from vibro_ros.study.precision import AVERAGE, REFERENCE, TRAJECTORY, Row
from vibro_ros.study.precision_diagram import WITHIN

_HEADING = ("method", "setting", "cost, RK4 = 1", "wall time", "runs", "body", "masses", "contacts", "mean speed", "")
BELOW = "below the reference's"
#: Needs that the recommendations answer: in words, column of the error, its limit in SI units.
_NEEDS = (("the body's position to 1 mm", "body_error", 1e-3), ("every position to 1 µm", "mass_error", 1e-6),
          ("every position to 1 nm", "mass_error", 1e-9), ("instants of contacts to 1 µs", "event_error", 1e-6))


def reference_of(rows: Sequence[Row]) -> Row:
    """The row of the reference's uncertainty."""
    return next(row for row in rows if row.compared == REFERENCE)


def markdown(rows: Sequence[Row]) -> str:
    """Both tables of one scene: trajectories, and mean speeds."""
    reference = reference_of(rows)
    lines = [f"Trajectories, compared within {reference.horizon:g} s; errors are the largest within it.", "",
             _line(_HEADING), "|---" * len(_HEADING) + "|"]
    lines += [_line(_trajectory(row, reference)) for row in rows if row.compared == TRAJECTORY]
    averages = [row for row in rows if row.compared == AVERAGE]
    if averages:
        lines += ["", "Averages, beyond the horizon: mean speed of the body, 95 % confidence interval over starts.", "",
                  "| method | setting | starts | of | mean speed | |\n|---|---|---|---|---|---|"]
        lines += [_line((row.method, _setting(row), row.repeats, f"{row.horizon:g} s",
                         f"{1e3 * row.mean_speed:.2f} ± {1e3 * row.mean_speed_spread:.2f} mm/s"
                         if math.isfinite(row.mean_speed) else "-", row.note)) for row in averages]
    return "\n".join(lines)


def reference_in_words(row: Row) -> str:
    """What the reference is, and how well it is known."""
    if math.isnan(row.body_error):
        return f"Reference: exact; no independent method could check it ({row.note})."
    return (f"Reference: exact; it agrees with {row.method} at tolerance {row.value:g} within {row.horizon:g} s to "
            f"{_metres(row.body_error)} (body), {_metres(row.mass_error)} (masses), {_number(row.event_error, 's')} "
            f"(contacts), {_number(row.speed_error, 'm/s')} (mean speed): the reference's uncertainty.")


def findings(rows: Sequence[Row]) -> list[str]:
    """`finding` for each method whose mean speeds were measured."""
    methods = dict.fromkeys(row.method for row in rows if row.compared == AVERAGE and row.method != "exact")
    return [finding(rows, method) for method in methods]


def finding(rows: Sequence[Row], method: str = "rk4") -> str:
    """From which step on a method reports the mean speed within 5 %, and its sign before that."""
    averages = [row for row in rows if row.compared == AVERAGE and math.isfinite(row.mean_speed)]
    exact = next((row for row in averages if row.method == "exact"), None)
    own = sorted((row for row in averages if row.method == method), key=lambda row: -row.value)
    if exact is None or not own:
        return f"Finding: not enough was measured to judge {method}'s mean speed."
    truth = f"exact: {_speed(exact)}"
    if abs(exact.mean_speed) <= exact.mean_speed_spread:
        return f"Finding: the mean speed is not known to differ from 0 ({truth}); no 5 % of it can be asked for."
    good = len(own)
    while good and abs(own[good - 1].mean_speed / exact.mean_speed - 1.0) <= WITHIN:
        good -= 1
    first = "at no step tried" if good == len(own) else f"from dt = {own[good].value:g} s down"
    first += ", the finest tried," if good == len(own) - 1 else ""
    text = f"Finding: {method} reports the mean speed within {WITHIN:.0%} {first} ({truth}"
    text += f"; {method}: {_speed(own[good])})." if good < len(own) else ")."
    failed = [f"{row.value:g} s" for row in rows if row.compared == AVERAGE and row.method == method
              and not math.isfinite(row.mean_speed)]
    if failed:
        text += f" It cannot go on at all at {', '.join(failed)}."
    if good:
        text += " Before that: " + "; ".join(_verdict(row, exact) for row in own[:good]) + "."
    elif not failed:
        text += " No coarser step was tried."
    widest = max(row.mean_speed_spread for row in (*own[good:], exact)) / abs(exact.mean_speed)
    if widest > WITHIN:
        text += f" The intervals, up to {widest:.0%} wide either side, are wider than that: more starts would tell."
    return text


def recommendations(rows: Sequence[Row]) -> str:
    """The cheapest row that meets each need, as a table."""
    reference = reference_of(rows)
    lines = ["| I need | use | cost, RK4 = 1 |", "|---|---|---|"]
    trajectories = [row for row in rows if row.compared == TRAJECTORY and math.isfinite(row.cost)]
    for need, column, limit in _NEEDS:
        known = getattr(reference, column) < limit
        able = [row for row in trajectories if known and getattr(row, column) < limit]
        best = min(able, key=lambda row: row.cost, default=None)
        lines.append(f"| {need}, after {reference.horizon:g} s | {_use(best)} |")
    lines.append(f"| mean speed within 1 % | {_mean_speed_advice(rows)} |")
    return "\n".join(lines)


def _mean_speed_advice(rows: Sequence[Row]) -> str:
    exact = next((row for row in rows if row.compared == AVERAGE and row.method == "exact"), None)
    if exact is None or abs(exact.mean_speed) <= exact.mean_speed_spread:
        return "the mean speed is not known to differ from 0 | -"
    starts = math.ceil(exact.repeats * (exact.mean_speed_spread / abs(0.01 * exact.mean_speed)) ** 2)
    return f"exact, {max(2, starts)} starts of {exact.horizon:g} s, once settled | -"


def _use(row: Row | None) -> str:
    return "nothing that was measured | -" if row is None else f"{row.method}, {_setting(row)} | {row.cost:.2g}"


def _verdict(row: Row, exact: Row) -> str:
    if abs(row.mean_speed) <= row.mean_speed_spread:
        sign = "sign not known"
    else:
        sign = "right sign" if row.mean_speed * exact.mean_speed > 0.0 else "WRONG SIGN"
    wrong = row.starts_forwards if exact.mean_speed < 0.0 else row.repeats - row.starts_forwards
    sign += f" ({wrong} of {row.repeats} starts the wrong way)"
    return f"{row.value:g} s: {_speed(row)}, {row.mean_speed / exact.mean_speed - 1.0:+.0%}, {sign}"


def _speed(row: Row) -> str:
    return f"{1e3 * row.mean_speed:.2f} ± {1e3 * row.mean_speed_spread:.2g} mm/s"


def _trajectory(row: Row, reference: Row) -> tuple:
    errors = [_error(value, least, unit) for value, least, unit in
              zip(row.errors, reference.errors, ("m", "m", "s", "m/s"), strict=True)]
    return (row.method, _setting(row), _number(row.cost), _number(row.wall_time, "s"), row.repeats, *errors, row.note)


def _error(value: float, least: float, unit: str) -> str:
    if value <= least:
        return BELOW
    return "one kind missed" if math.isinf(value) else _number(value, unit)


def _metres(value: float) -> str:
    return _number(value, "m")


def _number(value: float, unit: str = "") -> str:
    return f"{value:.2g} {unit}".strip() if not math.isnan(value) else "-"


def _setting(row: Row) -> str:
    return f"{row.setting} {row.value:.2g}" + (" s" if row.setting == "step" else "")


def _line(cells: Sequence[object]) -> str:
    return f"| {' | '.join(str(cell).replace('|', '/') for cell in cells)} |"
