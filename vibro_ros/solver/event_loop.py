"""The event loop: segment after segment, stopping at every event, sampled at the requested instants.

Segments depend on the system, its state and its commands alone, never on the instants at which they are sampled.
So the trajectory is the same, bit for bit, however the time is divided into calls.

Read this module from `advance` upwards. For an impact:

1. `_begin_mode` solves the segment and asks `guards.find_next_event` for the first root of a guard, `next_event`.
2. `advance` samples the polynomials up to `next_event`. For a sample at or after it, `_pass_event` passes the event.
3. `_pass_event` reads all channels there, books the work of the flow, and lets `events.transition` choose the next mode
   and the jump to it. `events.record_mode_change` records the event.
4. `advance` begins the new mode: back to 1. The same flow goes on if the event does not affect dynamic coordinates.
"""

import math

import numpy as np

from vibro_ros.solver.channels import first_ramp
from vibro_ros.solver.energy import book_jump, book_work
from vibro_ros.solver.events import (
    EVENT_COLUMNS,
    FLOW_GOES_ON,
    SEGMENT_ENDS,
    record_mode_change,
    record_reached,
    transition,
    update_peaks,
)
from vibro_ros.solver.flow import hold_dynamic, solve_driven, solve_dynamic
from vibro_ros.solver.guards import find_next_event
from vibro_ros.solver.layout import Laid
from vibro_ros.solver.lowpass import end_mode, filter_up_to
from vibro_ros.solver.polynomial import value
from vibro_ros.solver.rest import is_at_rest, lengthen_segment
from vibro_ros.solver.rotor import read_phase
from vibro_ros.solver.segment import advance_forcing, choose_segment, fill_forcing, local_time, phase_at
from vibro_ros.solver.state import UNKNOWN, State
from vibro_ros.solver.system import NOTHING, System
from vibro_ros.solver.taylor import end_where_term_returns, is_linear, solve_by_taylor
from vibro_ros.solver.typed import Indices, Row, Rows, entry, part

#: Values of `AUTOMATON.begins`: nothing begins; a mode begins while the flow goes on; a flow begins, with a mode.
UNDER_WAY = 0
MODE_BEGINS = 1
FLOW_BEGINS = 2

# Reasons why `advance` returns.
REACHED = 0
EVENTS_FULL = 1
STUCK = 2
DIVERGED = 3
ROOT_LOST = 4
SYSTEM_ENDS = 5

#: Events in a row at one instant after which the loop gives up; a legal cascade takes a handful.
_MOST_EVENTS_WITHOUT_PROGRESS = 200

_NO_TIMES, _NO_EVENTS = np.empty(0), np.empty((0, EVENT_COLUMNS))
_NO_SAMPLES = np.empty((0, 0)), np.empty(0, dtype=np.int64), np.empty((0, 3))


@part
def _solve_up_to_driven(system: System, state: State, point: Row) -> None:
    """Set up a segment with the series of everything except the driven coordinates."""
    if not is_linear(system, state.automaton.mode, point):
        solve_by_taylor(system, state, point)
        return
    if system.counts[0].decays > 0:  # the mode has no decaying term, or the term has faded
        state.z[len(state.z) - 2, :] = 0.0
    # As long as forcing and the flow's series allow; the longest, if the dynamic coordinates are at rest.
    choose_segment(system, state)
    fill_forcing(system, state)
    held = state.scratch.after
    if is_at_rest(system, state, point, held):
        lengthen_segment(state)
        hold_dynamic(system, state, held)
    else:
        solve_dynamic(system, state, point)


@part
def _begin_mode(system: System, state: State, point: Row, same_flow: bool) -> bool:
    """Begin the present mode at `point`, within the present segment if its flow goes on; False if a root search
    failed."""
    for channel in range(len(state.mode_point)):
        state.mode_point[channel] = point[channel]
    # Dynamic coordinates are solved first, unless their flow goes on; then the driven ones, which depend on them.
    if not same_flow:
        _solve_up_to_driven(system, state, point)
        state.accounts.booked = -1.0
        state.automaton.segments += 1
    solve_driven(system, state, point)
    # A known root remains valid if no coordinate that its guard reads has been solved again.
    for row in range(len(state.root)):
        if system.guards.driven[row] or not same_flow:
            state.root[row] = UNKNOWN
    if not find_next_event(system, state):
        return False
    end_where_term_returns(system, state)
    return True


@part
def _read(system: System, state: State, x: float, point: Row) -> None:
    """Read the first len(point) channels at the local time `x`; at the mode's start, with the bits it started with."""
    ramps = first_ramp(system.counts[0])
    end = ramps + 2 * system.counts[0].ramps
    for channel in range(len(point)):
        if ramps <= channel < end:  # ramps and their rates are straight lines
            point[channel] = state.z[channel, 0] + state.z[channel, 1] * x
        else:
            point[channel] = value(state.z[channel], x)
    if x == state.segment.mode_start:
        for channel in range(len(state.mode_point)):
            point[channel] = state.mode_point[channel]


@part
def _read_phase(system: System, state: State, x: float, point: Row, phase: Row) -> None:
    """Read turns, phase past the start of the turn and its rate into `phase`, at the local time `x` of `point`."""
    phase[0] = state.drive.turns
    if system.counts[0].rotors > 0:
        phase[1], phase[2] = read_phase(system, point)
    else:
        phase[1], phase[2] = phase_at(system, state, x)


@part
def _pass_event(system: System, state: State, point: Row, events: Rows, count: int) -> tuple[int, int]:
    """Pass the next event, the segment's end or a change of mode; return which begins (`AUTOMATON.begins`), and the
    number of events.

    Each kernel is called from one line only, because kernels are inlined and two copies would fill the cache.
    """
    segment, automaton, after = state.segment, state.automaton, state.scratch.after
    x = segment.next_event
    fires: bool = automaton.guard != NOTHING
    # Read the channels. At a segment's end the next segment needs only the positions and velocities.
    _read(system, state, x, point if fires else point[:2 * system.counts[0].coordinates])
    book_work(system, state, x, state.accounts)
    end_mode(system, state, x)
    # Choose the next mode; `after` receives the channels after the jump to it.
    outcome, mode = transition(system, state, point, after)
    stands: bool = fires and x == segment.mode_start
    automaton.events_without_progress = automaton.events_without_progress + 1 if stands else 0
    # Record what ends: peaks of the flow, the event itself, and the energy that a jump changes.
    if outcome != FLOW_GOES_ON:
        update_peaks(system, state, x)
    if outcome != SEGMENT_ENDS:
        count = record_mode_change(system, state, mode, point, events, count)
    if outcome != SEGMENT_ENDS:
        book_jump(system, state, mode, point, after)
        for channel in range(len(point)):
            point[channel] = after[channel]
        automaton.mode = mode
    # Begin another mode in the same segment, or a flow, in a segment that starts here.
    if outcome == FLOW_GOES_ON:
        segment.mode_start = x
        return MODE_BEGINS, count
    reached = advance_forcing(system, state, x)
    return FLOW_BEGINS, record_reached(system, state, reached, point, events, count) if reached else count


@part
def is_finite(point: Row) -> bool:
    """Whether every channel is a finite number."""
    total = 0.0
    for channel in range(len(point)):
        total += point[channel]
    return math.isfinite(total)


@entry
def advance(system: System, state: State, times: Row, point: Row, points: Rows, modes: Indices, phases: Rows,
            events: Rows) -> tuple[int, int, int]:
    """Pass all events up to the last of `times` and sample there.

    Parameters
    ----------
    system : System, as a `Laid.layout`
        The system.
    state : State, as a `Laid.layout`
        Changed in place.
    times : ndarray, shape (n,)
        Instants [s], ascending, none before the last command.
    point : ndarray, shape (channels,)
        Positions and velocities at which a segment begins, if one is due; overwritten.
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
        Reason for the return, number of samples taken, number of events recorded.
    """
    count, k = 0, 0
    segment, automaton = state.segment, state.automaton
    # Most records of one event: a change of mode, a blow, every monitor, every ramp and its release, and the speed.
    room = len(events) - 3 - len(state.monitor) - 2 * len(state.ramp)
    while True:
        # Begin the mode or flow that the last event, or a command, requires. Only here can a run fail.
        if automaton.begins != UNDER_WAY:
            if not _begin_mode(system, state, point, automaton.begins == MODE_BEGINS):
                return ROOT_LOST, k, count
            automaton.begins = UNDER_WAY
            if automaton.events_without_progress > _MOST_EVENTS_WITHOUT_PROGRESS:
                return STUCK, k, count
            if not is_finite(point):
                return DIVERGED, k, count
        if k == len(times):
            return REACHED, k, count
        # Events come first, even at the instant of a sample; no event is passed before a sample needs it.
        if local_time(state, times[k]) >= segment.next_event:
            if count > room:
                return EVENTS_FULL, k, count
            guard = automaton.guard
            ends: bool = guard != NOTHING and system.guards.candidate[automaton.mode, guard, 0] == NOTHING
            automaton.begins, count = _pass_event(system, state, point, events, count)
            if ends:  # the caller goes on from `point` with another system
                return SYSTEM_ENDS, k, count
        else:
            x = max(local_time(state, times[k]), segment.mode_start)
            _read(system, state, x, points[k])
            modes[k] = automaton.mode
            _read_phase(system, state, x, points[k], phases[k])
            k += 1


def begin_segment(system: Laid, state: Laid, point: np.ndarray) -> int:
    """Solve the segment that starts with the positions and velocities of `point`.

    Parameters
    ----------
    system : Laid of System
        The system.
    state : Laid of State
        Changed in place.
    point : ndarray, shape (channels,)
        Positions and velocities now; overwritten.

    Returns
    -------
    int
        `REACHED`, or the reason why the segment cannot begin.
    """
    state.values.now["automaton"]["begins"] = FLOW_BEGINS
    return advance(system.layout, state.layout, _NO_TIMES, point, *_NO_SAMPLES, _NO_EVENTS)[0]


@entry
def interrupt(system: System, state: State, time: float, point: Row) -> None:
    """Move clock and forcing to `time`, within the present segment, and read all channels there into `point`.

    A command calls this first, then sets the new rates, calls `events.leave_for_ramp` for every ramp whose rate
    changes, and `begin_segment` with `point`.
    """
    segment = state.segment
    x = max(local_time(state, time), segment.mode_start)
    _read(system, state, x, point)
    update_peaks(system, state, x)
    book_work(system, state, x, state.accounts)
    end_mode(system, state, x)
    state.automaton.events_without_progress = 0  # events after a command are not part of the cascade before it
    advance_forcing(system, state, x)
    segment.start, segment.residue = time, 0.0  # else rounding could put a sample now before the segment


@entry
def filter_rates(system: System, state: State, time: float) -> None:
    """Advance the filters of `State.lowpass` to `time`; `advance` must have passed all events up to there."""
    filter_up_to(system, state, max(local_time(state, time), state.segment.mode_start))
