"""A work-precision study in words: findings, recommendations, and the table in Markdown."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from vibro_ros.solver.methods import SCHEMES
from vibro_ros.study.effects import SETTLING
from vibro_ros.study.precision import AVERAGE, LONG, NEED, REFERENCE, SHORT, TRAJECTORY, Row
from vibro_ros.study.precision_diagram import WITHIN

_HEADING = ("method", "setting", "cost, RK4 = 1", "wall time", "runs", "body", "masses", "contacts", "mean speed", "")
BELOW = "below the reference's"


@dataclass(frozen=True)
class Need:
    """What somebody may ask for: in words, the `horizon` [s], the `column` of the error and its `limit` in SI units."""

    words: str
    horizon: float
    column: str
    limit: float


NEEDS = (Need(f"every position to 1 mm for {SHORT:g} s", SHORT, "mass_error", 1e-3),
         Need(f"every position to 1 µm for {SHORT:g} s", SHORT, "mass_error", 1e-6),
         Need(f"every contact to 1 µs for {SHORT:g} s", SHORT, "event_error", 1e-6),
         Need(f"the body to 1 mm for {LONG:g} s", LONG, "body_error", 1e-3))
MEAN_SPEED = "the mean speed to 1 %"


def reference_of(rows: Sequence[Row]) -> Row:
    """The row of the reference's uncertainty, within the diagram's horizon."""
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
    methods = (row.method for row in rows if row.compared == AVERAGE and row.method != "exact")
    return list(dict.fromkeys(finding(rows, method) for method in dict.fromkeys(methods)))


def finding(rows: Sequence[Row], method: str = "rk4") -> str:
    """From which step on a method reports the mean speed within 5 %, and its sign before that."""
    averages = [row for row in rows if row.compared == AVERAGE and math.isfinite(row.mean_speed)]
    exact = next((row for row in averages if row.method == "exact"), None)
    own = sorted((row for row in averages if row.method == method), key=lambda row: -row.value)
    if exact is None or not own:
        return f"Not enough was measured to judge {method}'s mean speed."
    truth = f"exact: {_speed(exact)}"
    if abs(exact.mean_speed) <= exact.mean_speed_spread:
        return f"The mean speed is not known to differ from 0 ({truth}); no 5 % of it can be asked for."
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
    widest = max(row.mean_speed_spread for row in (*own[good:], exact)) / abs(exact.mean_speed)
    if widest > WITHIN:
        text += f" The intervals, up to {widest:.0%} wide either side, are wider than that: more starts would tell."
    return text


def recommendations(rows: Sequence[Row], comparable: float) -> str:
    """What meets each need at the least cost, as a table; see `advice`."""
    lines = ["| I need | use (cost, RK4 = 1) |", "|---|---|"]
    return "\n".join([*lines, *(f"| {need} | {use} |" for need, use in advice(rows, comparable).items())])


def advice(rows: Sequence[Row], comparable: float) -> dict[str, str]:
    """Need to what meets it in one scene, from the cheapest on, steps of fixed length by the cheapest of their methods.

    It says why, where nothing does.
    Chaos lets trajectories be compared within the time `comparable` [s].
    """
    return {need.words: _advice(rows, need, comparable) for need in NEEDS} | {MEAN_SPEED: _mean_speed_advice(rows)}


def cheapest(rows: Sequence[Row], need: Need) -> dict[str, Row]:
    """Method to its coarsest row that meets a need, from the cheapest on.

    A setting counts only if all finer ones that were measured meet the need, too: not by luck.
    """
    known = [row for row in rows if row.compared == REFERENCE and row.horizon == need.horizon]
    found = {}
    if known and not getattr(known[-1], need.column) >= need.limit:  # NaN: nothing to compare
        for name in dict.fromkeys(row.method for row in rows if row.compared == NEED):
            able = list(_able(rows, name, need))
            if able:
                found[name] = able[-1]
    return dict(sorted(found.items(), key=lambda item: item[1].wall_time))


def _able(rows: Sequence[Row], method: str, need: Need) -> Iterator[Row]:
    own = [row for row in rows if row.compared == NEED and row.method == method and row.horizon == need.horizon]
    for row in sorted(own, key=lambda row: row.value):
        if not getattr(row, need.column) < need.limit:
            return
        yield row


def _advice(rows: Sequence[Row], need: Need, comparable: float) -> str:
    if need.horizon > comparable:
        return "not possible: chaos"
    measured = [row for row in rows if row.compared == NEED and row.horizon == need.horizon]
    if not measured:
        return "not measured"
    if all(math.isnan(getattr(row, need.column)) for row in measured):
        return "nothing touches"
    best = cheapest(rows, need)
    fixed = [name for name in best if name in SCHEMES]
    shown = [row for name, row in best.items() if name not in fixed[1:]]
    return "; ".join(f"{_use(row)} ({row.cost:.2g})" for row in shown) or "nothing that was measured"


def _mean_speed_advice(rows: Sequence[Row]) -> str:
    exact = next((row for row in rows if row.compared == AVERAGE and row.method == "exact"), None)
    if exact is None or not math.isfinite(exact.mean_speed):
        return "not measured"
    if abs(exact.mean_speed) <= exact.mean_speed_spread:
        return "not known to differ from 0"
    starts = max(1, math.ceil(exact.repeats * (exact.mean_speed_spread / abs(0.01 * exact.mean_speed)) ** 2))
    return f"exact, {starts} start{'s' * (starts > 1)} of {exact.horizon:g} s after {SETTLING:g} s"


def _use(row: Row) -> str:
    return row.method if row.method == "exact" else f"{row.method}, {_setting(row)}"


def _verdict(row: Row, exact: Row) -> str:
    off = f"{row.value:g} s: {_speed(row)}, {row.mean_speed / exact.mean_speed - 1.0:+.0%}"
    if abs(row.mean_speed) <= row.mean_speed_spread:
        off += ", sign not known"
    elif row.mean_speed * exact.mean_speed < 0.0:
        off += ", WRONG SIGN"
    wrong = row.starts_forwards if exact.mean_speed < 0.0 else row.repeats - row.starts_forwards
    return off + (f" ({wrong} of {row.repeats} starts the wrong way)" if wrong else "")


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
