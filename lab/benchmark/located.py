"""A run from event to event, for any integrator that can stop at a zero of a guard."""

import numpy as np

from benchmark.equations import AIR, STICK, start
from vibro_lab.accuracy.programs import Answer, UnableError, event_array

_MOST_EVENTS = 5000
_MOST_IN_AN_INSTANT = 50


def run(problem, callbacks, integrate):
    """Return the answer of a run by `integrate(t, y, end, brief)`, with the mode in `callbacks`.

    `integrate` is a generator of steps. Each step is the time reached, a function of time that interpolates the step,
    and the number of the guard that has become zero there, or None; after a step with a number the generator ends. The
    first step must be at most `brief` [s] long, because the guard of a flight is 0 at both ends of the flight, so that
    a longer step could pass over the whole flight.
    """
    y, t, times, rows = start(problem), 0.0, problem.times, [start(problem)]
    callbacks.begin(y)
    simultaneous, mode = 0, callbacks.mode[:3].copy()
    events = [(0.0, kind) for kind, is_closed in zip(("upper_contact", "inclined_contact"), mode[:2], strict=True)
              if is_closed]
    while len(rows) < len(times):
        segment_begin, which = t, None
        brief = 0.2 * y[7] / callbacks.numbers.g if y[6] == 0.0 < y[7] else np.inf
        for now, dense, guard in integrate(segment_begin, y, times[-1], brief):
            while len(rows) < len(times) and times[len(rows)] <= now:
                rows.append(dense(times[len(rows)]))
            t, y, which = now, np.array(dense(now)), guard
        if which is None:
            break
        callbacks.cross(t, y, which)
        (upper, inclined, ground), mode = mode, callbacks.mode[:3].copy()
        for kind, happened in (("upper_contact", mode[0] > upper), ("inclined_contact", mode[1] > inclined),
                               ("lift_off", mode[2] == AIR != ground), ("landing", ground == AIR and which == 2),
                               ("stick", mode[2] == STICK != ground)):
            if happened:
                events.append((t, kind))
        simultaneous = simultaneous + 1 if t - segment_begin < 1e-14 else 0
        if simultaneous > _MOST_IN_AN_INSTANT or len(events) > _MOST_EVENTS:
            raise UnableError(f"events without end at {t:.6g} s")
    return Answer(lambda: np.array(rows), lambda: event_array(events), callbacks.seconds)
