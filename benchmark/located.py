"""A run from event to event, for any integrator that can stop at a zero of a guard."""

import numpy as np

from benchmark.equations import AIR, STICK, begin, crossed, guards, slope, start
from vibro_ros.accuracy.programs import Answer, UnableError, event_array

_MOST_EVENTS = 5000
_MOST_IN_AN_INSTANT = 50


def run(problem, numbers, integrate):
    """An answer by `integrate(slope, guards, t, y, end, brief)`.

    That is a generator of steps: the time reached, a function of time that interpolates the step, and the number of
    the guard that has become zero there (None: none; after a number it ends). A first step of at most `brief` [s] does
    not pass over a flight, whose guard is 0 where it begins and where it ends.
    """
    y, t, times, rows = start(problem), 0.0, problem.times, [start(problem)]
    mode, crowd = begin(t, y, numbers), 0
    events = [(0.0, kind) for kind, closed in zip(("upper_contact", "inclined_contact"), mode[:2], strict=True)
              if closed]
    while len(rows) < len(times):
        upper, inclined, ground = mode
        slide = float(ground)

        def rate(at, state, upper=upper, inclined=inclined, ground=ground, slide=slide):
            out = np.empty(8)
            slope(at, state, upper, inclined, ground, slide, numbers, out)
            return out

        def bounds(at, state, upper=upper, inclined=inclined, ground=ground):
            out = np.empty(4)
            guards(at, state, upper, inclined, ground, numbers, out)
            return out

        before, which = t, None
        brief = 0.2 * y[7] / numbers.g if y[6] == 0.0 < y[7] else np.inf
        for now, dense, guard in integrate(rate, bounds, before, y, times[-1], brief):
            while len(rows) < len(times) and times[len(rows)] <= now:
                rows.append(dense(times[len(rows)]))
            t, y, which = now, np.array(dense(now)), guard
        if which is None:
            break
        new = crossed(t, y, upper, inclined, ground, which, numbers)
        for kind, happened in (("upper_contact", new[0] and not upper), ("inclined_contact", new[1] and not inclined),
                               ("lift_off", new[2] == AIR != ground), ("landing", ground == AIR and which == 2),
                               ("stick", new[2] == STICK != ground)):
            if happened:
                events.append((t, kind))
        mode, crowd = new, crowd + 1 if t - before < 1e-14 else 0
        if crowd > _MOST_IN_AN_INSTANT or len(events) > _MOST_EVENTS:
            raise UnableError(f"events without end at {t:.6g} s")
    return Answer(np.array(rows), event_array(events))
