"""What is kept of a trajectory beside its samples: events, and the peaks of monitored quantities."""

import math

from vibro_ros.solver.compilation import entry_kernel, kernel, sum_kernel
from vibro_ros.solver.polynomial import fill_form
from vibro_ros.solver.roots import maximum
from vibro_ros.solver.state import APPROACH, ENTRANCE, GUARD, HALF, MODE, NEXT, PEAK, SINCE, START, START_RESIDUE
from vibro_ros.solver.system import NOTHING

#: Kinds of recorded events: changes of mode have the system's own, from 0; then the end of monitor k, of ramp k,
#: and of a change of the phase's speed.
MONITOR_KIND = 100
RAMP_KIND = 200
PHASE_KIND = 300
#: Columns of an event: time [s], kind, approach, peak, duration [s].
EVENT_COLUMNS = 5

# A motion that has died away to less is told as zero: below 2e-308 doubles lose their digits.
_LEAST_VALUE = 1e-290


@sum_kernel
def form_value(row, point):
    """Value of a linear form at a point."""
    total = 0.0
    for channel in range(len(point)):
        total += row[channel] * point[channel]
    return total


@kernel
def update_peaks(system, state, x):
    """Take the flow of this segment, which ends at `x`, into the peaks of the monitors that are on."""
    mode = state.index[MODE]
    for k in range(len(state.monitor)):
        if system.monitored[mode, k]:
            quantity = state.work[0]
            fill_form(system.monitor[mode, k], system.monitor_terms[mode, k], state.z, quantity)
            peak = maximum(quantity, state.clock[ENTRANCE], x, state.work[1:])
            state.monitor[k, PEAK] = max(state.monitor[k, PEAK], peak)


@kernel
def instant(state, x):
    """Time [s] at `x` in the segment."""
    return state.clock[START] + (state.clock[START_RESIDUE] + state.clock[HALF] * (x + 1.0))


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
    """Record that a guard leads to `mode` at `point`, and switch the monitors; returns the number of events."""
    previous = state.index[MODE]
    time = instant(state, state.clock[NEXT])
    kind = system.event[previous, mode]
    if kind != NOTHING:
        count = record(events, count, time, kind, form_value(system.noted[kind], point), 0.0, 0.0)
    struck = system.strike[previous, state.index[GUARD]]
    if struck != NOTHING and not system.monitored[mode, struck]:
        approach = form_value(system.approach[struck], point)
        count = record(events, count, time, MONITOR_KIND + struck, approach, math.inf, 0.0)
    return switch_monitors(system, state, mode, time, point, events, count)


@kernel
def switch_monitors(system, state, mode, time, point, events, count):
    """Switch on the monitors that `mode`, entered at `time` [s], needs; record those that end. Returns the number
    of events."""
    previous = state.index[MODE]
    for k in range(len(state.monitor)):
        if system.monitored[previous, k] and not system.monitored[mode, k]:
            since = state.monitor[k, SINCE]
            # In the same instant, two segments' clocks may differ by the rounding of either.
            count = record(events, count, since, MONITOR_KIND + k, state.monitor[k, APPROACH],
                            state.monitor[k, PEAK], max(time - since, 0.0))
        elif system.monitored[mode, k] and not system.monitored[previous, k]:
            state.monitor[k, SINCE] = time
            state.monitor[k, APPROACH] = form_value(system.approach[k], point)
            state.monitor[k, PEAK] = 0.0
    return count


@entry_kernel
def evaluate_forms(forms, terms, modes, points, values):
    """Values of each mode's linear forms at sampled points.

    Parameters
    ----------
    forms : ndarray, shape (m, f, channels)
        The forms by mode.
    terms : ndarray of int, shape (m, f, channels)
        The forms' `system.terms`.
    modes, points : ndarray
        As `event_loop.advance` fills them; shapes (n,) and (n, channels).
    values : tuple of f ndarrays, shape (n,)
        Receive the values.
    """
    for f in range(len(values)):
        form, used, result = forms[:, f], terms[:, f], values[f]
        for k in range(len(modes)):
            mode = modes[k]
            total = 0.0
            for channel in used[mode]:
                if channel < 0:
                    break
                total += form[mode, channel] * points[k, channel]
            result[k] = total if abs(total) >= _LEAST_VALUE else 0.0
