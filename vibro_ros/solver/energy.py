"""Energy accounts: the energy that each kind of force gives or takes, exact to the solver's own error.

The work of every kind of force is booked on an account of its own, from event to event; the change of energy in a jump
is booked when the event is passed. The stored energy E = sum w (e z)² / 2 + b z has weights w that depend on the mode,
because a contact stores energy only while it is closed. Then

    E(now) - E(0) = sum of all accounts

and the difference, the *residual*, is the solver's error, found without knowing the solution. A jump books only the
change of the squares, so that a height that jumps, as in a landing above the ground, adds to the residual.

The power of a force is a product of two polynomials, the force and the velocity along it, so that Gauss's rule gives
its work exactly. The power of the account `MOTOR` is also integrated in magnitude, because the sum alone does not show
how much the motor gives and how much it takes back.
"""

import numpy as np

from vibro_ros.solver.channels import first_ramp
from vibro_ros.solver.polynomial import fill_form, gauss_legendre, products, value
from vibro_ros.solver.state import Accounts, State
from vibro_ros.solver.system import System, form_value
from vibro_ros.solver.typed import Row, part
from vibro_ros.solver.vector import LENGTH, Vector, indices_above, magnitudes, repeated, store, total, vector

# Gauss's rule with LENGTH nodes is exact for the product of two polynomials of that length.
_NODES, _WEIGHTS = gauss_legendre(LENGTH)

#: The account whose power is also integrated in magnitude, and the account of the ramps' work.
MOTOR, RAMPS = 0, 1

# Steps of the search for a zero of the motor's power. A zero that is off by d costs d² of the magnitude alone.
_STEPS = 8


@part
def _power(system: System, state: State, k: int, start: float, x: float) -> Vector:
    """Return the k-th power at Gauss's nodes from the local time `start` to `x`, as a vector."""
    table, mode = system.accounts, state.automaton.mode
    rate, force, half = state.z[table.rate[k]], state.scratch.force, 0.5 * (x - start)
    if indices_above(magnitudes(vector(rate)), 0.0) == 0:  # a body that sticks and a plate at rest have no power
        return repeated(0.0)
    if not fill_form(table.force[mode, k], table.terms[mode, k], state.z, force):
        return repeated(0.0)
    return products(force, rate, repeated(start + half) + half * vector(_NODES))


@part
def _fill_motor_power(system: System, state: State, start: float, x: float, target: Row) -> None:
    """Fill `target` with the motor's power at Gauss's nodes from the local time `start` to `x`."""
    power = repeated(0.0)
    for k in range(len(system.accounts.account)):
        if system.accounts.account[k] == MOTOR:
            power = power + _power(system, state, k, start, x)
    store(target, power)


@part
def _work(state: State, power: Vector, start: float, x: float) -> float:
    """Return the integral of powers, a vector at Gauss's nodes, from the local time `start` to `x`."""
    return total(power * vector(_WEIGHTS)) * (0.5 * (x - start)) * state.segment.half


@part
def _motor_work(system: System, state: State, start: float, x: float) -> float:
    """Return the integral of the motor's power from the local time `start` to `x`."""
    power = state.scratch.part_power
    _fill_motor_power(system, state, start, x, power)
    return _work(state, vector(power), start, x)


@part
def _motor_power_at(system: System, state: State, x: float) -> float:
    """Return the motor's power at the local time `x`."""
    table, mode, force, power = system.accounts, state.automaton.mode, state.scratch.force, 0.0
    for k in range(len(table.account)):
        if table.account[k] == MOTOR and fill_form(table.force[mode, k], table.terms[mode, k], state.z, force):
            power += value(force, x) * value(state.z[table.rate[k]], x)
    return power


@part
def _zero_between(system: System, state: State, a: float, b: float, at_a: float, at_b: float) -> float:
    """Return the local time of a zero of the motor's power between `a` and `b`, where its signs differ (Illinois
    method)."""
    x = b
    for _ in range(_STEPS):
        x = b - at_b * (b - a) / (at_b - at_a)
        at_x = _motor_power_at(system, state, x)
        if at_x == 0.0:
            break
        if (at_x > 0.0) != (at_b > 0.0):
            a, at_a = b, at_b
        else:
            at_a *= 0.5
        b, at_b = x, at_x
    return x


@part
def _magnitude(system: System, state: State, start: float, x: float) -> float:
    """Return the integral of the magnitude of the motor's power, from the local time `start` to `x`.

    The scratch holds the power at Gauss's nodes. The sign is taken there and at both ends. Two zeros between neighbours
    go unseen, but there the power is as small as the neighbours are close.
    """
    powers, magnitude = state.scratch.power, 0.0
    since, last, at_last = start, start, _motor_power_at(system, state, start)
    for n in range(LENGTH + 1):
        now = 0.5 * (start + x) + 0.5 * (x - start) * _NODES[n] if n < LENGTH else x
        at_now = powers[n] if n < LENGTH else _motor_power_at(system, state, x)
        if (at_now > 0.0 and at_last < 0.0) or (at_now < 0.0 and at_last > 0.0):
            zero = _zero_between(system, state, last, now, at_last, at_now)
            magnitude += abs(_motor_work(system, state, since, zero))
            since = zero
        if at_now != 0.0:
            last, at_last = now, at_now
    return magnitude + abs(_motor_work(system, state, since, x))


@part
def _book(system: System, state: State, x: float, accounts: Accounts) -> None:
    start, powers = accounts.booked, state.scratch.power
    if x <= start:
        return
    for k in range(len(system.accounts.account)):
        if system.accounts.account[k] != MOTOR:
            accounts.work[system.accounts.account[k]] += _work(state, _power(system, state, k, start, x), start, x)
    _fill_motor_power(system, state, start, x, powers)
    forwards, backwards = indices_above(vector(powers), 0.0), indices_above(-1.0 * vector(powers), 0.0)
    work = _work(state, vector(powers), start, x)
    accounts.work[MOTOR] += work
    # No zero is searched if all nodes have the same sign, so that only a change of sign costs more than the sum.
    accounts.magnitude += _magnitude(system, state, start, x) if forwards and backwards else abs(work)
    accounts.booked = x


@part
def book_work(system: System, state: State, x: float, accounts: Accounts) -> None:
    """Book the work of the present mode up to the local time `x`, where the mode or the flow ends, on `accounts`."""
    if len(system.accounts.account) > 0:
        _book(system, state, x, accounts)


@part
def _book_jump(system: System, state: State, mode: int, point: Row, after: Row) -> None:
    table, accounts, previous = system.accounts, state.accounts, state.automaton.mode
    jump, by_motor = table.jump[previous, state.automaton.guard], 0.0
    for e in range(len(table.stored_form)):
        value_before, value_after = form_value(table.stored_form[e], point), form_value(table.stored_form[e], after)
        change = (table.stored_weight[mode, e] * value_after * value_after
                  - table.stored_weight[previous, e] * value_before * value_before)
        if jump[e] == MOTOR:
            by_motor += 0.5 * change
        else:
            accounts.work[jump[e]] += 0.5 * change
    accounts.work[MOTOR] += by_motor
    accounts.magnitude += abs(by_motor)
    rates = first_ramp(system.counts[0]) + system.counts[0].ramps
    for r in range(len(table.struck)):
        shock = form_value(table.momentum[r], after) - form_value(table.momentum[r], point)
        work = shock * point[rates + table.struck[r]]
        accounts.work[RAMPS] += work
        accounts.work[jump[r]] -= work


@part
def book_jump(system: System, state: State, mode: int, point: Row, after: Row) -> None:
    """Book the change of energy in the jump from `point` to `mode`, which starts with the channels `after`."""
    if len(system.accounts.account) > 0:
        _book_jump(system, state, mode, point, after)


def stored_on_accounts(system: System, mode: int, point: np.ndarray) -> float:
    """Return the stored energy E [J] in `mode` at the channels `point`."""
    table = system.accounts
    energy = form_value(table.stored_linear, point)
    for weight, form in zip(table.stored_weight[mode], table.stored_form, strict=True):
        part = form_value(form, point)
        energy += 0.5 * weight * part * part
    return float(energy)
