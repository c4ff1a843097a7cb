"""The known forcing: periodic signals of the phase, and ramps, as polynomials over a segment."""

import math

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.polynomial import LENGTH, differentiate, recentre, substitute
from vibro_ros.solver.state import (
    CELL,
    CELL_TIME,
    DURATION,
    LAG,
    MODE,
    OFFSET,
    RATE,
    SPEED,
    SPEED_CHANGE,
    SPEED_TARGET,
    SPEED_TIME,
    START,
    START_RESIDUE,
    TARGET,
    TIME,
    TURNS,
    VALUE,
)
from vibro_ros.solver.system import STRIDE

#: A segment without a fast mode, a signal or a ramp to end it ends after this time [s].
_LONGEST_SEGMENT = 1.0
# While the speed changes, phase(tau) is quadratic. The series of signal(phase(tau)) reaches rounding at its last
# term when |phase - start| stays below 1/STRIDE cells for complex |tau| up to 1/STRIDE.
_REACH = 1.0 / STRIDE
# Logarithm of what may be neglected beside 1.
_ROUNDING = math.log(1e-18)
_NEGLIGIBLE = 1e-18
# Newton's method for the end of a cell: monotone after its first step, because the speed is.
_MOST_NEWTON_STEPS = 60
_NEWTON_END = 4e-16


@kernel
def _next_cell(system, state):
    state.clock[OFFSET] = 0.0
    state.index[CELL] += 1
    if state.index[CELL] == len(system.signals.start) - 1:
        state.index[CELL] = 0
        state.index[TURNS] += 1


@kernel
def _phase_after(clock, elapsed):
    """Advance of the phase [rad] in `elapsed` [s] from the segment's start, and its rate [rad/s] then."""
    speed, target, lag = clock[SPEED], clock[SPEED_TARGET], clock[LAG]
    if lag > 0.0:
        decayed = -math.expm1(-elapsed / lag)
        return target * elapsed + (speed - target) * lag * decayed, speed + (target - speed) * decayed
    change = clock[SPEED_CHANGE]
    # The speed falls to zero, never below: what is less is rounding.
    return elapsed * (speed + 0.5 * change * elapsed), max(0.0, speed + change * elapsed)


@kernel
def _ramped_time_to_cross(distance, speed, change):
    """Time [s] in which the phase advances by `distance`; infinite if it stops before."""
    discriminant = speed * speed + 2.0 * change * distance
    if discriminant < 0.0:
        return math.inf
    rate = speed + math.sqrt(discriminant)
    return 2.0 * distance / rate if rate > 0.0 else math.inf


@kernel
def _time_to_cross(clock, distance):
    """The same for any change of speed."""
    if clock[LAG] == 0.0:
        return _ramped_time_to_cross(distance, clock[SPEED], clock[SPEED_CHANGE])
    if clock[SPEED_TARGET] == 0.0 and clock[SPEED] * clock[LAG] <= distance:
        return math.inf
    time = distance / max(clock[SPEED], clock[SPEED_TARGET])
    for _ in range(_MOST_NEWTON_STEPS):
        phase, rate = _phase_after(clock, time)
        if rate <= 0.0:
            return math.inf
        step = (distance - phase) / rate
        time += step
        if abs(step) <= _NEWTON_END * time:
            break
    return time


@kernel
def _resolved_time(clock, width):
    """Longest time [s] over which the series of the signals resolves a changing speed."""
    if clock[LAG] > 0.0:
        # For complex times up to 1/STRIDE segments the decay grows by e at most, and the phase with it.
        fastest = max(clock[SPEED], clock[SPEED_TARGET])
        return STRIDE * min(clock[LAG], _REACH * width / (2.0 * math.e * fastest))
    return STRIDE * _ramped_time_to_cross(_REACH * width, clock[SPEED], abs(clock[SPEED_CHANGE]))


@kernel
def _fill_phase(clock, width, series):
    """Phase past the segment's start in cells, as a series over the segment; returns its number of terms."""
    duration = clock[DURATION]
    series[:] = 0.0
    series[1] = clock[SPEED] * duration / width
    if clock[LAG] == 0.0:
        series[2] = 0.5 * clock[SPEED_CHANGE] * duration * duration / width
        return 2 if series[2] == 0.0 else 3
    shrink = duration / clock[LAG]
    series[2] = 0.5 * (clock[SPEED_TARGET] - clock[SPEED]) * shrink * duration / width
    terms = 3
    while terms < LENGTH and abs(series[terms - 1]) > _NEGLIGIBLE:
        series[terms] = -series[terms - 1] * shrink / terms
        terms += 1
    return terms


@kernel
def choose_duration(system, state):
    """Set the segment's duration: to the end of the cell or of a ramp, or to what the series resolves."""
    clock = state.clock
    start = system.signals.start
    width = start[state.index[CELL] + 1] - start[state.index[CELL]]
    if clock[OFFSET] >= width:
        _next_cell(system, state)
        width = start[state.index[CELL] + 1] - start[state.index[CELL]]
    clock[CELL_TIME] = _time_to_cross(clock, width - clock[OFFSET])
    duration = min(_LONGEST_SEGMENT, system.longest_step[state.index[MODE]], clock[CELL_TIME])
    if clock[SPEED_TIME] > 0.0:
        duration = min(duration, clock[SPEED_TIME], _resolved_time(clock, width))
    for k in range(len(state.ramp)):
        if state.ramp[k, RATE] != 0.0:
            duration = min(duration, state.ramp[k, TIME])
    clock[DURATION] = duration


@kernel
def _terms(cells):
    """Terms of a signal's series that matter over a segment which spans this many cells: their sizes fall as
    (STRIDE cells)^n."""
    ratio = STRIDE * cells
    if ratio <= 0.0:
        return 1
    return min(LENGTH, int(_ROUNDING / math.log(ratio)) + 2) if ratio < 0.2 else LENGTH


@kernel
def fill_forcing(system, state):
    """Polynomials of the signals, the ramps and their rates over the segment."""
    clock, z = state.clock, state.z
    first, signals, ramps = 2 * system.sizes[0] + system.sizes[1], system.sizes[2], system.sizes[3]
    cell = state.index[CELL]
    width = system.signals.start[cell + 1] - system.signals.start[cell]
    duration = clock[DURATION]
    phase = state.work[1]
    phase_terms = _fill_phase(clock, width, phase)
    reach = 0.0
    for n in range(1, phase_terms):
        reach += n * abs(phase[n])
    terms = _terms(reach)
    for k in range(signals):
        channel = first + k
        series = system.signals.series[cell, k]
        if clock[OFFSET] > 0.0:
            recentre(series, clock[OFFSET] / width, terms, state.work[0])
            series = state.work[0]
        substitute(series, phase, phase_terms, z[channel])
        differentiate(z[channel], duration, z[channel + signals])
    for k in range(ramps):
        channel = first + 2 * signals + k
        z[channel, 0] = state.ramp[k, VALUE]
        z[channel, 1] = state.ramp[k, RATE] * duration
        z[channel + ramps, 0] = state.ramp[k, RATE]
    z[len(z) - 1, 0] = 1.0
    for channel in range(first, len(z)):
        state.scale[channel] = abs(z[channel, 0]) + abs(z[channel, 1])


@kernel
def advance_clock(state, elapsed):
    """Move the segment's start by `elapsed` [s] and keep what rounding takes from the sum."""
    clock = state.clock
    increment = elapsed + clock[START_RESIDUE]
    total = clock[START] + increment
    clock[START_RESIDUE] = increment - (total - clock[START])
    clock[START] = total


@kernel
def advance_forcing(system, state, tau):
    """Move phase and ramps to `tau` of the segment.

    Returns
    -------
    int
        Bit k is set when ramp k has reached its target, the bit after the last ramp when the speed has.
    """
    clock = state.clock
    elapsed = clock[DURATION] * tau
    at_end = tau == 1.0
    advance, speed = _phase_after(clock, elapsed)
    if at_end and elapsed == clock[CELL_TIME]:
        _next_cell(system, state)
    else:
        clock[OFFSET] += advance
    reached = 0
    if clock[SPEED_TIME] > 0.0:
        clock[SPEED] = speed
        clock[SPEED_TIME] -= elapsed
        if clock[SPEED_TIME] <= 0.0:
            clock[SPEED] = clock[SPEED_TARGET]
            clock[SPEED_CHANGE] = clock[LAG] = clock[SPEED_TIME] = 0.0
            reached |= 1 << len(state.ramp)
    for k in range(len(state.ramp)):
        if state.ramp[k, RATE] != 0.0:
            state.ramp[k, VALUE] += state.ramp[k, RATE] * elapsed
            state.ramp[k, TIME] -= elapsed
            if state.ramp[k, TIME] <= 0.0:
                state.ramp[k, VALUE] = state.ramp[k, TARGET]
                state.ramp[k, RATE] = 0.0
                reached |= 1 << k
    advance_clock(state, elapsed)
    return reached


@kernel
def phase_at(system, state, tau):
    """Phase past the start of the turn [rad] and its rate [rad/s] at `tau` of the segment."""
    clock = state.clock
    advance, speed = _phase_after(clock, clock[DURATION] * tau)
    return system.signals.start[state.index[CELL]] + clock[OFFSET] + advance, speed
