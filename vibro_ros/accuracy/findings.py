"""A study of accuracy in words: findings, prices of a digit, advice, and the tables in Markdown."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile

import numpy as np
from scipy.stats import t as student

from vibro_ros.accuracy.diagram import WITHIN
from vibro_ros.accuracy.measurement import AVERAGE, NEED, REFERENCE, TRAJECTORY, Measurement
from vibro_ros.accuracy.methods import BASELINE
from vibro_ros.accuracy.precision import LONG, SHORT
from vibro_ros.accuracy.tables_by_scipy import SOLVERS
from vibro_ros.orbits.starts import SETTLING
from vibro_ros.solver.methods import SCHEMES

#: The method of fixed step that locates events, which is no blind one.
LOCATED = "rk4_located"
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
    for row in rows:
        if row.compared == TRAJECTORY:
            errors = [BELOW if value <= least else "one kind missed" if math.isinf(value) else _number(value, unit)
                      for value, least, unit in zip(row.errors, reference.errors, ("m", "m", "m", "s", "m/s"),
                                                    strict=True)]
            setting = f"{row.setting} {row.value:.2g}" + (" s" if row.setting == "step" else "")
            lines.append(_line((row.method, setting, _number(row.cost), _number(row.wall_time, "s"), row.repeats,
                                *errors, row.note)))
    return "\n".join([*lines, "", baseline_in_words({reference.scene: rows})])


def reference_in_words(row: Measurement) -> str:
    """What the reference is, and how well it is known."""
    if math.isnan(row.body_error):
        return f"Reference: exact; no independent method could check it ({row.note})."
    return (f"Reference: exact; it agrees with {row.method} at tolerance {row.value:g} within {row.horizon:g} s to "
            f"{_number(row.path_error, 'm')} (body), {_number(row.mass_error, 'm')} (masses), "
            f"{_number(row.event_error, 's')} "
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


def _number(value: float, unit: str = "") -> str:
    return f"{value:.2g} {unit}".strip() if not math.isnan(value) else "-"


def _line(cells: Sequence[object]) -> str:
    return f"| {' | '.join(str(cell).replace('|', '/') for cell in cells)} |"


#: Kind of method, in words, to the methods whose slope is fitted in common; every other method is a kind of its own.
KINDS: Mapping[str, tuple[str, ...]] = {
    **{f"`{scheme}`": (scheme,) for scheme in SCHEMES}, "scipy's solvers with events": tuple(SOLVERS)}
# Of a fit: errors above this are not small beside the robot's motion [m], and errors that are not so many times the
# reference's own have ended at rounding.
_LARGEST_ERROR, _ABOVE_REFERENCE = 1e-2, 10.0
_LEAST_POINTS = 3


@dataclass(frozen=True)
class Price:
    """The factor by which one more digit raises the cost.

    Attributes
    ----------
    slope, spread : float
        Change of log10 of the cost by one digit, and half the width of its 95 % interval: of the fit's residuals in one
        scene, of the scenes' slopes in several.
    points, scenes : int
        Number of settings, and of scenes, that it is known from.
    coarse, fine : float
        Largest and least error of every position that the fit has seen [m].
    """

    slope: float
    spread: float
    points: int
    scenes: int
    coarse: float
    fine: float

    @property
    def factor(self) -> float:
        """The factor itself."""
        return 10.0**self.slope

    def __str__(self):
        low, high = (10.0 ** (self.slope + sign * self.spread) for sign in (-1.0, 1.0))
        known = f"over {self.scenes} related scenes" if self.scenes > 1 else f"95 % interval of {self.points} settings"
        return (f"{self.factor:.3g} times as much ({low:.3g} to {high:.3g} {known}) between errors of "
                f"{self.coarse:.0e} and {self.fine:.0e} m")


def price_of_a_digit(rows: Sequence[Measurement], methods: Sequence[str]) -> Price | None:
    """Fit of one scene, with one slope for all `methods`; None where too little was measured."""
    groups = [points for method in methods for kind in (TRAJECTORY, NEED)
              if len(points := _points(rows, method, kind)) >= 2]
    count = sum(len(points) for points in groups)
    if count < _LEAST_POINTS:
        return None
    digits = np.concatenate([points[:, 0] - points[:, 0].mean() for points in groups])
    costs = np.concatenate([points[:, 1] - points[:, 1].mean() for points in groups])
    free, scale = count - len(groups) - 1, float(digits @ digits)
    if free < 1 or scale == 0.0:
        return None
    slope = float(digits @ costs) / scale
    error = math.sqrt(float(np.sum((costs - slope * digits) ** 2)) / free / scale)
    errors = 10.0 ** -np.concatenate([points[:, 0] for points in groups])
    return Price(slope, float(student.ppf(0.975, free)) * error, count, 1, float(errors.max()), float(errors.min()))


def price_over_scenes(rows: Mapping[str, Sequence[Measurement]], methods: Sequence[str]) -> Price | None:
    """Mean over scenes, or the fit of the only one; None where too little was measured."""
    found = [price for own in rows.values() if (price := price_of_a_digit(own, methods))]
    if len(found) < 2:
        return found[0] if found else None
    slopes = np.array([price.slope for price in found])
    error = float(slopes.std(ddof=1)) / math.sqrt(len(slopes))
    return Price(float(slopes.mean()), float(student.ppf(0.975, len(slopes) - 1)) * error,
                 sum(price.points for price in found), len(found), max(price.coarse for price in found),
                 min(price.fine for price in found))


def _points(rows: Sequence[Measurement], method: str, kind: str) -> np.ndarray:
    """Digits (minus log10 of the error) and log10 of the cost, shape (settings, 2), where the error still falls."""
    own = [row for row in rows if row.method == method and row.compared == kind
           and (kind == TRAJECTORY or row.horizon == SHORT)]
    known = [row.position_error for row in rows if row.compared == REFERENCE and own and row.horizon == own[0].horizon]
    floor = _ABOVE_REFERENCE * (known[-1] if known and math.isfinite(known[-1]) else 0.0)
    return np.array([(-math.log10(row.position_error), math.log10(row.cost)) for row in own
                     if floor < row.position_error < _LARGEST_ERROR and row.cost > 0.0]).reshape(-1, 2)


def prices_in_words(rows: Mapping[str, Sequence[Measurement]]) -> list[str]:
    """A sentence for each kind of method that was measured: what one more digit of every position costs by it.

    `exact` has no setting, so that one more digit of it has no price: it has one price and one error.
    """
    known = {"exact", "baseline", *(method for methods in KINDS.values() for method in methods)}
    kinds = {row.method: (row.method,) for own in rows.values() for row in own if row.compared == TRAJECTORY
             and row.method not in known} | dict(KINDS)
    sentences = [f"One more digit of every position by {kind} costs {price}." for kind, methods in kinds.items()
                 if (price := price_over_scenes(rows, methods))]
    exact = [row.cost for own in rows.values() for row in own
             if row.method == "exact" and row.compared == NEED and row.horizon == SHORT and math.isfinite(row.cost)]
    if exact:
        worst = [row.position_error for own in rows.values() for row in own
                 if row.compared == REFERENCE and row.horizon == SHORT and math.isfinite(row.position_error)]
        error = f", at most {max(worst):.0e} m, as far as the reference is known" if worst else ""
        sentences.insert(0, f"`exact` has no setting, but one price, {cost_range(exact)} of the baseline's cost, and "
                         f"one error within {SHORT:g} s, that of rounding{error}.")
    return sentences


def baseline_in_words(rows: Mapping[str, Sequence[Measurement]]) -> str:
    """What `RK4 = 1` is, and how far off it is itself."""
    text = f"RK4 = 1 is the cost of fixed-step Runge-Kutta 4 of {BASELINE.ladder[0]:g} s (`baseline`)"
    off = {name: row.position_error for name, own in rows.items() for row in own
           if row.method == "baseline" and row.compared == NEED and math.isfinite(row.position_error)}
    if not off:
        return f"{text}."
    worst, least = max(off, key=off.__getitem__), min(off, key=off.__getitem__)
    if worst == least:
        return f"{text}, which is itself off by {off[worst]:.1e} m within {SHORT:g} s."
    return (f"{text}, which is itself off by {off[least]:.1e} m (`{least}`) to {off[worst]:.1e} m (`{worst}`) within "
            f"{SHORT:g} s.")


def cost_range(costs: Sequence[float]) -> str:
    """From the least to the largest, without exponents."""
    low, high = two_digits(min(costs)), two_digits(max(costs))
    return low if low == high else f"{low} to {high}"


def two_digits(cost: float) -> str:
    """A cost without an exponent."""
    return f"{float(f'{cost:.2g}'):g}"


# Starts, as many as somebody may want to simulate.
_MOST_STARTS = 10_000


@dataclass(frozen=True)
class Need:
    """A need: in words, the `horizon` [s], the `column` of a row that is the error, and its `limit` in SI units."""

    words: str
    horizon: float
    column: str
    limit: float


NEEDS = (Need(f"every position to 1 mm for {SHORT:g} s", SHORT, "position_error", 1e-3),
         Need(f"every position to 1 µm for {SHORT:g} s", SHORT, "position_error", 1e-6),
         Need(f"every contact to 1 µs for {SHORT:g} s", SHORT, "event_error", 1e-6),
         Need(f"the body to 1 mm for {LONG:g} s", LONG, "path_error", 1e-3))
MEAN_SPEED = "the mean speed to 1 %"


def advice(rows: Sequence[Measurement], comparable: float) -> dict[str, str]:
    """Need to what meets it in one scene, from the cheapest on, steps of fixed length by the cheapest of their methods.

    It says why, where nothing does.
    Chaos lets trajectories be compared within the time `comparable` [s].
    """
    return {need.words: _advice(rows, need, comparable) for need in NEEDS} | {MEAN_SPEED: _mean_speed_advice(rows)}


def cheapest(rows: Sequence[Measurement], need: Need) -> dict[str, Measurement]:
    """Method to its coarsest row that meets a need, from the cheapest on.

    A setting counts only if all finer ones that were measured meet the need, too: not by luck.
    """
    known = [row for row in rows if row.compared == REFERENCE and row.horizon == need.horizon]
    found = {}
    if known and not getattr(known[-1], need.column) >= need.limit:  # NaN: nothing to compare
        measured = [row for row in rows if (row.compared, row.horizon) == (NEED, need.horizon)]
        for name in dict.fromkeys(row.method for row in measured if row.method != "baseline"):
            own = [row for row in measured if row.method == name]
            able = list(takewhile(lambda row: getattr(row, need.column) < need.limit,
                                  sorted(own, key=lambda row: row.value)))
            if able:
                found[name] = able[-1]
    return dict(sorted(found.items(), key=lambda item: item[1].wall_time if math.isnan(item[1].cost) else item[1].cost))


def _advice(rows: Sequence[Measurement], need: Need, comparable: float) -> str:
    if need.horizon > comparable:
        return "not possible: chaos"
    measured = [row for row in rows if row.compared == NEED and row.horizon == need.horizon]
    if not measured:
        return "not measured"
    done = [row for row in measured if row.method != "baseline" and math.isfinite(row.position_error)]
    if done and all(math.isnan(getattr(row, need.column)) for row in done):
        return "nothing touches"
    best = cheapest(rows, need)
    fixed = [name for name in best if name in SCHEMES and name != LOCATED]
    shown = [row for name, row in best.items() if name not in fixed[1:]]
    uses = [row.method if row.method == "exact" else f"{row.method} {row.value:.2g}" + " s" * (row.setting == "step")
            for row in shown]
    return "; ".join(f"{use} ({two_digits(row.cost)})" for use, row in zip(uses, shown, strict=True)) or (
        "nothing that was measured")


def _mean_speed_advice(rows: Sequence[Measurement]) -> str:
    exact = next((row for row in rows if row.compared == AVERAGE and row.method == "exact"), None)
    if exact is None or not math.isfinite(exact.mean_speed):
        return "not measured"
    if abs(exact.mean_speed) <= exact.mean_speed_spread:
        return "not known to differ from 0"
    spread = exact.mean_speed_spread / abs(exact.mean_speed)
    starts = max(1, math.ceil(exact.repeats * (spread / 0.01) ** 2))
    if starts > _MOST_STARTS:
        return f"not measured: ± {spread:.0%} after {exact.repeats} starts"
    return f"exact, {starts} start{'s' * (starts > 1)} of {exact.horizon:g} s after {SETTLING:g} s"
