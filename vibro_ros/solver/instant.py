"""All channels at one instant, by values and not by series: what a fixed step evaluates."""

import math

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.forcing import advance_ramps, phase_at
from vibro_ros.solver.polynomial import value_and_derivatives
from vibro_ros.solver.recording import form_value
from vibro_ros.solver.state import (
    CELL,
    HALF,
    LAG,
    OFFSET,
    RATE,
    SPEED,
    SPEED_CHANGE,
    SPEED_TARGET,
    SPEED_TIME,
    TARGET,
    TIME,
    TURNS,
    VALUE,
)
from vibro_ros.solver.vector import LENGTH


@kernel
def phase_after(system, state, elapsed):
    """Phase past the start of the turn [rad] and its rate [rad/s], `elapsed` [s] after the step's start."""
    clock = state.clock
    change = clock[SPEED_TIME]
    if 0.0 < change < elapsed:
        phase, _ = phase_at(system, state, change / clock[HALF] - 1.0)
        return phase + clock[SPEED_TARGET] * (elapsed - change), clock[SPEED_TARGET]
    return phase_at(system, state, elapsed / clock[HALF] - 1.0)


@kernel
def _fill_signals(system, state, elapsed, z):
    start = system.signals.start
    cells, signals = len(start) - 1, system.sizes[2]
    first = 2 * system.sizes[0] + system.sizes[1]
    phase, speed = phase_after(system, state, elapsed)
    cell = state.index[CELL]
    while phase >= start[cell + 1]:
        cell += 1
        if cell == cells:
            cell = 0
            phase -= start[cells]
    scale = 2.0 / (start[cell + 1] - start[cell])
    y = (phase - start[cell]) * scale - 1.0
    for k in range(signals):
        value, slope, _ = value_and_derivatives(system.signals.series[cell, k], LENGTH // 2, y)
        z[first + k] = value
        z[first + signals + k] = slope * scale * speed


@kernel
def fill_forcing_at(system, state, elapsed, z):
    """Set the channels of signals, ramps and the constant to their values `elapsed` [s] after the step's start."""
    _fill_signals(system, state, elapsed, z)
    ramps = system.sizes[3]
    first = 2 * (system.sizes[0] + system.sizes[2]) + system.sizes[1]
    for k in range(ramps):
        moving = state.ramp[k, RATE] != 0.0 and elapsed < state.ramp[k, TIME]
        rate = state.ramp[k, RATE] if moving else 0.0
        z[first + k] = state.ramp[k, VALUE] + rate * elapsed if moving or state.ramp[k, RATE] == 0.0 else (
            state.ramp[k, TARGET])
        z[first + ramps + k] = rate
    z[len(z) - 1] = 1.0


@kernel
def accelerate(system, mode, z, accelerations):
    """Accelerations of all coordinates in `mode`, from the other channels of z; it receives the dynamic ones' and the
    decaying term."""
    coordinates, dynamic = system.sizes[0], system.sizes[1]
    for i in range(dynamic):
        accelerations[i] = z[2 * coordinates + i] = form_value(system.acceleration[mode, i], z)
    if system.sizes[4] > 0:
        decay = len(z) - 2
        z[decay] = 0.0
        if system.decay.rate[mode] != 0.0:
            # A step may end beyond the speed 0, where the mode ends.
            fallen = min(0.0, system.decay.rate[mode] * z[coordinates + dynamic])
            z[decay] = form_value(system.decay.factor[mode], z) * math.exp(fallen)
    for i in range(dynamic, coordinates):
        accelerations[i] = form_value(system.acceleration[mode, i], z)


@kernel
def _move_phase(system, state, elapsed):
    """Move the phase by `elapsed` [s], over as many cells as it takes; whether its speed has reached its target."""
    clock, start = state.clock, system.signals.start
    phase, speed = phase_after(system, state, elapsed)
    while phase >= start[state.index[CELL] + 1]:
        state.index[CELL] += 1
        if state.index[CELL] == len(start) - 1:
            state.index[CELL] = 0
            state.index[TURNS] += 1
            phase -= start[len(start) - 1]
    clock[OFFSET] = phase - start[state.index[CELL]]
    if clock[SPEED_TIME] == 0.0:
        return False
    clock[SPEED] = speed
    clock[SPEED_TIME] -= elapsed
    if clock[SPEED_TIME] > 0.0:
        return False
    clock[SPEED] = clock[SPEED_TARGET]
    clock[SPEED_CHANGE] = clock[LAG] = clock[SPEED_TIME] = 0.0
    return True


@kernel
def move_forcing(system, state, elapsed):
    """Move phase and ramps by `elapsed` [s], but not the clock; returns what has been reached, as
    `forcing.advance_forcing` does."""
    reached = 1 << len(state.ramp) if _move_phase(system, state, elapsed) else 0
    return reached | advance_ramps(state, elapsed)
