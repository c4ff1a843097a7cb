"""The event loop: segment after segment, stopping at every event, sampled wherever it is asked.

Segments depend on the system, its state and its commands alone, never on the instants at which they are sampled,
so the trajectory is the same, bit for bit, however the time is cut up.
"""

import math

import numpy as np

from vibro_ros.solver.audit import close_audit, open_audit
from vibro_ros.solver.compilation import entry_kernel, kernel
from vibro_ros.solver.decay import decays, known_reach, resolve_decay
from vibro_ros.solver.flow import solve_driven, solve_dynamic, weighted_sum
from vibro_ros.solver.forcing import (
    advance_forcing,
    choose_segment,
    fill_forcing,
    phase_at,
    place_of,
    ramp_channels,
)
from vibro_ros.solver.polynomial import fill_form, value
from vibro_ros.solver.recording import (
    PHASE_KIND,
    RAMP_KIND,
    instant,
    record,
    record_mode_change,
    switch_monitors,
    update_peaks,
)
from vibro_ros.solver.roots import NO_ROOT, SEARCH_FAILED, first_root
from vibro_ros.solver.state import (
    ANCHOR,
    GUARD,
    MODE,
    NEXT,
    SEGMENTS,
    STANDSTILLS,
    START,
    START_RESIDUE,
    TURNS,
    UNKNOWN,
    VERSION,
)
from vibro_ros.solver.system import NOTHING
from vibro_ros.solver.transition import EPSILON, NOISE, choose_candidate, keeps_flow

# What `advance` returns.
REACHED = 0
EVENTS_FULL = 1
STUCK = 2
DIVERGED = 3
ROOT_LOST = 4

#: Events in a row at one instant after which the loop gives up; a legal cascade takes a handful.
_MOST_STANDSTILLS = 200
# Events in a row at one instant after which a guard must be below zero by more than its rounding error: modes whose
# guards contradict each other within it would take turns for ever.
_DOUBTFUL_STANDSTILLS = 10
_DOUBT = 8.0  # rounding errors
# Roots no further apart than rounding are simultaneous: the guard that its mode names first decides.
_SIMULTANEOUS = 16.0 * EPSILON


@kernel
def _guard_root(system, state, row):
    """First root up to NEXT of a guard row, from where the mode began; remembered until its polynomial changes."""
    if state.root[row] > state.clock[ANCHOR]:
        return state.root[row]
    guard = state.work[1]
    fill_form(system.row[row], system.row_terms[row], state.z, guard)
    noise = NOISE * weighted_sum(system.row[row], state.scale)
    if state.index[STANDSTILLS] > _DOUBTFUL_STANDSTILLS:
        guard[0] += _DOUBT * noise
    limit = state.clock[NEXT]
    root = first_root(guard, state.clock[ANCHOR], limit, noise, state.work[2:4])
    state.root[row] = UNKNOWN if root == NO_ROOT and limit < 1.0 else root
    return root


@kernel
def _find_next_event(system, state):
    """Set NEXT and GUARD to the earliest guard of the mode; False if a root search failed."""
    mode = state.index[MODE]
    state.clock[NEXT] = 1.0
    state.index[GUARD] = NOTHING
    for g in range(system.guard.shape[1]):
        row = system.guard[mode, g]
        if row == NOTHING:
            break
        root = _guard_root(system, state, row)
        if root == SEARCH_FAILED:
            return False
        if root != NO_ROOT and (root < state.clock[NEXT] - _SIMULTANEOUS or state.index[GUARD] == NOTHING):
            state.clock[NEXT] = root
            state.index[GUARD] = g
    return True


@kernel
def _solve_up_to_driven(system, state, point):
    """Set up a segment that is short enough for a decaying term, if the mode has one."""
    longest = known_reach(system, state)
    while True:
        choose_segment(system, state, longest)
        fill_forcing(system, state)
        solve_dynamic(system, state, point)
        if not decays(system, state.index[MODE]):
            return
        longest = resolve_decay(system, state, point)
        if longest == math.inf:
            return


@kernel
def _begin_mode(system, state, point, same_flow):
    """Begin the current mode at `point`, in the segment that is there if its flow is the same; False on a lost root."""
    for channel in range(len(state.origin)):
        state.origin[channel] = point[channel]
    if not same_flow:
        _solve_up_to_driven(system, state, point)
        state.index[SEGMENTS] += 1
    solve_driven(system, state, point)
    if not same_flow:
        open_audit(system, state, point)
    for row in range(len(state.root)):
        if system.driven[row] or not same_flow:
            state.root[row] = UNKNOWN
    return _find_next_event(system, state)


@entry_kernel
def begin_segment(system, state, point):
    """Build the segment that starts with the positions and velocities of `point`; False on a lost root.

    `point`, shape (channels,), is overwritten.
    """
    return _begin_mode(system, state, point, np.bool_(False))  # a literal would be one more signature to compile


@kernel
def _read(system, state, x, point):
    """Values of the first len(point) channels at `x`; where the mode began, the coordinates' very values."""
    ramps, end = ramp_channels(system)
    for channel in range(len(point)):
        if ramps <= channel < end:
            point[channel] = state.z[channel, 0] + state.z[channel, 1] * x
        else:
            point[channel] = value(state.z[channel], x)
    if x == state.clock[ANCHOR]:
        for channel in range(len(state.origin)):
            point[channel] = state.origin[channel]


@entry_kernel
def release_from(system, state, ramp, point, events, count):
    """At the segment's start, leave what cannot outlast a change of the ramp's rate; returns the number of events."""
    mode = system.unheld[state.index[MODE], ramp]
    count = switch_monitors(system, state, mode, instant(state, -1.0), point, events, count)
    state.index[MODE] = mode
    return count


@kernel
def _move_forcing(system, state, x, point, events, count):
    """Move the forcing to `x`, where the next segment starts; returns the number of events."""
    reached = advance_forcing(system, state, x)
    if reached:
        time = instant(state, -1.0)
        for k in range(len(state.ramp)):
            if reached & (1 << k):
                count = record(events, count, time, RAMP_KIND + k, 0.0, 0.0, 0.0)
                count = release_from(system, state, k, point, events, count)
        if reached & (1 << len(state.ramp)):
            count = record(events, count, time, PHASE_KIND, 0.0, 0.0, 0.0)
    return count


@kernel
def _pass_event(system, state, point, events, count):
    """Do what happens at NEXT: the end of the segment or a change of mode; returns (success, number of events).

    Everything is called from one place only: kernels are inlined, and two copies would fill the processor's cache.
    """
    x, mode, same_flow = state.clock[NEXT], state.index[MODE], False
    fires = state.index[GUARD] != NOTHING
    # At a segment's end the next one needs the positions and velocities, and the audit all.
    _read(system, state, x, point if fires or system.power.shape[1] > 0 else point[:2 * system.sizes[0]])
    if fires:
        candidate = choose_candidate(system, state, point)
        mode = system.candidate[mode, state.index[GUARD], candidate]
        same_flow = x < 1.0 and keeps_flow(system, state, mode, point) and not decays(system, mode)
    state.index[STANDSTILLS] = state.index[STANDSTILLS] + 1 if fires and x == state.clock[ANCHOR] else 0
    if not same_flow:
        update_peaks(system, state, x)
        close_audit(system, state, x, point)
    if fires:
        count = record_mode_change(system, state, mode, point, events, count)
        for channel in range(len(point)):
            point[channel] = state.trial[channel]
        state.index[MODE] = mode
    if same_flow:
        state.clock[ANCHOR] = x
    else:
        count = _move_forcing(system, state, x, point, events, count)
    return _begin_mode(system, state, point, same_flow), count


@kernel
def is_finite(point):
    """Whether every channel is a finite number."""
    total = 0.0
    for channel in range(len(point)):
        total += point[channel]
    return math.isfinite(total)


@entry_kernel
def advance(system, state, times, point, points, modes, phases, events):
    """Pass all events up to the last of `times` and sample there.

    Parameters
    ----------
    system : System
        The system.
    state : State
        Changed in place.
    times : ndarray, shape (n,)
        Instants [s], ascending, none before the last command.
    point : ndarray, shape (channels,)
        Overwritten.
    points : ndarray, shape (n, channels)
        Receives z.
    modes : ndarray of int, shape (n,)
        Receives the modes.
    phases : ndarray, shape (n, 3)
        Receives the turns, the phase past the start of the turn [rad] and its rate [rad/s].
    events : ndarray, shape (room, EVENT_COLUMNS)
        Receives the events.

    Returns
    -------
    (int, int, int)
        Why it returned, number of samples taken, number of events recorded.
    """
    count = np.int64(0)  # see `begin_segment`
    # The most that one event records: a change of mode, a blow, every monitor, every ramp and its release, the speed.
    room = len(events) - 3 - len(state.monitor) - 2 * len(state.ramp)
    for k in range(len(times)):
        while place_of(state, times[k]) >= state.clock[NEXT]:
            if count > room:
                return EVENTS_FULL, k, count
            found, count = _pass_event(system, state, point, events, count)
            if not found:
                return ROOT_LOST, k, count
            if state.index[STANDSTILLS] > _MOST_STANDSTILLS:
                return STUCK, k, count
            if not is_finite(point):
                return DIVERGED, k, count
        x = max(place_of(state, times[k]), state.clock[ANCHOR])
        _read(system, state, x, points[k])
        modes[k] = state.index[MODE]
        phase, speed = phase_at(system, state, x)
        phases[k, 0], phases[k, 1], phases[k, 2] = state.index[TURNS], phase, speed
    return REACHED, len(times), count


@entry_kernel
def interrupt(system, state, time, point):
    """Move clock and forcing to `time`, within the current segment, and read all channels there into `point`.

    For a command: set the new rates after this, then call `release_from` for every ramp whose
    rate changes, and `begin_segment` with `point`.
    """
    x = max(place_of(state, time), state.clock[ANCHOR])
    _read(system, state, x, point)
    update_peaks(system, state, x)
    close_audit(system, state, x, point)
    state.index[STANDSTILLS] = 0  # what a command sets off is no part of the cascade before it
    advance_forcing(system, state, x)
    state.index[VERSION] += 1  # of the forcing after the command
    state.clock[START], state.clock[START_RESIDUE] = time, 0.0  # or a sample now could lie before what follows at once
