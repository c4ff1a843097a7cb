"""Steps of fixed length, which know of events only at their ends: what the event loop is compared with.

The grid starts at time 0 and anew at every command, so that the trajectory does not depend on where it is sampled.
A step is taken in the mode that its start is in. At its end the guards are evaluated, and the mode changes there, by
the same candidates and jumps as in the event loop: an event is up to a step late, and a pair of crossings within
one step goes unseen. Moreau's scheme finds the mode together with the step instead. Between a step's ends samples are
interpolated, by cubic Hermite polynomials of the positions and of the velocities (first-order schemes: linearly).
"""


import numpy as np

from vibro_ros.solver.compilation import entry_kernel, kernel
from vibro_ros.solver.event_loop import DIVERGED, EVENTS_FULL, REACHED, is_finite, release_from
from vibro_ros.solver.forcing import advance_clock, place_of
from vibro_ros.solver.instant import accelerate, fill_forcing_at, move_forcing, phase_after
from vibro_ros.solver.moreau import enter_found_mode
from vibro_ros.solver.one_step import MOREAU, RK4, take_step
from vibro_ros.solver.recording import PHASE_KIND, RAMP_KIND, form_value, record, record_mode_change
from vibro_ros.solver.state import GUARD, HALF, MODE, NEXT, PEAK, SEGMENTS, START, START_RESIDUE, TURNS
from vibro_ros.solver.system import NOTHING
from vibro_ros.solver.transition import NOISE, choose_candidate

# Changes of mode at the end of one step, after which the next step is taken whatever the guards say.
_MOST_CHANGES = 8
# A mass that arrives at its stop no faster than so many steps accelerate it has stopped bouncing: bounces that are
# shorter than a step would never end.
_STEPS_TO_REST = 2.0


@kernel
def _broken_guard(system, mode, z):
    """The first guard of `mode` that is negative by more than its rounding error, or `NOTHING`."""
    for g in range(system.guard.shape[1]):
        row = system.guard[mode, g]
        if row == NOTHING:
            break
        total = 0.0
        noise = 0.0
        for channel in system.row_terms[row]:
            if channel == NOTHING:
                break
            term = system.row[row, channel] * z[channel]
            total += term
            noise += abs(term)
        if total < -NOISE * noise:
            return g
    return NOTHING


@kernel
def _resting_candidate(system, state, track):
    """The candidate of a blow without a rebound, if the blow is so slow that steps cannot resolve a bounce."""
    mode, guard = state.index[MODE], state.index[GUARD]
    struck, coordinates, z = system.strike[mode, guard], system.sizes[0], track.start
    if struck == NOTHING:
        return NOTHING
    change = 0.0
    for i in range(system.sizes[1]):
        change += system.approach[struck, coordinates + i] * track.rates[0, i]
    if form_value(system.approach[struck], z) > _STEPS_TO_REST * track.step * abs(change):
        return NOTHING
    for c in range(system.candidate.shape[2]):
        target = system.candidate[mode, guard, c]
        if target != NOTHING and system.monitored[target, struck]:
            return c
    return NOTHING


@kernel
def _fill_trial(system, state, candidate, z):
    """Fill `trial` with z after the jump to a candidate."""
    jump = system.jump[state.index[MODE], state.index[GUARD], candidate]
    for channel in range(len(z)):
        state.trial[channel] = z[channel]
    if jump != NOTHING:
        for channel in range(2 * system.sizes[0]):
            state.trial[channel] = form_value(system.landing[jump, channel], z)


@kernel
def _change_modes(system, state, track, events, count):
    """Enter the mode that the step's start is in; returns the number of events."""
    z = track.start
    for _ in range(_MOST_CHANGES):
        state.index[GUARD] = guard = _broken_guard(system, state.index[MODE], z)
        if guard == NOTHING:
            break
        candidate = _resting_candidate(system, state, track)
        if candidate == NOTHING:
            candidate = choose_candidate(system, state, z)
        else:
            _fill_trial(system, state, candidate, z)
        mode = system.candidate[state.index[MODE], guard, candidate]
        count = record_mode_change(system, state, mode, z, events, count)
        for channel in range(2 * system.sizes[0]):
            z[channel] = state.trial[channel]
        state.index[MODE] = mode
        accelerate(system, mode, z, track.rates[0])
    return count


@kernel
def _raise_peaks(system, state, z):
    mode = state.index[MODE]
    for k in range(len(state.monitor)):
        if system.monitored[mode, k]:
            state.monitor[k, PEAK] = max(state.monitor[k, PEAK], form_value(system.monitor[mode, k], z))


@kernel
def _move_forcing(system, state, point, events, count):
    """Move clock and forcing to the step's end; returns the number of events."""
    reached = move_forcing(system, state, 2.0 * state.clock[HALF])
    advance_clock(state, 2.0 * state.clock[HALF])
    for k in range(len(state.ramp)):
        if reached & (1 << k):
            count = record(events, count, state.clock[START], RAMP_KIND + k, 0.0, 0.0, 0.0)
            count = release_from(system, state, k, point, events, count)
    if reached & (1 << len(state.ramp)):
        count = record(events, count, state.clock[START], PHASE_KIND, 0.0, 0.0, 0.0)
    return count


@kernel
def _pass_step(system, state, track, events, count):
    """Go on to the next step; returns the number of events."""
    mode = state.index[MODE]
    count = _move_forcing(system, state, track.start, events, count)
    if track.scheme == MOREAU:
        count = enter_found_mode(system, state, track, events, count)
    for channel in range(len(track.start)):
        track.start[channel] = track.end[channel]
    if state.index[MODE] == mode:
        for i in range(system.sizes[0]):
            track.rates[0, i] = track.rates[1, i]
    else:
        accelerate(system, state.index[MODE], track.start, track.rates[0])
    _raise_peaks(system, state, track.start)
    if track.scheme != MOREAU:
        count = _change_modes(system, state, track, events, count)
    _finish_step(system, state, track)
    return count


@kernel
def _finish_step(system, state, track):
    """Take the step from `Track.start`."""
    take_step(system, state, track)
    accelerate(system, state.index[MODE], track.end, track.rates[1])
    state.index[SEGMENTS] += 1


@entry_kernel
def begin(system, state, track, point):
    """Begin the grid now, with the positions and velocities of `point`, shape (channels,)."""
    state.clock[HALF] = 0.5 * track.step
    state.clock[NEXT] = -1.0  # events are recorded at a step's start
    for channel in range(2 * system.sizes[0]):
        track.start[channel] = point[channel]
    fill_forcing_at(system, state, 0.0, track.start)
    accelerate(system, state.index[MODE], track.start, track.rates[0])
    _finish_step(system, state, track)


@kernel
def _interpolate(track, coordinates, s, z):
    """Positions and velocities at the part s of the step, 0 to 1."""
    start, end, rates, h = track.start, track.end, track.rates, track.step
    cubic = track.scheme == RK4
    rise = s * s * (3.0 - 2.0 * s) if cubic else s
    first, last = s * (1.0 - s) * (1.0 - s) * h, s * s * (s - 1.0) * h
    for i in range(coordinates):
        v = coordinates + i
        z[i] = start[i] + rise * (end[i] - start[i])
        z[v] = start[v] + rise * (end[v] - start[v])
        if cubic:
            z[i] += first * start[v] + last * end[v]
            z[v] += first * rates[0, i] + last * rates[1, i]


@kernel
def _read(system, state, track, x, z):
    """All channels at `x` in the step, -1 to 1."""
    if x <= -1.0:
        for channel in range(len(z)):
            z[channel] = track.start[channel]
        return
    for channel in range(len(z)):
        z[channel] = 0.0  # where it is multiplied by zero it may still not be NaN
    _interpolate(track, system.sizes[0], 0.5 * (x + 1.0), z)
    fill_forcing_at(system, state, state.clock[HALF] * (x + 1.0), z)
    accelerate(system, state.index[MODE], z, track.slopes[2])


@entry_kernel
def advance(system, state, track, times, points, modes, phases, events):
    """Take all steps up to the last of `times` and sample there; as `event_loop.advance`."""
    count = np.int64(0)  # a literal would be one more signature to compile
    # The most that a step records: each change of mode a blow, itself and every monitor; then ramps and the speed.
    room = len(events) - (_MOST_CHANGES + 1) * (2 + len(state.monitor)) - 2 * len(state.ramp)
    for k in range(len(times)):
        while place_of(state, times[k]) >= 1.0:
            if count > room:
                return EVENTS_FULL, k, count
            count = _pass_step(system, state, track, events, count)
            if not is_finite(track.end):
                return DIVERGED, k, count
        x = place_of(state, times[k])
        _read(system, state, track, x, points[k])
        modes[k] = state.index[MODE]
        phase, speed = phase_after(system, state, max(0.0, state.clock[HALF] * (x + 1.0)))
        phases[k, 0], phases[k, 1], phases[k, 2] = state.index[TURNS], phase, speed
    return REACHED, len(times), count


@entry_kernel
def interrupt(system, state, track, time, point):
    """Move clock and forcing to `time`, within the present step, and read all channels there into `point`; as
    `event_loop.interrupt`, and `begin` is to follow."""
    x = place_of(state, time)
    _read(system, state, track, x, point)
    move_forcing(system, state, max(0.0, state.clock[HALF] * (x + 1.0)))
    state.clock[START], state.clock[START_RESIDUE] = time, 0.0
