"""The energy audit: stored energy against the work of the forcing, segment by segment.

The dynamic coordinates exchange energy with the forcing and lose it in dampers, and nowhere else; so

    E(end) - E(start) - integral of P dt = 0

on every segment, with E = sum w (e z)² / 2 and P = sum (a z)(b z). What remains is the solver's
error, found without knowing the solution.
"""

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.polynomial import fill_form, value
from vibro_ros.solver.state import ENERGY, ENTRANCE, EXCHANGED, HALF, MODE, RESIDUAL
from vibro_ros.solver.vector import LENGTH, total, vector


@kernel
def _energy(system, state, point):
    mode = state.index[MODE]
    energy = 0.0
    for e in range(system.stiffness.shape[1]):
        weight = system.stiffness[mode, e]
        if weight != 0.0:
            stretch = 0.0
            for channel in range(len(point)):
                stretch += system.stretch[mode, e, channel] * point[channel]
            energy += 0.5 * weight * stretch * stretch
    return energy


@kernel
def _fill_moments(a, b, moments):
    """moments[n] = integral of x^n from a to b."""
    low, high = a, b
    for n in range(len(moments)):
        moments[n] = (high - low) / (n + 1)
        low *= a
        high *= b


@kernel
def _integral_of_product(p, q, moments):
    """Integral of p q where the moments were taken."""
    integral = 0.0
    for i in range(LENGTH):
        integral += p[i] * total(vector(q) * vector(moments[i:i + LENGTH]))
    return integral


@kernel
def open_audit(system, state, point):
    """Note the energy where a flow begins; `point`, shape (channels,), is overwritten."""
    if system.power.shape[1] == 0:
        return
    for channel in range(len(point)):
        point[channel] = value(state.z[channel], state.clock[ENTRANCE])
    state.audit[ENERGY] = _energy(system, state, point)


@kernel
def close_audit(system, state, x, point):
    """Balance the flow up to `x`, where the channels have the values of `point`."""
    if system.power.shape[1] == 0:
        return
    mode = state.index[MODE]
    work = 0.0
    _fill_moments(state.clock[ENTRANCE], x, state.moments)
    for k in range(system.power.shape[1]):
        force, rate = state.work[0], state.work[1]
        form, terms = system.power[mode, k], system.power_terms[mode, k]
        if fill_form(form[0], terms[0], state.z, force) and fill_form(form[1], terms[1], state.z, rate):
            work += _integral_of_product(force, rate, state.moments)
    work *= state.clock[HALF]
    state.audit[RESIDUAL] += _energy(system, state, point) - state.audit[ENERGY] - work
    state.audit[EXCHANGED] += abs(work)
