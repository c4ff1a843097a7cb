"""A driven coordinate with a decaying term: x'' = L + k f e, where e = exp(r x') decays with the speed.

L and f are linear forms of the channels, so polynomials on a segment, and r is constant in a mode. Then
w = exp(-r (x' - x'(a))), which is 1 where the mode begins, at a, obeys an equation that is linear, too,

    w' = -r (L w + k f e(a)),        e = e(a) / w,

so that free and forced series of w are found about the segment's middle. The series of 1 / w ends sooner, by the
zeros of w at complex times. Its last terms decide whether the segment is short enough.
"""

import math

from vibro_ros.solver.compilation import called_kernel, kernel
from vibro_ros.solver.flow import weighted_sum
from vibro_ros.solver.forcing import advance_forcing
from vibro_ros.solver.polynomial import (
    INVERSE,
    fill_form,
    integrate_through,
    sum_of_magnitudes,
    value,
)
from vibro_ros.solver.roots import NO_ROOT, first_root
from vibro_ros.solver.state import ANCHOR, HALF, MODE, REACH
from vibro_ros.solver.transition import EPSILON, NOISE
from vibro_ros.solver.vector import LENGTH, store, vector

# What the last terms may amount to, in parts of the magnitude of the terms that make up the acceleration.
_ALLOWED = 0.25 * EPSILON
_LAST_TERMS = 3
#: Bound of |r x'|'s change over half a segment beyond which no series is tried; 6^LENGTH / LENGTH! is not small.
_STRONGEST = 6.0
#: Where -r x' exceeds this the decay, to 4e-18, is over and left out ...
_OVER = 40.0
# ... from where it exceeds this, so that what has been left out is not needed again at once.
_WELL_OVER = 44.0
# A segment that ends where the decay begins to matter again ends before, by more than rounding.
_BEFORE = 1.0 - 1e-6
# By how much a segment's duration is changed at once, and part of what seems possible that is tried.
_SHORTER, _LONGER, _CAUTION = 0.1, 4.0, 0.9


@kernel
def _tail(p):
    total = 0.0
    for n in range(LENGTH - _LAST_TERMS, LENGTH):
        total += abs(p[n])
    return total


@kernel
def _fill_growth(load, force, exponent, anchor, growth, forced):
    """Series of w with w' = exponent (load w + force) over half a segment, 1 at `anchor`.

    `forced` is overwritten.
    """
    growth[0], forced[0] = 1.0, 0.0
    for n in range(LENGTH - 1):
        free_rate, forced_rate = 0.0, force[n]
        for j in range(n + 1):
            free_rate += load[j] * growth[n - j]
            forced_rate += load[j] * forced[n - j]
        step = exponent * INVERSE[n]
        growth[n + 1] = step * free_rate
        forced[n + 1] = step * forced_rate
    amount = (1.0 - value(forced, anchor)) / value(growth, anchor)
    store(growth, vector(forced) + amount * vector(growth))


@kernel
def _fill_reciprocal(p, target):
    """Coefficients of target = 1 / p."""
    target[0] = 1.0 / p[0]
    for n in range(1, LENGTH):
        total = 0.0
        for j in range(1, n + 1):
            total += p[j] * target[n - j]
        target[n] = -target[0] * total


@kernel
def _fill_product(p, q, target):
    """Coefficients of target = p q, cut at their length."""
    for n in range(LENGTH):
        total = 0.0
        for j in range(n + 1):
            total += p[j] * q[n - j]
        target[n] = total


@kernel
def decays(system, mode):
    """Whether the mode has a decaying term."""
    return len(system.decay.rate) > 0 and system.decay.rate[mode] != 0.0


@kernel
def known_reach(system, state):
    """Duration [s] that a segment of this mode may have, as far as is known before it is tried."""
    return state.clock[REACH] if decays(system, state.index[MODE]) else math.inf


@kernel
def _time_without(state, load, rate, speed, scale):
    """Time [s] from the anchor in which a motion too fast for the decay does without; infinite if to the end."""
    half, anchor, guard = state.clock[HALF], state.clock[ANCHOR], state.work[1]
    integrate_through(load, half, anchor, speed, guard)
    store(guard, -rate * vector(guard))
    guard[0] -= _OVER
    noise = NOISE * abs(rate) * (abs(speed) + scale * 2.0 * half)
    root = first_root(guard, anchor, 1.0, noise, state.work[2:4])
    if root == NO_ROOT:
        return math.inf
    return half * (root - anchor) * _BEFORE if root > anchor else half


@kernel
def _fill_term(state, load, factor, strength, rate, start, term):
    """Series of the term f e, `start` = e where the mode begins; returns what it and k f e, k = `strength`, leave out.

    All of `work` is overwritten; infinite if e has a pole in the first half.
    """
    growth, other = state.work[2], state.work[3]
    store(term, (strength * start) * vector(factor))
    _fill_growth(load, term, -rate * state.clock[HALF], state.clock[ANCHOR], growth, other)
    if growth[0] <= 0.0:
        return math.inf
    _fill_reciprocal(growth, other)
    _fill_product(factor, other, term)
    store(term, start * vector(term))
    by_growth = _tail(growth) * max(1.0, other[0])
    return abs(strength) * (_tail(term) + by_growth * (abs(term[0]) + abs(term[1])))


@kernel
def _resolve(system, state, point):
    """See `resolve_decay`."""
    mode = state.index[MODE]
    coordinate, channel, half = system.sizes[1], len(state.z) - 2, state.clock[HALF]
    row, rate = system.acceleration[mode, coordinate], system.decay.rate[mode]
    speed = point[system.sizes[0] + coordinate]
    load, factor, term = state.work[0], state.work[1], state.z[channel]
    term[:] = 0.0
    state.scale[channel] = 0.0
    if not fill_form(row, system.terms[mode, coordinate], state.z, load):  # of which the term is one, still zero
        load[:] = 0.0
    if -rate * speed > _WELL_OVER:
        time = _time_without(state, load, rate, speed, weighted_sum(row, state.scale))
        if time == math.inf:
            state.clock[REACH] = math.inf
        return time
    if not fill_form(system.decay.factor[mode], system.decay.terms[mode], state.z, factor):
        return math.inf
    start = math.exp(min(rate * speed, 0.0))  # a speed beyond zero is rounding
    state.scale[channel] = start * weighted_sum(system.decay.factor[mode], state.scale)
    change = half * abs(rate) * (sum_of_magnitudes(load) + abs(row[channel]) * start * sum_of_magnitudes(factor))
    if change > _STRONGEST:
        state.clock[REACH] = 2.0 * half * _CAUTION * _STRONGEST / change
        return state.clock[REACH]
    left_out = _fill_term(state, load, factor, row[channel], rate, start, term)
    allowed = _ALLOWED * weighted_sum(row, state.scale)
    share = _CAUTION * (allowed / left_out) ** (1.0 / (LENGTH - _LAST_TERMS)) if left_out > 0.0 else _LONGER
    if left_out > allowed:
        state.clock[REACH] = 2.0 * half * max(min(share, _CAUTION), _SHORTER)
        return state.clock[REACH]
    # Resolved; or a value is NaN, which the event loop will find.
    state.clock[REACH] = max(state.clock[REACH], 2.0 * half * min(share, _LONGER))
    return math.inf


@called_kernel
def resolve_decay(system, state, point):
    """Series of the decaying term of a mode that has one, through the velocity in `point` where the mode begins.

    Returns
    -------
    float
        Infinite if the series resolve the segment to rounding; else the duration [s] of one to try instead, with the
        forcing back where the mode begins.
    """
    longest = _resolve(system, state, point)
    if longest < math.inf:
        advance_forcing(system, state, state.clock[ANCHOR])  # from the cell's start, if the segment was a whole cell
    return longest
