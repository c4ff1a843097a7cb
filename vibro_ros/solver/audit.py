"""The energy audit: stored energy against the work of the forcing, segment by segment.

The dynamic coordinates exchange energy with the forcing and lose it in dampers, and nowhere else; so

    E(end) - E(start) - integral of P dt = 0

on every segment, with E = sum w (e z)² / 2 and P = sum (a z)(b z). What remains is the solver's
error, found without knowing the solution.
"""

import numpy as np

from vibro_ros.solver.channels import first_signal
from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.linear_forms import form_value
from vibro_ros.solver.polynomial import INVERSE, fill_form, value
from vibro_ros.solver.vector import LENGTH, powers, store, total, vector

# Numbers that follow those of `INVERSE`.
_INVERSE_BEYOND = 1.0 / np.arange(LENGTH + 1, 2 * LENGTH + 1)


@kernel
def _energy(system, state, point):
    mode = state.now[0].automaton.mode
    energy = 0.0
    for e in range(system.stiffness.shape[1]):
        weight = system.stiffness[mode, e]
        if weight != 0.0:
            stretch = form_value(system.stretch[mode, e], point)
            energy += 0.5 * weight * stretch * stretch
    return energy


@kernel
def _fill_moments(a, b, moments):
    """moments[n] = integral of x^n from a to b."""
    low, high = a * powers(a), b * powers(b)
    store(moments[:LENGTH], (high - low) * vector(INVERSE))
    store(moments[LENGTH:], (b**LENGTH * high - a**LENGTH * low) * vector(_INVERSE_BEYOND))


@kernel
def _integral_of_product(p, q, moments):
    """Integral of p q where the moments were taken."""
    weights = p[0] * vector(moments[:LENGTH])
    for i in range(1, LENGTH):
        weights = weights + p[i] * vector(moments[i:i + LENGTH])
    return total(weights * vector(q))


@kernel
def open_audit(system, state, point):
    """Store the energy at the flow's start, with the positions and velocities of `point`.

    The other channels of `point` are overwritten.
    """
    if system.power.shape[1] == 0:
        return
    for channel in range(first_signal(system.size[0]), len(point)):
        point[channel] = value(state.z[channel], state.now[0].segment.flow_start)
    state.now[0].audit.energy = _energy(system, state, point)


@kernel
def close_audit(system, state, x, point):
    """Balance the flow up to the local time `x`, where the channels have the values of `point`."""
    if system.power.shape[1] == 0:
        return
    mode, room, audit = state.now[0].automaton.mode, state.scratch.room[0], state.now[0].audit
    force, rate, moments = room.force[:], room.rate[:], room.moments[:]
    work = 0.0
    _fill_moments(state.now[0].segment.flow_start, x, moments)
    for k in range(system.power.shape[1]):
        form, terms = system.power[mode, k], system.power_terms[mode, k]
        if fill_form(form[0], terms[0], state.z, force) and fill_form(form[1], terms[1], state.z, rate):
            work += _integral_of_product(force, rate, moments)
    work *= state.now[0].segment.half
    audit.residual += _energy(system, state, point) - audit.energy - work
    audit.exchanged += abs(work)
