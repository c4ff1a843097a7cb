"""What is recorded of a trajectory beside its samples: events, and the peaks of monitored quantities."""

import math

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.linear_forms import form_value
from vibro_ros.solver.polynomial import fill_form
from vibro_ros.solver.roots import maximum
from vibro_ros.solver.segment import instant
from vibro_ros.solver.system import NOTHING

#: Kinds of recorded events: changes of mode have the system's own, from 0; then the end of monitor k, of ramp k,
#: and of a change of the phase's speed.
MONITOR_KIND = 100
RAMP_KIND = 200
PHASE_KIND = 300
#: Columns of an event: time [s], kind, approach, peak, duration [s].
EVENT_COLUMNS = 5


@kernel
def update_peaks(system, state, x):
    """Raise the peaks of the monitors that are on by the flow of this segment, which ends at the local time `x`."""
    mode, room = state.now[0].automaton.mode, state.scratch.room[0]
    for k in range(len(state.monitor)):
        if system.monitored[mode, k]:
            quantity = room.peak[:]
            fill_form(system.monitor[mode, k], system.monitor_terms[mode, k], state.z, quantity)
            peak = maximum(quantity, state.now[0].segment.flow_start, x, room.peak_search[:])
            state.monitor[k].peak = max(state.monitor[k].peak, peak)


@kernel
def record(events, count, time, kind, approach, peak, duration):
    """Append an event; returns the new number of events."""
    events[count, 0] = time
    events[count, 1] = kind
    events[count, 2] = approach
    events[count, 3] = peak
    events[count, 4] = duration
    return count + 1


@kernel
def record_mode_change(system, state, mode, point, events, count):
    """Record that the next event, at `point`, leads to `mode`, and switch the monitors; returns the number of
    events."""
    previous = state.now[0].automaton.mode
    time = instant(state, state.now[0].segment.next_event)
    kind = system.event_kind[previous, mode]
    if kind != NOTHING:
        count = record(events, count, time, kind, form_value(system.event_quantity[kind], point), 0.0, 0.0)
    struck = system.blow_monitor[previous, state.now[0].automaton.guard]
    if struck != NOTHING and not system.monitored[mode, struck]:
        approach = form_value(system.approach[struck], point)
        count = record(events, count, time, MONITOR_KIND + struck, approach, math.inf, 0.0)
    return switch_monitors(system, state, mode, time, point, events, count)


@kernel
def switch_monitors(system, state, mode, time, point, events, count):
    """Switch on the monitors that `mode`, entered at `time` [s], needs; record those that end. Returns the number
    of events."""
    previous = state.now[0].automaton.mode
    for k in range(len(state.monitor)):
        monitor = state.monitor[k]
        if system.monitored[previous, k] and not system.monitored[mode, k]:
            # In the same instant, the clocks of two segments may differ by the rounding of either.
            duration = max(time - monitor.since, 0.0)
            count = record(events, count, monitor.since, MONITOR_KIND + k, monitor.approach, monitor.peak, duration)
        elif system.monitored[mode, k] and not system.monitored[previous, k]:
            monitor.since = time
            monitor.approach = form_value(system.approach[k], point)
            monitor.peak = 0.0
    return count
