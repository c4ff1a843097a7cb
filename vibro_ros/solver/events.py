"""Events: the mode that follows an event, the jump to it, and the record of the event.

An event is the end of a segment, or the root of a guard. `transition` chooses the next mode; `record_mode_change`
records the event, and switches the *monitors*, which find the peak of a quantity, such as a contact force, in some
modes.
"""

import math

from vibro_ros.solver.channels import first_acceleration
from vibro_ros.solver.guards import guard_value, maximum
from vibro_ros.solver.polynomial import fill_form
from vibro_ros.solver.segment import instant
from vibro_ros.solver.shock import outcomes, strike
from vibro_ros.solver.state import State
from vibro_ros.solver.system import NOTHING, System, form_value, sparse_magnitude, value_and_magnitude
from vibro_ros.solver.taylor import decays, evaluate
from vibro_ros.solver.typed import Row, Rows, entry, part

#: Outcomes of `transition`: no guard fires, and the mode goes on in the next segment; ...
SEGMENT_ENDS = 0
#: ... a guard fires, and the flow of the dynamic coordinates goes on; or a guard fires, and another flow starts.
FLOW_GOES_ON = 1
FLOW_ENDS = 2


@part
def _fill_magnitude(state: State, point: Row) -> None:
    """Fill the scratch with the magnitude of the terms that make up each channel at `point`."""
    for channel in range(len(point)):
        state.scratch.magnitude[channel] = abs(point[channel]) + state.magnitude[channel]


@part
def _holds(system: System, state: State, row: int, point: Row) -> bool:
    """Whether a guard row is not negative at `point`, to rounding."""
    total, noise = guard_value(system, row, point, state.scratch.magnitude)
    return total >= -noise


@part
def _accelerate(system: System, state: State, mode: int, point: Row) -> None:
    """Set the accelerations of the dynamic coordinates at `point` to those of `mode`, and all magnitudes."""
    first, magnitude = first_acceleration(system.counts[0]), state.scratch.magnitude
    if system.counts[0].rotors > 0 or decays(system, mode):
        evaluate(system, state, mode, point)
        _fill_magnitude(state, point)
        if decays(system, mode):  # the term reads the accelerations that it changes
            factor, terms = system.decay.factor[mode], system.decay.terms[mode]
            magnitude[len(point) - 2] += sparse_magnitude(factor, terms, magnitude)
            for i in range(system.counts[0].dynamic - 2 * system.counts[0].rotors):
                magnitude[first + i] = sparse_magnitude(system.equations[mode, i], system.reads_all[mode, i], magnitude)
        return
    _fill_magnitude(state, point)
    for i in range(system.counts[0].dynamic):
        point[first + i], magnitude[first + i] = value_and_magnitude(
            system.equations[mode, i], system.reads_all[mode, i], point, magnitude)


@part
def jump(system: System, state: State, candidate: int, point: Row, after: Row) -> int:
    """Fill `after` with the channels after the jump from `point` to a candidate of the firing guard.

    Return the candidate, or the one of the same shock that the shock chooses.
    """
    mode, guard = state.automaton.mode, state.automaton.guard
    if len(system.shock.numbers) > 0 and system.shock.candidate[mode, guard, candidate] != NOTHING:
        return candidate + strike(system, state, system.shock.candidate[mode, guard, candidate], point, after)
    for channel in range(len(point)):
        after[channel] = point[channel]
    matrix = system.guards.jump[mode, guard, candidate]
    if matrix != NOTHING:
        for channel in range(2 * system.counts[0].coordinates):
            after[channel] = form_value(system.guards.jump_matrix[matrix, channel], point)
    return candidate


@part
def _valid_candidate(system: System, state: State, candidate: int, point: Row, after: Row) -> int:
    """Return the candidate to which `jump` leads if that may be entered from `point`, else `NOTHING`; fill `after`, as
    `jump` does."""
    mode, guard = state.automaton.mode, state.automaton.guard
    _fill_magnitude(state, point)
    for row in system.guards.entry[mode, guard, candidate]:
        if row != NOTHING and not _holds(system, state, row, point):
            return NOTHING
    entered = jump(system, state, candidate, point, after)
    target = system.guards.candidate[mode, guard, entered]
    _accelerate(system, state, target, after)
    for g in range(system.guards.row.shape[1]):
        if system.guards.effect[target, g] == system.guards.effect[mode, guard]:
            if not _holds(system, state, system.guards.row[target, g], after):
                return NOTHING
    return entered


@part
def choose_candidate(system: System, state: State, point: Row, after: Row) -> int:
    """Return the number of the firing guard's first valid candidate, else of its last; fill `after`, as `jump` does."""
    mode, guard = state.automaton.mode, state.automaton.guard
    candidates = system.guards.candidate[mode, guard]
    last = 0
    while True:
        following = last + outcomes(system, mode, guard, last)
        if following >= len(candidates) or candidates[following] == NOTHING:
            return jump(system, state, last, point, after)
        entered = _valid_candidate(system, state, last, point, after)
        if entered != NOTHING:
            return entered
        last = following


@part
def _keeps_flow(system: System, state: State, mode: int, point: Row, after: Row) -> bool:
    """Whether `mode`, entered at `after`, has the same flow, and the same dynamic coordinates as at `point`."""
    if system.flow[state.automaton.mode] != system.flow[mode]:
        return False
    coordinates = system.counts[0].coordinates
    for i in range(system.counts[0].dynamic):
        if after[i] != point[i] or after[coordinates + i] != point[coordinates + i]:
            return False
    return True


@part
def transition(system: System, state: State, point: Row, after: Row) -> tuple[int, int]:
    """Decide how the next event, at which all channels have the values of `point`, changes mode and flow.

    Returns
    -------
    (int, int)
        `SEGMENT_ENDS`, `FLOW_GOES_ON` or `FLOW_ENDS`, and the mode that follows. If a guard fires, `after` receives
        the channels that the mode starts with.
    """
    mode, guard = state.automaton.mode, state.automaton.guard
    if guard == NOTHING:
        return SEGMENT_ENDS, mode
    if system.guards.candidate[mode, guard, 0] == NOTHING:  # the caller goes on with another system
        for channel in range(len(point)):
            after[channel] = point[channel]
        return FLOW_ENDS, mode
    target = system.guards.candidate[mode, guard, choose_candidate(system, state, point, after)]
    if target == mode and system.guards.event[mode, guard] != NOTHING:  # a shock, perhaps of driven coordinates alone
        return FLOW_ENDS, target
    if state.segment.next_event < 1.0 and _keeps_flow(system, state, target, point, after):
        return FLOW_GOES_ON, target
    return FLOW_ENDS, target


@part
def _enter_after_ramp(system: System, state: State, ramp: int, point: Row, events: Rows, count: int) -> int:
    """At the segment's start, enter the mode that follows when the rate of a ramp changes; return the number of
    events."""
    mode = system.mode_after_ramp_change[state.automaton.mode, ramp]
    count = switch_monitors(system, state, mode, instant(state, -1.0), point, events, count)
    state.automaton.mode = mode
    return count


@entry
def leave_for_ramp(system: System, state: State, ramp: int, point: Row, events: Rows, count: int) -> int:
    """Enter the mode that follows a command to a ramp: `_enter_after_ramp` as an entry for Python."""
    return _enter_after_ramp(system, state, ramp, point, events, count)


@part
def record_reached(system: System, state: State, reached: int, point: Row, events: Rows, count: int) -> int:
    """Record at the segment's start the targets that `segment.advance_forcing` has `reached`; return the number of
    events."""
    time = instant(state, -1.0)
    for k in range(len(state.ramp)):
        if reached & (1 << k):
            count = record(events, count, time, RAMP_KIND + k, 0.0, 0.0, 0.0)
            count = _enter_after_ramp(system, state, k, point, events, count)
    if reached & (1 << len(state.ramp)):
        count = record(events, count, time, PHASE_KIND, 0.0, 0.0, 0.0)
    return count


#: Kinds of recorded events. Changes of mode have the kinds of the system, from 0; these constants, plus k, are the end
#: of monitor k and of ramp k, and the end of a change of the phase's speed.
MONITOR_KIND = 100
RAMP_KIND = 200
PHASE_KIND = 300
#: Columns of an event: time [s], kind, approach, peak, duration [s].
EVENT_COLUMNS = 5


@part
def update_peaks(system: System, state: State, x: float) -> None:
    """Update the peaks of the monitors that are on with this segment's flow up to its end at the local time `x`."""
    mode, quantity = state.automaton.mode, state.scratch.peak
    for k in range(len(state.monitor)):
        if system.monitors.active[mode, k]:
            fill_form(system.monitors.quantity[mode, k], system.monitors.terms[mode, k], state.z, quantity)
            state.monitor[k].peak = maximum(quantity, -1.0, x, state.monitor[k].peak, state.scratch.peak_search)


@part
def record(events: Rows, count: int, time: float, kind: float, approach: float, peak: float, duration: float) -> int:
    """Append an event; return the new number of events."""
    events[count, 0] = time
    events[count, 1] = kind
    events[count, 2] = approach
    events[count, 3] = peak
    events[count, 4] = duration
    return count + 1


@part
def record_mode_change(system: System, state: State, mode: int, point: Row, events: Rows, count: int) -> int:
    """Record that the next event, at `point`, leads to `mode`, and switch the monitors; return the number of
    events."""
    previous = state.automaton.mode
    time = instant(state, state.segment.next_event)
    kind = system.events.kind[previous, mode]
    if kind == NOTHING:
        kind = system.guards.event[previous, state.automaton.guard]
    if kind != NOTHING:
        count = record(events, count, time, kind, form_value(system.events.quantity[kind], point), 0.0, 0.0)
    struck = system.guards.blow_monitor[previous, state.automaton.guard]
    if struck != NOTHING and not system.monitors.active[mode, struck]:
        approach = form_value(system.monitors.approach[struck], point)
        count = record(events, count, time, MONITOR_KIND + struck, approach, math.inf, 0.0)
    return switch_monitors(system, state, mode, time, point, events, count)


@part
def switch_monitors(system: System, state: State, mode: int, time: float, point: Row, events: Rows, count: int) -> int:
    """Switch on the monitors that `mode`, entered at `time` [s], needs; record those that end. Return the number of
    events."""
    previous = state.automaton.mode
    for k in range(len(state.monitor)):
        monitor = state.monitor[k]
        if system.monitors.active[previous, k] and not system.monitors.active[mode, k]:
            # At one instant, the clocks of two segments may differ by rounding.
            duration = max(time - monitor.since, 0.0)
            count = record(events, count, monitor.since, MONITOR_KIND + k, monitor.approach, monitor.peak, duration)
        elif system.monitors.active[mode, k] and not system.monitors.active[previous, k]:
            monitor.since = time
            monitor.approach = form_value(system.monitors.approach[k], point)
            monitor.peak = 0.0
    return count
