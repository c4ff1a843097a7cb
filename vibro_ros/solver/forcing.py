"""The known forcing: periodic signals of the phase, and ramps, as polynomials over a segment."""

import math

from vibro_ros.solver.compilation import entry_kernel, kernel
from vibro_ros.solver.polynomial import (
    differentiate,
    recentre,
    scale_argument,
    substitute,
    value,
)
from vibro_ros.solver.state import (
    ANCHOR,
    CELL,
    CELL_TIME,
    ENTRANCE,
    HALF,
    LAG,
    MODE,
    OFFSET,
    RATE,
    SLOT,
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
    VERSION,
)
from vibro_ros.solver.system import CELL_RATE, STRIDE
from vibro_ros.solver.vector import LENGTH, store, vector

#: A segment without a fast mode, a signal or a ramp to end it ends after this time [s].
_LONGEST_SEGMENT = 1.0
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
def _resolved_time(clock, reach):
    """Longest time [s] over which a signal's series in time reaches rounding at its last term: the phase stays within
    `reach` for complex times up to 1/STRIDE halves of the segment."""
    change = clock[SPEED_CHANGE]
    if clock[LAG] > 0.0:
        # For complex times up to 1/STRIDE half segments the decay grows by e at most, and the phase with it.
        fastest = max(clock[SPEED], clock[SPEED_TARGET])
        return 2.0 * STRIDE * min(clock[LAG], reach / (2.0 * math.e * fastest))
    # By the middle, STRIDE of that time away, the speed has risen.
    change_from_middle = abs(change) + 2.0 * STRIDE * max(change, 0.0)
    return 2.0 * STRIDE * _ramped_time_to_cross(reach, clock[SPEED], change_from_middle)


@kernel
def _fill_phase(clock, width, series):
    """Phase from the middle of the cell in halves of it, as a series over the segment; returns its number of terms."""
    half = clock[HALF]
    advance, speed = _phase_after(clock, half)
    series[:] = 0.0
    series[0] = 2.0 * (clock[OFFSET] + advance) / width - 1.0
    series[1] = speed * half * 2.0 / width
    if clock[LAG] == 0.0:
        series[2] = clock[SPEED_CHANGE] * half * half / width
        return 2 if series[2] == 0.0 else 3
    shrink = half / clock[LAG]
    series[2] = (clock[SPEED_TARGET] - speed) * shrink * half / width
    terms = 3
    while terms < LENGTH and abs(series[terms - 1]) > _NEGLIGIBLE:
        series[terms] = -series[terms - 1] * shrink / terms
        terms += 1
    return terms


@kernel
def _spans_cell(system, state, width, longest):
    """Whether a segment may be the whole cell: at a steady speed that the flow's series can follow so far."""
    clock = state.clock
    if clock[SPEED] <= 0.0 or clock[SPEED_TIME] > 0.0:
        return False
    duration = width / clock[SPEED]
    if duration > min(_LONGEST_SEGMENT, CELL_RATE * system.longest_step[state.index[MODE]], longest):
        return False
    left = (width - clock[OFFSET]) / clock[SPEED]
    for k in range(len(state.ramp)):
        if state.ramp[k, RATE] != 0.0 and state.ramp[k, TIME] <= left:
            return False
    return True


@kernel
def place_of(state, time):
    """Where in the segment (-1 to 1) the instant `time` [s] is."""
    return ((time - state.clock[START]) - state.clock[START_RESIDUE]) / state.clock[HALF] - 1.0


@kernel
def _return_to_cell(state):
    """Move the segment's start back to the start of the cell and the anchor to where the start was."""
    clock = state.clock
    now, residue, back = clock[START], clock[START_RESIDUE], clock[OFFSET] / clock[SPEED]
    clock[OFFSET] = 0.0
    advance_clock(state, -back)
    clock[ANCHOR] = ((now - clock[START]) + (residue - clock[START_RESIDUE])) / clock[HALF] - 1.0
    for k in range(len(state.ramp)):
        if state.ramp[k, RATE] != 0.0:
            state.ramp[k, VALUE] -= state.ramp[k, RATE] * back
            state.ramp[k, TIME] += back


@kernel
def choose_segment(system, state, longest):
    """Set the segment's extent, at most `longest` [s], and where in it the flow begins.

    It is the whole cell where the flow's series reaches so far, with the flow entering on the way, so that the
    series of the cell serve again; else it begins now and ends with the cell or a ramp, or where a series ends.
    """
    clock = state.clock
    start = system.signals.start
    width = start[state.index[CELL] + 1] - start[state.index[CELL]]
    if clock[OFFSET] >= width:
        _next_cell(system, state)
        width = start[state.index[CELL] + 1] - start[state.index[CELL]]
    clock[ANCHOR] = -1.0
    if _spans_cell(system, state, width, longest):
        clock[CELL_TIME] = duration = width / clock[SPEED]
        clock[HALF] = 0.5 * duration
        if clock[OFFSET] > 0.0:
            _return_to_cell(state)
        state.index[SLOT] = state.index[CELL]
    else:
        clock[CELL_TIME] = _time_to_cross(clock, width - clock[OFFSET])
        duration = min(_LONGEST_SEGMENT, system.longest_step[state.index[MODE]], clock[CELL_TIME], longest,
                       _resolved_time(clock, system.signals.reach[state.index[CELL]]))
        if clock[SPEED_TIME] > 0.0:
            duration = min(duration, clock[SPEED_TIME])
        for k in range(len(state.ramp)):
            if state.ramp[k, RATE] != 0.0:
                duration = min(duration, state.ramp[k, TIME])
        state.index[SLOT] = len(start) - 1
    clock[ENTRANCE] = clock[ANCHOR]
    clock[HALF] = 0.5 * duration


@kernel
def _terms(ratio):
    """Terms of a signal's series that matter over a segment, by half its span over the distance to a singularity."""
    if ratio <= 0.0:
        return 1
    return min(LENGTH, int(_ROUNDING / math.log(ratio)) + 2) if ratio < 0.17 else LENGTH


@kernel
def _fill_signals(system, state):
    """Polynomials of the signals over a part of a cell, or at a changing speed."""
    clock, cell, phase = state.clock, state.index[CELL], state.work[1]
    width = system.signals.start[cell + 1] - system.signals.start[cell]
    phase_terms = _fill_phase(clock, width, phase)
    middle, phase[0] = phase[0], 0.0
    span = 0.0
    for n in range(1, phase_terms):
        span += n * abs(phase[n])
    terms = _terms(0.5 * width * span / system.signals.reach[cell])
    first, series = 2 * system.sizes[0] + system.sizes[1], state.work[0]
    recentre(system.signals.series[cell], middle, terms, state.z[first:first + system.sizes[2]])
    for k in range(system.sizes[2]):
        if phase_terms == 2:
            scale_argument(state.z[first + k], phase[1], state.z[first + k])
        else:
            store(series, vector(state.z[first + k]))
            substitute(series, terms, phase, phase_terms, state.z[first + k])


@kernel
def ramp_channels(system):
    """First channel of the ramps and their rates, which are straight lines, and the first one behind."""
    first = 2 * (system.sizes[0] + system.sizes[2]) + system.sizes[1]
    return first, first + 2 * system.sizes[3]


@kernel
def fill_forcing(system, state):
    """Polynomials of the signals, the ramps and their rates over the segment."""
    half, z = state.clock[HALF], state.z
    first, signals, ramps = 2 * system.sizes[0] + system.sizes[1], system.sizes[2], system.sizes[3]
    if state.index[SLOT] == state.index[CELL]:
        for k in range(signals):
            store(z[first + k], vector(system.signals.series[state.index[CELL], k]))
    else:
        _fill_signals(system, state)
    for channel in range(first, first + signals):
        differentiate(z[channel], half, z[channel + signals])
    for k in range(ramps):
        if state.ramp[k, RATE] != 0.0:
            state.index[VERSION] += 1
        channel = first + 2 * signals + k
        z[channel, 0] = state.ramp[k, VALUE] + state.ramp[k, RATE] * half
        z[channel, 1] = state.ramp[k, RATE] * half
        z[channel + ramps, 0] = state.ramp[k, RATE]
    z[len(z) - 1, 0] = 1.0
    for channel in range(first, len(z)):
        state.scale[channel] = abs(z[channel, 0]) + abs(z[channel, 1])


@entry_kernel
def read_signals(system, state, values):
    """Values of the signals now, before the first segment: the very ones that its flow will start with."""
    choose_segment(system, state, math.inf)
    fill_forcing(system, state)
    for k in range(system.sizes[2]):
        values[k] = value(state.z[2 * system.sizes[0] + system.sizes[1] + k], -1.0)


@kernel
def advance_clock(state, elapsed):
    """Move the segment's start by `elapsed` [s] and keep what rounding takes from the sum."""
    clock = state.clock
    increment = elapsed + clock[START_RESIDUE]
    total = clock[START] + increment
    clock[START_RESIDUE] = increment - (total - clock[START])
    clock[START] = total


@kernel
def advance_ramps(state, elapsed):
    """Move the ramps by `elapsed` [s]; bit k of the result is set when ramp k has reached its target."""
    reached = 0
    for k in range(len(state.ramp)):
        if state.ramp[k, RATE] != 0.0:
            state.ramp[k, VALUE] += state.ramp[k, RATE] * elapsed
            state.ramp[k, TIME] -= elapsed
            if state.ramp[k, TIME] <= 0.0:
                state.ramp[k, VALUE] = state.ramp[k, TARGET]
                state.ramp[k, RATE] = 0.0
                reached |= 1 << k
    return reached


@kernel
def advance_forcing(system, state, x):
    """Move phase and ramps to `x` in the segment.

    Returns
    -------
    int
        Bit k is set when ramp k has reached its target, the bit after the last ramp when the speed has.
    """
    clock = state.clock
    elapsed = clock[HALF] * (x + 1.0)
    at_end = x == 1.0
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
    reached |= advance_ramps(state, elapsed)
    if reached:
        state.index[VERSION] += 1
    advance_clock(state, elapsed)
    return reached


@kernel
def phase_at(system, state, x):
    """Phase past the start of the turn [rad] and its rate [rad/s] at `x` in the segment."""
    clock = state.clock
    advance, speed = _phase_after(clock, clock[HALF] * (x + 1.0))
    return system.signals.start[state.index[CELL]] + clock[OFFSET] + advance, speed
