"""The known forcing: periodic signals of the phase, and ramps, as polynomials over a segment."""

import math

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.polynomial import LENGTH, differentiate, recentre, substitute
from vibro_ros.solver.state import (
    CELL,
    CELL_TIME,
    DURATION,
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


@kernel
def _next_cell(system, state):
    state.clock[OFFSET] = 0.0
    state.index[CELL] += 1
    if state.index[CELL] == len(system.signals.start) - 1:
        state.index[CELL] = 0
        state.index[TURNS] += 1


@kernel
def _time_to_cross(distance, speed, change):
    """Time [s] in which the phase advances by `distance`; infinite if it stops before."""
    discriminant = speed * speed + 2.0 * change * distance
    if discriminant < 0.0:
        return math.inf
    rate = speed + math.sqrt(discriminant)
    return 2.0 * distance / rate if rate > 0.0 else math.inf


@kernel
def choose_duration(system, state):
    """Set the segment's duration: to the end of the cell or of a ramp, or to what the series resolves."""
    clock = state.clock
    start = system.signals.start
    width = start[state.index[CELL] + 1] - start[state.index[CELL]]
    if clock[OFFSET] >= width:
        _next_cell(system, state)
        width = start[state.index[CELL] + 1] - start[state.index[CELL]]
    clock[CELL_TIME] = _time_to_cross(width - clock[OFFSET], clock[SPEED], clock[SPEED_CHANGE])
    duration = min(_LONGEST_SEGMENT, system.longest_step[state.index[MODE]], clock[CELL_TIME])
    if clock[SPEED_CHANGE] != 0.0:
        resolved = STRIDE * _time_to_cross(_REACH * width, clock[SPEED], abs(clock[SPEED_CHANGE]))
        duration = min(duration, clock[SPEED_TIME], resolved)
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
    a = clock[SPEED] * duration / width
    b = 0.5 * clock[SPEED_CHANGE] * duration * duration / width
    terms = _terms(a + 2.0 * abs(b))
    for k in range(signals):
        channel = first + k
        series = system.signals.series[cell, k]
        if clock[OFFSET] > 0.0:
            recentre(series, clock[OFFSET] / width, terms, state.work[0])
            series = state.work[0]
        substitute(series, a, b, z[channel])
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
    if at_end and elapsed == clock[CELL_TIME]:
        _next_cell(system, state)
    else:
        clock[OFFSET] += elapsed * (clock[SPEED] + 0.5 * clock[SPEED_CHANGE] * elapsed)
    reached = 0
    if clock[SPEED_CHANGE] != 0.0:
        clock[SPEED] += clock[SPEED_CHANGE] * elapsed
        clock[SPEED_TIME] -= elapsed
        if clock[SPEED_TIME] <= 0.0:
            clock[SPEED] = clock[SPEED_TARGET]
            clock[SPEED_CHANGE] = 0.0
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
    elapsed = clock[DURATION] * tau
    phase = system.signals.start[state.index[CELL]] + clock[OFFSET]
    phase += elapsed * (clock[SPEED] + 0.5 * clock[SPEED_CHANGE] * elapsed)
    return phase, clock[SPEED] + clock[SPEED_CHANGE] * elapsed
