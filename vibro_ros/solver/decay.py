"""A driven coordinate with a decaying term: x'' = L + k f e, where e = exp(r x') decays with the speed.

L and f are linear forms of the channels, so polynomials on a segment, and r is constant in a mode. Then
w = exp(-r (x' - x'(a))), which is 1 at a, where the mode starts, obeys an equation that is linear, too,

    w' = -r (L w + k f e(a)),        e = e(a) / w,

so that free and forced series of w are found about the segment's middle. The series of 1 / w ends sooner, by the
zeros of w at complex times. Its last terms decide whether the segment is short enough.
"""

import math

from vibro_ros.solver.compilation import called_kernel, kernel
from vibro_ros.solver.forcing import advance_forcing
from vibro_ros.solver.guards import EPSILON, NOISE
from vibro_ros.solver.linear_forms import form_magnitude
from vibro_ros.solver.polynomial import INVERSE, fill_form, integrate_through, sum_of_magnitudes, value
from vibro_ros.solver.roots import NO_ROOT, first_root
from vibro_ros.solver.vector import LENGTH, store, vector

# Largest sum of the last terms, in parts of the magnitude of the terms that make up the acceleration.
_ALLOWED = 0.25 * EPSILON
_LAST_TERMS = 3
#: Bound of |r x'|'s change over half a segment beyond which no series is tried; 6^LENGTH / LENGTH! is not small.
_STRONGEST = 6.0
#: Where -r x' exceeds this, e has decayed to 4e-18 and may be left out ...
_OVER = 40.0
# ... and e is left out from here on, so that it is not needed again at once.
_WELL_OVER = 44.0
# A segment without e ends before e matters again, by more than rounding.
_BEFORE = 1.0 - 1e-6
# Least and greatest factor by which a segment's duration changes at once, and the part of the possible that is tried.
_SHORTER, _LONGER, _CAUTION = 0.1, 4.0, 0.9


@kernel
def _tail(p):
    total = 0.0
    for n in range(LENGTH - _LAST_TERMS, LENGTH):
        total += abs(p[n])
    return total


@kernel
def _fill_growth(load, force, exponent, start, growth, forced):
    """Series of w with w' = exponent (load w + force) over half a segment, 1 at the local time `start`.

    `forced` receives the series that is 0 in the middle.
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
    amount = (1.0 - value(forced, start)) / value(growth, start)
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
def known_duration(system, state):
    """Duration [s] that a segment of this mode may have, as far as is known before the segment is tried."""
    return state.now[0].segment.decay_duration if decays(system, state.now[0].automaton.mode) else math.inf


@kernel
def _time_without(state, load, rate, speed, scale):
    """Time [s] from the mode's start in which the motion is too fast for the decay to matter; infinite if to the end
    of the segment."""
    half, start, room = state.now[0].segment.half, state.now[0].segment.mode_start, state.scratch.room[0]
    guard = room.guard[:]
    integrate_through(load, half, start, speed, guard)
    store(guard, -rate * vector(guard))
    guard[0] -= _OVER
    noise = NOISE * abs(rate) * (abs(speed) + scale * 2.0 * half)
    root = first_root(guard, start, 1.0, noise, room.search[:])
    if root == NO_ROOT:
        return math.inf
    return half * (root - start) * _BEFORE if root > start else half


@kernel
def _fill_term(state, load, factor, strength, rate, start, term):
    """Fill `term` with the series of f e, `start` = e at the mode's start; return what `strength` times it leaves out.

    Infinite if e has a pole in the first half.
    """
    room = state.scratch.room[0]
    growth, reciprocal = room.growth[:], room.reciprocal[:]
    store(term, (strength * start) * vector(factor))
    exponent = -rate * state.now[0].segment.half
    _fill_growth(load, term, exponent, state.now[0].segment.mode_start, growth, room.forced_growth[:])
    if growth[0] <= 0.0:
        return math.inf
    _fill_reciprocal(growth, reciprocal)
    _fill_product(factor, reciprocal, term)
    store(term, start * vector(term))
    by_growth = _tail(growth) * max(1.0, reciprocal[0])
    return abs(strength) * (_tail(term) + by_growth * (abs(term[0]) + abs(term[1])))


@kernel
def _resolve(system, state, point):
    """See `resolve_decay`."""
    mode, segment, room = state.now[0].automaton.mode, state.now[0].segment, state.scratch.room[0]
    coordinate, channel, half = system.size[0].dynamic, len(state.z) - 2, segment.half
    row, rate = system.acceleration[mode, coordinate], system.decay.rate[mode]
    speed = point[system.size[0].coordinates + coordinate]
    load, factor, term = room.decay_load[:], room.decay_factor[:], state.z[channel]
    term[:] = 0.0
    state.scale[channel] = 0.0
    if not fill_form(row, system.terms[mode, coordinate], state.z, load):  # of which the term is one, still zero
        load[:] = 0.0
    if -rate * speed > _WELL_OVER:
        time = _time_without(state, load, rate, speed, form_magnitude(row, state.scale))
        if time == math.inf:
            segment.decay_duration = math.inf
        return time
    if not fill_form(system.decay.factor[mode], system.decay.terms[mode], state.z, factor):
        return math.inf
    start = math.exp(min(rate * speed, 0.0))  # a speed beyond zero is rounding
    state.scale[channel] = start * form_magnitude(system.decay.factor[mode], state.scale)
    change = half * abs(rate) * (sum_of_magnitudes(load) + abs(row[channel]) * start * sum_of_magnitudes(factor))
    if change > _STRONGEST:
        segment.decay_duration = 2.0 * half * _CAUTION * _STRONGEST / change
        return segment.decay_duration
    left_out = _fill_term(state, load, factor, row[channel], rate, start, term)
    allowed = _ALLOWED * form_magnitude(row, state.scale)
    share = _CAUTION * (allowed / left_out) ** (1.0 / (LENGTH - _LAST_TERMS)) if left_out > 0.0 else _LONGER
    if left_out > allowed:
        segment.decay_duration = 2.0 * half * max(min(share, _CAUTION), _SHORTER)
        return segment.decay_duration
    # Resolved; or a value is NaN, which the event loop will find.
    segment.decay_duration = max(segment.decay_duration, 2.0 * half * min(share, _LONGER))
    return math.inf


@called_kernel
def resolve_decay(system, state, point):
    """Series of the decaying term of a mode that has one, through the velocity in `point` at the mode's start.

    Returns
    -------
    float
        Infinite if the series resolve the segment to rounding; else the duration [s] of one to try instead, with the
        forcing back at the mode's start.
    """
    longest = _resolve(system, state, point)
    if longest < math.inf:
        # From the cell's start, if the segment was a cell.
        advance_forcing(system, state, state.now[0].segment.mode_start)
    return longest
