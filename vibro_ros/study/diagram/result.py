"""What a diagram has found: a row a visit, ranges of one kind of motion, and regions of hysteresis."""

import itertools
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes

from vibro_ros.accuracy.figures import new_figure, png, tidy, with_unit
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.chaos import sign_of
from vibro_ros.orbits.recurrence import LONGEST_PERIOD, WATCHED
from vibro_ros.simulation.given_state import STATE_UNITS
from vibro_ros.study.diagram.visits import DOWN, UP, Design, Visit
from vibro_ros.study.execution import fingerprint
from vibro_ros.study.table import KEY, file_of
from vibro_ros.study.variation import beyond_the_edge


@dataclass(frozen=True)
class Diagram:
    """A diagram that is done.

    Attributes
    ----------
    design : Design
        What was asked.
    visits : tuple of Visit
        By their numbers.
    natures : Table or None
        What was measured of each; None where nothing was.
    """

    design: Design
    visits: tuple[Visit, ...]
    natures: pa.Table | None

    def of(self, direction: str) -> tuple[Visit, ...]:
        """The visits of a direction, by value."""
        count = len(self.design.axis.values)
        return self.visits[:count] if direction == UP else self.visits[:count - 1:-1]

    def nature(self, column: str, visit: int) -> float:
        """What was measured of a visit, a column of its table; NaN where nothing was."""
        return float(self.natures[column][visit].as_py()) if self.natures is not None else float("nan")

    def period(self, visit: Visit) -> int:
        """Turns after which a motion repeats itself, a long period among them; 0 where none was found."""
        return visit.motion.turns if self.natures is None else int(self.nature("period", visit.number))

    def sign(self, visit: Visit) -> int | None:
        """Sign of a visit's largest exponent, 0 where it is not known; None where none was measured."""
        exponent = self.nature("exponent_1", visit.number)
        return None if math.isnan(exponent) else sign_of(exponent, self.nature("spread_1", visit.number))

    def disagrees(self, visit: Visit) -> bool:
        """Whether the largest exponent and K of the 0-1 test contradict each other."""
        chaos = self.nature("zero_one", visit.number)
        return bool(self.sign(visit)) and not math.isnan(chaos) and (chaos > _CHAOTIC) != (self.sign(visit) == 1)

    def differ(self) -> list[bool]:
        """For each value, whether the motions found upwards and downwards are settled, and two."""
        return [up.settled and down.settled and not up.motion.is_same(down.motion)
                for up, down in zip(self.of(UP), self.of(DOWN), strict=True)]

    def kind(self, visit: Visit) -> str:
        """How a motion repeats itself, in words."""
        turns = self.period(visit)
        if not (visit.settled or turns):
            return "not settled"
        watched = LONGEST_PERIOD if self.natures is None or not self.design.exponents else WATCHED // 4
        return f"no period to {watched}" if not turns else "every turn" if turns == 1 else f"every {turns} turns"

    def hysteresis(self) -> list[list[int]]:
        """Places of neighbouring values at which the motion found upwards is another one than that found downwards."""
        two = self.differ()
        return [list(places) for is_two, places in itertools.groupby(range(len(two)), two.__getitem__) if is_two]

    def ranges(self) -> list[list[Visit]]:
        """Visits of neighbouring values, of one direction and period, all with two motions or all with one."""
        two, found = self.differ(), []
        for direction in (UP, DOWN):
            keys = [(self.kind(one), is_two) for one, is_two in zip(self.of(direction), two, strict=True)]
            for _, places in itertools.groupby(range(len(two)), keys.__getitem__):
                found.append([self.of(direction)[place] for place in places])
        return found


def states_table(design: Design, table: pa.Table) -> bytes:
    """All states, as one Parquet file."""
    return _file(table, design)


def values_table(found: Diagram) -> bytes:
    """A row a visit, as one Parquet file."""
    design, two = found.design, found.differ()
    first = {
        "visit": pa.array([one.number for one in found.visits], pa.int64()),
        "direction": pa.array([design.direction(one.number) for one in found.visits], pa.string()),
        design.axis.name: pa.array([design.value(one.number) for one in found.visits], pa.float64()),
        "period": pa.array([found.period(one) for one in found.visits], pa.int64()),
        "settled": pa.array([one.settled for one in found.visits], pa.bool_()),
        "after": pa.array([one.motion.after for one in found.visits], pa.int64()),
        "mean_speed": pa.array([one.motion.mean_speed for one in found.visits], pa.float64()),
        "two_motions": pa.array([two[design.place(one.number)] for one in found.visits], pa.bool_()),
    }
    natures = found.natures.drop_columns(["visit", "period"]) if found.natures is not None else None
    rest = dict(zip(natures.column_names, natures.columns, strict=True)) if natures is not None else {}
    return _file(pa.table({**first, **rest}), design)


def _file(table: pa.Table, design: Design) -> bytes:
    about = json.dumps({**fingerprint(), "design": design.document()}, ensure_ascii=False).encode()
    return file_of(table.replace_schema_metadata({KEY: about}))


_CHAOTIC = 0.5  # K above which the 0-1 test says chaos
_MOST_RANGES = 40  # of a table that is read; the files hold all


def in_words(found: Diagram) -> Iterator[str]:
    """Lines: a table of ranges, then the regions of hysteresis."""
    design, name = found.design, found.design.axis.name
    unit = BY_NAME[name].unit
    head = f"{name} [{unit}]" if unit else name
    yield f"{'':5} {head:>24}  {'repeats itself':17} {'mean speed [mm/s]':>18} {'largest exponent [1/s]':>30} {'K':>13}"
    ranges = found.ranges()
    for visits in ranges[:_MOST_RANGES]:
        numbers = [one.number for one in visits]
        where = _between([design.value(number) for number in numbers], ".6g")
        speeds = _between([1e3 * one.motion.mean_speed for one in visits], ".2f")
        exponents = _exponents(found, numbers)
        chaos = _between([found.nature("zero_one", number) for number in numbers], ".2f")
        yield (f"{design.direction(numbers[0]):5} {where:>24}  {found.kind(visits[0]):17} {speeds:>18} {exponents:>30} "
               f"{chaos:>13}").rstrip()
    if len(ranges) > _MOST_RANGES:
        yield f"and {len(ranges) - _MOST_RANGES} ranges more; the files hold all"
    regions = found.hysteresis()
    for places in regions:
        ways = []
        for direction in (UP, DOWN):
            visits = [found.of(direction)[place] for place in places]
            speeds = _between([1e3 * one.motion.mean_speed for one in visits], ".2f")
            ways.append(f"{direction} {', '.join(dict.fromkeys(map(found.kind, visits)))} at {speeds} mm/s")
        where = _between([float(design.axis.values[place]) for place in places], ".6g")
        yield (f"hysteresis: {where}{f' {unit}' if unit else ''} ({len(places)} value{'s' * (len(places) > 1)}): "
               f"{'; '.join(ways)}")
    if not regions:
        yield f"hysteresis: none at the {len(design.axis.values)} values; both ways lead to the same motions"
    for said, chosen in (("sign of the largest exponent not known, 0 lies within its interval",
                          [one for one in found.visits if found.sign(one) == 0]),
                         ("the largest exponent and K disagree, trust the exponent",
                          list(filter(found.disagrees, found.visits)))):
        if chosen:
            values = dict.fromkeys(f"{design.value(one.number):.6g}" for one in chosen)
            yield f"{said}: at {', '.join(values)}{f' {unit}' if unit else ''}"
    fastest = max(found.visits, key=lambda one: abs(one.motion.mean_speed))
    if edge := beyond_the_edge("the largest mean speed", {name: design.axis.values}, design.place(fastest.number)):
        yield edge
    unsettled = sum(not one.settled for one in found.visits)
    if unsettled:
        yield (f"not settled: {unsettled} of {design.visits} visits within {design.most_turns} turns, of which nothing "
               "is said about hysteresis; give more --most-turns, or dampers")


def _exponents(found: Diagram, numbers: Sequence[int]) -> str:
    """The least and the largest exponent of visits; of a single one with its interval."""
    values, spreads = ([found.nature(column, number) for number in numbers] for column in ("exponent_1", "spread_1"))
    if len(numbers) == 1 and spreads[0] > 0.0:
        return f"{values[0]:.2f} ± {spreads[0]:.2g}" + ", sign not known" * (not sign_of(values[0], spreads[0]))
    return _between(values, ".2f")


def _between(values: Sequence[float], form: str) -> str:
    """The least and the largest of the values that are finite; empty without any."""
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return ""
    low, high = f"{min(finite):{form}}", f"{max(finite):{form}}"
    return low if low == high else f"{low} to {high}"


# Okabe and Ito's blue and vermilion, which the colour-blind can tell apart. Where both ways lead to one motion, the dot
# of the way down stands within the ring of the way up.
_COLOURS = {UP: "#0072b2", DOWN: "#d55e00"}
_MARKS: dict[str, dict[str, Any]] = {
    UP: {"marker": "o", "markerfacecolor": "none", "markeredgewidth": 0.8},
    DOWN: {"marker": ".", "markeredgewidth": 0.0}}
_SHADE = "#e4e4e4"
_FAINT = 0.3  # of the many states of a motion that does not repeat itself
_WIDTH, _STATES, _PANEL = 9.0, 3.8, 1.8  # in
_MOST, _LEAST, _CROWD = 5.0, 2.0, 450.0  # size of a ring [pt]: a share of the crowd, among so many values


def draw_diagram(found: Diagram) -> bytes:
    """Draw a diagram; returns a PNG file."""
    design = found.design
    panels = [_draw_states, _draw_speed]
    panels += [_draw_exponents] * bool(design.exponents) + [_draw_chaos] * bool(design.cuts)
    heights = [_STATES, *[_PANEL] * (len(panels) - 1)]
    figure = new_figure(_WIDTH, sum(heights), 100)
    rows = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    for axes, draw in zip(rows, panels, strict=True):
        draw(axes, found)
        _shade(axes, found)
        tidy(axes)
    rows[-1].set_xlabel(with_unit(design.axis.name, BY_NAME[design.axis.name].unit))
    figure.suptitle(f"{design.scene.name}: once a turn, at the crank angle {design.phase:.3f} rad; "
                    f"{len(design.axis.values)} values up and down", fontsize=11)
    return png(figure)


def _draw_states(axes: Axes, found: Diagram) -> None:
    design = found.design
    column, size = design.names.index(design.coordinate), _size(found)
    for direction in (UP, DOWN):
        for is_periodic, opacity in ((False, _FAINT), (True, 1.0)):
            visits = [one for one in found.of(direction) if bool(one.motion.turns) == is_periodic]
            places = [design.value(one.number) for one in visits for _ in one.states]
            states = [1e3 * value for one in visits for value in one.states[:, column]]
            share = 1.0 if is_periodic and direction == UP else 0.8
            axes.plot(places, states, linestyle="none", ms=share * size, alpha=opacity, color=_COLOURS[direction],
                      **_MARKS[direction if is_periodic else DOWN])
        axes.plot([], [], linestyle="none", ms=6, label=f"{direction}wards", color=_COLOURS[direction],
                  **_MARKS[direction])
    axes.set_ylabel(f"{design.coordinate.replace('_', ' ')} [m{STATE_UNITS[design.coordinate]}]")
    axes.legend(fontsize=9, frameon=False, ncols=2, loc="best")


def _size(found: Diagram) -> float:
    return min(_MOST, max(_LEAST, _CROWD / len(found.design.axis.values)))


def _draw_speed(axes: Axes, found: Diagram) -> None:
    for direction in (UP, DOWN):
        _draw_line(axes, found, direction, [1e3 * one.motion.mean_speed for one in found.of(direction)])
    axes.set_ylabel("mean speed [mm/s]")


def _draw_exponents(axes: Axes, found: Diagram) -> None:
    """The largest exponent with its interval, and the second one as a thin line."""
    for direction in (UP, DOWN):
        for column, share in (("exponent_1", 1.0), ("exponent_2", 0.4)):
            if found.natures is not None and column in found.natures.column_names:
                values = [found.nature(column, one.number) for one in found.of(direction)]
                values = [value if np.isfinite(value) else np.nan for value in values]
                _draw_line(axes, found, direction, values, share)
                if share == 1.0:
                    spreads = [found.nature("spread_1", one.number) for one in found.of(direction)]
                    axes.errorbar(found.design.axis.values, values, yerr=spreads, fmt="none", lw=0.8,
                                  color=_COLOURS[direction])
    axes.axhline(0.0, color="black", lw=0.8)
    axes.set_ylabel("two largest exponents\n[1/s]")


def _draw_chaos(axes: Axes, found: Diagram) -> None:
    for direction in (UP, DOWN):
        _draw_line(axes, found, direction, [found.nature("zero_one", one.number) for one in found.of(direction)])
    axes.set(ylabel="0-1 test, K\n[dimensionless]", ylim=(-0.2, 1.1))


def _draw_line(axes: Axes, found: Diagram, direction: str, values: list[float], share: float = 1.0) -> None:
    axes.plot(found.design.axis.values, values, ms=share * _size(found), lw=0.8 * share, alpha=0.4 + 0.6 * share,
              color=_COLOURS[direction], **_MARKS[direction])


def _shade(axes: Axes, found: Diagram) -> None:
    """Grey where both ways lead to two motions, from halfway to the values beside."""
    values = np.array(found.design.axis.values, dtype=float)
    middles = np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1]), values[-1:]])
    for places in found.hysteresis():
        axes.axvspan(middles[places[0]], middles[places[-1] + 1], color=_SHADE, zorder=0, lw=0.0)
