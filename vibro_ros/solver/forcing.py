"""The known forcing: periodic signals of the phase, and ramps, as polynomials over a segment."""

import math

from vibro_ros.solver.channels import first_signal
from vibro_ros.solver.compilation import entry_kernel, kernel
from vibro_ros.solver.drive import advance_speed, enter_next_cell, fill_phase, phase_advance
from vibro_ros.solver.polynomial import differentiate, recentre, scale_argument, substitute, value
from vibro_ros.solver.segment import advance_clock, choose_segment
from vibro_ros.solver.vector import LENGTH, store, vector

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
def _fill_signals(system, state):
    """Polynomials of the signals over a part of a cell, or at a changing speed."""
    cell, room = state.now[0].drive.cell, state.scratch.room[0]
    phase, signal = room.phase[:], room.signal[:]
    width = system.signals.start[cell + 1] - system.signals.start[cell]
    phase_terms = fill_phase(state.now[0].drive, state.now[0].segment.half, width, phase)
    middle, phase[0] = phase[0], 0.0
    span = 0.0
    for n in range(1, phase_terms):
        span += n * abs(phase[n])
    terms = _significant_terms(0.5 * width * span / system.signals.reach[cell])
    first, count = first_signal(system.size[0]), system.size[0].signals
    recentre(system.signals.series[cell], middle, terms, state.z[first:first + count])
    for k in range(count):
        if phase_terms == 2:
            scale_argument(state.z[first + k], phase[1], state.z[first + k])
        else:
            store(signal, vector(state.z[first + k]))
            substitute(signal, terms, phase, phase_terms, state.z[first + k])


@kernel
def fill_forcing(system, state):
    """Polynomials of the signals, the ramps, their rates and the constant over the segment."""
    half, z, drive = state.now[0].segment.half, state.z, state.now[0].drive
    first, signals, ramps = first_signal(system.size[0]), system.size[0].signals, system.size[0].ramps
    if state.now[0].segment.slot == drive.cell:
        for k in range(signals):
            store(z[first + k], vector(system.signals.series[drive.cell, k]))
    else:
        _fill_signals(system, state)
    for channel in range(first, first + signals):
        differentiate(z[channel], half, z[channel + signals])
    for k in range(ramps):
        ramp = state.ramp[k]
        if ramp.rate != 0.0:
            drive.version += 1
        channel = first + 2 * signals + k
        z[channel, 0] = ramp.value + ramp.rate * half
        z[channel, 1] = ramp.rate * half
        z[channel + ramps, 0] = ramp.rate
    z[len(z) - 1, 0] = 1.0
    for channel in range(first, len(z)):
        state.scale[channel] = abs(z[channel, 0]) + abs(z[channel, 1])


@entry_kernel
def read_signals(system, state, values):
    """Values of the signals now, before the first segment: the very bits that the segment's flow starts with."""
    choose_segment(system, state, math.inf)
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
    advance, speed = phase_advance(drive, elapsed)
    if x == 1.0 and elapsed == state.now[0].segment.cell_left:
        enter_next_cell(system, drive)
    else:
        drive.offset += advance
    reached = 1 << len(state.ramp) if advance_speed(drive, elapsed, speed) else 0
    reached |= advance_ramps(state, elapsed)
    if reached:
        drive.version += 1
    advance_clock(state, elapsed)
    return reached


@kernel
def phase_at(system, state, x):
    """Phase past the start of the turn [rad] and its rate [rad/s] at the local time `x`."""
    drive = state.now[0].drive
    advance, speed = phase_advance(drive, state.now[0].segment.half * (x + 1.0))
    return system.signals.start[drive.cell] + drive.offset + advance, speed
