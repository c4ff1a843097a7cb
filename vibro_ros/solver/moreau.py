"""Time stepping of non-smooth mechanics: the step of J. J. Moreau (1988) and M. Jean (1999), with theta = 1.

The scheme looks for no event. Springs and dampers are implicit, q+ = q + h v+. The impulses of all contacts and of
friction during the step are found together with the velocities v+ at the step's end, so that each law holds there: the
laws are projected one after the other until no impulse changes (Gauss and Seidel). Friction is projected last, so that
a body that sticks has the velocity zero, exactly.
The scheme is of first order. See V. Acary and B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems
(2008), ch. 10.

The coordinates obey M q'' + C q' + K q = f + contact forces, with known loads f. A *contact* has a gap g, a linear form
that grows with q, and pushes with an impulse P >= 0 along W: M dq' = W P. It is

- rigid: where the gap would close, its rate after the step is at least -e times that before, e the restitution
  (Newton's law), and P is no more than that takes; or
- compliant: P = h (k d + c d') at the step's end while the depth d = -g is positive there, where P < 0 is a plate's
  pull, if it may.

One coordinate may *slip*, with a friction impulse of at most mu times the normal impulse, which is a multiple of the
step and a linear form of the changes of velocity, or the impulse of one of the contacts, the *support*.
"""

import math
from typing import NamedTuple

import numpy as np

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.events import MONITOR_KIND, record, switch_monitors
from vibro_ros.solver.right_hand_side import fill_forcing_at
from vibro_ros.solver.system import NOTHING, form_value

#: Outcomes of the friction law.
STICK, FORWARD, BACKWARD, WITHOUT_LOAD = range(4)


class Laws(NamedTuple):
    """The laws of n coordinates with m contacts; `response` and `compliance` belong to one length of step.

    Attributes
    ----------
    inertia, stiffness : ndarray, shape (n, n)
        M and K.
    load : ndarray, shape (n, channels)
        Rows of f.
    inverse : ndarray, shape (n, n)
        (M + h C + h² K)^-1.
    gap : ndarray, shape (m, channels)
        Rows of the gaps.
    spring, damper : ndarray, shape (m,)
        k and c of compliant contacts.
    restitution : ndarray, shape (m,)
        e of rigid contacts.
    rigid, pulls : ndarray of bool, shape (m,)
        Which contacts are rigid, and which may pull.
    response : ndarray, shape (m, n)
        Change of the velocities by a unit of each contact's impulse.
    compliance : ndarray, shape (m,)
        Change of the gap's rate by it.
    slipping : int
        The coordinate with friction, or `NOTHING`.
    sliding, rise, fading : float
        The friction coefficient of a coordinate that slips with speed v is sliding + rise exp(-fading |v|), fading in
        [s/m] ...
    holding : float
        ... and the coefficient while it is at rest.
    slip_response : ndarray, shape (n,)
        Change of the velocities by a unit of its impulse.
    weight : float
        Normal force without acceleration [N].
    swing : ndarray, shape (n,)
        What a change of the velocities adds to the normal impulse.
    support : int
        Contact whose impulse is the normal impulse instead, or `NOTHING`.
    negative : bool
        Whether friction follows a normal impulse below zero, along the motion; else there is none then.
    mode : ndarray of int, shape (2^(m without support) 4,)
        Mode of the system by the outcomes: pressing or not for each contact but the support, and the friction's.
    """

    inertia: np.ndarray
    stiffness: np.ndarray
    load: np.ndarray
    inverse: np.ndarray
    gap: np.ndarray
    spring: np.ndarray
    damper: np.ndarray
    restitution: np.ndarray
    rigid: np.ndarray
    pulls: np.ndarray
    response: np.ndarray
    compliance: np.ndarray
    slipping: int
    sliding: float
    rise: float
    fading: float
    holding: float
    slip_response: np.ndarray
    weight: float
    swing: np.ndarray
    support: int
    negative: bool
    mode: np.ndarray


def no_laws(coordinates: int, channels: int) -> Laws:
    """Laws of nothing, for the methods that know of guards instead."""
    square, none = np.zeros((coordinates, coordinates)), np.zeros(0)
    return Laws(square, square, np.zeros((coordinates, channels)), square, np.zeros((0, channels)), none, none, none,
                np.zeros(0, dtype=bool), np.zeros(0, dtype=bool), np.zeros((0, coordinates)), none, NOTHING,
                0.0, 0.0, 0.0, 0.0, np.zeros(coordinates), 0.0, np.zeros(coordinates), NOTHING, False,
                np.zeros(4, dtype=np.int64))


_MOST_SWEEPS = 200
# Sweeps end when no impulse changes by more than this part of the largest.
_CONVERGED = 1e-15


@kernel
def _rate(laws, contact, coordinates, v):
    """Rate of a contact's gap, but for what the ramps add."""
    total = 0.0
    for i in range(coordinates):
        total += laws.gap[contact, i] * v[coordinates + i]
    return total


@kernel
def _least_rate(laws, contact, gap, before, free, h):
    """Least rate of a rigid contact's gap where the gap closes: the rebound's or, without a rebound, the rate that just
    closes the gap.

    A mass that arrives no faster than a step accelerates it does not rebound, because no step could follow.
    """
    if -before > abs(free - before) and laws.restitution[contact] > 0.0:
        return -laws.restitution[contact] * before
    return -max(gap, 0.0) / h


@kernel
def _rigid_impulse(laws, contact, gap, least_rate, free, h):
    if gap + h * free > 0.0:
        return 0.0
    return max(0.0, (least_rate - free) / laws.compliance[contact])


@kernel
def _compliant_impulse(laws, contact, gap, free, h):
    stiff = h * (h * laws.spring[contact] + laws.damper[contact])
    impulse = -(h * laws.spring[contact] * gap + stiff * free) / (1.0 + stiff * laws.compliance[contact])
    if gap + h * (free + laws.compliance[contact] * impulse) >= 0.0:
        return 0.0
    return impulse if laws.pulls[contact] else max(0.0, impulse)


@kernel
def _project_contact(laws, step, contact, coordinates, h):
    """Set a contact's impulse so that its law holds; returns by how much it has changed."""
    v, old = step.end, step.impulse[contact]
    free = _rate(laws, contact, coordinates, v) + step.drift[contact] - laws.compliance[contact] * old
    gap = step.gap[contact]
    if laws.rigid[contact]:
        new = _rigid_impulse(laws, contact, gap, step.least_rate[contact], free, h)
    else:
        new = _compliant_impulse(laws, contact, gap, free, h)
    step.impulse[contact] = new
    for i in range(coordinates):
        v[coordinates + i] += laws.response[contact, i] * (new - old)
    return abs(new - old)


@kernel
def _normal_impulse(laws, step, coordinates, h):
    if laws.support != NOTHING:
        return step.impulse[laws.support]
    total = laws.weight * h
    for i in range(coordinates):
        total += laws.swing[i] * (step.end[coordinates + i] - step.start[coordinates + i])
    return total


@kernel
def _friction(laws, before, free, normal):
    """Friction impulse and outcome, from the speeds before the step and after it, were there no friction."""
    sliding = laws.sliding + laws.rise * math.exp(-laws.fading * abs(before))
    if normal <= 0.0:
        ahead = before if before != 0.0 else free
        if not laws.negative or normal == 0.0 or ahead == 0.0:
            return 0.0, WITHOUT_LOAD
        return (-sliding * normal, FORWARD) if ahead > 0.0 else (sliding * normal, BACKWARD)
    compliance, bound = laws.slip_response[laws.slipping], sliding * normal
    if before > 0.0 and free > bound * compliance:
        return -bound, FORWARD
    if before < 0.0 and free < -bound * compliance:
        return bound, BACKWARD
    if abs(free) <= laws.holding * normal * compliance:
        return -free / compliance, STICK
    return (-bound, FORWARD) if free > 0.0 else (bound, BACKWARD)


@kernel
def _project_friction(laws, step, coordinates, h):
    """Set the friction impulse so that its law holds; returns by how much it has changed."""
    v, slipping = step.end, coordinates + laws.slipping
    last = len(step.impulse) - 1
    old = step.impulse[last]
    free = v[slipping] - laws.slip_response[laws.slipping] * old
    normal = _normal_impulse(laws, step, coordinates, h)
    new, outcome = _friction(laws, step.start[slipping], free, normal)
    step.impulse[last] = new
    step.found[0].outcome = outcome
    for i in range(coordinates):
        v[coordinates + i] += laws.slip_response[i] * (new - old)
    if outcome == STICK:
        v[slipping] = 0.0
    return abs(new - old)


@kernel
def _begin_step(system, state, step, coordinates, h):
    """Fill the step's end with the velocities that no impulse changes, and the gaps, their rates and zero impulses."""
    laws, start, end = step.laws, step.start, step.end
    fill_forcing_at(system, state, h, end)
    for i in range(coordinates):
        force = form_value(laws.load[i], end)
        step.stage[i] = h * force
        for j in range(coordinates):
            step.stage[i] += laws.inertia[i, j] * start[coordinates + j] - h * laws.stiffness[i, j] * start[j]
    for i in range(coordinates):
        total = 0.0
        for j in range(coordinates):
            total += laws.inverse[i, j] * step.stage[j]
        end[coordinates + i] = total
    for channel in range(2 * coordinates):
        step.stage[channel] = start[channel]
    for channel in range(2 * coordinates, len(end)):
        step.stage[channel] = end[channel]
    for contact in range(len(laws.gap)):
        step.gap[contact] = form_value(laws.gap[contact], start)
        step.drift[contact] = (form_value(laws.gap[contact], step.stage) - step.gap[contact]) / h
        step.approach[contact] = _rate(laws, contact, coordinates, start) + step.drift[contact]
        free = _rate(laws, contact, coordinates, end) + step.drift[contact]
        step.least_rate[contact] = _least_rate(laws, contact, step.gap[contact], step.approach[contact], free, h)
    for law in range(len(step.impulse)):
        step.impulse[law] = 0.0


@kernel
def step_velocities(system, state, step):
    """Fill `Step.end` and find the mode that it is in."""
    laws, coordinates, h = step.laws, system.size[0].coordinates, 2.0 * state.now[0].segment.half
    _begin_step(system, state, step, coordinates, h)
    step.found[0].outcome = STICK
    for _ in range(_MOST_SWEEPS):
        change = 0.0
        for contact in range(len(laws.gap)):
            change = max(change, _project_contact(laws, step, contact, coordinates, h))
        if laws.slipping != NOTHING:
            change = max(change, _project_friction(laws, step, coordinates, h))
        largest = 0.0
        for law in range(len(step.impulse)):
            largest = max(largest, abs(step.impulse[law]))
        if change <= _CONVERGED * largest:
            break
    for i in range(coordinates):
        step.end[i] = step.start[i] + h * step.end[coordinates + i]
    step.found[0].mode = _found_mode(laws, step, coordinates, h)


@kernel
def _rebounds(laws, step, contact):
    """Whether a rigid contact has thrown back what struck it."""
    return laws.rigid[contact] and step.impulse[contact] > 0.0 and step.least_rate[contact] > 0.0


@kernel
def _found_mode(laws, step, coordinates, h):
    number = 0
    for contact in range(len(laws.gap)):
        if contact != laws.support:
            pressing = step.impulse[contact] != 0.0 and not _rebounds(laws, step, contact)
            number = 2 * number + (1 if pressing else 0)
    outcome = step.found[0].outcome
    if laws.slipping == NOTHING or laws.support != NOTHING:
        if _normal_impulse(laws, step, coordinates, h) <= 0.0:
            outcome = WITHOUT_LOAD
    return laws.mode[4 * number + outcome]


@kernel
def enter_found_mode(system, state, step, events, count):
    """Record at the step's end what the step has found, and enter its mode; returns the number of events."""
    laws, time = step.laws, state.now[0].segment.start
    previous, mode = state.now[0].automaton.mode, step.found[0].mode
    for contact in range(len(laws.gap)):
        if contact != laws.support and _rebounds(laws, step, contact):
            count = record(events, count, time, MONITOR_KIND + contact, -step.approach[contact], math.inf, 0.0)
    kind = system.event_kind[previous, mode]
    if kind != NOTHING:
        count = record(events, count, time, kind, form_value(system.event_quantity[kind], step.start), 0.0, 0.0)
    count = switch_monitors(system, state, mode, time, step.start, events, count)
    state.now[0].automaton.mode = mode
    return count
