"""Segments: spans of time in which one polynomial describes each channel, and the clock that they advance.

A segment starts with a flow, or where the previous segment ends. It ends with the cell of the signals, with a ramp, or
where a series no longer reaches rounding.

The known forcing, periodic signals of the phase and ramps, is written as polynomials over the segment.
"""

import math

import numpy as np

from vibro_ros.solver.channels import first_ramp, first_signal
from vibro_ros.solver.drive import (
    advance_speed,
    enter_next_cell,
    fill_shift,
    phase_advance,
    resolved_time,
    time_to_advance,
)
from vibro_ros.solver.elementary import exp, log
from vibro_ros.solver.polynomial import SECOND, differentiate, displace, recentre, scale_argument, value
from vibro_ros.solver.state import Drive, State
from vibro_ros.solver.system import System
from vibro_ros.solver.typed import Row, Rows, entry, part
from vibro_ros.solver.vector import LENGTH, first_index, indices_above, magnitudes, total, vector

#: A segment without a fast motion, a signal or a ramp to end it ends after this time [s].
LONGEST_SEGMENT = 1.0


@part
def local_time(state: State, time: float) -> float:
    """Return the local time of the instant `time` [s]: -1 at the segment's start, 1 at its end."""
    segment = state.segment
    return ((time - segment.start) - segment.residue) / segment.half - 1.0


@part
def instant(state: State, x: float) -> float:
    """Return the instant [s] of the local time `x`."""
    segment = state.segment
    return segment.start + (segment.residue + segment.half * (x + 1.0))


@part
def advance_clock(state: State, elapsed: float) -> None:
    """Move the segment's start by `elapsed` [s] and store the rounding error of the sum."""
    segment = state.segment
    increment = elapsed + segment.residue
    total = segment.start + increment
    segment.residue = increment - (total - segment.start)
    segment.start = total


@part
def _cell_width(system: System, drive: Drive) -> float:
    return system.signals.start[drive.cell + 1] - system.signals.start[drive.cell]


@part
def choose_segment(system: System, state: State) -> None:
    """Start a segment and its mode; the segment lasts as long as the flow's series and the forcing allow."""
    segment, drive = state.segment, state.drive
    if drive.offset >= _cell_width(system, drive):
        enter_next_cell(system, drive)
    segment.mode_start = -1.0
    segment.cell_left = time_to_advance(drive, _cell_width(system, drive) - drive.offset)
    longest = system.longest_segment[state.automaton.mode]
    duration = min(LONGEST_SEGMENT, segment.cell_left, longest)
    if drive.time_left > 0.0:  # at a constant speed the signals are polynomials of time over all of the cell
        duration = min(duration, drive.time_left, resolved_time(drive, system.signals.reach[drive.cell]))
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0:
            duration = min(duration, state.ramp[k].time_left)
    segment.half = 0.5 * duration


# A series whose coefficients fall by `ratio` from each to the next is resolved, to 1e-18 of its first, by as many terms
# as numbers of these do not exceed `ratio`, and another.
_RATIOS = np.array([5e-324, *(exp(log(1e-18) / n) for n in range(1, LENGTH - 1)), math.inf])


@part
def _significant_terms(ratio: float) -> int:
    """Return the number of terms of a signal's series that matter over a segment.

    `ratio` is half the segment's span of the phase over the distance to the signal's nearest singularity.
    """
    return 1 + first_index(indices_above(vector(_RATIOS), ratio))


# A segment is the whole cell if its middle is this close to the cell's, in halves of the cell: some roundings.
_CENTRED = 1e-15


@part
def _fill_parts(system: System, state: State, polynomials: Rows, middle: float, slope: float,
                shift_size: float) -> None:
    """Fill in the signals' polynomials over a part of the cell, from those over the cell; a negative slope mirrors."""
    drive, first = state.drive, first_signal(system.counts[0])
    targets = state.z[first:first + len(polynomials)]
    ratio = 0.5 * _cell_width(system, drive) * abs(slope) * (1.0 + shift_size) / system.signals.reach[drive.cell]
    if abs(middle) < _CENTRED:
        for k in range(len(targets)):
            scale_argument(polynomials[k], slope, targets[k])
        return
    recentre(polynomials, middle, _significant_terms(ratio), targets)
    for k in range(len(targets)):
        scale_argument(targets[k], slope, targets[k])


@part
def _displace_all(state: State, polynomials: Rows, ratio: float, terms: int, size: float, targets: Rows) -> None:
    """Shift the argument of each of `polynomials`, whose coefficients fall by `ratio`, by the shift in the scratch."""
    scratch, order = state.scratch, _significant_terms(ratio * size) - 1
    for k in range(len(targets)):
        displace(polynomials[k], scratch.shift, terms, order, scratch.displaced, targets[k])


@part
def _size(shift: Row, terms: int) -> float:
    """Return a bound of the shift on [-1, 1]."""
    size = 0.0
    for n in range(2, terms):
        size += abs(shift[n])
    return size


@part
def _fill_changing_signals(system: System, state: State) -> None:
    segment, drive, shift = state.segment, state.drive, state.scratch.shift
    first, width = first_signal(system.counts[0]), _cell_width(system, drive)
    targets = state.z[first:first + system.counts[0].signals]
    middle, slope, terms = fill_shift(drive, segment.half, width, shift)
    size = _size(shift, terms)
    _fill_parts(system, state, system.signals.series[drive.cell], drive.direction * middle, drive.direction * slope,
                size)
    if terms > 2:
        ratio = 0.5 * width * slope / system.signals.reach[drive.cell]
        _displace_all(state, targets, ratio, terms, size, targets)


@part
def _fill_signals(system: System, state: State) -> None:
    segment, drive = state.segment, state.drive
    if drive.time_left > 0.0:
        _fill_changing_signals(system, state)
    else:
        slope = 2.0 * drive.speed * segment.half / _cell_width(system, drive)
        middle = 2.0 * (drive.offset + drive.speed * segment.half) / _cell_width(system, drive) - 1.0
        _fill_parts(system, state, system.signals.series[drive.cell], drive.direction * middle,
                    drive.direction * slope, 0.0)


@part
def _raise_acceleration_magnitudes(system: System, state: State) -> None:
    """Give the signals' accelerations the magnitude of their terms over the cell, because in a short segment about a
    zero they are sums of these terms, and much smaller."""
    drive, first = state.drive, first_signal(system.counts[0]) + 2 * system.counts[0].signals
    speed = max(abs(drive.speed), abs(drive.target)) * 2.0 / _cell_width(system, drive)
    for k in range(system.counts[0].signal_accelerations):
        terms = total(vector(SECOND) * magnitudes(vector(system.signals.series[drive.cell, k])))
        state.magnitude[first + k] += terms * speed * speed


@part
def fill_forcing(system: System, state: State) -> None:
    """Fill in the polynomials of signals, ramps, their rates and the constant over the segment."""
    half, z = state.segment.half, state.z
    first, signals, ramps = first_signal(system.counts[0]), system.counts[0].signals, system.counts[0].ramps
    _fill_signals(system, state)
    for channel in range(first, first + signals):
        differentiate(z[channel], half, z[channel + signals])
    for channel in range(first + signals, first + signals + system.counts[0].signal_accelerations):
        differentiate(z[channel], half, z[channel + signals])
    for k in range(ramps):
        ramp = state.ramp[k]
        channel = first_ramp(system.counts[0]) + k
        z[channel, 0] = ramp.value + ramp.rate * half
        z[channel, 1] = ramp.rate * half
        z[channel + ramps, 0] = ramp.rate
    z[len(z) - 1, 0] = 1.0
    for channel in range(first, len(z)):
        state.magnitude[channel] = abs(z[channel, 0]) + abs(z[channel, 1])
    if system.counts[0].signal_accelerations > 0:
        _raise_acceleration_magnitudes(system, state)


@entry
def read_signals(system: System, state: State, values: Row) -> None:
    """Read the signals now, before the first segment, with the same bits with which the segment's flow starts."""
    choose_segment(system, state)
    fill_forcing(system, state)
    for k in range(system.counts[0].signals):
        values[k] = value(state.z[first_signal(system.counts[0]) + k], -1.0)


@part
def advance_ramps(state: State, elapsed: float) -> int:
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


@part
def advance_forcing(system: System, state: State, x: float) -> int:
    """Let the next segment start at the local time `x`: move the clock, the phase and the ramps.

    Returns
    -------
    int
        Bit k is set when ramp k has reached its target, and the bit after the last ramp when the speed has.
    """
    drive = state.drive
    elapsed = state.segment.half * (x + 1.0)
    if system.counts[0].rotors > 0:  # the phase is a coordinate
        advance_clock(state, elapsed)
        return advance_ramps(state, elapsed)
    advance, speed = phase_advance(drive, elapsed)
    if x == 1.0 and elapsed == state.segment.cell_left:
        enter_next_cell(system, drive)
    else:
        drive.offset += advance
    direction = drive.direction
    reached = 1 << len(state.ramp) if advance_speed(drive, elapsed, speed) else 0
    if drive.direction != direction:
        drive.offset = max(0.0, _cell_width(system, drive) - drive.offset)
    reached |= advance_ramps(state, elapsed)
    advance_clock(state, elapsed)
    return reached


@part
def phase_at(system: System, state: State, x: float) -> tuple[float, float]:
    """Return the phase past the start of the turn [rad] and its rate [rad/s], below 0 backwards, at local time `x`."""
    drive = state.drive
    advance, speed = phase_advance(drive, state.segment.half * (x + 1.0))
    if drive.direction < 0:
        return system.signals.start[drive.cell + 1] - drive.offset - advance, 0.0 - speed  # never -0.0
    return system.signals.start[drive.cell] + drive.offset + advance, speed
