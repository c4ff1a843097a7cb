"""Guards: the guard of the mode that turns negative first, and its root.

`find_next_event` makes a polynomial of each guard and keeps the earliest root. `first_root` proves that its root is the
first: no crossing is stepped over, and a graze is distinguished from a hit.
"""

import math

import numpy as np

from vibro_ros.solver.polynomial import (
    SECOND,
    differentiate,
    divide_by_root,
    fill_form,
    sum_of_magnitudes,
    value,
    value_and_derivatives,
)
from vibro_ros.solver.state import UNKNOWN, State
from vibro_ros.solver.system import NOTHING, System, sparse_magnitude, value_and_magnitude
from vibro_ros.solver.typed import Row, Rows, part
from vibro_ros.solver.vector import LENGTH, first_index, indices_above, magnitudes, store, total, vector

EPSILON = 2.220446049250313e-16
#: Rounding error of a guard over the magnitude of its terms; a guard is a sum of products of the series' first terms.
NOISE = 16.0 * EPSILON

# Events in a row at one instant after which a guard must be below zero by more than its rounding error, because modes
# whose guards contradict each other within that error would alternate for ever.
_EVENTS_BEFORE_DOUBT = 10
_DOUBT = 8.0  # by how many rounding errors
# Roots no further apart than rounding are simultaneous: the guard that comes first in the mode's list fires.
_SIMULTANEOUS = 16.0 * EPSILON


@part
def guard_value(system: System, row: int, point: Row, magnitude: Row) -> tuple[float, float]:
    """Value of a guard row at a point and its rounding error, from the magnitude of the terms of each channel."""
    total, terms = value_and_magnitude(system.guards.form[row], system.guards.terms[row], point, magnitude)
    return total, NOISE * terms


@part
def _guard_root(system: System, state: State, row: int) -> float:
    """Return the first root of a guard row between the mode's start and the next event; cached until its polynomial
    changes."""
    segment, guard = state.segment, state.scratch.guard
    if state.root[row] > segment.mode_start:
        return state.root[row]
    fill_form(system.guards.form[row], system.guards.terms[row], state.z, guard)
    noise = NOISE * sparse_magnitude(system.guards.form[row], system.guards.terms[row], state.magnitude)
    if state.automaton.events_without_progress > _EVENTS_BEFORE_DOUBT:
        guard[0] += _DOUBT * noise
    root = first_root(guard, segment.mode_start, segment.next_event, noise, state.scratch.search)
    state.root[row] = UNKNOWN if root == NO_ROOT and segment.next_event < 1.0 else root
    return root


@part
def find_next_event(system: System, state: State) -> bool:
    """Set the next event to the earliest root of the mode's guards, else to the segment's end; return False if a root
    search failed."""
    segment, automaton = state.segment, state.automaton
    segment.next_event = 1.0
    automaton.guard = NOTHING
    for g in range(system.guards.row.shape[1]):
        row = system.guards.row[automaton.mode, g]
        if row == NOTHING:
            break
        root = _guard_root(system, state, row)
        if root == SEARCH_FAILED:
            return False
        if root != NO_ROOT and (root < segment.next_event - _SIMULTANEOUS or automaton.guard == NOTHING):
            segment.next_event = root
            automaton.guard = g
    return True


#: Returned when a guard stays non-negative to the end of the segment.
NO_ROOT = 2.0
#: Returned when the search does not end, which a finite polynomial cannot cause.
SEARCH_FAILED = -3.0

_MOST_STEPS = 100_000
# A guard that only touches zero is a graze, not a hit; this much below zero, over the sum of its terms, is rounding.
_TOUCH = 4.0 * 2.2e-16
_ULP_OF_ONE = 2.3e-16
#: A guard that starts at zero to this order, at a rest or a release, stays zero, because nothing moves it.
_DEEPEST_ZERO = 5
# A zero is known up to the noise, and the next coefficients may contain four times the noise, because a flow's series
# falls no faster than 2^n / n!. If this noise counted, rounding would push a mass at rest off its plate.
_ECHO = 4.0
# Smaller guards, of a motion that has died away, count as zero, because their squares would underflow.
_VANISHING = 1e-100

# A guard is evaluated at these nodes first; row n has the n-th powers of the nodes.
_NODES = np.linspace(-1.0, 1.0, LENGTH)
_SPACING = 2.0 / (LENGTH - 1)
_POWERS_OF_NODES = np.cumprod(np.vstack([np.ones(LENGTH), *[_NODES] * (LENGTH - 1)]), axis=0)
# The slope between two nodes differs from the mean slope by at most 4 bends over their distance, so with a drop of this
# many bends the slope has one sign, with a margin.
_FALLS = 5.0
# Halley's step leaves the cube of the distance to the root, times (p''/2p')² - p'''/6p', which is about 2000 at most
# where `_search` uses it. After a step shorter than this, the distance is below rounding.
_LAST_STEP = 2e-7
_MOST_HALLEY_STEPS = 20

_ORDER = np.arange(LENGTH)
_THIRD = (_ORDER * (_ORDER - 1) * (_ORDER - 2)).astype(float)
# On [-1, 1] an odd term is at least -|p|, and an even one at least min(p, 0) = (p - |p|) / 2; a bound of a polynomial
# without its parabola, the first three terms.
_SHARE_OF_VALUE = np.where((_ORDER > 2) & (_ORDER % 2 == 0), 0.5, 0.0)
_SHARE_OF_MAGNITUDE = np.where(_ORDER > 2, 1.0 - _SHARE_OF_VALUE, 0.0)


@part
def _safe_step(f: float, d: float, dd: float, third: float, reach: float) -> float:
    """Return the s up to which f + d s + dd s²/2 - third s³/6, a lower bound of the guard, stays positive in `reach`.

    On [0, reach] the cubic term is at least -(third reach / 6) s², which leaves a quadratic.
    """
    m = 0.5 * dd - third * reach / 6.0
    if m >= 0.0 and d >= 0.0:
        return reach
    discriminant = d * d - 4.0 * m * f
    if discriminant < 0.0:
        return reach
    root = math.sqrt(discriminant)
    # The quadratic's root, written so that nothing cancels.
    if d < 0.0:
        return min(reach, 2.0 * f / (root - d))
    return min(reach, (d + root) / (-2.0 * m)) if root > 0.0 else reach  # the root is 0 if squares underflow


@part
def _lower_bound(sign: float, p: Row, a: float, b: float) -> float:
    """A value below sign * p everywhere on [a, b]: the least value of the parabola, and a bound of the other terms."""
    terms, constant, slope, bend = sign * vector(p), sign * p[0], sign * p[1], sign * p[2]
    least = min(constant + a * (slope + a * bend), constant + b * (slope + b * bend))
    if -2.0 * bend * b < slope < -2.0 * bend * a:  # the parabola's lowest point lies between
        least = constant - 0.5 * slope * (0.5 * slope / bend)
    return least + total(vector(_SHARE_OF_VALUE) * terms - vector(_SHARE_OF_MAGNITUDE) * magnitudes(terms))


@part
def _passed_touch(p: Row, f: float, d: float, dd: float) -> float:
    """Return the step from f <= 0 that passes a minimum that is zero to rounding; 0 if p falls below that."""
    doubt = _TOUCH * sum_of_magnitudes(p)
    if dd <= 0.0 or 2.0 * dd * (f + doubt) < d * d:
        return 0.0
    return (math.sqrt(d * d + 2.0 * dd * (2.0 * doubt - f)) - d) / dd


@part
def _march(p: Row, a: float, limit: float) -> float:
    """Return the first root of p, positive at a, in (a, limit], by steps that a bound on p''' proves free of roots.

    Near a simple root the steps converge faster than Newton's, from the safe side; a near miss
    (p > 0 at its minimum) is passed in a few steps, because its curvature is in the bound.
    """
    third = total(vector(_THIRD) * magnitudes(vector(p)))  # a bound of |p'''| on [-1, 1]
    x = a
    reach = limit - x
    for _ in range(_MOST_STEPS):
        f, d, dd = value_and_derivatives(p, x)
        if f <= 0.0:
            beyond = _passed_touch(p, f, d, dd)
            if beyond == 0.0:
                return x
            x += beyond
            reach = limit - x
            if reach < 0.0:
                return NO_ROOT
            continue
        # A shorter reach gives a closer bound; a root is hardly farther than twice the distance to the tangent's root.
        if x > a and 2.0 * f < -d * reach:
            reach = -2.0 * f / d
        step = _safe_step(f, d, dd, third, reach)
        if step >= limit - x:
            return NO_ROOT
        # If the bound was too loose, try twice the proved step as the reach, as long as all of it proves safe.
        proved = step
        while proved == step and 2.0 * step < reach:
            proved = 2.0 * step
            step = max(step, _safe_step(f, d, dd, third, proved))
        x += max(step, _ULP_OF_ONE)
        reach = limit - x
        if reach < 0.0:
            return NO_ROOT
    return SEARCH_FAILED


@part
def _evaluate_at_nodes(p: Row, noise: float, values: Row) -> float:
    """Fill `values` with p at all nodes; return by how much p may leave the range of two neighbouring values."""
    even, odd = p[0] * vector(_POWERS_OF_NODES[0]), p[1] * vector(_POWERS_OF_NODES[1])
    for n in range(2, LENGTH, 2):
        even = even + p[n] * vector(_POWERS_OF_NODES[n])
        odd = odd + p[n + 1] * vector(_POWERS_OF_NODES[n + 1])
    store(values, even + odd)
    bound = total(vector(SECOND) * magnitudes(vector(p)))  # of |p''| on [-1, 1]
    return 0.125 * _SPACING * _SPACING * bound + noise


@part
def _next_node(x: float) -> int:
    """Return the index of the first node beyond x < 1."""
    k = int((x + 1.0) / _SPACING)
    while _NODES[k] <= x:
        k += 1
    return k


@part
def _only_root(p: Row, left: float, right: float, start: float) -> float:
    """Return the root of p in [left, right], where p falls all the way, by Halley's method from `start`; `NO_ROOT` if
    the steps do not converge."""
    x = start
    for _ in range(_MOST_HALLEY_STEPS):
        f, d, dd = value_and_derivatives(p, x)
        step = 2.0 * f * d / (2.0 * d * d - f * dd)
        x = min(max(x - step, left), right)
        if abs(step) < _LAST_STEP:
            return x
    return NO_ROOT


@part
def _search(p: Row, a: float, f: float, limit: float, noise: float, values: Row) -> float:
    """Return the first root of p, which is f > 0 at a, in (a, limit]."""
    bend = _evaluate_at_nodes(p, noise, values)
    first = _next_node(a)
    # p stays positive up to node k - 1.
    k = first if f <= bend else first_index(~indices_above(vector(values), bend) >> first << first)
    left, at_left = a, f
    if k != first:
        left, at_left = _NODES[k - 1], values[k - 1]
    if k >= LENGTH or left >= limit:
        return NO_ROOT
    right, drop = _NODES[k], at_left - values[k]
    if values[k] < 0.0 and drop > _FALLS * bend:
        root = _only_root(p, left, right, left + (right - left) * at_left / drop)
        if root != NO_ROOT:
            return root if root <= limit else NO_ROOT
    return _march(p, left, limit)


@part
def first_root(p: Row, a: float, limit: float, noise: float, work: Rows) -> float:
    """Return the first local time in [a, limit] at which the guard p turns negative.

    A zero at `a` itself is divided out as often as necessary, so that the sign of the first coefficient that differs
    from zero decides. A guard that has just fired, or that starts at rest on its boundary, therefore neither fires
    again and again nor hides its next root.

    Parameters
    ----------
    p : ndarray, shape (LENGTH,)
        The guard, which a valid mode keeps non-negative.
    a : float
        Local time (dimensionless) at which the mode starts, -1 <= a < 1.
    limit : float
        Local time (dimensionless) at which the search ends, a < limit <= 1.
    noise : float
        Rounding error of the guard, in the guard's unit; smaller values count as zero.
    work : ndarray, shape (2, LENGTH)
        Overwritten.

    Returns
    -------
    float
        The local time (dimensionless); `a` when the guard is negative from the start; `NO_ROOT`; or `SEARCH_FAILED`.
    """
    noise = max(noise, _VANISHING)
    guard, values = work[0], work[1]
    store(guard, vector(p))
    hidden = noise
    for _ in range(_DEEPEST_ZERO):
        if _lower_bound(1.0, guard, a, limit) > hidden:
            return NO_ROOT
        f = value(guard, a)
        if f > hidden:
            return _search(guard, a, f, limit, noise, values)
        if f < -hidden:
            return a
        divide_by_root(guard, a)
        hidden = _ECHO * noise
    return NO_ROOT


@part
def _highest_turning_point(p: Row, slope: Row, a: float, b: float, noise: float, work: Rows) -> float:
    """Return the largest value of p at a and at its turning points in (a, b), which are found one after the other."""
    best = -math.inf
    x = a
    while True:
        best = max(best, value(p, x))
        x = first_root(slope, x, b, noise, work)
        if x < a or x >= b:
            return best
        store(slope, -1.0 * vector(slope))


@part
def maximum(p: Row, a: float, b: float, known: float, work: Rows) -> float:
    """Return the largest of `known` and the values of p on [a, b], from the ends and every turning point between them.

    `work`, shape (3, LENGTH), is overwritten.
    """
    slope, values = work[0], work[1]
    best = max(known, value(p, a), value(p, b))
    if NOISE * sum_of_magnitudes(p) - _lower_bound(-1.0, p, a, b) < best:
        return best
    differentiate(p, 1.0, slope)
    if _lower_bound(1.0, slope, a, b) > 0.0 or _lower_bound(-1.0, slope, a, b) > 0.0:
        return best
    noise = 1e-15 * sum_of_magnitudes(slope)
    bend = _evaluate_at_nodes(slope, noise, values)
    rises, falls = indices_above(vector(values), bend), indices_above(-1.0 * vector(values), bend)
    first = _next_node(a)
    # Between two nodes of the same kind, `rises` or `falls`, the slope keeps its sign.
    turns = ~(rises & rises << 1 | falls & falls << 1) >> first << first
    while True:
        k = first_index(turns)
        if k >= LENGTH or _NODES[k - 1] >= b:
            return best
        turns &= turns - 1
        left, right, at_left, at_right = _NODES[k - 1], _NODES[k], values[k - 1], values[k]
        drop, x = at_left - at_right, NO_ROOT
        if at_left > 0.0 and at_right < 0.0 and drop > _FALLS * bend:
            x = _only_root(slope, left, right, left + _SPACING * at_left / drop)
        if x == NO_ROOT:
            return max(best, _highest_turning_point(p, slope, a, b, noise, work[1:]))
        if a < x < b:
            best = max(best, value(p, x))
