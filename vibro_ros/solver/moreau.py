"""Time stepping of non-smooth mechanics: the step of J. J. Moreau (1988) and M. Jean (1999), with theta = 1.

No event is looked for. Springs and dampers are implicit, q+ = q + h v+, and the impulses of all contacts and of
friction during the step are found with the velocities v+ at its end, so that each law holds there, by projecting one
after the other until none changes (Gauss and Seidel). Friction is projected last: a body that sticks has the
velocity zero, exactly. First order. See V. Acary and B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems
(2008), ch. 10.
"""

import math

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.instant import fill_forcing_at
from vibro_ros.solver.laws import BACKWARD, FORWARD, STICK, WITHOUT_LOAD
from vibro_ros.solver.recording import MONITOR_KIND, form_value, record, switch_monitors
from vibro_ros.solver.state import HALF, MODE, START
from vibro_ros.solver.system import NOTHING

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
def _wanted_rate(laws, contact, gap, before, free, h):
    """Least rate of a rigid contact's gap where it closes: that of the rebound or, without one, what closes it just.

    What arrives no faster than a step accelerates it does not rebound: no step could follow it.
    """
    if -before > abs(free - before) and laws.restitution[contact] > 0.0:
        return -laws.restitution[contact] * before
    return -max(gap, 0.0) / h


@kernel
def _rigid_impulse(laws, contact, gap, wanted, free, h):
    if gap + h * free > 0.0:
        return 0.0
    return max(0.0, (wanted - free) / laws.compliance[contact])


@kernel
def _compliant_impulse(laws, contact, gap, free, h):
    stiff = h * (h * laws.spring[contact] + laws.damper[contact])
    impulse = -(h * laws.spring[contact] * gap + stiff * free) / (1.0 + stiff * laws.compliance[contact])
    if gap + h * (free + laws.compliance[contact] * impulse) >= 0.0:
        return 0.0
    return impulse if laws.pulls[contact] else max(0.0, impulse)


@kernel
def _project_contact(laws, track, contact, coordinates, h):
    """Set a contact's impulse so that its law holds; returns by how much it has changed."""
    v, old = track.end, track.impulse[contact]
    free = _rate(laws, contact, coordinates, v) + track.drift[contact] - laws.compliance[contact] * old
    gap = track.gap[contact]
    if laws.rigid[contact]:
        new = _rigid_impulse(laws, contact, gap, track.wanted[contact], free, h)
    else:
        new = _compliant_impulse(laws, contact, gap, free, h)
    track.impulse[contact] = new
    for i in range(coordinates):
        v[coordinates + i] += laws.response[contact, i] * (new - old)
    return abs(new - old)


@kernel
def _normal_impulse(laws, track, coordinates, h):
    if laws.support != NOTHING:
        return track.impulse[laws.support]
    total = laws.weight * h
    for i in range(coordinates):
        total += laws.swing[i] * (track.end[coordinates + i] - track.start[coordinates + i])
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
def _project_friction(laws, track, coordinates, h):
    """Set the friction impulse so that its law holds; returns by how much it has changed."""
    v, slipping = track.end, coordinates + laws.slipping
    last = len(track.impulse) - 1
    old = track.impulse[last]
    free = v[slipping] - laws.slip_response[laws.slipping] * old
    normal = _normal_impulse(laws, track, coordinates, h)
    new, outcome = _friction(laws, track.start[slipping], free, normal)
    track.impulse[last] = new
    track.found[0] = outcome
    for i in range(coordinates):
        v[coordinates + i] += laws.slip_response[i] * (new - old)
    if outcome == STICK:
        v[slipping] = 0.0
    return abs(new - old)


@kernel
def _begin_step(system, state, track, coordinates, h):
    """Velocities without any impulse, and the gaps; nothing pushes yet."""
    laws, start, end = track.laws, track.start, track.end
    fill_forcing_at(system, state, h, end)
    for i in range(coordinates):
        force = form_value(laws.load[i], end)
        track.stage[i] = h * force
        for j in range(coordinates):
            track.stage[i] += laws.inertia[i, j] * start[coordinates + j] - h * laws.stiffness[i, j] * start[j]
    for i in range(coordinates):
        total = 0.0
        for j in range(coordinates):
            total += laws.inverse[i, j] * track.stage[j]
        end[coordinates + i] = total
    for channel in range(2 * coordinates):
        track.stage[channel] = start[channel]
    for channel in range(2 * coordinates, len(end)):
        track.stage[channel] = end[channel]
    for contact in range(len(laws.gap)):
        track.gap[contact] = form_value(laws.gap[contact], start)
        track.drift[contact] = (form_value(laws.gap[contact], track.stage) - track.gap[contact]) / h
        track.approach[contact] = _rate(laws, contact, coordinates, start) + track.drift[contact]
        free = _rate(laws, contact, coordinates, end) + track.drift[contact]
        track.wanted[contact] = _wanted_rate(laws, contact, track.gap[contact], track.approach[contact], free, h)
    for law in range(len(track.impulse)):
        track.impulse[law] = 0.0


@kernel
def step_velocities(system, state, track):
    """Fill `Track.end` and find the mode that it is in."""
    laws, coordinates, h = track.laws, system.sizes[0], 2.0 * state.clock[HALF]
    _begin_step(system, state, track, coordinates, h)
    track.found[0] = STICK
    for _ in range(_MOST_SWEEPS):
        change = 0.0
        for contact in range(len(laws.gap)):
            change = max(change, _project_contact(laws, track, contact, coordinates, h))
        if laws.slipping != NOTHING:
            change = max(change, _project_friction(laws, track, coordinates, h))
        largest = 0.0
        for law in range(len(track.impulse)):
            largest = max(largest, abs(track.impulse[law]))
        if change <= _CONVERGED * largest:
            break
    for i in range(coordinates):
        track.end[i] = track.start[i] + h * track.end[coordinates + i]
    track.found[1] = _found_mode(laws, track, coordinates, h)


@kernel
def _rebounds(laws, track, contact):
    """Whether a rigid contact has thrown back what struck it."""
    return laws.rigid[contact] and track.impulse[contact] > 0.0 and track.wanted[contact] > 0.0


@kernel
def _found_mode(laws, track, coordinates, h):
    number = 0
    for contact in range(len(laws.gap)):
        if contact != laws.support:
            pressing = track.impulse[contact] != 0.0 and not _rebounds(laws, track, contact)
            number = 2 * number + (1 if pressing else 0)
    outcome = track.found[0]
    if laws.slipping == NOTHING or laws.support != NOTHING:
        if _normal_impulse(laws, track, coordinates, h) <= 0.0:
            outcome = WITHOUT_LOAD
    return laws.mode[4 * number + outcome]


@kernel
def enter_found_mode(system, state, track, events, count):
    """Record what the step has done, at its end, and enter the mode that it ended in; returns the number of events."""
    laws, time = track.laws, state.clock[START]
    previous, mode = state.index[MODE], track.found[1]
    for contact in range(len(laws.gap)):
        if contact != laws.support and _rebounds(laws, track, contact):
            count = record(events, count, time, MONITOR_KIND + contact, -track.approach[contact], math.inf, 0.0)
    kind = system.event[previous, mode]
    if kind != NOTHING:
        count = record(events, count, time, kind, form_value(system.noted[kind], track.start), 0.0, 0.0)
    count = switch_monitors(system, state, mode, time, track.start, events, count)
    state.index[MODE] = mode
    return count
