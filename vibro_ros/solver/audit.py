"""The energy audit: stored energy against the work of the forces on it.

Nothing else changes the energy of the dynamic coordinates, but for jumps; so

    E(now) - E(0) - sum over jumps of (E(after) - E(before)) - integral of P dt = 0

with E = sum w (e z)² / 2 + b z and P = sum (a z) v. What remains is the solver's error, found without knowing the
solution.
"""

import numpy as np

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.linear_forms import form_value
from vibro_ros.solver.polynomial import fill_form, products
from vibro_ros.solver.state import State
from vibro_ros.solver.system import System
from vibro_ros.solver.vector import LENGTH, indices_above, repeated, total, vector

# Gauss's rule with so many nodes is exact for the product of two polynomials of that length.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(LENGTH)


@kernel
def _work(system, state, x):
    """Work of all forces from the flow's start to the local time `x`."""
    mode, start, force = state.now[0].automaton.mode, state.now[0].segment.flow_start, state.scratch.room[0].force[:]
    half = 0.5 * (x - start)
    nodes, power = repeated(start + half) + half * vector(_NODES), repeated(0.0)
    for k in range(system.power.shape[1]):
        rate = state.z[system.power_rate[mode, k]]
        if indices_above(abs(vector(rate)), 0.0) != 0:  # a body that sticks has no power
            if fill_form(system.power[mode, k], system.power_terms[mode, k], state.z, force):
                power = power + products(force, rate, nodes)
    return total(power * vector(_WEIGHTS)) * half * state.now[0].segment.half


@kernel
def audit_work(system, state, x):
    """Add the work of the flow up to the local time `x`, where the flow ends."""
    if system.power.shape[1] > 0:
        work, audit = _work(system, state, x), state.now[0].audit
        audit.work += work
        audit.exchanged += abs(work)


@kernel
def _energy(system, point):
    """E where all channels have the values of `point`."""
    energy = form_value(system.potential, point)
    for e in range(len(system.stretch)):
        stretch = form_value(system.stretch[e], point)
        energy += 0.5 * system.stiffness[e] * stretch * stretch
    return energy


@kernel
def _differ(point, after, count):
    """Whether any of the first `count` channels does."""
    for channel in range(count):
        if after[channel] != point[channel]:
            return True
    return False


@kernel
def audit_jump(system, state, point, after):
    """Add what a jump from the channels `point` to `after` gives."""
    if system.power.shape[1] > 0 and _differ(point, after, 2 * system.size[0].coordinates):
        state.now[0].audit.energy += _energy(system, after) - _energy(system, point)


def stored_energy(system: System, point: np.ndarray) -> float:
    """E [J] where the positions and velocities have the values of `point`."""
    z = np.zeros(system.stretch.shape[1])
    z[:len(point)], z[-1] = point, 1.0
    return float(0.5 * system.stiffness @ (system.stretch @ z) ** 2 + system.potential @ z)


def residual(system: System, state: State) -> float:
    """What does not balance [J], up to the start of the present flow; 0 without an audit."""
    powers = state.now["segment"]["flow_start"][0] ** np.arange(LENGTH)
    point = state.z[:2 * int(system.size["coordinates"][0])] @ powers
    audit = state.now["audit"][0]
    return stored_energy(system, point) - float(audit["energy"]) - float(audit["work"])
