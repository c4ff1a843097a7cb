"""Which method for what: the least that meets a need, from the measured rows of a work–precision study."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from vibro_ros.accuracy.measurement import AVERAGE, NEED, REFERENCE, Measurement
from vibro_ros.accuracy.precision import COMPILED, LONG, SHORT
from vibro_ros.accuracy.price import two_digits
from vibro_ros.accuracy.starts import SETTLING
from vibro_ros.solver.methods import SCHEMES

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
        for name in COMPILED:
            able = list(_able(rows, name, need))
            if able:
                found[name] = able[-1]
    return dict(sorted(found.items(), key=lambda item: item[1].wall_time if math.isnan(item[1].cost) else item[1].cost))


def _able(rows: Sequence[Measurement], method: str, need: Need) -> Iterator[Measurement]:
    own = [row for row in rows if row.compared == NEED and row.method == method and row.horizon == need.horizon]
    for row in sorted(own, key=lambda row: row.value):
        if not getattr(row, need.column) < need.limit:
            return
        yield row


def _advice(rows: Sequence[Measurement], need: Need, comparable: float) -> str:
    if need.horizon > comparable:
        return "not possible: chaos"
    measured = [row for row in rows if row.compared == NEED and row.horizon == need.horizon]
    if not measured:
        return "not measured"
    done = [row for row in measured if row.method in COMPILED and math.isfinite(row.position_error)]
    if done and all(math.isnan(getattr(row, need.column)) for row in done):
        return "nothing touches"
    best = cheapest(rows, need)
    fixed = [name for name in best if name in SCHEMES]
    shown = [row for name, row in best.items() if name not in fixed[1:]]
    return "; ".join(f"{_use(row)} ({two_digits(row.cost)})" for row in shown) or "nothing that was measured"


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


def _use(row: Measurement) -> str:
    unit = " s" if row.setting == "step" else ""
    return row.method if row.method == "exact" else f"{row.method} {row.value:.2g}{unit}"
