"""The energy audit: stored energy against the work of the forcing, segment by segment.

The dynamic coordinates exchange energy with the forcing and lose it in dampers, and nowhere else; so

    E(end) - E(start) - integral of P dt = 0

on every segment, with E = sum w (e z)² / 2 and P = sum (a z)(b z). What remains is the solver's
error, found without knowing the solution.
"""

import numpy as np

from vibro_ros.solver.compilation import kernel, sum_kernel
from vibro_ros.solver.polynomial import LENGTH, add_multiple, scale_argument
from vibro_ros.solver.state import DURATION, ENERGY, EXCHANGED, MODE, RESIDUAL

# Entry [i, j] is the integral of tau^i tau^j from 0 to 1.
_MOMENT = 1.0 / (np.arange(LENGTH)[:, None] + np.arange(LENGTH) + 1.0)


@kernel
def _energy(system, state, point):
    mode = state.index[MODE]
    total = 0.0
    for e in range(system.stiffness.shape[1]):
        weight = system.stiffness[mode, e]
        if weight != 0.0:
            stretch = 0.0
            for channel in range(len(point)):
                stretch += system.stretch[mode, e, channel] * point[channel]
            total += 0.5 * weight * stretch * stretch
    return total


@kernel
def _fill(form, z, target):
    """target = form z; False if it vanishes."""
    target[:] = 0.0
    vanishes = True
    for channel in range(len(z)):
        if form[channel] != 0.0:
            add_multiple(target, form[channel], z[channel])
            vanishes = False
    return not vanishes


@sum_kernel
def _integral_of_product(p, q):
    """Integral of p q from 0 to 1."""
    total = 0.0
    for i in range(LENGTH):
        inner = 0.0
        for j in range(LENGTH):
            inner += _MOMENT[i, j] * q[j]
        total += p[i] * inner
    return total


@kernel
def open_audit(system, state, point):
    """Note the energy at the start of a segment; `point`, shape (channels,), is overwritten."""
    if system.power.shape[1] == 0:
        return
    for channel in range(len(point)):
        point[channel] = state.z[channel, 0]
    state.audit[ENERGY] = _energy(system, state, point)


@kernel
def close_audit(system, state, tau, point):
    """Balance the segment up to `tau`, where the channels have the values of `point`."""
    if system.power.shape[1] == 0:
        return
    work = 0.0
    for k in range(system.power.shape[1]):
        force, rate = state.work[0], state.work[1]
        form = system.power[state.index[MODE], k]
        if _fill(form[0], state.z, force) and _fill(form[1], state.z, rate):
            if tau < 1.0:
                scale_argument(force, tau)
                scale_argument(rate, tau)
            work += _integral_of_product(force, rate)
    work *= state.clock[DURATION] * tau
    state.audit[RESIDUAL] += _energy(system, state, point) - state.audit[ENERGY] - work
    state.audit[EXCHANGED] += abs(work)
