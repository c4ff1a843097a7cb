"""Segments: the part of time that one polynomial a channel describes, and the clock that the segments move.

A segment is a whole cell of the signals where the flow's series reaches so far and the speed is steady, so that the
series of the cell serve again; the flow then starts on the way. Elsewhere the segment starts with the flow and ends
with the cell, with a ramp, or where a series no longer reaches rounding.

The known forcing, which is periodic signals of the phase and ramps, is written as polynomials over the segment.
"""

import math

from vibro_ros.solver.compilation import called_kernel, entry_kernel, kernel
from vibro_ros.solver.drive import (
    advance_speed,
    enter_next_cell,
    fill_shift,
    phase_advance,
    resolved_time,
    time_to_advance,
)
from vibro_ros.solver.polynomial import SECOND, differentiate, displace, recentre, scale_argument, value
from vibro_ros.solver.system import CELL_RATE, first_ramp, first_signal
from vibro_ros.solver.vector import LENGTH, store, total, vector

#: A segment without a fast motion, a signal or a ramp to end it ends after this time [s].
LONGEST_SEGMENT = 1.0


@kernel
def local_time(state, time):
    """Local time of the instant `time` [s]: -1 at the segment's start, 1 at its end."""
    segment = state.now[0].segment
    return ((time - segment.start) - segment.residue) / segment.half - 1.0


@kernel
def instant(state, x):
    """Instant [s] of the local time `x`; not before 0, where a segment that is a whole cell may have begun."""
    segment = state.now[0].segment
    return max(0.0, segment.start + (segment.residue + segment.half * (x + 1.0)))


@kernel
def advance_clock(state, elapsed):
    """Move the segment's start by `elapsed` [s] and store what rounding takes from the sum."""
    segment = state.now[0].segment
    increment = elapsed + segment.residue
    total = segment.start + increment
    segment.residue = increment - (total - segment.start)
    segment.start = total


@kernel
def _spans_cell(system, state, duration, since):
    """Whether a segment may be the whole cell: if the flow's series reaches so far, and nothing changes on the way."""
    if duration > min(LONGEST_SEGMENT, CELL_RATE * system.longest_segment[state.now[0].automaton.mode]):
        return False
    left, drive = duration - since, state.now[0].drive
    if duration == 0.0 or drive.time_left > 0.0:
        return False
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0 and state.ramp[k].time_left <= left:
            return False
    return True


@kernel
def _return_to_cell(state, back):
    """Move the segment's start back by `back` [s] to the start of the cell, and the mode's start to where it was."""
    segment, drive = state.now[0].segment, state.now[0].drive
    now, residue = segment.start, segment.residue
    drive.offset = 0.0
    advance_clock(state, -back)
    segment.mode_start = ((now - segment.start) + (residue - segment.residue)) / segment.half - 1.0
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0:
            state.ramp[k].value -= state.ramp[k].rate * back
            state.ramp[k].time_left += back


@kernel
def _part_of_cell(system, state):
    """Duration [s] of a segment that is not a whole cell, as far as the flow's series and the forcing go."""
    segment, drive = state.now[0].segment, state.now[0].drive
    longest = system.longest_segment[state.now[0].automaton.mode]
    duration = min(LONGEST_SEGMENT, segment.cell_left, longest, resolved_time(drive, system.signals.reach[drive.cell]))
    if drive.time_left > 0.0:
        duration = min(duration, drive.time_left)
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0:
            duration = min(duration, state.ramp[k].time_left)
    return duration


@kernel
def _cell_width(system, drive):
    return system.signals.start[drive.cell + 1] - system.signals.start[drive.cell]


@kernel
def choose_segment(system, state, may_be_cell):
    """Set the segment's extent and the local time at which flow and mode start.

    Where the segment may be a whole cell, it may begin before them.
    """
    segment, drive = state.now[0].segment, state.now[0].drive
    width = _cell_width(system, drive)
    if drive.offset >= width:
        enter_next_cell(system, drive)
        width = _cell_width(system, drive)
    segment.mode_start = -1.0
    # Of the whole cell, and from its start to the segment's start; 0 if no segment may be the cell.
    duration, since = 0.0, 0.0
    if drive.speed > 0.0:
        duration, since = width / drive.speed, drive.offset / drive.speed
    if may_be_cell and _spans_cell(system, state, duration, since):
        segment.cell_left = duration
        segment.half = 0.5 * duration
        if drive.offset > 0.0:
            _return_to_cell(state, since)
        segment.slot = drive.cell
    else:
        segment.cell_left = time_to_advance(drive, width - drive.offset)
        duration = _part_of_cell(system, state)
        segment.slot = len(system.signals.start) - 1
    segment.flow_start = segment.mode_start
    segment.half = 0.5 * duration


# Logarithm of what may be neglected beside 1.
_ROUNDING = math.log(1e-18)


@kernel
def _significant_terms(ratio):
    """Number of terms of a signal's series that matter over a segment.

    `ratio` is half the segment's span of the phase over the distance to the signal's nearest singularity.
    """
    if ratio <= 0.0:
        return 1
    return min(LENGTH, int(_ROUNDING / math.log(ratio)) + 2) if ratio < 0.17 else LENGTH


@kernel
def _copy(polynomials, targets):
    for k in range(len(polynomials)):
        store(targets[k], vector(polynomials[k]))


@kernel
def _copy_cell(system, drive, targets):
    """Polynomials of the signals over the present cell, from where the phase enters it to where it leaves it."""
    polynomials = system.signals.series[drive.cell]
    if drive.direction > 0:
        _copy(polynomials, targets)
        return
    for k in range(len(polynomials)):
        scale_argument(polynomials[k], -1.0, targets[k])


@kernel
def _fill_parts(system, state, polynomials, middle, slope, shift_size):
    """Polynomials of the signals over a part of the cell, from those over all of it; a negative slope mirrors them."""
    drive, first = state.now[0].drive, first_signal(system.size[0])
    targets = state.z[first:first + len(polynomials)]
    ratio = 0.5 * _cell_width(system, drive) * abs(slope) * (1.0 + shift_size) / system.signals.reach[drive.cell]
    recentre(polynomials, middle, _significant_terms(ratio), targets)
    for k in range(len(targets)):
        scale_argument(targets[k], slope, targets[k])


@kernel
def _displace_all(state, polynomials, ratio, terms, size, targets):
    """Shift the argument of each of `polynomials`, whose coefficients shrink by `ratio`, by the scratch's shift."""
    room, order = state.scratch.room[0], _significant_terms(ratio * size) - 1
    for k in range(len(targets)):
        displace(polynomials[k], room.shift[:], terms, order, room.displaced[:], targets[k])


@kernel
def _size(shift, terms):
    """Bound of the shift on [-1, 1]."""
    size = 0.0
    for n in range(2, terms):
        size += abs(shift[n])
    return size


@called_kernel
def _fill_changing_signals(system, state):
    segment, drive, shift = state.now[0].segment, state.now[0].drive, state.scratch.room[0].shift[:]
    first, width = first_signal(system.size[0]), _cell_width(system, drive)
    targets = state.z[first:first + system.size[0].signals]
    middle, slope, terms = fill_shift(drive, segment.half, width, shift)
    size = _size(shift, terms)
    _fill_parts(system, state, system.signals.series[drive.cell], drive.direction * middle, drive.direction * slope,
                size)
    if terms > 2:
        ratio = 0.5 * width * slope / system.signals.reach[drive.cell]
        _displace_all(state, targets, ratio, terms, size, targets)


@kernel
def _fill_signals(system, state):
    segment, drive, first = state.now[0].segment, state.now[0].drive, first_signal(system.size[0])
    if drive.time_left > 0.0:
        _fill_changing_signals(system, state)
    elif segment.slot == drive.cell:
        _copy_cell(system, drive, state.z[first:])
    else:
        slope = 2.0 * drive.speed * segment.half / _cell_width(system, drive)
        middle = 2.0 * (drive.offset + drive.speed * segment.half) / _cell_width(system, drive) - 1.0
        _fill_parts(system, state, system.signals.series[drive.cell], drive.direction * middle,
                    drive.direction * slope, 0.0)


@called_kernel
def _raise_acceleration_scales(system, state):
    """Let the signals' accelerations have the scale of their terms over the cell: in a short segment about a zero they
    are sums of these, and much smaller."""
    drive, first = state.now[0].drive, first_signal(system.size[0]) + 2 * system.size[0].signals
    speed = max(abs(drive.speed), abs(drive.target)) * 2.0 / _cell_width(system, drive)
    for k in range(system.size[0].signal_accelerations):
        terms = total(vector(SECOND) * abs(vector(system.signals.series[drive.cell, k])))
        state.scale[first + k] += terms * speed * speed


@kernel
def fill_forcing(system, state):
    """Polynomials of the signals, the ramps, their rates and the constant over the segment."""
    half, z, drive = state.now[0].segment.half, state.z, state.now[0].drive
    first, signals, ramps = first_signal(system.size[0]), system.size[0].signals, system.size[0].ramps
    _fill_signals(system, state)
    for channel in range(first, first + signals):
        differentiate(z[channel], half, z[channel + signals])
    for channel in range(first + signals, first + signals + system.size[0].signal_accelerations):
        differentiate(z[channel], half, z[channel + signals])
    for k in range(ramps):
        ramp = state.ramp[k]
        if ramp.rate != 0.0:
            drive.version += 1
        channel = first_ramp(system.size[0]) + k
        z[channel, 0] = ramp.value + ramp.rate * half
        z[channel, 1] = ramp.rate * half
        z[channel + ramps, 0] = ramp.rate
    z[len(z) - 1, 0] = 1.0
    for channel in range(first, len(z)):
        state.scale[channel] = abs(z[channel, 0]) + abs(z[channel, 1])
    if system.size[0].signal_accelerations > 0:
        _raise_acceleration_scales(system, state)


@entry_kernel
def read_signals(system, state, values):
    """Values of the signals now, before the first segment: the very bits that the segment's flow starts with."""
    choose_segment(system, state, True)
    fill_forcing(system, state)
    for k in range(system.size[0].signals):
        values[k] = value(state.z[first_signal(system.size[0]) + k], -1.0)


@kernel
def advance_ramps(state, elapsed):
    """Move the ramps by `elapsed` [s]; bit k of the result is set when ramp k has reached its target."""
    reached = 0
    for k in range(len(state.ramp)):
        ramp = state.ramp[k]
        if ramp.rate != 0.0:
            ramp.value += ramp.rate * elapsed
            ramp.time_left -= elapsed
            if ramp.time_left <= 0.0:
                ramp.value = ramp.target
                ramp.rate = 0.0
                reached |= 1 << k
    return reached


@kernel
def advance_forcing(system, state, x):
    """Let the next segment start at the local time `x`: move the clock, the phase and the ramps.

    Returns
    -------
    int
        Bit k is set when ramp k has reached its target, the bit after the last ramp when the speed has.
    """
    drive = state.now[0].drive
    elapsed = state.now[0].segment.half * (x + 1.0)
    if system.size[0].rotors > 0:  # whose phase is a coordinate
        advance_clock(state, elapsed)
        return advance_ramps(state, elapsed)
    advance, speed = phase_advance(drive, elapsed)
    if x == 1.0 and elapsed == state.now[0].segment.cell_left:
        enter_next_cell(system, drive)
    else:
        drive.offset += advance
    direction = drive.direction
    reached = 1 << len(state.ramp) if advance_speed(drive, elapsed, speed) else 0
    if drive.direction != direction:
        drive.offset = max(0.0, _cell_width(system, drive) - drive.offset)
    reached |= advance_ramps(state, elapsed)
    if reached:
        drive.version += 1
    advance_clock(state, elapsed)
    return reached


@kernel
def phase_at(system, state, x):
    """Phase past the start of the turn [rad] and its rate [rad/s], below 0 backwards, at the local time `x`."""
    drive = state.now[0].drive
    advance, speed = phase_advance(drive, state.now[0].segment.half * (x + 1.0))
    if drive.direction < 0:
        return system.signals.start[drive.cell + 1] - drive.offset - advance, 0.0 - speed  # never -0.0
    return system.signals.start[drive.cell] + drive.offset + advance, speed
