"""The flow of a mode: its exact solution over a segment, as power series.

With polynomial forcing a linear equation determines the series of its solution term by term;
the segments are short enough for the series to end at rounding (`System.longest_step`).
"""

from vibro_ros.solver.compilation import kernel, rounding_kernel
from vibro_ros.solver.polynomial import LENGTH, add_multiple, value
from vibro_ros.solver.state import ANCHOR, DURATION, MODE


@rounding_kernel  # a mass at rest on its slider feels exactly no force
def _solve_oscillator(load, stiffness, damping, h, q, v, a):
    """Series of q, v = q' and a = q'' = load + stiffness q + damping v, from the constant terms of q and v."""
    position, velocity = q[0], v[0]
    for n in range(LENGTH - 1):
        step = h / (n + 1)
        acceleration = load[n] + stiffness * position + damping * velocity
        position = velocity * step
        velocity = acceleration * step
        q[n + 1] = position
        v[n + 1] = velocity
        a[n] = acceleration


@kernel
def _solve_coupled(loads, row, h, coordinates, dynamic, z):
    """The same for coordinates that enter each other's equations; `loads` has a row for each."""
    for n in range(LENGTH - 1):
        step = h / (n + 1)
        for i in range(dynamic):
            acceleration = loads[i, n]
            for j in range(dynamic):
                acceleration += row[i, j] * z[j, n] + row[i, coordinates + j] * z[coordinates + j, n]
            z[2 * coordinates + i, n] = acceleration
        for i in range(dynamic):
            z[i, n + 1] = z[coordinates + i, n] * step
            z[coordinates + i, n + 1] = z[2 * coordinates + i, n] * step


@kernel
def _rescale(state, channel, magnitude):
    """A segment starts with the rounding error of the one before, however small its own terms are."""
    state.scale[channel] = max(magnitude, 0.5 * state.scale[channel])


@kernel
def solve_dynamic(system, state):
    """Series of the dynamic coordinates from their values and rates at the segment's start (constant terms)."""
    coordinates, dynamic = system.sizes[0], system.sizes[1]
    z, h, mode = state.z, state.clock[DURATION], state.index[MODE]
    for i in range(dynamic):
        row, load = system.acceleration[mode, i], state.work[i]
        load[:] = 0.0
        for channel in range(2 * coordinates + dynamic, len(z)):
            if row[channel] != 0.0:
                add_multiple(load, row[channel], z[channel])
        if not system.coupled[mode]:
            _solve_oscillator(load, row[i], row[coordinates + i], h, z[i], z[coordinates + i], z[2 * coordinates + i])
    if system.coupled[mode]:
        _solve_coupled(state.work, system.acceleration[mode], h, coordinates, dynamic, z)
    for i in range(dynamic):
        for channel in (i, coordinates + i):
            _rescale(state, channel, abs(z[channel, 0]) + abs(z[channel, 1]))
    for i in range(dynamic):
        scale = 0.0
        for channel in range(len(z)):
            scale += abs(system.acceleration[mode, i, channel]) * state.scale[channel]
        state.scale[2 * coordinates + i] = scale


@kernel
def _integrate_through(p, tau, wanted):
    """Set the constant term so that p(tau) = wanted."""
    p[0] = 0.0
    p[0] = wanted - value(p, tau)


@kernel
def solve_driven(system, state, position, velocity):
    """Series of the driven coordinates that pass through `position` and `velocity` where the mode begins."""
    coordinates, dynamic = system.sizes[0], system.sizes[1]
    z, h, anchor = state.z, state.clock[DURATION], state.clock[ANCHOR]
    acceleration = state.work[0]
    for i in range(dynamic, coordinates):
        acceleration[:] = 0.0
        scale = 0.0
        row = system.acceleration[state.index[MODE], i]
        for channel in range(len(z)):
            if row[channel] != 0.0:
                add_multiple(acceleration, row[channel], z[channel])
                scale += abs(row[channel]) * state.scale[channel]
        rate = z[coordinates + i]
        for n in range(LENGTH - 1):
            rate[n + 1] = acceleration[n] * h / (n + 1)
        _integrate_through(rate, anchor, velocity[i])
        for n in range(LENGTH - 1):
            z[i, n + 1] = rate[n] * h / (n + 1)
        _integrate_through(z[i], anchor, position[i])
        state.scale[coordinates + i] = abs(velocity[i]) + scale * h
        state.scale[i] = abs(position[i]) + state.scale[coordinates + i] * h
