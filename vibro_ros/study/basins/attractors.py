"""The motions that the starts of a study lead to: numbered by their starts, with fractions and exponents."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from vibro_ros.orbits.attractors import Attractor, measured, share_of
from vibro_ros.orbits.recurrence import Cloud, SettledMotion, number_among, settle, tolerance_of
from vibro_ros.orbits.turn_map import Stroboscope
from vibro_ros.study.progress import Progress

#: Starts along a side of a box of `basin_entropy`, as its authors have it.
BOX = 5


class BasinEntropy(NamedTuple):
    """How hard it is to tell where a start leads.

    Attributes
    ----------
    entropy : float
        Mean over all boxes of the entropy of the motions within a box [nat]: 0 where every box has one motion.
    boundary : float
        Mean over the boxes with more than one motion [nat]; NaN without any. Above log 2, in boxes ever
        smaller and with ever more starts, the boundary is fractal; in the boxes of a grid it is a hint.
    boxes, mixed : int
        Boxes, and those with more than one motion.
    """

    entropy: float
    boundary: float
    boxes: int
    mixed: int


def basin_entropy(numbers: np.ndarray, outside: int, side: int = BOX) -> BasinEntropy | None:
    """Basin entropy and boundary basin entropy of a grid of starts; None for a grid without a whole box.

    Both, and the criterion of log 2, are those of A. Daza, A. Wagemakers, B. Georgeot, D. Guery-Odelin and
    M. A. F. Sanjuan, Sci. Rep. 6 (2016) 31416.

    Parameters
    ----------
    numbers : ndarray of int, shape (rows, columns)
        Where each start leads.
    outside : int
        What stands where nothing can start; a box with such a start is left out.
    side : int
        Starts along a side of a box, dimensionless; what is left over at the ends of the grid is left out.
    """
    rows, columns = (count // side for count in numbers.shape)
    boxes = numbers[:rows * side, :columns * side].reshape(rows, side, columns, side).swapaxes(1, 2)
    found = []
    for box in boxes.reshape(rows * columns, side * side):
        if outside not in box:
            shares = np.unique(box, return_counts=True)[1] / len(box)
            found.append(float(-np.sum(shares * np.log(shares))) if len(shares) > 1 else 0.0)
    if not found:
        return None
    entropies = np.array(found)
    mixed = entropies > 0.0
    boundary = float(entropies[mixed].mean()) if mixed.any() else math.nan
    return BasinEntropy(float(entropies.mean()), boundary, len(entropies), int(mixed.sum()))


#: Numbers of starts that have none of the motions: nothing had settled; the start cannot be, or could not go on; the
#: motion is none of the first `MOST_MOTIONS`.
UNSETTLED, NOWHERE, UNTOLD = 0, -1, -2
#: Most motions that get a number. Without losses every start has one of its own.
MOST_MOTIONS = 64
_CLOUD = 4096  # states that tell a motion which does not repeat itself, and turns before them


@dataclass(frozen=True)
class Found:
    """What all starts lead to.

    Attributes
    ----------
    attractors : list of Attractor
        The motion with most starts first; of equal ones the one that was met first.
    numbers : ndarray of int, shape (starts,)
        Place of each start's attractor, counted from 1; or `UNSETTLED`, `NOWHERE`, `UNTOLD`.
    """

    attractors: list[Attractor]
    numbers: np.ndarray


def found_in(table: pa.Table, stroboscope: Stroboscope) -> Found:
    """The attractors of all rows, which a study of starts has written.

    Rows are judged in their order, so that the outcome does not depend on who computed them.
    """
    numbers, motions = _compared(table, stroboscope)
    count = np.array([np.sum(numbers == number) for number in range(1, len(motions) + 1)], dtype=int)
    order, possible = np.argsort(-count, kind="stable"), int(np.sum(numbers != NOWHERE))
    renumbered, attractors = numbers.copy(), []
    with Progress("motions measured", "motion", len(motions)) as progress:
        for place, old in enumerate(order, 1):
            renumbered[numbers == old + 1] = place
            motion, starts = motions[old], int(count[old])
            attractors.append(measured(Attractor(motion.turns, motion.mean_speed, 0.0, starts, *share_of(
                starts, possible), states=motion.states), stroboscope.turn_map))
            progress.add(1)
    return Found(attractors, renumbered)


def _compared(table: pa.Table, stroboscope: Stroboscope) -> tuple[np.ndarray, list[SettledMotion]]:
    """A number for each row, counted from 1, and the motions in the order of these numbers: periodic ones first."""
    turns, dimension = table["turns"].to_pylist(), len(stroboscope.turn_map.names)
    numbers = np.array([UNTOLD if period is not None else UNSETTLED for period in turns])
    numbers[np.array([error is not None for error in table["error"].to_pylist()])] = NOWHERE
    lists = table["states"].combine_chunks()
    first, values = lists.offsets.to_numpy(), lists.values.to_numpy().reshape(-1, dimension)
    met: list[SettledMotion] = []
    for period in sorted({period for period in turns if period is not None}, key=lambda period: (period == 0, period)):
        rows = np.flatnonzero([one == period for one in turns])
        width = (first[rows[0] + 1] - first[rows[0]]) // dimension
        states = values[(first[rows] // dimension)[:, None] + np.arange(width)]
        with Progress("starts compared", "start", len(rows)) as progress:
            for chosen, motion in _groups(states, period, stroboscope):
                progress.add(len(chosen))
                if motion is None:
                    numbers[rows[chosen]] = UNSETTLED
                    continue
                known = number_among(motion, met)
                if known is None and len(met) < MOST_MOTIONS:
                    known = len(met)
                    met.append(motion)
                numbers[rows[chosen]] = UNTOLD if known is None else known + 1
    return numbers, met


def _groups(states: np.ndarray, period: int,
            stroboscope: Stroboscope) -> Iterator[tuple[np.ndarray, SettledMotion | None]]:
    """Places of rows with the same motion, and the motion; `states` has shape (rows, m, n).

    After `MOST_MOTIONS` groups all that is left comes as one, with the motion of its first row.
    """
    left = np.arange(len(states))
    for group in range(MOST_MOTIONS + 1):
        if not len(left):
            return
        state = states[left[0], -1]
        motion: SettledMotion | None
        if period:
            stroboscope.begin(state)
            seen = stroboscope.turns(period)
            motion = SettledMotion(period, seen.states, float(seen.positions[-1] / seen.times[-1]), period,
                                   tolerance_of(stroboscope.turn_map.scene))
        else:
            motion = _wandering(state, stroboscope)
        if group == MOST_MOTIONS:
            same = np.ones(len(left), dtype=bool)
        elif period and motion:
            apart = [np.abs(states[left, 0] - one).max(axis=1) for one in motion.states]
            same = np.min(apart, axis=0) <= motion.tolerance
        elif motion and not motion.turns:
            same = Cloud(motion.states).holds(states[left])
        else:
            same = np.zeros(len(left), dtype=bool)
        same[0] = True
        yield left[same], motion
        left = left[~same]


def _wandering(state: np.ndarray, stroboscope: Stroboscope) -> SettledMotion | None:
    """The motion that goes on from a state of one without a period, once more as long: chaos may end late."""
    stroboscope.begin(state)
    motion = settle(stroboscope, _CLOUD, _CLOUD)
    if motion is None or motion.turns:
        return motion
    seen = stroboscope.turns(_CLOUD)
    gone, lasted = (float(one[-1] - one[0]) for one in (seen.positions, seen.times))
    return SettledMotion(0, seen.states, gone / lasted, _CLOUD, motion.tolerance)
